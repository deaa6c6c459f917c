"""What a window says of an output that has not settled in it: a value relative to its last one, and how far the rest may change it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

from engine.analysis.measuring import MetricRequest, measure
from engine.analysis.study import simulate
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram, compile_system
from engine.model.verdicts import Measured, Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document

STEP = {"r": make("step", {})}
WINDOW = 1.0
OF_THE_END = (
    "rise_time", "settling_time", "response_time", "overshoot", "undershoot", "steady_state_error", "residual_vibration",
)  # fmt: skip


def lag(frequency: float = 0.0) -> Diagram:
    """A lag of 1 s behind a limit that the step does not reach; with a frequency, a swing that decays with e^(-t/2) instead."""
    denominator = [1.0, 1.0, 0.25 + frequency**2] if frequency else [1.0, 1.0]
    blocks = {
        "r": block("input"), "s": block("saturation", upper=2.0),
        "p": block("transfer_function", numerator=["=gain*1"], denominator=denominator),
    }  # fmt: skip
    return compile_system(document(blocks, ["r -> s", "s -> p"], {"y": "p"}, gain=denominator[-1]))


def pendulum() -> Diagram:
    """x'' = -x + sat(r): 1 - cos t for ever."""
    blocks = {
        "r": block("input"), "s": block("saturation", upper=2.0),
        "p": block("transfer_function", numerator=[1.0], denominator=[1.0, 0.0, 1.0]),
    }  # fmt: skip
    return compile_system(document(blocks, ["r -> s", "s -> p"], {"y": "p"}))


def found(diagram: Diagram, duration: float, signals: Mapping = STEP, **more) -> dict[str, Measured]:
    requests = [
        MetricRequest(metric=m, signals=signals, output="y", duration=duration, **more) for m in (*OF_THE_END, "iae")
    ]
    return {r.metric: m for r, (m, _) in zip(requests, measure(diagram, requests), strict=True)}


def test_the_last_value_is_taken_for_the_final_one():
    """y = 1 - e^-t ends at y(1); level p of the way is passed at -ln(1 - p y(1)), the error that is left is e^-1."""
    metrics = found(lag(), WINDOW)
    last = 1 - math.exp(-WINDOW)
    expected = {
        "rise_time": math.log(1 - 0.1 * last) - math.log(1 - 0.9 * last),
        "settling_time": -math.log(1 - 0.98 * last),
        "response_time": -math.log(1 - 0.95 * last),
        "overshoot": 0.0,
        "undershoot": 0.0,
        "steady_state_error": math.exp(-WINDOW),
        "residual_vibration": last / 2,
    }
    for name, value in expected.items():
        assert metrics[name].value == pytest.approx(value, rel=1e-9, abs=1e-12), name
        assert (metrics[name].verdict, metrics[name].settled_from) == (Verdict.NOT_SETTLED, "last_sample"), name
    assert (metrics["iae"].verdict, metrics["iae"].settled_from) == (Verdict.OK, "")


def test_the_doubt_is_what_the_rest_changes():
    """The rest is e^-1, all of it upwards: then nothing is left of the error, and the swing is half of the whole way."""
    metrics = found(lag(), WINDOW)
    assert metrics["steady_state_error"].doubt == pytest.approx(math.exp(-WINDOW), rel=1e-9)
    assert metrics["residual_vibration"].doubt == pytest.approx(math.exp(-WINDOW) / 2, rel=1e-9)
    assert metrics["overshoot"].doubt == 0.0
    assert metrics["rise_time"].doubt is None  # 90 % of the whole way lies beyond the window


def test_the_doubt_of_a_swing_covers_where_it_ends():
    """1 - e^(-t/2) (cos wt + sin wt / 2w) ends at 1."""
    metrics = found(lag(6.0), 5.0)
    error = metrics["steady_state_error"]
    assert abs(error.value) <= error.doubt <= 0.5
    exact = found(lag(6.0), 60.0)["overshoot"]
    assert exact.verdict is Verdict.OK
    assert abs(metrics["overshoot"].value - exact.value) <= metrics["overshoot"].doubt <= 0.7


def test_what_swings_for_ever_stays_within_its_swing():
    """Of 1 - cos t half the swing is 1, and so is the distance from any value to the middle at most."""
    metrics = found(pendulum(), 30.0)
    assert metrics["residual_vibration"].value == pytest.approx(1.0, rel=1e-9)
    assert metrics["steady_state_error"].value == pytest.approx(math.cos(30.0), abs=1e-9)
    assert metrics["steady_state_error"].doubt == pytest.approx(2.0, rel=1e-2)


def test_a_window_that_ends_before_its_command_does():
    ramp = {"r": make("trapezoid", {"distance": 1.0, "max_velocity": 0.5, "max_acceleration": 1.0})}
    metrics = found(lag(), WINDOW, ramp)
    for name in OF_THE_END:
        assert (metrics[name].value, metrics[name].verdict) == (None, Verdict.TOO_SHORT), name


def test_who_wants_settled_values_only_has_none():
    for name, measured in found(lag(), WINDOW, unsettled=False).items():
        if name in OF_THE_END:
            assert (measured.value, measured.verdict) == (None, Verdict.NOT_SETTLED), name
        else:
            assert measured.verdict is Verdict.OK


def test_its_derivative_is_that_of_the_window():
    request = MetricRequest(metric="steady_state_error", signals=STEP, output="y", duration=WINDOW)
    ((_, gradient),) = measure(lag(), [request], gradient=["gain"])
    assert gradient.values == pytest.approx([math.exp(-WINDOW) - 1], rel=1e-9)


@pytest.mark.parametrize("unsettled", [True, False])
def test_many_candidates_are_screened_to_the_same(unsettled):
    gains = np.array([0.5, 1.0, 1.7])
    requests = [
        MetricRequest(metric=m, signals=STEP, output="y", duration=WINDOW, unsettled=unsettled) for m in OF_THE_END[:-1]
    ]
    screened = Screening(lag(), requests)({"gain": gains})
    assert not screened.doubtful.any()
    for gain, row in zip(gains, screened.values, strict=True):
        exact = [m.value for m, _ in measure(lag(), requests, overrides={"gain": gain})]
        np.testing.assert_allclose(row, np.array(exact, dtype=float), rtol=1e-4, atol=1e-9)


def test_a_stuck_axis_has_settled():
    """1 N against 5 N of dry friction: a force is a disturbance of a position, which no force is compared with."""
    blocks = {
        "r": block("input", role="disturbance"), "n": block("sum", signs="+-"), "f": block("friction", coulomb=5.0),
        "m": block("mass_spring_damper", mass=1.0, stiffness=0.0, damping=0.0),
    }  # fmt: skip
    made = compile_system(
        document(blocks, ["r -> n.in1", "f -> n.in2", "n -> m", "m.velocity -> f"], {"y": "m.position"})
    )
    metrics = simulate(made, signals=STEP, duration=1.0).metrics["y"]
    assert metrics["steady_state_error"].value == 0.0
    assert metrics["steady_state_error"].verdict is Verdict.OK
    assert {m.verdict for m in metrics.values()} <= {
        Verdict.OK,
        Verdict.ZERO_STATIC_GAIN,
        Verdict.NEVER_CROSSES,
        Verdict.DIVERGES,
    }
