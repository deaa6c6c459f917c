"""What the service finds wrong with a file, and with a map, is told where it was chosen."""

from __future__ import annotations

import json
import re

import httpx
from playwright.sync_api import Page, expect

from tests.browser.places import Mistake
from tests.browser.soundness import untold
from tests.browser.test_panel import study


def test_files_are_refused_where_they_were_chosen(page: Page) -> None:
    page.goto("/systems")
    document = {"blocks": {"u": {"kind": "input"}, "a": {"kind": "nonsense"}}, "outputs": {"y": "u"}}
    file = {"name": "wrong.json", "mimeType": "application/json", "buffer": json.dumps(document).encode()}
    page.locator("input[type=file]").set_input_files(file)  # type: ignore[arg-type] # a FilePayload
    # Of a file no part is on the page: the place in it is named.
    button = page.get_by_role("button", name="Import JSON")
    expect(button).to_have_accessible_description(re.compile("/blocks/a.*nonsense"))
    page.goto("/datasets")
    recording = {"name": "run.csv", "mimeType": "text/csv", "buffer": b"t;x\n0;1\n1;2\n"}
    page.locator("input[type=file]").set_input_files(recording)  # type: ignore[arg-type] # a FilePayload
    assert untold(page, Mistake(fill={"Name": "x" * 300}, press=("Send",), at="Name", said="200")) == []


def test_a_map_of_one_point_is_refused_at_its_points(page: Page, client: httpx.Client) -> None:
    page.goto(f"/systems/{study(client, 'hydraulic-velocity')}/optimise")
    page.get_by_label("Method", exact=True).select_option("grid")
    assert untold(page, Mistake(fill={"points": "1"}, press=("Start",), at="points", said="2")) == []


def test_a_key_that_would_outlive_its_successor_too_long_is_refused_at_its_hours(
    page: Page, client: httpx.Client
) -> None:
    client.post("/v1/keys", json={"name": "of the fields", "scopes": ["read"]}).raise_for_status()
    page.goto("/access")
    page.get_by_role("button", name="Rotate of the fields").click()
    dialog = page.get_by_role("dialog")
    hours, make = (
        dialog.get_by_label("The old one opens for another"),
        dialog.get_by_role("button", name="Make the new key"),
    )
    # 30 days are allowed, 720 h.
    hours.fill("721")
    expect(hours).to_have_attribute("aria-invalid", "true")
    expect(hours).to_have_accessible_description(re.compile("must be at most 720 h, got 721 h"))
    expect(make).to_be_disabled()
    hours.fill("720")
    make.click()
    expect(page.get_by_test_id("new-key")).to_be_visible()
