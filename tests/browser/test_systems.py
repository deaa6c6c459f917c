"""Coming in, the list of systems, studies, revisions."""

from __future__ import annotations

import gzip
import json
import re

import pytest
from playwright.sync_api import Page, expect

from tests.browser.driving import KEY, PAGES, faults

SYSTEM = {
    "name": "a lag of its own",
    "blocks": {"u": {"kind": "input"}, "lag": {"kind": "transfer_function", "numerator": [1], "denominator": [0.5, 1]}},
    "connections": [{"from": "u", "to": "lag"}],
    "outputs": {"y": "lag"},
}


def test_a_wrong_key_is_told_and_a_right_one_opens(browser, service) -> None:
    context = browser.new_context(base_url=service.url, locale="en-GB")
    page = context.new_page()
    page.goto("/systems?q=x")
    page.get_by_test_id("key").fill("a-key-that-opens-nothing")
    page.get_by_role("button", name="Sign in").click()
    expect(page.get_by_text("the key must be a valid one")).to_be_visible()
    page.get_by_test_id("key").fill(KEY)
    page.get_by_role("button", name="Sign in").click()
    expect(page.get_by_role("heading", name="Systems", exact=True)).to_be_visible()
    assert page.url.endswith("/systems?q=x")
    # No script can read what keeps this browser in.
    assert "servotune" not in page.evaluate(
        "document.cookie + Object.keys(localStorage).filter(k => /key|token/.test(k))"
    )
    page.get_by_role("button", name="bootstrap").click()
    page.get_by_role("menuitem", name="Sign out").click()
    expect(page.get_by_test_id("key")).to_be_visible()
    context.close()


def test_a_system_comes_in_goes_out_is_copied_found_and_deleted(page: Page, tmp_path) -> None:
    file = tmp_path / "lag.json"
    file.write_text(json.dumps(SYSTEM))
    page.goto("/systems")
    page.locator("input[type=file]").set_input_files(file)
    expect(page).to_have_url(re.compile(r"/systems/sys_\w+/diagram"))
    page.goto("/systems?q=lag of its")
    more = page.get_by_role("button", name="What to do with a lag of its own")
    more.click()
    with page.expect_download() as download:
        page.get_by_role("menuitem", name="Export JSON").click()
    assert json.loads(download.value.path().read_text()) == SYSTEM
    more.click()
    page.get_by_role("menuitem", name="Duplicate").click()
    copy = page.get_by_role("link", name="Copy of a lag of its own")
    expect(copy).to_be_visible()
    expect(page.get_by_role("menu")).to_have_count(0)
    page.get_by_role("button", name="What to do with Copy of a lag").click()
    page.get_by_role("menuitem", name="Delete").click()
    expect(copy).to_have_count(0)


def test_letters_that_follow_at_once_are_all_searched_for(page: Page, client) -> None:
    client.post("/v1/systems", json={"name": "typed", "blocks": {"u": {"kind": "input"}}, "outputs": {"y": "u"}})
    page.goto("/systems")
    search = page.get_by_label("Search")
    search.focus()
    # No task of the page comes between two letters, as where it has no time to draw between them.
    page.evaluate("""async () => {
      for (const letter of 'typed') {
        document.execCommand('insertText', false, letter);
        await null;
      }
    }""")
    expect(search).to_have_value("typed")
    expect(page).to_have_url(re.compile(r"q=typed$"))


def test_a_file_that_is_no_system_is_refused_in_words(page: Page, tmp_path) -> None:
    file = tmp_path / "wrong.json"
    file.write_text('{"blocks": {"u": {"kind": "inpt"}}, "outputs": {"y": "u"}}')
    page.goto("/systems")
    page.locator("input[type=file]").set_input_files(file)
    expect(page.get_by_role("alert")).to_contain_text("kind must be one of")


def test_revisions_differ_readably_and_come_back(page: Page, client) -> None:
    made = client.post("/v1/systems", json=SYSTEM).json()
    changed = json.loads(json.dumps(SYSTEM))
    changed["blocks"]["lag"]["denominator"] = [0.25, 1]
    client.put(f"/v1/systems/{made['id']}", json=changed, headers={"If-Match": '"1"'})
    page.goto(f"/systems/{made['id']}/revisions")
    row = page.get_by_test_id("difference").get_by_role("row").nth(1)
    expect(row).to_contain_text("blocks.lag.denominator")
    expect(row).to_contain_text("[0.5,1]")
    page.get_by_role("button", name="Restore revision 1").click()
    expect(page.get_by_text("revision 3", exact=True)).to_be_visible()
    assert client.get(f"/v1/systems/{made['id']}").json()["document"] == SYSTEM


def test_every_study_is_a_system(client) -> None:
    listed = json.loads((PAGES.parents[1] / "web/src/features/systems/templates.json").read_text())
    for template in listed:
        if "document" in template:
            reply = client.post("/v1/systems", json=template["document"])
            assert reply.status_code == 201, (template["id"], reply.text)


def test_the_first_load_is_small() -> None:
    manifest = json.loads((PAGES / ".vite" / "manifest.json").read_text())
    entry = next(name for name, chunk in manifest.items() if chunk.get("isEntry"))
    files: set[str] = set()

    def collect(name: str) -> None:
        chunk = manifest[name]
        if chunk["file"] not in files:
            files.add(chunk["file"])
            for inner in chunk.get("imports", []):
                collect(inner)

    collect(entry)
    size = sum(len(gzip.compress((PAGES / file).read_bytes())) for file in files)
    assert size <= 350_000


@pytest.mark.parametrize("language", ["ro-RO"])
def test_the_page_speaks_the_language_of_the_browser(browser, service, language) -> None:
    context = browser.new_context(base_url=service.url, locale=language)
    page = context.new_page()
    page.goto("/")
    expect(page.get_by_role("button", name="Intră")).to_be_visible()
    expect(page.locator("html")).to_have_attribute("lang", "ro")
    context.close()


def test_a_first_visit_is_led_through_three_steps_by_keyboard_and_never_again(page: Page) -> None:
    page.goto("/systems")
    page.evaluate("localStorage.removeItem('servotune-tour')")
    page.reload()
    page.get_by_test_id("tour-offer").get_by_role("button", name="Begin").focus()
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", name="Linear hydraulic motor")).to_have_count(0)
    expect(page.get_by_role("heading", name="Step 2 of 3")).to_be_focused()
    page.locator("[data-testid=plots][data-frame]").wait_for()
    assert faults(page) == []
    page.get_by_role("slider", name="motor.leakage", exact=True).focus()
    page.keyboard.press("ArrowRight")
    tour = page.get_by_test_id("tour")
    expect(tour.get_by_role("status")).to_contain_text("Moved")
    tour.get_by_role("button", name="Next").focus()
    page.keyboard.press("Enter")
    page.wait_for_url("**/optimise")
    expect(page.get_by_role("heading", name="Step 3 of 3")).to_be_focused()
    expect(page.get_by_role("button", name="Start")).to_be_visible()
    page.goto("/about")
    tour.get_by_role("link", name="Back to the step").click()
    page.wait_for_url("**/optimise")
    tour.get_by_role("button", name="Finish").click()
    expect(tour).to_have_count(0)
    page.goto("/systems")
    expect(page.locator("#templates")).to_be_visible()
    expect(page.get_by_test_id("tour-offer")).to_have_count(0)
