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
from playwright.sync_api import Browser, BrowserContext, Page, Playwright

from tests.support.patience import PATIENCE

ROOT = Path(__file__).parents[2]
KEY = "a-key-for-the-browser-tests"
PAGES = ROOT / "api" / "static"
#: The distribution's browser: nothing is downloaded. The one without a window of its own takes a sixth of the time for a page.
CHROMIUM = os.environ.get("SERVOTUNE_TEST_CHROMIUM") or next(
    filter(None, map(shutil.which, ("chromium-headless-shell", "chromium", "chromium-browser"))), None
)
_ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"]
AXE = ROOT / "web" / "node_modules" / "axe-core" / "axe.min.js"
WCAG = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"]


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
        return httpx.Client(
            base_url=self.url, headers={"Authorization": f"Bearer {KEY}"}, timeout=PATIENCE, trust_env=False
        )

    def start(self) -> None:
        code = f"import sys; from api.commands.service import serve; sys.exit(serve(['--port', '{self.port}']))"
        environment = {
            **os.environ,
            "SERVOTUNE_DATABASE_URL": f"sqlite:///{self.folder / 'service.db'}",
            "SERVOTUNE_BOOTSTRAP_KEY": KEY,
            "SERVOTUNE_REQUEST_SECONDS": str(PATIENCE),
            "PYTHONPATH": str(ROOT),
        }
        with (self.folder / "service.log").open("ab") as log:
            self.process = subprocess.Popen([sys.executable, "-c", code], env=environment, stdout=log, stderr=log)
        deadline = time.monotonic() + PATIENCE
        with self.client() as client:
            while time.monotonic() < deadline:
                try:
                    if client.get("/readyz").status_code == 200:
                        return
                except httpx.TransportError:
                    assert self.process.poll() is None, (self.folder / "service.log").read_text()
                time.sleep(0.1)
        raise AssertionError(f"the service was not ready within {PATIENCE} s")

    def stop(self) -> None:
        assert self.process is not None
        self.process.terminate()
        self.process.wait(timeout=PATIENCE)


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
    assert CHROMIUM is not None, (
        "chromium must be installed (Debian: apt-get install chromium-headless-shell), got none"
    )
    return playwright.chromium.launch(executable_path=CHROMIUM, args=_ARGUMENTS)


def signed_in(
    browser: Browser,
    url: str,
    *,
    scheme: Any = "light",
    size: tuple[int, int] = (1280, 800),
    locale: str = "en-GB",
    key: str = KEY,
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
    context.set_default_timeout(1000 * PATIENCE)
    page = context.new_page()
    page.goto("/systems")
    page.get_by_test_id("key").fill(key)
    page.locator("button[type=submit]").click()
    page.locator("h1").first.wait_for()
    page.locator("nav").first.wait_for(state="attached")  # on a narrow window it is behind a button
    page.close()
    return context


def faults(page: Page) -> list[str]:
    """Return what axe finds against WCAG AA in the theme that is shown, one line for each element."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(AXE.read_text(encoding="utf-8"))
    # Colours that are on their way to others are not judged: a button that becomes usable, numbers that are being renewed.
    page.wait_for_function("() => document.getAnimations().every(one => one.playState !== 'running')")
    found = page.evaluate(
        "tags => axe.run(document, {runOnly: {type: 'tag', values: tags}, resultTypes: ['violations']})", WCAG
    )
    return [
        f"{violation['id']}: {node['target']} {node['failureSummary'][:300]}"
        for violation in found["violations"]
        for node in violation["nodes"]
    ]
