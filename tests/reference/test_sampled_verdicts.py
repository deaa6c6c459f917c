"""Verdicts at 0.99 and 1.01 of every margin of seven axes: gain up and down, phase and delay, at both loops."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from engine.analysis.evaluation import Evaluation
from engine.analysis.measuring import MetricRequest, measure
from engine.diagram.diagram import Diagram, compile_system
from engine.model.verdicts import Verdict
from tests.reference.test_sampled_loops import AXES, Axis
from tests.unit.engine.diagrams import block, document


@pytest.mark.parametrize("axis", AXES)
def test_verdicts_on_either_side_of_a_margin(axis):
    for place, factor, names in (("e", "k_position", ("position.kp",)), ("f", "k_speed", ("speed.kp", "speed.ki"))):
        up = measure(axis.diagram, [MetricRequest(metric="gain_margin_up", open_at=place)])[0][0].value
        for part, verdict in ((0.99, Verdict.OK), (1.01, Verdict.UNSTABLE)):
            moved = {name: part * up * axis.diagram.parameters[name].value for name in names}
            assert Evaluation(axis.diagram, moved).poles.verdict is verdict
            assert (axis.radius(**{factor: part * up}) > 1) is (verdict is Verdict.UNSTABLE)


@pytest.mark.parametrize("axis", AXES)
def test_on_either_side_of_a_phase_margin(axis):
    for place, factor in (("e", "k_position"), ("f", "k_speed")):
        phase = measure(axis.diagram, [MetricRequest(metric="phase_margin", open_at=place)])[0][0].value
        for part, stable in ((0.99, True), (1.01, False)):
            assert (axis.radius(**{factor: np.exp(-1j * part * abs(phase))}) < 1) is stable


def loosened(axis: Axis, place: str) -> Diagram:
    """Return an axis with a delay behind one of its controllers."""
    made = axis.diagram
    wires = [f"{'way' if c.source == place else c.source} -> {c.target}" for c in made.system.connections]
    blocks = dict(made.system.blocks) | {"way": block("delay", time=1e-3)}
    return compile_system(document(blocks, [*wires, f"{place} -> way"], {"y": "axis.load_angle"}))


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("place", ["position", "speed"])
def test_on_either_side_of_a_delay_margin(axis, place):
    delay = measure(axis.diagram, [MetricRequest(metric="delay_margin", open_at=place)])[0][0].value
    later = loosened(axis, place)
    for part, verdict in ((0.99, Verdict.OK), (1.01, Verdict.UNSTABLE)):
        more = Fraction(part * delay * 1000)
        assert (axis.radius(**{f"later_{place}": more}) < 1) is (verdict is Verdict.OK)
        assert Evaluation(later, {"way.time": part * delay}).poles.verdict is verdict
    if place == "speed":  # what the position loop writes counts at samples alone: its margin is a step
        assert axis.radius(later_speed=Fraction(delay * 1000)) == pytest.approx(1, abs=1e-10)


@pytest.mark.parametrize("axis", AXES)
def test_verdicts_on_either_side_of_a_lower_gain_margin(axis):
    for place, factor, names in (("e", "k_position", ("position.kp",)), ("f", "k_speed", ("speed.kp", "speed.ki"))):
        down = measure(axis.diagram, [MetricRequest(metric="gain_margin_down", open_at=place)])[0][0].value
        for part, verdict in ((0.99, Verdict.UNSTABLE), (1.01, Verdict.OK)) if down else ():
            moved = {name: part * down * axis.diagram.parameters[name].value for name in names}
            assert Evaluation(axis.diagram, moved).poles.verdict is verdict
            assert (axis.radius(**{factor: part * down}) > 1) is (verdict is Verdict.UNSTABLE)
