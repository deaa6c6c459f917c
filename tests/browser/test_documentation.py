"""The documentation as the service serves it: its search and its scripts run under its policy, in both themes."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page, expect

from api.app import documentation


@pytest.fixture(autouse=True)
def built() -> None:
    assert (documentation.SITE / "index.html").is_file(), "run `make docs`"


def test_the_search_finds_a_page(page: Page) -> None:
    page.goto("/docs/")
    expect(page.get_by_role("heading", name="Servotune", level=1)).to_be_visible()
    field = page.get_by_role("combobox", name="Search")
    for _ in range(300):  # the key is heard once the script of the search has come
        page.keyboard.press("/")
        page.wait_for_timeout(100)
        if field.is_visible():
            break
    field.fill("neutral")
    page.get_by_role("option", name="Poles and stability").click()
    page.wait_for_url("**/docs/theory/delays.html**")
    assert page.locator("math").count() >= 5


def test_the_pages_follow_the_dark_theme(page: Page) -> None:
    page.emulate_media(color_scheme="dark")
    page.goto("/docs/theory/margins.html")
    expect(page.locator("body")).to_have_attribute("data-md-color-scheme", "slate")
    page.emulate_media(color_scheme="light")


def test_the_reference_is_linked_and_is_the_services_own(page: Page) -> None:
    page.goto("/docs/reference/http.html")
    page.get_by_role("link", name="The reference").click()
    page.locator(".opblock-tag-section").first.wait_for()
    assert page.url.endswith("/docs/api")
