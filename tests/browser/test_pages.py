"""The main path of searches, influence and what they lead to; an address without a page; a tablet."""

from __future__ import annotations

import json
import re

import pytest
from playwright.sync_api import Page, expect

from tests.browser.driving import PAGES, signed_in


@pytest.fixture(scope="module")
def hydraulic(client) -> str:
    templates = json.loads((PAGES.parents[1] / "web/src/features/systems/templates.json").read_text())
    document = next(t for t in templates if t["id"] == "hydraulic-velocity")["document"]
    return str(client.post("/v1/systems", json=document).json()["id"])


@pytest.fixture(scope="module")
def job(visitor, hydraulic) -> str:
    """An optimisation that was asked for, followed and understood on the pages."""
    page = visitor.new_page()
    page.goto(f"/systems/{hydraulic}/optimise")
    page.get_by_label("Method").select_option("grid")
    page.get_by_role("textbox", name="points").fill("5")
    page.get_by_role("textbox", name="points").press("Enter")
    page.get_by_role("button", name="Remove law.kd2").click()
    page.get_by_role("button", name="Start").click()
    page.wait_for_url("**/jobs/job_*")
    expect(page.get_by_test_id("optimum")).to_be_visible()
    found = page.url.rsplit("/", 1)[1]
    page.close()
    return found


def test_an_optimum_is_shown_and_opened_on_the_panel(page: Page, job, client) -> None:
    result = client.get(f"/v1/jobs/{job}/result").json()
    page.goto(f"/jobs/{job}")
    expect(page.get_by_test_id("goals").get_by_role("row")).to_have_count(1 + len(result["goals"]))
    after = result["goals"][1]["after"]["value"]
    expect(page.get_by_test_id("goals")).to_contain_text(f"{100 * after:.4g}")
    # An earlier step of the search: its metrics are computed as it is looked at, and the address holds it.
    page.get_by_role("slider", name="Drag to see").focus()
    page.keyboard.press("Home")
    expect(page).to_have_url(re.compile(r"step=0"))
    asked = client.get(f"/v1/jobs/{job}/request").json()
    first = next(entry["variables"] for entry in result["history"] if entry["variables"])
    body = {"system": asked["system"], "input": asked["experiments"][0]["input"], "variants": [first]}
    exact = client.post("/v1/simulations", json=body).json()["variants"][0]["metrics"]["velocity"]["overshoot"]["value"]
    expect(page.get_by_test_id("between").nth(1)).to_contain_text(f"{100 * exact:.4g}")
    page.keyboard.press("End")
    expect(page.get_by_test_id("between")).to_have_count(0)
    page.get_by_role("link", name="Open on the panel").click()
    page.locator("[data-testid=plots][data-frame]").wait_for()
    expect(page.get_by_role("textbox", name="Value of law.kp")).to_have_value(f"{result['best']['law.kp']:.6g}")
    expect(page.get_by_test_id("reference")).to_be_visible()


def test_a_point_of_a_front_is_chosen_and_opened_on_the_panel(page: Page, hydraulic, client) -> None:
    step = {"experiment": "step", "output": "velocity", "sense": "minimize"}
    body = {
        "system": hydraulic,
        "variables": [
            {"parameter": "law.kp", "lower": 0.001, "upper": 0.1},
            {"parameter": "motor.leakage", "lower": 1e-11, "upper": 1e-9},
        ],
        "experiments": [{"name": "step", "input": {"port": "reference", "signal": {"kind": "step"}}}],
        "goals": [{"metric": "overshoot", **step}, {"metric": "response_time", **step}],
        "method": {"kind": "pareto", "points": 6, "population": 16, "generations": 4},
    }
    asked = client.post("/v1/optimizations", json=body)
    assert asked.status_code == 202, asked.text
    found = asked.json()["id"]
    page.goto(f"/jobs/{found}")
    front = page.get_by_test_id("front")
    expect(front).to_be_visible()
    points = client.get(f"/v1/jobs/{found}/result").json()["front"]
    expect(front.get_by_role("row")).to_have_count(1 + len(points))
    second = front.get_by_role("button", name="Choose point 2", exact=True)
    expect(second).to_have_attribute("aria-pressed", "false")
    second.click()
    expect(second).to_have_attribute("aria-pressed", "true")
    expect(page).to_have_url(re.compile(r"point=1$"))
    page.get_by_role("link", name="Open on the panel").click()
    page.locator("[data-testid=plots][data-frame]").wait_for()
    value = points[1]["parameters"]["law.kp"]
    expect(page.get_by_role("textbox", name="Value of law.kp")).to_have_value(f"{value:.6g}")


def test_a_wrong_goal_is_told_beside_it(page: Page, hydraulic) -> None:
    page.goto(f"/systems/{hydraulic}/optimise")
    page.get_by_role("textbox", name="At most, goal 2").fill("5 kg")
    page.get_by_role("textbox", name="At most, goal 2").press("Enter")
    page.get_by_role("button", name="Start").click()
    expect(
        page.get_by_role("row").filter(has=page.get_by_label("Goal 2", exact=True)).get_by_role("alert")
    ).to_contain_text("kg")


def test_influence_is_read_by_rows_and_by_columns_and_leads_to_the_slider(page: Page, hydraulic, client) -> None:
    page.goto(f"/systems/{hydraulic}/influence?p=law.kp,motor.mass&m=overshoot,bandwidth")
    body = {
        "system": hydraulic, "input": "reference", "output": "velocity", "open_at": "error",
        "parameters": ["law.kp", "motor.mass"], "metrics": ["overshoot"],
    }  # fmt: skip
    exact = client.post("/v1/influence", json=body).json()["elasticities"]["overshoot"]["law.kp"]["value"]
    expect(page.get_by_test_id("influence").get_by_role("row").nth(1)).to_contain_text(f"{exact:.3g}")
    page.get_by_role("button", name="bandwidth").click()
    expect(page.get_by_role("heading", name="What moves the bandwidth")).to_be_visible()
    # A column: what one parameter moves; and the answer to a change that is not small.
    page.get_by_role("button", name="Read the column of law.kp").click()
    expect(page).to_have_url(re.compile(r"col=law\.kp"))
    expect(page.get_by_test_id("tornado").get_by_role("heading", name="What law.kp moves")).to_be_visible()
    page.goto(f"{page.url}&kind=coefficient&change=25")
    found = client.post("/v1/influence", json={**body, "metrics": ["overshoot", "bandwidth"], "change": 0.25}).json()
    finite = {metric: cells["law.kp"]["value"] for metric, cells in found["coefficients"].items()}
    bars = page.get_by_test_id("tornado").get_by_role("button")
    expect(bars).to_have_text(sorted(finite, key=lambda metric: -abs(finite[metric])))
    for metric, value in finite.items():
        row = page.get_by_test_id("influence").get_by_role("row").filter(has=page.get_by_role("button", name=metric))
        expect(row).to_contain_text(f"{value:.3g}".replace("-", "−"))
    page.get_by_test_id("influence").get_by_role("link", name="motor.mass").click()
    expect(page.get_by_role("slider").first).to_have_attribute("aria-label", "motor.mass")


def test_an_address_without_a_page_says_so(page: Page) -> None:
    page.goto("/nothing-here")
    expect(page.get_by_role("heading", name="There is no such page")).to_be_visible()


def test_a_tablet_is_enough(browser, service, hydraulic) -> None:
    context = signed_in(browser, service.url, size=(1024, 768), touch=True)
    page = context.new_page()
    page.goto(f"/systems/{hydraulic}/panel?s=law.kp&in=reference&loop=error")
    page.locator("[data-testid=plots][data-frame]").wait_for()
    slider = page.get_by_role("slider", name="law.kp", exact=True)
    box = slider.bounding_box()
    assert box is not None
    page.touchscreen.tap(box["x"] + box["width"] * 0.75, box["y"] + box["height"] / 2)
    expect(page).to_have_url(re.compile(r"p\.law\.kp="))
    page.get_by_role("link", name="Diagram").tap()
    page.locator(".react-flow__edge").first.wait_for()
    count = page.locator(".react-flow__node").count()
    page.locator('[data-kind="gain"]').tap()
    expect(page.locator(".react-flow__node")).to_have_count(count + 1)
    expect(page.get_by_role("textbox", name="Name")).to_have_value("gain")
    page.get_by_role("button", name="Undo").tap()
    expect(page.locator(".react-flow__node")).to_have_count(count)
    context.close()


#: Pixels by which the table of a part of a page is wider than the frame that it scrolls in.
_BEYOND = """name => {
  const part = document.querySelector(`[data-testid=${name}]`);
  const frame = (part.querySelector('table') ?? part).closest('.mantine-ScrollArea-viewport');
  return frame.scrollWidth - frame.clientWidth;
}"""


def test_goals_on_a_tablet_and_influences_on_a_laptop_are_seen_without_scrolling_sideways(
    page: Page, hydraulic
) -> None:
    page.set_viewport_size({"width": 820, "height": 1180})
    page.goto(f"/systems/{hydraulic}/optimise")
    page.get_by_test_id("wanted").get_by_role("row").nth(1).wait_for()
    assert page.evaluate(_BEYOND, "wanted") == 0
    page.set_viewport_size({"width": 1280, "height": 800})
    page.goto(f"/systems/{hydraulic}/influence")
    page.get_by_test_id("influence").wait_for()
    assert page.evaluate(_BEYOND, "influence") == 0
