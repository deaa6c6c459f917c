"""The schema of many nested loops, drawn from an empty canvas by mouse and keyboard, simulated and optimised on the pages."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from tests.browser.drawing import draw, shortest
from tests.browser.driving import ROOT

EXAMPLE = json.loads((ROOT / "examples" / "systems" / "many_loops.json").read_text(encoding="utf-8"))
#: An entry in a unit of the parameter itself with a prefix is kept as the number in SI.
PREFIXES = {"kohm": 1e3, "nF": 1e-9, "GPa": 1e9, "ms": 1e-3}


def plain(system: dict[str, Any]) -> dict[str, Any]:
    """Return what makes a system itself: without notes, with connections in no order and numbers in SI."""
    return {
        "blocks": {
            name: {key: plain(value) if key == "system" else _number(value) for key, value in block.items()}
            for name, block in system["blocks"].items()
        },
        "connections": {shortest(system, wire["to"]): wire["from"] for wire in system["connections"]},
        "outputs": system["outputs"],
        "values": {name: (p["value"], p.get("unit")) for name, p in system.get("parameters", {}).items()},
    }


def _number(value: Any) -> Any:
    if isinstance(value, dict) and value.get("unit") in PREFIXES:
        return float(f"{value['value'] * PREFIXES[value['unit']]:.12g}")
    return value


def test_nested_loops_are_drawn_simulated_and_optimised(page: Page, client) -> None:
    page.goto("/systems")
    page.get_by_role("button", name="New system", exact=True).click()
    page.wait_for_url("**/diagram")
    system = re.search(r"sys_\w+", page.url)[0]  # type: ignore[index]
    page.locator(".react-flow__node").first.wait_for()
    page.locator(".react-flow__pane").click(position={"x": 40, "y": 500})
    page.keyboard.press("Control+a")
    page.keyboard.press("Delete")
    expect(page.get_by_text("An empty diagram")).to_be_visible()
    draw(page, EXAMPLE)
    page.get_by_label("Name", exact=True).fill(EXAMPLE["name"])
    page.get_by_role("button", name="Lay out").click()
    page.keyboard.press("Control+s")
    expect(page.get_by_test_id("check")).to_have_text("saved")
    assert plain(client.get(f"/v1/systems/{system}").json()["document"]) == plain(EXAMPLE)

    # Simulated: the drawn system answers like the example.
    page.get_by_role("link", name="Front panel").click()
    page.locator("[data-testid=plots][data-frame]").wait_for()
    body = {
        "input": {"port": "reference", "signal": {"kind": "step", "amplitude": 0.01}},
        "outputs": ["position"],
        "metrics": ["rise_time", "overshoot"],
        "samples": 100,
    }
    drawn, example = (
        client.post("/v1/simulations", json={"system": one, **body}, timeout=240).json()["variants"][0]
        for one in (system, EXAMPLE)
    )
    for metric in ("rise_time", "overshoot"):
        values = [reply["metrics"]["position"][metric]["value"] for reply in (drawn, example)]
        assert values[0] == pytest.approx(values[1], rel=1e-6)

    # Optimised: what the form proposes, on a small grid.
    page.get_by_role("link", name="Optimise").click()
    page.get_by_label("Method").select_option("grid")
    page.get_by_role("textbox", name="points").fill("2")
    page.get_by_role("textbox", name="points").press("Enter")
    page.get_by_role("button", name="Start").click()
    page.wait_for_url("**/jobs/job_*")
    expect(page.get_by_test_id("optimum")).to_be_visible()
    result = client.get(f"/v1/jobs/{page.url.rsplit('/', 1)[1]}/result").json()
    assert result["goals"][0]["after"]["value"] is not None
