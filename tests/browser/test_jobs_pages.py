"""Jobs: followed while they run, listed, cancelled, taken away; an optimum understood on its map, proven, and kept."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from tests.browser.places import until
from tests.browser.test_panel import study

_STEP = {"name": "step", "input": {"port": "reference", "signal": {"kind": "step", "amplitude": 0.1}}}
_QUICK = {"metric": "response_time", "experiment": "step", "output": "velocity", "sense": "minimize"}
_SWIFT = {**_QUICK, "metric": "rise_time"}
_CALM = {"metric": "overshoot", "experiment": "step", "output": "velocity"}
_GAIN = {"parameter": "law.kp", "lower": 0.001, "upper": 0.1}
_LEAKAGE = {"parameter": "motor.leakage", "lower": 1e-11, "upper": 1e-9}
#: Of the map's picture: what lies around its cells, in pixels (left, right, top, bottom).
_AROUND = (76, 116, 20, 48)


@pytest.fixture(scope="module")
def hydraulic(client) -> str:
    return study(client, "hydraulic-velocity")


def asked(client, system: str, **more: Any) -> str:
    body = {"system": system, "variables": [_GAIN, _LEAKAGE], "experiments": [_STEP], **more}
    reply = client.post("/v1/optimizations", json=body)
    assert reply.status_code == 202, reply.text
    return str(reply.json()["id"])


@pytest.fixture(scope="module")
def mapped(client, hydraulic) -> str:
    grid = {"kind": "grid", "points": 4}
    return asked(client, hydraulic, goals=[_QUICK, {**_CALM, "upper": 0.3}], method=grid)


@pytest.fixture(scope="module")
def fronted(client, hydraulic) -> str:
    pareto = {"kind": "pareto", "points": 4, "population": 16, "generations": 2}
    return asked(client, hydraulic, goals=[_QUICK, {**_CALM, "sense": "minimize"}], method=pareto)


def test_a_search_is_watched_while_it_runs_and_cancelled_in_the_list(page: Page, client, hydraulic) -> None:
    endless = {"kind": "global", "restarts": 20, "population": 500, "max_evaluations": 100_000_000}
    job = asked(client, hydraulic, goals=[_QUICK, {**_CALM, "upper": 0.05}], method=endless)
    page.goto(f"/jobs/{job}")
    # The best point so far, as it gets better: points come long before the end.
    convergence = page.get_by_test_id("convergence")
    expect(convergence).to_have_attribute("data-points", re.compile(r"^([3-9]|\d\d+)$"))
    assert client.get(f"/v1/jobs/{job}").json()["status"] == "running"
    expect(page.get_by_text(re.compile(r"best after \d+ evaluations")).first).to_be_visible()
    # Whose it is, how long it has been at it, and what it has found until now, with its curves.
    expect(page.get_by_test_id("of-system")).to_have_attribute("href", f"/systems/{hydraulic}/panel")
    expect(page.get_by_test_id("clock")).to_contain_text(re.compile(r"running for \d+:\d\d"))
    expect(page.get_by_test_id("best-so-far").get_by_test_id("values")).to_contain_text("law.kp = ")
    expect(page.get_by_test_id("best-so-far").locator("[data-testid=plots][data-frame]")).to_be_visible()
    page.goto("/jobs?status=running")
    page.get_by_role("button", name=f"Cancel {job}").click()
    expect(page.get_by_role("button", name=f"Cancel {job}")).to_have_count(0)
    page.get_by_label("Status").select_option("cancelled")
    expect(page).to_have_url(re.compile(r"status=cancelled"))
    expect(page.locator(f"a[href='/jobs/{job}']")).to_be_visible()
    # What had been found is kept.
    page.goto(f"/jobs/{job}")
    expect(page.get_by_test_id("optimum").get_by_test_id("values")).to_contain_text("law.kp = ")


def test_a_value_at_an_end_of_its_range_is_marked(page: Page, client, hydraulic) -> None:
    # What is quickest lies at the largest gain: the range decides.
    narrow = {"parameter": "law.kp", "lower": 0.001, "upper": 0.002}
    job = asked(client, hydraulic, variables=[narrow], goals=[_SWIFT], method={"kind": "grid", "points": 3})
    page.goto(f"/jobs/{job}")
    expect(page.get_by_test_id("values").locator("[data-end=upper]")).to_have_text(
        re.compile("law.kp = 0.002 · at the upper end of its range")
    )


def test_a_cell_of_a_map_is_hovered_clicked_and_moved(page: Page, client, mapped) -> None:
    page.goto(f"/jobs/{mapped}")
    shown = page.get_by_test_id("map")
    expect(shown).to_be_visible()
    result = client.get(f"/v1/jobs/{mapped}/result").json()
    gains, leakages = result["map"]["axes"].values()
    picture = shown.get_by_role("img", name="Map of the objective")
    picture.locator("svg").wait_for()
    picture.scroll_into_view_if_needed()
    left, right, top, bottom = _AROUND

    def cell() -> tuple[float, float]:
        """Where the cell is now: what comes above the map moves it."""
        box = picture.bounding_box()
        assert box is not None
        x = box["x"] + left + (box["width"] - left - right) * 1.5 / len(gains)
        return x, box["y"] + top + (box["height"] - top - bottom) * (1 - 2.5 / len(leakages))

    def hovered() -> bool:
        x, y = cell()
        page.mouse.move(x - 1, y)
        page.mouse.move(x, y)
        return f"law.kp = {gains[1]:.4g}" in (picture.locator("svg").text_content() or "")

    until(hovered)
    page.mouse.click(*cell())
    expect(page).to_have_url(re.compile(r"cell=1%2C2"))
    # Its metric is computed by the service as it is looked at.
    request = client.get(f"/v1/jobs/{mapped}/request").json()
    body = {
        "system": request["system"], "input": _STEP["input"],
        "variants": [{"law.kp": gains[1], "motor.leakage": leakages[2]}],
    }  # fmt: skip
    exact = client.post("/v1/simulations", json=body).json()["variants"][0]["metrics"]["velocity"]
    expect(page.get_by_test_id("between").first).to_contain_text(f"{1e3 * exact['response_time']['value']:.4g} ms")
    objective = result["map"]["objective"][1 * len(leakages) + 2]
    expect(shown.get_by_test_id("cell")).to_contain_text(f"objective {objective:.4g}")
    # Without a mouse: sliders move the cell; a reload keeps it.
    shown.get_by_role("slider", name="Place of law.kp on the map").focus()
    page.keyboard.press("ArrowLeft")
    expect(page).to_have_url(re.compile(r"cell=0%2C2"))
    page.reload()
    expect(page.get_by_test_id("optimum")).to_contain_text(f"law.kp = {gains[0]:.5g}")
    page.get_by_role("button", name="Back to the best").click()
    expect(page).not_to_have_url(re.compile(r"cell="))


def test_the_axes_of_a_front_are_chosen_and_stand_in_the_address(page: Page, fronted) -> None:
    page.goto(f"/jobs/{fronted}")
    front = page.get_by_test_id("front")
    across, upwards = (front.get_by_role("combobox", name=name) for name in ("Across", "Upwards"))
    expect(across).to_have_value("0")
    plane, parallel = (
        front.get_by_role("img", name=name) for name in ("Points of the front", "Every point of the front")
    )
    expect(parallel).to_contain_text("law.kp")

    def lower() -> str:
        """The name of the axis that lies under the picture."""
        names = plane.locator("text", has_text=re.compile("response time|overshoot"))
        expect(names).to_have_count(2)
        boxes = [(one.bounding_box(), one.text_content() or "") for one in names.all()]
        return max((box["y"], text) for box, text in boxes if box is not None)[1]

    until(lambda: lower() == "response time [s]")
    # What went upwards goes across, and the other way round.
    across.select_option(label="overshoot")
    expect(upwards).to_have_value("0")
    until(lambda: lower() == "overshoot [%]")
    expect(page).to_have_url(re.compile("fx=1.*fy=0"))
    page.reload()
    expect(across).to_have_value("1")
    expect(parallel).to_contain_text("motor.leakage")


def test_the_optimum_is_proven_opened_on_the_panel_and_kept(page: Page, client, mapped, hydraulic) -> None:
    page.goto(f"/jobs/{mapped}")
    certificate = page.get_by_test_id("certificate")
    expect(certificate).to_have_attribute("data-valid", "true")
    certificate.get_by_text("The proof, goal by goal").click()
    result = client.get(f"/v1/jobs/{mapped}/result").json()
    proof = result["certificate"]["goals"]
    rows = page.get_by_test_id("proof").get_by_role("row")
    expect(rows).to_have_count(1 + len(proof))
    expect(rows.nth(2)).to_contain_text(f"{100 * proof[1]['value']:.4g} %")
    best = result["best"]
    elasticity = result["goals"][0]["elasticities"]["law.kp"]
    expect(page.get_by_test_id("elasticities").get_by_role("row").nth(1)).to_contain_text(
        f"{elasticity:.3g}".replace("-", "−")
    )
    page.get_by_role("link", name="Open on the panel").click()
    page.locator("[data-testid=plots][data-frame]").wait_for()
    expect(page.get_by_role("textbox", name="Value of law.kp")).to_have_value(f"{best['law.kp']:.6g}")
    page.go_back()
    page.get_by_role("button", name="Save as revision").click()
    page.wait_for_url("**/revisions")
    assert client.get(f"/v1/systems/{hydraulic}").json()["revision"] == 2
    kept = client.post("/v1/simulations", json={"system": hydraulic, "input": _STEP["input"]}).json()["variants"][0]
    after = result["goals"][1]["after"]["value"]
    assert kept["metrics"]["velocity"]["overshoot"]["value"] == pytest.approx(after, rel=1e-9)


def test_jobs_are_filtered_paged_and_their_results_taken_away(page: Page, client, mapped, fronted) -> None:
    # Pages of one job each, by the service itself.
    page.route("**/v1/jobs?*", lambda route: route.continue_(url=re.sub(r"limit=\d+", "limit=1", route.request.url)))
    page.goto("/jobs")
    listed = page.get_by_test_id("jobs").get_by_role("row")
    expect(listed).to_have_count(2)
    page.get_by_role("button", name="Show more").click()
    expect(listed).to_have_count(3)
    page.unroute("**/v1/jobs?*")
    page.get_by_label("Kind").select_option("preview")
    page.get_by_label("Status").select_option("cancelled")
    expect(page.get_by_role("heading", name="No such jobs")).to_be_visible()
    expect(page).to_have_url(re.compile(r"kind=preview.*status=cancelled|status=cancelled.*kind=preview"))
    page.goto("/jobs?kind=optimization&status=succeeded")
    expect(page.get_by_label("Kind")).to_have_value("optimization")
    with page.expect_download() as taken:
        page.get_by_role("link", name=f"Result of {mapped}").click()
    assert taken.value.suggested_filename == f"{mapped}.json"
    result = json.loads(Path(taken.value.path()).read_text(encoding="utf-8"))
    assert result == client.get(f"/v1/jobs/{mapped}/result").json()
