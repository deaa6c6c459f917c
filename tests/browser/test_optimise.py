"""The form of a search: all that a request may hold, kept over a reload, copied as what runs; and influence beside it."""

from __future__ import annotations

import json
import re
import shlex

import pytest
from playwright.sync_api import Locator, Page, expect

from tests.browser.driving import KEY
from tests.browser.test_panel import study


@pytest.fixture(scope="module")
def hydraulic(client) -> str:
    return study(client, "hydraulic-velocity")


def enter(where: Locator, text: str) -> None:
    where.fill(text)
    where.press("Enter")


def copied(page: Page, button: str) -> str:
    page.get_by_role("button", name=button).click()
    expect(page.get_by_role("button", name="Copied")).to_be_visible()
    text = str(page.evaluate("navigator.clipboard.readText()"))
    expect(page.get_by_role("button", name=button)).to_be_visible()
    return text


def body_of(curl: str, url: str) -> dict:
    """Return the body that a shell would send with the copied line."""
    words = shlex.split(curl)
    assert words[:4] == ["curl", "-X", "POST", f"{url}/v1/optimizations"]
    assert "Authorization: Bearer $SERVOTUNE_KEY" in words
    return json.loads(words[words.index("-d") + 1])


def test_all_that_a_request_may_hold_is_said_kept_and_copied(page: Page, hydraulic, service, client) -> None:
    page.context.grant_permissions(["clipboard-read", "clipboard-write"], origin=service.url)
    page.goto(f"/systems/{hydraulic}/optimise")
    # The bound on the effort that is proposed is not wanted here.
    page.get_by_role("button", name="Remove control effort").click()
    # Design variables: a range on a scale of its own, a list.
    page.get_by_role("button", name="Remove law.kd2").click()
    page.get_by_role("button", name="More about law.kp").click()
    page.get_by_label("Scale of law.kp").select_option("log")
    enter(page.get_by_role("textbox", name="Beginning of law.kp"), "20m")
    page.get_by_label("How law.kd1 is chosen").select_option("list")
    enter(page.get_by_role("textbox", name="Values for law.kd1"), "1e-5; 2e-5")
    # Experiments: a second experiment, its fields from the catalogue.
    page.get_by_role("button", name="Add an experiment").click()
    page.get_by_role("textbox", name="Name of experiment 2").fill("slowly")
    page.get_by_label("Command", exact=True).nth(1).select_option("ramp")
    enter(page.get_by_role("textbox", name="Slope"), "0.5")
    # Goals: of one experiment, of every one, with a weight, softly, around a target, below a curve.
    page.get_by_label("Experiment of goal 1").select_option("step")
    page.get_by_role("button", name="More about goal 1").click()
    enter(page.get_by_role("textbox", name="Weight of goal 1"), "2")
    page.get_by_label("Goal 2", exact=True).select_option("peak")
    page.get_by_role("button", name="More about goal 2").click()
    enter(page.get_by_role("textbox", name="At most, goal 2"), "")
    enter(page.get_by_role("textbox", name="Target of goal 2"), "1.1")
    enter(page.get_by_role("textbox", name="Tolerance of goal 2"), "0.2")
    page.get_by_label("Bounds of goal 2").select_option("soft")
    page.get_by_label("Goal 3", exact=True).select_option("sensitivity_bound")
    enter(page.get_by_role("textbox", name="At most, goal 3"), "")
    page.get_by_role("textbox", name="Curve above goal 3").fill("1: 2; 1000: 3")
    # What it must serve, and how it is searched for.
    page.get_by_role("textbox", name="Scenarios").fill("motor.mass = 5.5k")
    page.get_by_role("button", name="Add an uncertain range").click()
    page.get_by_label("Uncertain parameter 1").select_option("motor.viscous_friction")
    enter(page.get_by_role("textbox", name="Smallest uncertain motor.viscous_friction"), "100")
    enter(page.get_by_role("textbox", name="Largest uncertain motor.viscous_friction"), "200")
    page.get_by_label("Method", exact=True).select_option("grid")
    enter(page.get_by_role("textbox", name="points"), "3; 2")
    expect(page.get_by_test_id("advice")).to_contain_text("3 × 2 = 6 points")

    asked = body_of(copied(page, "Copy as curl"), service.url)
    peak = {"metric": "peak", "output": "velocity", "target": 1.1, "tolerance": 0.2, "hard": False}
    assert asked == {
        "system": hydraulic,
        "variables": [
            {"parameter": "law.kp", "lower": 0.001, "upper": 0.1, "scale": "log", "start": 0.02},
            {"parameter": "law.kd1", "choices": [1e-5, 2e-5]},
        ],
        "experiments": [
            {"name": "step", "input": {"port": "reference", "signal": {"kind": "step", "amplitude": 1}}},
            {"name": "slowly", "input": {"port": asked["experiments"][1]["input"]["port"], "signal": {"kind": "ramp", "slope": 0.5}}},
        ],
        "goals": [
            {"metric": "response_time", "experiment": "step", "output": "velocity", "sense": "minimize", "weight": 2},
            {**peak, "experiment": "step"},
            {**peak, "experiment": "slowly"},
            {"metric": "sensitivity_bound", "open_at": "error", "bounds": {"upper": [[1, 2], [1000, 3]]}},
        ],
        "scenarios": [{}, {"motor.mass": 5500}],
        "uncertain": [{"parameter": "motor.viscous_friction", "lower": 100, "upper": 200}],
        "method": {"kind": "grid", "points": {"law.kp": 3, "law.kd1": 2}},
    }  # fmt: skip
    # A reload loses nothing; what is dropped is gone.
    page.reload()
    assert body_of(copied(page, "Copy as curl"), service.url) == asked
    page.get_by_role("button", name="motor.viscous_friction is certain").click()
    page.get_by_role("button", name="Remove the experiment slowly").click()
    # The script asks for the same, and runs.
    script = copied(page, "Copy as Python").replace('key="..."', f'key="{KEY}"')
    told: dict = {}
    exec(compile(script, "copied", "exec"), told)  # what the page offers to be run
    told["client"].close()
    assert set(told["result"]["best"]) == {"law.kp", "law.kd1"}
    assert client.get(f"/v1/jobs/{told['job'].id}/request").json()["goals"][1]["target"] == 1.1


def test_what_is_wrong_stands_at_its_field(page: Page, hydraulic) -> None:
    page.goto(f"/systems/{hydraulic}/optimise")
    # By the page itself, before anything is sent.
    page.get_by_role("button", name="More about goal 2").click()
    enter(page.get_by_role("textbox", name="Target of goal 2"), "0.1")
    page.get_by_role("button", name="Start").click()
    goal = page.get_by_role("row").filter(has=page.get_by_label("Goal 2", exact=True))
    expect(goal.get_by_role("alert")).to_have_text("a target stands without other bounds")
    enter(page.get_by_role("textbox", name="At most, goal 2"), "")
    # By the service: a duration that is a mass, of an experiment.
    duration = page.get_by_role("textbox", name="Duration of step")
    enter(duration, "3 kg")
    page.get_by_role("button", name="Start").click()
    expect(page.get_by_test_id("experiments")).to_contain_text("kg")
    expect(duration).to_have_attribute("aria-invalid", "true")
    expect(page.get_by_role("alert")).to_have_count(0)


def test_a_form_begins_with_the_panels_step_and_the_controllers_gains(page: Page, client) -> None:
    system = study(client, "servo-hydraulic-position")
    page.goto(f"/systems/{system}/panel?s=cylinder.mass&in=reference&amp=0.01&loop=controller&g=overshoot<0.2")
    page.locator("[data-testid=plots][data-frame]").wait_for()
    page.get_by_role("link", name="Optimise", exact=True).click()
    expect(page.get_by_role("textbox", name="Amplitude")).to_have_value("0.01")
    for number, name in enumerate(("controller.kp", "controller.integral_time"), start=1):
        expect(page.get_by_label(f"Parameter {number}", exact=True)).to_have_value(name)
    expect(page.get_by_label("Parameter 3", exact=True)).to_have_count(0)
    expect(page.get_by_label("Goal 2", exact=True)).to_have_value("overshoot")
    expect(page.get_by_role("textbox", name="At most, goal 2")).to_have_value("0.2")
    # The effort is bounded by twice what a simulation says that it is now.
    effort = {"system": system, "input": {"port": "reference", "signal": {"kind": "step", "amplitude": 0.01}}, "outputs": ["control"], "metrics": ["control_effort"]}  # fmt: skip
    now = client.post("/v1/simulations", json=effort).json()["variants"][0]["metrics"]["control"]["control_effort"]
    expect(page.get_by_label("Goal 3", exact=True)).to_have_value("control_effort")
    expect(page.get_by_role("textbox", name="At most, goal 3")).to_have_value(f"{2 * now['value']:.3g}")
    # What it begins with is drawn beside it; the edge of a zone is its goal.
    preview = page.get_by_test_id("preview")
    preview.locator("[data-testid=plots][data-frame]").wait_for()
    grip = preview.locator("[data-zone=overshoot]")
    grip.focus()
    page.keyboard.press("ArrowUp")
    expect(page.get_by_role("textbox", name="At most, goal 2")).not_to_have_value("0.2")
    # A system opens as it was left.
    page.goto(f"/systems/{system}/panel")
    expect(page.get_by_role("slider", name="cylinder.mass", exact=True)).to_be_visible()
    expect(page).to_have_url(re.compile("amp=0.01"))


def test_start_with_a_wrong_beginning_leads_to_its_field(page: Page, hydraulic) -> None:
    page.goto(f"/systems/{hydraulic}/optimise")
    page.get_by_role("button", name="More about law.kp").click()
    beginning = page.get_by_role("textbox", name="Beginning of law.kp")
    enter(beginning, "5")
    start = page.get_by_role("button", name="Start")
    start.scroll_into_view_if_needed()
    expect(beginning).not_to_be_in_viewport()
    start.click()
    expect(beginning).to_be_focused()
    expect(beginning).to_be_in_viewport()
    expect(beginning).to_have_attribute("aria-invalid", "true")
    expect(page.get_by_test_id("variables").get_by_role("alert")).to_contain_text("0.1")


def test_a_bar_of_a_tornado_leads_to_its_slider(page: Page, hydraulic, client) -> None:
    page.goto(f"/systems/{hydraulic}/influence?p=law.kp,motor.mass,motor.leakage&m=overshoot,bandwidth&row=bandwidth")
    body = {
        "system": hydraulic, "input": "reference", "output": "velocity",
        "parameters": ["law.kp", "motor.mass", "motor.leakage"], "metrics": ["bandwidth"],
    }  # fmt: skip
    exact = client.post("/v1/influence", json=body).json()["elasticities"]["bandwidth"]
    order = sorted(exact, key=lambda name: -abs(exact[name]["value"]))
    tornado = page.get_by_test_id("tornado")
    expect(tornado.get_by_role("link")).to_have_text(order)
    expect(tornado).to_contain_text(f"{exact[order[1]]['value']:.3g}".replace("-", "−"))
    # The reading stands in the address.
    page.get_by_role("button", name="overshoot").click()
    page.reload()
    expect(tornado.get_by_role("heading", name="What moves the overshoot")).to_be_visible()
    tornado.get_by_role("link", name=order[1]).click()
    expect(page.get_by_role("slider").first).to_have_attribute("aria-label", order[1])
