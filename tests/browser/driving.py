"""A Chromium, a service with a worker, and somebody who has signed in: for the tests and for the screenshots."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
from playwright.sync_api import Browser, BrowserContext, Error, Page, Playwright

ROOT = Path(__file__).parents[2]
KEY = "a-key-for-the-browser-tests"
PAGES = ROOT / "api" / "static"
#: The distribution's browser: nothing is downloaded.
CHROMIUM = os.environ.get("SERVOTUNE_TEST_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
_ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"]
#: Seconds until the service must answer: beside other tests it waits for its processor.
_PATIENCE = 240
_AXE = ROOT / "web" / "node_modules" / "axe-core" / "axe.min.js"
_WCAG = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"]
#: Rules of axe that look at colours: the others see the same page in both themes.
_OF_COLOURS = ["color-contrast", "link-in-text-block"]


@dataclass
class Running:
    """A service in a process of its own, which can be stopped and started again at the same address."""

    folder: Path
    port: int
    process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def client(self) -> httpx.Client:
        return httpx.Client(base_url=self.url, headers={"Authorization": f"Bearer {KEY}"}, timeout=60, trust_env=False)

    def start(self) -> None:
        code = f"import sys; from api.commands import serve; sys.exit(serve(['--port', '{self.port}']))"
        environment = {
            **os.environ,
            "SERVOTUNE_DATABASE_URL": f"sqlite:///{self.folder / 'service.db'}",
            "SERVOTUNE_BOOTSTRAP_KEY": KEY,
            "PYTHONPATH": str(ROOT),
        }
        with (self.folder / "service.log").open("ab") as log:
            self.process = subprocess.Popen([sys.executable, "-c", code], env=environment, stdout=log, stderr=log)
        deadline = time.monotonic() + _PATIENCE
        with self.client() as client:
            while time.monotonic() < deadline:
                try:
                    if client.get("/readyz").status_code == 200:
                        return
                except httpx.TransportError:
                    assert self.process.poll() is None, (self.folder / "service.log").read_text()
                time.sleep(0.1)
        raise AssertionError(f"the service was not ready within {_PATIENCE} s")

    def stop(self) -> None:
        assert self.process is not None
        self.process.terminate()
        self.process.wait(timeout=_PATIENCE)


@contextmanager
def running(folder: Path) -> Iterator[Running]:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    service = Running(folder=folder, port=port)
    try:
        service.start()
        yield service
    finally:
        service.stop()


def launched(playwright: Playwright) -> Browser:
    assert CHROMIUM is not None, "chromium must be installed (Debian: apt-get install chromium), got none"
    return playwright.chromium.launch(executable_path=CHROMIUM, args=_ARGUMENTS)


def signed_in(
    browser: Browser,
    url: str,
    *,
    scheme: Any = "light",
    size: tuple[int, int] = (1280, 800),
    locale: str = "en-GB",
    touch: bool = False,
) -> BrowserContext:
    """Return a browser that has signed in by the page's own form."""
    context = browser.new_context(
        base_url=url,
        viewport={"width": size[0], "height": size[1]},
        color_scheme=scheme,
        locale=locale,
        timezone_id="UTC",
        reduced_motion="reduce",
        has_touch=touch,
    )
    context.set_default_timeout(30_000)
    context.set_default_navigation_timeout(90_000)
    page = context.new_page()
    page.goto("/systems")
    page.get_by_test_id("key").fill(KEY)
    page.locator("button[type=submit]").click()
    page.locator("h1").first.wait_for()
    page.locator("nav").first.wait_for(state="attached")  # on a narrow window it is behind a button
    page.close()
    return context


def faults(page: Page) -> list[str]:
    """Return what axe finds against WCAG AA, one line for each element."""
    return _told_by_axe(page, {"type": "tag", "values": _WCAG})


def faults_of_both_themes(page: Page) -> list[str]:
    """Return what axe finds in the dark theme and in the light one, without opening the page twice."""
    found = []
    for scheme, rules in (
        ("dark", {"type": "rule", "values": _OF_COLOURS}),
        ("light", {"type": "tag", "values": _WCAG}),
    ):
        page.emulate_media(color_scheme=scheme)
        page.wait_for_function("scheme => document.documentElement.dataset.mantineColorScheme === scheme", arg=scheme)
        found += [f"{scheme}, {one}" for one in _told_by_axe(page, rules)]
    return found


def _told_by_axe(page: Page, rules: dict[str, Any]) -> list[str]:
    if not page.evaluate("'axe' in window"):
        page.evaluate(_AXE.read_text(encoding="utf-8"))
    # Colours that are on their way to others are not judged: a button that becomes usable, numbers that are being renewed.
    page.wait_for_function("() => document.getAnimations().every(one => one.playState !== 'running')")
    found = page.evaluate("rules => axe.run(document, {runOnly: rules, resultTypes: ['violations']})", rules)
    return [
        f"{violation['id']}: {node['target']} {node['failureSummary'][:300]}"
        for violation in found["violations"]
        for node in violation["nodes"]
    ]


def too_wide(page: Page) -> list[str]:
    """Return the sizes of windows in which a page must be scrolled sideways; its own size comes back."""
    before = page.viewport_size
    found = []
    for width, height in ((1024, 768), (768, 1024), (1280, 800)):
        page.set_viewport_size({"width": width, "height": height})
        try:
            # Charts follow the window in a later frame.
            page.wait_for_function("width => document.documentElement.scrollWidth <= width", arg=width, timeout=10_000)
        except Error:
            found.append(f"wider than a window of {width} x {height}: {page.evaluate(_WIDEST)}")
    if before is not None and before != page.viewport_size:
        page.set_viewport_size(before)
    return found


def shifted(page: Page) -> float:
    """Return by how much of the window what was there has jumped since the page was opened (cumulative layout shift)."""
    return float(page.evaluate(_SHIFT))


def unreachable(page: Page) -> list[str]:
    """Return what can be used with a mouse but is not come to with the tabulator key."""
    count: int = page.evaluate(_BEGIN_TO_TAB)
    # Boxes that scroll are come to, too, and are not counted.
    for _ in range(count + 10):
        page.keyboard.down("Tab")  # held down: it repeats
    page.keyboard.up("Tab")
    left: list[str] = page.evaluate(
        "() => [...window.usable].filter(one => one.isConnected).map(one => one.outerHTML.slice(0, 200))"
    )
    return left


_WIDEST = """() => [...document.querySelectorAll('main *')].filter(one => one.getBoundingClientRect().right > innerWidth)
  .slice(0, 3).map(one => one.outerHTML.slice(0, 120)).join(' ')"""
_SHIFT = """() => new Promise(resolve => {
  let sum = 0;
  const observer = new PerformanceObserver(list => { for (const one of list.getEntries()) if (!one.hadRecentInput) sum += one.value; });
  observer.observe({type: 'layout-shift', buffered: true});
  setTimeout(() => { observer.disconnect(); resolve(sum); }, 0);
})"""
_BEGIN_TO_TAB = """() => {
  const all = document.querySelectorAll('a[href], button, input, select, textarea, [tabindex]');
  const one = element => element.checkVisibility({visibilityProperty: true}) && !element.disabled && element.tabIndex >= 0;
  // Of radio buttons that belong together the arrow keys reach the others.
  const usable = window.usable = new Set([...all].filter(element => one(element) && !(element.type === 'radio' && !element.checked)));
  document.addEventListener('focusin', event => usable.delete(event.target));
  document.activeElement?.blur();
  return usable.size;
}"""
