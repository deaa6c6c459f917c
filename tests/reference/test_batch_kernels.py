"""Compiled batches against the exact path: the loops of the benchmark, every metric that the kernels have.

Full size is `make proof`; otherwise a share of the same candidates.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import settings

from bench import inner_velocity_loop, pneumatic_loop
from engine.analysis.study import MetricRequest
from engine.batch.kernels.batch import Batch
from engine.batch.screening import Screened, Screening
from engine.diagram.diagram import Diagram
from engine.model.metric_options import Options
from engine.signals import make
from tests.reference.batch_agreement import compare
from tests.reference.systems import block, system
from tests.reference.systems import pneumatic_loop as loop_with_outputs

CANDIDATES = 2000
SHARE = 60
MOST_DOUBTFUL = 0.01
TIME = (
    "rise_time", "settling_time", "response_time", "overshoot", "undershoot", "peak", "peak_time", "max_velocity",
    "max_acceleration", "control_effort", "steady_state_error",
)  # fmt: skip
LOOP = ("gain_margin", "phase_margin", "delay_margin", "sensitivity_peak", "complementary_peak")
PATH = ("bandwidth", "compliance_peak", "control_sensitivity_peak")


def rows(seed: int) -> list[int]:
    """Return which candidates are held against the exact path."""
    full = settings.get_profile("proof").max_examples
    if settings.default.max_examples >= full:
        return list(range(CANDIDATES))
    return sorted(np.random.default_rng(seed).choice(CANDIDATES, SHARE, replace=False).tolist())


def share_left(screened: Screened) -> float:
    """Return the share of all candidates of which any number is left to the exact path."""
    return float(screened.doubtful.any(axis=1).mean())


def pneumatic_requests(output: str) -> list[MetricRequest]:
    step = {"reference": make("step", {})}
    timed = [
        MetricRequest(metric=metric, signals=step, output=output, options=Options(derivative=0)) for metric in TIME
    ]
    return [
        *(one for one in timed if output != "velocity" or not one.compares),  # a position less a velocity is no error
        *(MetricRequest(metric=metric, open_at="error") for metric in LOOP),
        *(MetricRequest(metric=metric, source="reference", target=output) for metric in PATH),
    ]


@pytest.mark.parametrize("seed", [7, 11])
def test_wide_candidates_of_the_inner_velocity_loop(seed: int) -> None:
    diagram, requests = inner_velocity_loop.diagram(), inner_velocity_loop.requests()
    candidates = inner_velocity_loop.wide(CANDIDATES, seed)
    screened = Screening(diagram, requests)(candidates)
    found = compare(diagram, requests, candidates, screened, rows(seed))
    assert not found.wrong, "\n".join(found.wrong)
    assert found.compared > 400
    assert share_left(screened) <= MOST_DOUBTFUL
    assert not np.isnan(screened.growth[screened.valid]).any()


@pytest.mark.parametrize("row", [1809, 1844], ids=["settling_time", "phase_margin"])
def test_what_the_full_size_found(row: int) -> None:
    diagram, requests = inner_velocity_loop.diagram(), inner_velocity_loop.requests()
    candidates = inner_velocity_loop.wide(CANDIDATES, 7)
    found = compare(diagram, requests, candidates, Screening(diagram, requests)(candidates), [row])
    assert not found.wrong, "\n".join(found.wrong)


def test_the_kernels_alone_are_right_where_they_are_sure() -> None:
    diagram, requests = inner_velocity_loop.diagram(), inner_velocity_loop.requests()
    candidates = inner_velocity_loop.wide(CANDIDATES, 3)
    results = Batch(diagram, tuple(candidates), requests)(np.stack(list(candidates.values()), axis=1))
    screened = Screened(values=results.values, doubtful=results.doubtful, growth=results.growth, valid=results.valid)
    found = compare(diagram, requests, candidates, screened, rows(3))
    assert not found.wrong, "\n".join(found.wrong)
    assert found.share_doubtful < 0.1


@pytest.mark.parametrize("spread", [0.2, 1.5], ids=["near", "wide"])
@pytest.mark.parametrize("output", ["position", "velocity", "control"])
def test_every_metric_of_the_pneumatic_loop(output: str, spread: float) -> None:
    diagram: Diagram = loop_with_outputs() if output != "position" else pneumatic_loop.diagram()
    requests = pneumatic_requests(output)
    rng = np.random.default_rng(9)
    candidates = {
        name: value * pneumatic_loop.PER_SI * np.exp(rng.uniform(-spread, spread, CANDIDATES))
        for name, value in pneumatic_loop.GAINS.items()
    }
    screened = Screening(diagram, requests)(candidates)
    found = compare(diagram, requests, candidates, screened, rows(9)[::3])
    assert not found.wrong, "\n".join(found.wrong)
    assert share_left(screened) <= MOST_DOUBTFUL


def resonant_loop() -> Diagram:
    """PID round a notch, a resonance of 50 rad/s with damping 0.02 and an integrating drive."""
    return system(
        {
            "r": block("input"),
            "error": block("sum", signs="+-"),
            "controller": block("pid", kp="=kp", ki="=ki", kd="=kd", filter_frequency=300.0),
            "resonance": block(
                "transfer_function", numerator=[1.0, "=2*za*wa", "=wa**2"], denominator=[1.0, "=2*z*w", "=w**2"]
            ),
            "drive": block("transfer_function", numerator=[1.0], denominator=[0.05, 1.0, 0.0]),
            "sensor": block("transfer_function", numerator=[1.0], denominator=["=lag", 1.0]),
        },
        [
            "r -> error.in1", "sensor -> error.in2", "error -> controller", "controller -> resonance",
            "resonance -> drive", "drive -> sensor",
        ],
        {"y": "drive", "u": "controller"},
        {"kp": 2.1, "ki": 0.5, "kd": 0.05, "wa": 33.0, "za": 0.02, "w": 50.0, "z": 0.018, "lag": 0.003},
    )  # fmt: skip


def test_a_fast_ripple_on_a_slow_hump() -> None:
    diagram = resonant_loop()
    step = {"r": make("step", {})}
    requests = [MetricRequest(metric=m, signals=step, output="y") for m in ("overshoot", "peak", "peak_time")]
    rng = np.random.default_rng(77)
    candidates = {
        name: diagram.parameters[name].value * np.exp(rng.uniform(-0.1, 0.1, 60))
        for name in ("kp", "ki", "kd", "wa", "za", "w", "z", "lag")
    }
    found = compare(diagram, requests, candidates, Screening(diagram, requests)(candidates))
    assert not found.wrong, "\n".join(found.wrong)
    assert found.share_doubtful < 0.7


def test_the_benchmarks_own_numbers() -> None:
    diagram, requests = inner_velocity_loop.diagram(), inner_velocity_loop.requests()
    points = np.array([[diagram.parameters[name].value for name in inner_velocity_loop.PARAMETERS]])
    found = Batch(diagram, inner_velocity_loop.PARAMETERS, requests)(points)
    assert not found.doubtful.any()
    # mpmath at 50 digits: partial fractions of the closed loop, and the loop itself
    exact = [inner_velocity_loop.EXACT[request.metric] for request in requests]
    assert found.values[0] == pytest.approx(exact, rel=1e-9, abs=1e-10)
