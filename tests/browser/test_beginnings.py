"""A workspace in which nothing is yet: every list says what it would hold, and leads to the first one."""

from __future__ import annotations

from collections.abc import Iterator

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect

from tests.browser.driving import Running, signed_in

#: Page -> the heading of what is said there, the action that is offered, and where it leads.
EMPTY = {
    "/systems": ("No systems yet", "Look at the studies", "/systems#templates"),
    "/jobs": ("No jobs yet", "Choose a system", "/systems"),
    "/jobs?status=failed": ("No such jobs", "Show all", "/jobs"),
    "/schedules": ("Nothing runs by itself yet", "New schedule", "/schedules/new"),
    "/rigs": ("No rigs yet", "Make a key for its agent", "/access"),
    "/identify": ("A system and a recording are needed", "Systems", "/systems"),
    "/validate": ("A system and a recording are needed", "Datasets", "/datasets"),
}


@pytest.fixture(scope="module")
def fresh(browser: Browser, service: Running, client: httpx.Client) -> Iterator[Page]:
    """The page of somebody in a workspace of their own, which is empty."""
    workspace = client.post("/v1/workspaces", json={"name": "of beginnings"}).json()["id"]
    scopes = ["read", "write", "run", "acquire", "admin"]
    made = client.post("/v1/keys", json={"name": "first", "scopes": scopes, "workspace": workspace})
    assert made.status_code == 201, made.text
    context = signed_in(browser, service.url, key=made.json()["key"])
    yield context.new_page()
    context.close()


def test_every_list_that_is_empty_says_what_it_is_for_and_leads_on(fresh: Page, service: Running) -> None:
    for address, (heading, action, to) in EMPTY.items():
        fresh.goto(address)
        said = fresh.get_by_test_id("empty")
        expect(said.get_by_role("heading", name=heading)).to_be_visible()
        assert len(said.get_by_role("paragraph").first.inner_text()) > 40, f"{address} must say what it is for"
        said.get_by_role("link", name=action).or_(said.get_by_role("button", name=action)).click()
        expect(fresh).to_have_url(f"{service.url}{to}")
        expect(fresh.get_by_role("heading", level=1)).to_be_visible()
    # The first recording is a file, which is chosen at once.
    fresh.goto("/datasets")
    said = fresh.get_by_test_id("empty")
    expect(said.get_by_role("heading", name="No recordings yet")).to_be_visible()
    with fresh.expect_file_chooser() as chooser:
        said.get_by_role("button", name="Choose the first file").click()
    chooser.value.set_files({"name": "first.csv", "mimeType": "text/csv", "buffer": b"t;x\n0;1\n1;2\n"})
    expect(fresh.get_by_test_id("upload")).to_be_visible()
    expect(fresh.get_by_test_id("empty")).to_have_count(0)
