"""What holds for every problem: fast and exact agree, bounds are kept, the ranking never prefers a broken goal."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.analysis.study import MetricRequest, measure
from engine.batch.screening import Screening
from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.signals import make
from optimizers.evaluation.certificate import TOLERANCE
from optimizers.evaluation.constraint_violation import signed_excess
from optimizers.evaluation.evaluate import Assessment, Evaluator
from optimizers.problem import Axis, Experiment, Goal, Problem, Sense, Variable

STEP = {"u": make("step", {})}
REQUESTS = [
    *(
        MetricRequest(metric=m, signals=STEP, output="y")
        for m in ("rise_time", "settling_time", "overshoot", "peak", "iae")
    ),
    MetricRequest(metric="sensitivity_peak", open_at="error"),
    MetricRequest(metric="bandwidth", source="u", target="y"),
]


def servo(*, delay: float) -> Diagram:
    """Gain, second-order valve, integrator and transport delay in a loop, scaled to an integrator of 1/s."""
    return compile_system(
        System(
            parameters={"k": Parameter(value=0.5), "w": Parameter(value=20.0), "z": Parameter(value=0.7)},
            blocks={
                "u": Block(kind="input"),
                "error": Block(kind="sum", values={"signs": "+-"}),
                "gain": Block(kind="gain", values={"gain": "=k"}),
                "valve": Block(kind="transfer_function", values={"numerator": ["=w*w"], "denominator": [1.0, "=2*z*w", "=w*w"]}),
                "cylinder": Block(kind="integrator"),
                "transport": Block(kind="delay", values={"time": delay}),
            },
            connections=tuple(
                Connection(source=a, target=b)
                for a, b in (
                    ("u", "error.in1"), ("transport", "error.in2"), ("error", "gain"),
                    ("gain", "valve"), ("valve", "cylinder"), ("cylinder", "transport"),
                )
            ),
            outputs={"y": "cylinder"},
        )
    )  # fmt: skip


SERVOS = {0.0: servo(delay=0.0), 0.3: servo(delay=0.3)}


@settings(max_examples=15, deadline=None)
@given(
    delay=st.sampled_from(sorted(SERVOS)),
    gain=st.floats(0.3, 2.5),
    corner=st.floats(5.0, 80.0),
    damping=st.floats(0.4, 1.5),
)
def test_screening_agrees_with_the_exact_path(delay, gain, corner, damping) -> None:
    diagram = SERVOS[delay]
    point = {"k": gain, "w": corner, "z": damping}
    screened = Screening(diagram, REQUESTS)({name: np.array([value]) for name, value in point.items()})
    exact = [measured for measured, _ in measure(diagram, REQUESTS, overrides=point)]
    assert screened.valid[0]
    assert screened.growth[0] < 0
    for column, measured in enumerate(exact):
        if not screened.doubtful[0, column]:
            assert measured.value is not None
            assert screened.values[0, column] == pytest.approx(measured.value, rel=1e-6, abs=1e-9)


@settings(max_examples=50, deadline=None)
@given(ends=st.tuples(st.floats(1e-6, 1e3), st.floats(1.001, 1e6)), position=st.floats(-1.0, 2.0), log=st.booleans())
def test_a_position_never_leaves_the_bounds(ends, position, log) -> None:
    lower, upper = ends[0], ends[0] * ends[1]
    axis = Axis(parameter="p", lower=lower, upper=upper, start=lower, log=log)
    value = float(axis.value(position))
    assert lower <= value <= upper
    assert float(axis.value(axis.position(value))) == pytest.approx(value, rel=1e-9, abs=1e-9 * (upper - lower))


@settings(max_examples=50, deadline=None)
@given(points=st.lists(st.tuples(st.floats(-10, 10), st.floats(0, 2)), min_size=1, max_size=8))
def test_the_ranking_puts_met_goals_first(points) -> None:
    objective, violation = (np.array(column) for column in zip(*points, strict=True))
    found = Assessment(
        objective=objective,
        violation=violation,
        values=np.zeros((len(points), 1, 1)),
        doubtful=np.zeros(len(points), dtype=bool),
    )
    best = int(found.order()[0])
    if (violation <= TOLERANCE).any():
        assert violation[best] <= TOLERANCE
        assert objective[best] == objective[violation <= TOLERANCE].min()
    else:
        assert violation[best] == violation.min()


@settings(max_examples=50, deadline=None)
@given(value=st.floats(-100, 100), bound=st.floats(-100, 100), factor=st.floats(0.01, 100))
def test_a_violation_does_not_depend_on_the_unit(value, bound, factor) -> None:
    if abs(bound) < 1e-3:
        return
    for goal, scaled in (
        (Goal(metric="peak", upper=bound), Goal(metric="peak", upper=bound * factor)),
        (Goal(metric="peak", lower=bound), Goal(metric="peak", lower=bound * factor)),
    ):
        plain = signed_excess(goal, np.array(value))
        assert signed_excess(scaled, np.array(value * factor)) == pytest.approx(plain, rel=1e-9, abs=1e-9)


@settings(max_examples=10, deadline=None)
@given(position=st.tuples(st.floats(0.05, 0.95), st.floats(0.05, 0.95)), delay=st.sampled_from(sorted(SERVOS)))
def test_slopes_are_the_limit_of_differences(position, delay) -> None:
    problem = Problem(
        diagram=SERVOS[delay],
        variables=(
            Variable(parameter="k", lower=0.3, upper=2.0, scale="log"),
            Variable(parameter="w", lower=10.0, upper=60.0),
        ),
        experiments=(Experiment(name="step", signals=STEP),),
        goals=(
            Goal(metric="rise_time", experiment="step", output="y", sense=Sense.MINIMIZE),
            Goal(metric="sensitivity_peak", open_at="error", upper=1.6),
        ),
        scenarios=({}, {"z": 0.9}),
    )
    evaluator = Evaluator(problem)
    x = np.array(position)
    local = evaluator.local(x)
    assert local is not None
    for v in range(2):
        step = np.zeros(2)
        step[v] = 1e-5
        both = evaluator.assess(np.array([x + step, x - step])).values
        assert (both[0] - both[1]) / 2e-5 == pytest.approx(local.slopes[:, :, v], rel=1e-4, abs=1e-5)
