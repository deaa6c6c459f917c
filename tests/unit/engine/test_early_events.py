"""Laws that switch with the sign of what has only just begun to move: for a while rounding decides, and the run goes on."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from api.convert.systems import diagram_from_wire
from api.schemas.systems import SystemDocument
from engine.analysis.measuring import MetricRequest, measure
from engine.model.verdicts import Verdict
from engine.signals import make

ROOT = Path(__file__).parents[3]
FORCE = 1200.0


def test_a_skyhook_law_is_followed_from_rest_whatever_rounding_makes_of_its_first_moment() -> None:
    """The velocities on which it switches grow with the third and fourth power of the time: nanoseconds after the start nobody knows their signs."""
    robot = json.loads((ROOT / "examples/systems/intelligent_damper.json").read_text())
    heard = ("velocity", "relative_velocity", "force")
    robot["blocks"]["law"] = {
        "kind": "subsystem",
        "system": {
            "name": "skyhook",
            "blocks": {
                **{name: {"kind": "input"} for name in heard},
                "switch": {"kind": "skyhook", "off": 0, "on": 1},
            },
            "connections": [{"from": name, "to": f"switch.{name}"} for name in heard[:2]],
            "outputs": {"current": "switch"},
        },
    }
    diagram = diagram_from_wire(SystemDocument.model_validate(robot))
    peaks = []
    for part in (0.0, 1e-9, -1e-9, 1e-8, -1e-8, 1e-7, -1e-7, 1e-6, -1e-6):
        force = {"amplitude": FORCE * (1 + part), "fundamental": 5.0, "harmonics": list(range(1, 19))}
        asked = MetricRequest(
            metric="peak", signals={"exciter": make("multisine", force)}, output="position", duration=0.4
        )
        ((found, _),) = measure(diagram, [asked])
        assert found.verdict is Verdict.OK, found.advice
        peaks.append(found.value / (1 + part))
    assert peaks == pytest.approx([peaks[0]] * len(peaks), rel=1e-6)
