"""Slopes by compiled kernels against the exact path: every metric that the kernels have, candidates far apart.

Full size is `make proof`; otherwise a share of the same candidates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import settings

from bench import inner_velocity_loop, pneumatic_loop, twenty_states
from engine.analysis.study import MetricRequest, measure
from engine.batch.kernels.batch import Batch
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram
from engine.signals import make
from tests.reference.systems import block, system
from tests.reference.systems import pneumatic_loop as loop_with_outputs
from tests.reference.test_batch_kernels import pneumatic_requests

CANDIDATES = 300
SHARE = 8
TOLERANCE = 1e-8
"""Of the largest slope of a metric; 1e-9 where a loop is not stiff, which the benchmark's own loops are not."""
FLOOR = {"steady_state_error": 1.0, "overshoot": 1e-2, "undershoot": 1e-2}
"""Metrics that may vanish, as their slopes do: of a command of size one, what is below has no digits to agree in."""

Array = npt.NDArray[np.float64]


def some(total: int = CANDIDATES) -> int:
    full = settings.get_profile("proof").max_examples
    return total if settings.default.max_examples >= full else SHARE


def worst(diagram: Diagram, requests: Sequence[MetricRequest], candidates: Mapping[str, Array]) -> tuple[float, int]:
    """Return the largest error of any slope by the logarithm of a parameter, and how many metrics were compared."""
    names = list(candidates)
    points = np.stack([candidates[name] for name in names], axis=1)
    found = Batch(diagram, names, requests).slopes(points, points[:, :, None] * np.eye(len(names)))
    error, compared = 0.0, 0
    for row in np.flatnonzero(found.growth < 0):
        exact = measure(
            diagram, requests, overrides=dict(zip(names, points[row].tolist(), strict=True)), gradient=names
        )
        for column, (measured, gradient) in enumerate(exact):
            if found.doubtful[row, column] or measured.value is None or gradient is None:
                continue
            expected = gradient.values * points[row]
            scale = max(float(np.abs(expected).max()), FLOOR.get(requests[column].metric, 0.0))
            miss = float(np.abs(found.slopes[row, column] - expected).max())
            error = max(error, miss / scale if scale else miss)
            compared += 1
    return error, compared


def test_slopes_of_the_inner_velocity_loop() -> None:
    candidates = {name: column[: some()] for name, column in inner_velocity_loop.wide(CANDIDATES, 7).items()}
    error, compared = worst(inner_velocity_loop.diagram(), inner_velocity_loop.requests(), candidates)
    assert error <= TOLERANCE
    assert compared > 5 * some()


@pytest.mark.parametrize("output", ["position", "velocity", "control"])
def test_slopes_of_every_metric(output: str) -> None:
    diagram = loop_with_outputs() if output != "position" else pneumatic_loop.diagram()
    rng = np.random.default_rng(9)
    candidates = {
        name: value * pneumatic_loop.PER_SI * np.exp(rng.uniform(-1.5, 1.5, some()))
        for name, value in pneumatic_loop.GAINS.items()
    }
    error, compared = worst(diagram, pneumatic_requests(output), candidates)
    assert error <= TOLERANCE
    assert compared > 5 * some()


@pytest.mark.parametrize("loop", [inner_velocity_loop, twenty_states], ids=["8 states", "20 states"])
def test_the_benchmarks_own_slopes(loop: object) -> None:
    if loop is inner_velocity_loop:
        diagram, requests = inner_velocity_loop.diagram(), inner_velocity_loop.requests()
        at = {name: np.array([diagram.parameters[name].value]) for name in inner_velocity_loop.PARAMETERS}
    else:
        diagram, requests = twenty_states.diagram(), twenty_states.requests()
        at = {name: np.array([value]) for name, value in twenty_states.PARAMETERS.items()}
    error, compared = worst(diagram, requests, at)
    assert error <= 1e-9
    assert compared >= len(requests) - 1


def test_more_directions_than_lanes_and_ties_between_them() -> None:
    diagram, requests = twenty_states.diagram(), twenty_states.requests()
    overrides = {name: np.array([value, 1.02 * value]) for name, value in twenty_states.PARAMETERS.items()}
    names = list(overrides)
    eye = np.eye(len(names))
    # eleven variables: every parameter alone, then three that move several at once
    together = np.array([[1.0] * len(names), [1.0, -1.0] * (len(names) // 2), [0.0] * len(names)]).T
    directions = {name: np.tile(np.hstack([eye, together])[k], (2, 1)) for k, name in enumerate(names)}
    found = Screening(diagram, requests).slopes(overrides, directions)
    assert found is not None
    alone, tied = found.slopes[:, :, : len(names)], found.slopes[:, :, len(names) :]
    scale = np.abs(alone).max(axis=2, keepdims=True)
    assert np.abs(tied - alone @ together).max() <= 1e-9 * scale.max()
    assert not tied[:, :, 2].any()


def test_a_response_that_jumps_at_once_has_the_slopes_of_its_edge() -> None:
    # y = k (s + z)/(s + p) of a step: k at 0+, k z/p in the end; analytic.
    diagram = system(
        {"u": block("input"), "lead": block("transfer_function", numerator=["=k", "=k*z"], denominator=[1.0, "=p"])},
        ["u -> lead"], {"y": "lead"}, {"k": 2.0, "z": 3.0, "p": 5.0},
    )  # fmt: skip
    requests = [
        MetricRequest(metric=metric, signals={"u": make("step", {})}, output="y")
        for metric in ("peak", "overshoot", "steady_state_error", "settling_time")
    ]
    found = Batch(diagram, ["k", "z", "p"], requests).slopes(np.array([[2.0, 3.0, 5.0]]), np.eye(3)[None])
    k, z, p = 2.0, 3.0, 5.0
    assert found.values[0] == pytest.approx([k, p / z - 1, 1 - k * z / p, np.log((p / z - 1) / 0.02) / p], rel=1e-10)
    assert found.slopes[0, 0] == pytest.approx([1.0, 0.0, 0.0], abs=1e-11)
    assert found.slopes[0, 1] == pytest.approx([0.0, -p / z**2, 1 / z], abs=1e-10)
    assert found.slopes[0, 2] == pytest.approx([-z / p, -k / p, k * z / p**2], rel=1e-10)
    # t = ln((p/z - 1)/0.02)/p
    by_ratio, time = 1 / (p / z - 1) / p, np.log((p / z - 1) / 0.02) / p
    assert found.slopes[0, 3] == pytest.approx([0.0, -by_ratio * p / z**2, by_ratio / z - time / p], abs=1e-10)
