"""Everything by keyboard: signed in, a study opened, a slider moved, a search started, its result applied; dialogs keep the focus."""

from __future__ import annotations

import re

import httpx
from playwright.sync_api import Browser, Page, expect

from tests.browser.driving import KEY, Running
from tests.browser.keyboard import go_to, step
from tests.support.patience import PATIENCE


def test_a_study_is_optimised_without_a_mouse(browser: Browser, service: Running, client: httpx.Client) -> None:
    context = browser.new_context(base_url=service.url, reduced_motion="reduce", locale="en-GB")
    context.set_default_timeout(1000 * PATIENCE)
    page = context.new_page()
    page.goto("/systems")
    # The field of the key has the focus from the beginning.
    page.get_by_test_id("key").wait_for()
    page.keyboard.type(KEY)
    page.keyboard.press("Enter")
    expect(page.get_by_role("article").first).to_be_visible()
    # The first stop of every page leads past what all pages have in common, and is seen as soon as it has the focus.
    assert step(page) == ("a", "Skip to the content")
    page.keyboard.press("Enter")
    expect(page.locator("#content")).to_be_focused()
    assert step(page)[1] not in {"", "Systems", "Recordings"}

    go_to(page, "button", "Open the study Linear hydraulic motor")
    page.keyboard.press("Enter")
    page.wait_for_url("**/systems/sys_*/panel**")
    page.locator("[data-testid=plots][data-frame]").wait_for()
    system = page.url.split("/systems/")[1].split("/")[0]
    go_to(page, "slider", "")
    moved = str(page.evaluate("document.activeElement.getAttribute('aria-label')"))
    for key in ("ArrowRight", "ArrowRight", "ArrowUp"):
        page.keyboard.press(key)
    expect(page).to_have_url(re.compile(rf"p\.{re.escape(moved)}="))

    go_to(page, "a", "Optimise", back=True)
    page.keyboard.press("Enter")
    page.wait_for_url("**/optimise**")
    expect(page.get_by_role("button", name="Start")).to_be_visible()
    go_to(page, "select", "Method")
    method = page.get_by_label("Method", exact=True)
    # Not by typing its name: letters that come slowly begin a new name each.
    for _ in range(method.locator("option").count()):
        if method.input_value() == "grid":
            break
        page.keyboard.press("ArrowDown")
    expect(method).to_have_value("grid")
    expect(method).to_be_focused()
    go_to(page, "input", "points")
    page.keyboard.type("3")
    page.keyboard.press("Enter")
    go_to(page, "button", "Start")
    page.keyboard.press("Enter")
    page.wait_for_url("**/jobs/job_*")
    expect(page.get_by_test_id("optimum")).to_be_visible()
    job = page.url.rsplit("/", 1)[1]
    go_to(page, "button", "Save as revision")
    page.keyboard.press("Enter")
    page.wait_for_url("**/revisions**")
    assert client.get(f"/v1/systems/{system}").json()["revision"] == 2
    best = client.get(f"/v1/jobs/{job}/result").json()["best"]
    assert best, "the search must have found values, got none"
    context.close()


def test_a_dialog_keeps_the_focus_and_gives_it_back(page: Page, client: httpx.Client) -> None:
    client.post("/v1/keys", json={"name": "of the keyboard", "scopes": ["read"]}).raise_for_status()
    page.goto("/access")
    opener = "Rotate of the keyboard"
    page.get_by_role("button", name=opener).wait_for()
    go_to(page, "button", opener)
    page.keyboard.press("Enter")
    dialog = page.get_by_role("dialog")
    expect(dialog.get_by_label("The old one opens for another")).to_be_focused()
    stops = {step(page, back=back)[1] for back in (False, False, False, False, True, True, True)}
    assert stops == {"Close", "The old one opens for another", "Make the new key"}
    assert page.evaluate("document.activeElement.closest('[role=dialog]') !== null")
    page.keyboard.press("Escape")
    expect(dialog).to_have_count(0)
    expect(page.get_by_role("button", name=opener)).to_be_focused()
