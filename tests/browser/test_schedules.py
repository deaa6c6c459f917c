"""Schedules: made in a form that says them in words, paused, run at once, looked back on, changed, deleted."""

from __future__ import annotations

import json
import re
from urllib.parse import urlencode

import pytest
from playwright.sync_api import Page, expect

from tests.browser.driving import faults

LAG = {
    "name": "of a schedule",
    "parameters": {"tau": {"value": 0.5, "unit": "s"}},
    "blocks": {
        "u": {"kind": "input"},
        "lag": {"kind": "transfer_function", "numerator": [1], "denominator": ["=tau", 1]},
    },
    "connections": [{"from": "u", "to": "lag"}],
    "outputs": {"y": "lag"},
}


@pytest.fixture(scope="module")
def job(client) -> dict[str, object]:
    system = client.post("/v1/systems", json=LAG).json()
    step = {"name": "step", "input": {"port": "u", "signal": {"kind": "step"}}}
    goal = {"metric": "rise_time", "experiment": "step", "output": "y", "sense": "minimize"}
    body = {
        "system": system["id"],
        "variables": [{"parameter": "tau", "lower": 0.1, "upper": 1}],
        "experiments": [step],
        "goals": [goal],
        "method": {"kind": "grid", "points": 3},
    }
    return {"kind": "optimization", "body": body}


def test_a_schedule_is_made_paused_run_and_deleted(page: Page, job) -> None:
    page.goto("/schedules/new?" + urlencode({"name": "every night", "job": json.dumps(job)}))
    page.get_by_role("textbox", name="Cron expression").fill("61 25 * * *")
    page.get_by_role("button", name="Save").click()
    expect(page.get_by_text("must be a cron expression of five parts")).to_be_visible()
    page.get_by_role("combobox", name="Often used").select_option("30 2 * * *")
    zone = page.get_by_role("combobox", name="Time zone")
    zone.fill("Europe/Bucharest")
    zone.press("Escape")
    page.get_by_role("button", name="Save").click()
    page.wait_for_url(re.compile(r"/schedules/sch_\w+$"))
    expect(page.get_by_test_id("words")).to_have_text("At 02:30")
    # Five instants, each at half past two on the clocks of Bucharest.
    expect(page.get_by_test_id("next").get_by_role("listitem")).to_have_count(5)
    expect(page.get_by_test_id("next").get_by_role("listitem").first).to_contain_text("02:30")
    expect(page.get_by_text("It has not run yet.")).to_be_visible()
    page.get_by_role("button", name="Run now").click()
    row = page.get_by_test_id("runs").get_by_role("row").nth(1)
    expect(row).to_contain_text("started")
    assert faults(page) == []
    # In words and on the clocks of the schedule, the next one with how far it is away.
    expect(page.get_by_test_id("next").get_by_role("listitem").first).to_contain_text(
        re.compile(r"\w+day, .*02:30 [A-Z].* · (in \d+ (hours?|minutes?)|tomorrow)")
    )
    page.get_by_role("button", name="Pause").click()
    expect(page.get_by_text("None while it is paused.")).to_be_visible()
    page.get_by_role("button", name="Resume").click()
    expect(page.get_by_test_id("next").get_by_role("listitem")).to_have_count(5)
    page.get_by_role("button", name="Pause").click()
    expect(page.get_by_text("None while it is paused.")).to_be_visible()
    page.get_by_role("link", name="Change").click()
    page.get_by_role("textbox", name="Name").fill("every hour")
    page.get_by_role("combobox", name="Often used").select_option("0 * * * *")
    page.get_by_role("button", name="Save").click()
    page.wait_for_url(re.compile(r"/schedules/sch_\w+$"))
    expect(page.get_by_role("heading", name="every hour")).to_be_visible()
    page.goto("/schedules")
    expect(page.get_by_test_id("schedules").get_by_role("row").filter(has_text="every hour")).to_contain_text(
        "Every hour"
    )
    page.get_by_role("link", name="every hour").click()
    page.get_by_role("button", name="Delete").click()
    page.get_by_role("dialog").get_by_role("button", name="Delete").click()
    page.wait_for_url("**/schedules")
    expect(page.get_by_role("link", name="every hour")).to_have_count(0)


def test_what_the_service_refuses_stands_at_its_field(page: Page, job) -> None:
    page.goto(
        "/schedules/new?" + urlencode({"name": "wrong", "job": json.dumps({**job, "body": {"system": "sys_none"}})})
    )
    page.get_by_role("button", name="Save").click()
    expect(page.locator(".mantine-Textarea-error")).to_be_visible()
    assert page.url.endswith(urlencode({"job": json.dumps({**job, "body": {"system": "sys_none"}})}))
    assert faults(page) == []


def test_two_who_change_one_schedule_lose_nothing(page: Page, client, job) -> None:
    document = {"name": "shared", "cron": "30 2 * * *", "time_zone": "UTC", "paused": True, "job": job}
    made = client.post("/v1/schedules", json=document).json()["id"]
    page.goto(f"/schedules/{made}/edit")
    page.get_by_role("textbox", name="Name").fill("x" * 201)
    page.get_by_role("button", name="Save").click()
    expect(page.get_by_text("must have at most 200 characters, got xxx")).to_be_visible()
    page.get_by_role("textbox", name="Name").fill("shared by two")
    tag = client.get(f"/v1/schedules/{made}").headers["ETag"]
    changed = client.put(f"/v1/schedules/{made}", json={**document, "cron": "0 * * * *"}, headers={"If-Match": tag})
    assert changed.status_code == 200
    page.get_by_role("button", name="Save").click()
    expect(page.get_by_text("Somebody else has changed it meanwhile")).to_be_visible()
    assert faults(page) == []
    page.get_by_role("button", name="Take over what is there now").click()
    expect(page.get_by_role("textbox", name="Cron expression")).to_have_value("0 * * * *")
    expect(page.get_by_role("textbox", name="Name")).to_have_value("shared by two")
    page.get_by_role("button", name="Save").click()
    page.wait_for_url(re.compile(r"/schedules/sch_\w+$"))
    kept = client.get(f"/v1/schedules/{made}").json()["document"]
    assert (kept["name"], kept["cron"]) == ("shared by two", "0 * * * *")
