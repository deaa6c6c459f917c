"""The search over everything: by keyboard from any page, of every kind, and what of it could not be searched."""

from __future__ import annotations

import re

import httpx
from playwright.sync_api import Page, Route, expect

from tests.browser.soundness import faults_of_both_themes
from tests.browser.test_diagram import LOOP


def opened(page: Page) -> None:
    page.keyboard.press("Control+k")
    expect(page.get_by_role("combobox", name="Search everything")).to_be_focused()
    expect(page.get_by_test_id("finder-state")).to_have_attribute("data-pending", "false")


def test_a_system_its_optimum_and_a_chapter_are_found_by_keyboard(page: Page, client: httpx.Client) -> None:
    system = client.post("/v1/systems", json={**LOOP, "name": "Axă căutată"}).json()["id"]
    asked = {
        "system": system,
        "variables": [{"parameter": "k", "lower": 1, "upper": 3}],
        "experiments": [{"name": "step", "input": {"port": "u", "signal": {"kind": "step"}}}],
        "goals": [{"metric": "rise_time", "experiment": "step", "output": "y", "sense": "minimize"}],
        "method": {"kind": "grid", "points": 2},
    }
    job = client.post("/v1/optimizations", json=asked).json()["id"]
    page.goto(f"/jobs/{job}")
    expect(page.get_by_test_id("optimum")).to_be_visible()
    opened(page)
    expect(page.get_by_test_id("found").get_by_role("option", selected=True)).to_have_count(1)
    assert faults_of_both_themes(page, "light") == []
    # Without the accents, and the words in another order.
    page.keyboard.type("cautata axa")
    found = page.get_by_test_id("found")
    expect(found.locator("[data-kind=systems]")).to_have_text(re.compile("Axă căutată"))
    expect(found.locator("[data-kind=optima]")).to_have_text(re.compile("Optimisation: Axă căutată"))
    expect(page.get_by_test_id("finder-state")).to_have_text("2 found")
    page.keyboard.press("ArrowDown")
    expect(page.get_by_test_id("found").get_by_role("option", selected=True)).to_have_attribute("data-kind", "optima")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    expect(page).to_have_url(re.compile(rf"/systems/{system}/panel"))
    expect(page.get_by_role("dialog")).to_have_count(0)
    opened(page)
    page.keyboard.type("no such thing anywhere")
    expect(page.get_by_test_id("finder-state")).to_contain_text("Nothing holds “no such thing anywhere”.")
    page.keyboard.press("Enter")
    page.keyboard.press("Escape")
    expect(page.get_by_role("dialog")).to_have_count(0)
    expect(page).to_have_url(re.compile(rf"/systems/{system}/panel"))
    page.get_by_role("button", name="Search").click()
    page.get_by_role("combobox", name="Search everything").fill("coming from simulink")
    page.get_by_role("option").and_(page.locator("[data-kind=documentation]")).first.click()
    expect(page).to_have_url(re.compile(r"/docs/coming-from\.html"))


def test_letters_typed_before_the_search_has_loaded_are_in_its_field(page: Page) -> None:
    page.goto("/systems")
    page.get_by_role("heading", name="Systems", exact=True).wait_for()
    held: list[Route] = []

    def hold(route: Route) -> None:
        held.append(route)

    page.route("**/assets/Finder-*.js", hold)
    with page.expect_request("**/assets/Finder-*.js"):
        page.keyboard.press("Control+k")
    page.keyboard.type("aboux")
    page.keyboard.press("Backspace")
    expect(page.get_by_role("dialog")).to_have_count(0)
    held[0].continue_()
    field = page.get_by_role("combobox", name="Search everything")
    expect(field).to_be_focused()
    expect(field).to_have_value("abou")
    page.keyboard.type("t")
    expect(page.get_by_role("option", name="About", exact=True)).to_be_visible()
    # The next search begins empty.
    page.keyboard.press("Escape")
    expect(page.get_by_role("dialog")).to_have_count(0)
    page.keyboard.press("Control+k")
    expect(field).to_have_value("")


def test_what_does_not_answer_is_told_and_hides_nothing_else(page: Page, client: httpx.Client) -> None:
    client.post("/v1/systems", json={**LOOP, "name": "seen without rigs"}).raise_for_status()

    def refuse(route: Route) -> None:
        route.abort()

    page.route("**/v1/rigs*", refuse)
    page.goto("/about")
    page.get_by_role("button", name="Search").wait_for()
    opened(page)
    page.keyboard.type("seen without")
    expect(page.get_by_role("option", name="seen without rigs")).to_have_count(1)
    expect(page.get_by_test_id("finder-state")).to_contain_text("Not searched, because it was not answered: Rigs.")
