"""Every page is sound, and its form tells what the service finds wrong at the field; no page is left out; what is wrong is found."""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import quote

import httpx
from playwright.sync_api import Browser, Page

from tests.browser.driving import ROOT, Running
from tests.browser.places import Mistake, Places, of_models, of_the_laboratory
from tests.browser.soundness import Scheme, other, quiet, unsound, untold

#: Room is made above what has been painted.
_JUMP = """() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => {
  document.getElementById('room').style.height = '500px';
  setTimeout(done, 100);
})))"""
_ROUTES = ROOT / "web" / "src" / "app" / "routes.tsx"


def _walked(page: Page, places: Places) -> dict[str, list[str]]:
    """Return page -> what is wrong there."""
    wrong = {}
    scheme: Scheme = "light"
    for name in places.listed:
        place = places.wait(name)
        with quiet(page) as told:
            page.goto(place.address)
            page.locator(place.there).first.wait_for()
            # The theme that is there comes first: it is changed once a page.
            found = unsound(page, scheme)
            scheme = other(scheme)
        found += told
        for mistake in place.mistakes:
            found += untold(page, mistake)
        if found:
            wrong[name] = found
    return wrong


def test_pages_of_models_are_sound(page: Page, client: httpx.Client) -> None:
    assert _walked(page, of_models(client)) == {}


def test_pages_of_the_laboratory_are_sound(page: Page, client: httpx.Client, tmp_path: Path) -> None:
    assert _walked(page, of_the_laboratory(client, page.context, tmp_path)) == {}


def test_the_way_in_is_sound(browser: Browser, service: Running) -> None:
    window = {"width": 1280, "height": 800}
    context = browser.new_context(base_url=service.url, viewport=window, reduced_motion="reduce")  # type: ignore[arg-type] # a ViewportSize
    page = context.new_page()
    # Whether somebody has signed in is asked first, and the answer is no.
    with quiet(page, but="/v1/session") as told:
        page.goto("/jobs")
        page.get_by_test_id("key").wait_for()
        assert unsound(page, "light") == []
    assert told == []
    assert untold(page, Mistake(fill={"Key": "not a key"}, press=("Sign in",), at="Key", said="key")) == []
    context.close()


def test_no_page_is_left_out() -> None:
    """Every route of the client is among the pages that are walked through."""
    listed = (ROOT / "tests" / "browser" / "places.py").read_text(encoding="utf-8")
    addresses = [re.sub(r"\{\w+\}", ":id", found) for found in re.findall(r'f?"(/[^"?]*)', listed)]
    routes = re.findall(r'path: "([^"*]+)"', _ROUTES.read_text(encoding="utf-8"))
    views = {"panel", "diagram", "influence", "optimise", "revisions"}
    wanted = {f"/systems/:id/{one}" if one in views else f"/{one}" for one in routes} - {"/systems/:id"}
    # The address of an import comes from the page that sends the file.
    assert wanted - set(addresses) == {"/datasets/:id/import"}
    assert re.search(r'of\.add\(\s*"import",\s*described', listed)


def test_what_is_wrong_is_found(page: Page) -> None:
    page.set_viewport_size({"width": 1024, "height": 768})
    wrong = """<!doctype html><html lang="en"><title>wrong</title><style>
      body { background: #fff; margin: 0 }
      @media (prefers-color-scheme: dark) { body { background: #222 } }
      p { color: #333; height: 400px } button:focus { outline: none }
      #away { position: fixed; left: -500px }
    </style><div id="room"></div><p>text that is dark on dark</p>
    <button>no outline</button><a id="away" href="#x">out of sight</a><div style="width: 900px">wide</div>
    <div inert><button id="never">never reached</button></div>
    <label>Mass <input aria-invalid="true" /></label><button>Send</button><span>must be a mass</span></html>"""
    page.goto(f"data:text/html,{quote(wrong)}")
    page.evaluate(_JUMP)
    told = "\n".join(unsound(page, "light", patience=500))
    assert "dark, color-contrast" in told
    assert "light, color-contrast" not in told
    assert "what is there jumps by" in told
    assert "does not show that it has the focus: <button>no outline" in told
    assert 'does not show that it has the focus: <a id="away"' in told
    assert 'not reached by keyboard: <button id="never"' in told
    assert "wider than a window of 820 x 1180" in told
    assert "1024 x 768" not in told
    mistake = Mistake(fill={"Mass": "3 m"}, press=("Send",), at="Mass", said="must be a mass")
    assert "not told at its field: Mass" in "".join(untold(page, mistake, patience=100))
    with quiet(page) as complaints:
        page.evaluate("console.error('something failed')")
    assert complaints == ["console: something failed"]
