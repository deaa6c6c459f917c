"""Two measurements that share no code agree wherever both have a value."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.model.masks import Corners, Envelope, FrequencyBounds, Polyline
from optimizers.evaluation.measuring import measured
from optimizers.independent_check import witnessed
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable
from tests.property.test_optimizers import SERVOS, STEP

TIMED = (
    "rise_time", "settling_time", "response_time", "overshoot", "undershoot", "peak", "iae", "ie", "ise", "itae",
)  # fmt: skip
LOOPS = ("sensitivity_peak", "complementary_peak", "gain_margin", "phase_margin", "delay_margin")
GOALS = (
    *(Goal(metric=m, experiment="step", output="y", sense=Sense.MINIMIZE) for m in TIMED),
    *(Goal(metric=m, open_at="error", sense=Sense.MINIMIZE) for m in LOOPS),
    Goal(metric="bandwidth", source="u", target="y", sense=Sense.MINIMIZE),
    Goal(
        metric="envelope", experiment="step", output="y",
        mask=Envelope(upper=Polyline(times=(0, 2, 2, 9), values=(1.5, 1.2, 1.1, 1.02)), lower=Polyline(times=(3, 20), values=(0, 1))),
    ),
    Goal(metric="tracking_error", experiment="step", output="y", sense=Sense.MINIMIZE, mask=Polyline(times=(0, 1, 30), values=(0, 1, 1))),
    Goal(
        metric="sensitivity_bound", open_at="error",
        mask=FrequencyBounds(upper=Corners(frequencies=(0.01, 1.0, 50.0), magnitudes=(0.05, 1.4, 1.4))),
    ),
)  # fmt: skip


@settings(max_examples=8, deadline=None)
@given(
    delay=st.sampled_from(sorted(SERVOS)),
    gain=st.floats(0.3, 2.5),
    corner=st.floats(5.0, 80.0),
    damping=st.floats(0.4, 1.5),
)
def test_two_measurements_agree(delay, gain, corner, damping) -> None:
    problem = Problem(
        diagram=SERVOS[delay],
        variables=tuple(Variable(parameter=name, lower=0.01, upper=100.0) for name in ("k", "w", "z")),
        experiments=(Experiment(name="step", signals=STEP),),
        goals=GOALS,
    )
    values = {"k": gain, "w": corner, "z": damping}
    for goal, (exact, _), second in zip(
        GOALS, measured(problem, values, {}), witnessed(problem, values, {}), strict=True
    ):
        assert second is not None, goal.metric
        if exact.value is None:
            assert math.isinf(second.value), goal.metric
        else:
            assert second.value == pytest.approx(exact.value, rel=1e-7, abs=1e-9), goal.metric
