"""A mass with dry friction that creeps behind a slow ramp under an integral part: it sticks, tears loose, and sticks again."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from engine.analysis.study import MetricRequest, measure
from engine.batch.nonlinear.batch import NonlinearBatch
from engine.diagram.diagram import Diagram, compile_system
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document

DURATION, FILTER = 3.0, 800.0


def axis(p: dict[str, float]) -> Diagram:
    blocks = {
        "ref": block("input"), "e": block("sum", signs="+-"),
        "pid": block("pid", kp=p["kp"], ki=p["ki"], kd=p["kd"], filter_frequency=FILTER), "net": block("sum", signs="+-"),
        "rub": block("friction", coulomb=p["coulomb"], static=p["static"]), "v": block("integrator", gain=1 / p["mass"]),
        "x": block("integrator"),
    }  # fmt: skip
    wires = [
        "ref -> e.in1", "e -> pid", "pid -> net.in1", "v -> rub.velocity", "rub -> net.in2", "net -> v", "v -> x",
        "x -> e.in2",
    ]  # fmt: skip
    return compile_system(document(blocks, wires, {"x": "x", "v": "v"}))


def by_hand(p: dict[str, float], slope: float) -> tuple[float, float, int]:
    """Return the largest position, ∫|e| and how often it tears loose: sticking and sliding solved one after the other."""

    def force(t, s):
        e = slope * t - s[0]
        return p["kp"] * e + p["ki"] * s[2] + p["kd"] * FILTER * (e - s[3])

    def rates(mode):
        def f(t, s):
            e = slope * t - s[0]
            push = 0.0 if mode == 0 else (force(t, s) - mode * p["coulomb"]) / p["mass"]
            return [s[1], push, e, FILTER * (e - s[3]), abs(e)]

        return f

    def end_of(mode, begun):
        def sticking(t, s):
            return abs(force(t, s)) - p["static"]

        def sliding(t, s):
            return mode * s[1] if t > begun + 1e-6 else 1.0

        return sticking if mode == 0 else sliding

    mode, t, s, loose, peak, begun = 0, 0.0, np.zeros(5), 0, 0.0, 0.0
    while t < DURATION:
        event = end_of(mode, begun)
        event.terminal, event.direction = True, 1.0 if mode == 0 else -1.0
        found = solve_ivp(
            rates(mode), (t, DURATION), s, method="DOP853", rtol=1e-11, atol=1e-14, events=event, max_step=0.01
        )
        t, s, peak = found.t[-1], found.y[:, -1].copy(), max(peak, found.y[0].max())
        if found.status == 1:
            s[1] = 0.0
            sticks = mode != 0 and abs(force(t, s)) <= p["static"]
            mode = 0 if sticks else int(np.sign(force(t, s)))
            loose, begun = loose + (mode != 0), t
    return peak, float(s[4]), loose


CASES = [
    ({"kp": 1000.0, "ki": 1000.0, "kd": 50.0, "coulomb": 12.0, "static": 12.0, "mass": 8.0}, 0.01),
    ({"kp": 4000.0, "ki": 9000.0, "kd": 260.0, "coulomb": 12.0, "static": 20.0, "mass": 8.0}, 0.004),
    ({"kp": 4000.0, "ki": 9000.0, "kd": 260.0, "coulomb": 12.0, "static": 20.0, "mass": 8.0}, 0.01),
    ({"kp": 2000.0, "ki": 3000.0, "kd": 0.0, "coulomb": 3.0, "static": 4.0, "mass": 8.0}, 0.002),
]


@pytest.mark.parametrize(("numbers", "slope"), CASES)
def test_it_creeps_as_two_equations_solved_in_turn(numbers, slope):
    peak, integral, loose = by_hand(numbers, slope)
    assert loose >= 1
    diagram, command = axis(numbers), {"ref": make("ramp", {"slope": slope})}
    asked = [
        MetricRequest(metric=name, signals=command, output="x", duration=DURATION) for name in ("peak", "iae")
    ]  # fmt: skip
    found = [one for one, _ in measure(diagram, asked)]
    assert {one.verdict for one in found} <= {Verdict.OK, Verdict.INTEGRATING, Verdict.NOT_SETTLED}
    assert found[0].value == pytest.approx(peak, rel=1e-6)
    assert found[1].value == pytest.approx(integral, rel=1e-6)
    batch = NonlinearBatch(diagram, ["pid.kp"], asked)(np.array([[numbers["kp"]]]))
    sure = ~batch.doubtful[0]
    np.testing.assert_allclose(batch.values[0, sure], np.array([peak, integral])[sure], rtol=1e-4)


def test_what_has_never_moved_does_not_jump_by_rounding():
    """Forces of 10 kN that cancel leave 1e-14 of a velocity that is held: no reason to let it go and hold it again."""
    rng = np.random.default_rng(7)
    for _ in range(20):
        size = 10.0 ** rng.uniform(-2, 4)
        numbers = {
            "kp": 100 * size, "ki": 100 * size * rng.uniform(0.1, 3), "kd": 6 * size * rng.uniform(0, 1), "coulomb": size,
            "static": size, "mass": size * rng.uniform(0.1, 2),
        }  # fmt: skip
        command = {"ref": make("ramp", {"slope": rng.uniform(0.001, 0.02)})}
        asked = [MetricRequest(metric="iae", signals=command, output="x", duration=DURATION)]
        (found, _), = measure(axis(numbers), asked)  # fmt: skip
        assert found.value is not None, found.advice
