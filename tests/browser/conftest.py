"""One service and one browser for all tests of the pages in a process; a page that fails a test when a script on it fails.

They end with the last of these tests: an idle service and its worker would take a twentieth of a core from all tests that follow.
"""

from __future__ import annotations

from collections.abc import Iterator

import httpx
import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright

from tests.browser.driving import Running, launched, running, signed_in
from tests.support.patience import PATIENCE

expect.set_options(timeout=1000 * PATIENCE)  # beside other tests a page may wait for its processor


@pytest.fixture(scope="package")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with running(tmp_path_factory.mktemp("browser")) as found:
        yield found


@pytest.fixture(scope="package")
def client(service: Running) -> Iterator[httpx.Client]:
    with service.client() as found:
        yield found


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        found = launched(playwright)
        yield found
        found.close()


@pytest.fixture(scope="package")
def visitor(browser: Browser, service: Running) -> Iterator[BrowserContext]:
    """A browser that has signed in once."""
    context = signed_in(browser, service.url)
    yield context
    context.close()


@pytest.fixture
def page(visitor: BrowserContext, service: Running) -> Iterator[Page]:
    found = visitor.new_page()
    wrong: list[str] = []
    found.on("pageerror", lambda error: wrong.append(str(error)))
    # The browser itself tells what the policy on scripts and styles has refused.
    found.on("console", lambda m: wrong.append(m.text) if "Content Security Policy" in m.text else None)
    # Everything comes from the service itself: no other host is asked for anything.
    found.on(
        "request",
        lambda asked: None if asked.url.startswith((service.url, "blob:", "data:")) else wrong.append(asked.url),
    )
    yield found
    found.close()
    assert wrong == []
