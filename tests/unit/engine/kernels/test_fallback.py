"""What the kernels do not cover is followed by pieces, scanned over frequencies or said to be doubtful, and never wrong."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from engine.analysis.study import MetricRequest, measure
from engine.batch.kernels.batch import Batch, UnsuitableError
from engine.batch.nonlinear.look import METRIC_TOLERANCE
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram
from engine.signals import make
from tests.reference.systems import block, pneumatic_loop, system

STEP = {"r": make("step", {})}
TIMED = [MetricRequest(metric=metric, signals=STEP, output="y") for metric in ("rise_time", "peak")]


def loop(*, dead_time: float | None = None, limited: bool = False, initial: float | str = 0.0) -> Diagram:
    """r -> error -> k -> (limit) -> 1/s -> 1/(0.1 s + 1) -> (delay) -> y, closed."""
    blocks = {
        "r": block("input"), "error": block("sum", signs="+-"), "k": block("gain", gain="=k"),
        "drive": block("integrator", initial=initial),
        "lag": block("transfer_function", numerator=[1.0], denominator=[0.1, 1.0]),
    }  # fmt: skip
    chain = ["error", "k", "drive", "lag"]
    if limited:
        blocks["limit"] = block("saturation")
        chain.insert(2, "limit")
    if dead_time is not None:
        blocks["dead"] = block("delay", time=dead_time)
        chain.append("dead")
    wires = [f"{a} -> {b}" for a, b in pairwise(chain)]
    return system(
        blocks, ["r -> error.in1", f"{chain[-1]} -> error.in2", *wires], {"y": "lag"}, {"k": 2.0, "start": 0.0}
    )


UNSUITABLE = {
    "delay": (loop(dead_time=0.05), ("k",)),
    "nonlinear": (loop(limited=True), ("k",)),
    "from a state": (loop(initial=0.3), ("k",)),
    "from a state that varies": (loop(initial="=start"), ("start",)),
    "no dynamics": (
        system({"r": block("input"), "k": block("gain", gain="=k")}, ["r -> k"], {"y": "k"}, {"k": 2.0}), ("k",)
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", list(UNSUITABLE))
def test_what_is_not_covered_is_still_right(name: str) -> None:
    diagram, varied = UNSUITABLE[name]
    with pytest.raises(UnsuitableError):
        Batch(diagram, varied, TIMED)
    candidates = {path: np.array([1.5, 2.0, 2.5]) for path in varied}
    screened = Screening(diagram, TIMED)(candidates)
    # nonlinear candidates are marched until their metrics agree to METRIC_TOLERANCE
    tolerance = METRIC_TOLERANCE if diagram.nonlinear else 1e-6
    for row in range(3):
        exact = measure(diagram, TIMED, overrides={path: float(v[row]) for path, v in candidates.items()})
        for column, (measured, _) in enumerate(exact):
            assert screened.doubtful[row, column] or screened.values[row, column] == pytest.approx(
                measured.value, rel=tolerance
            )


def test_a_loop_with_a_delay_is_followed_by_pieces() -> None:
    diagram, gains = loop(dead_time=0.05), np.array([1.5, 2.0, 2.5])
    screened = Screening(diagram, TIMED)({"k": gains})
    assert not screened.doubtful.any()
    for row, gain in enumerate(gains):
        exact = measure(diagram, TIMED, overrides={"k": float(gain)})
        assert screened.values[row] == pytest.approx([measured.value for measured, _ in exact], rel=1e-10)


def test_infinitesimals_are_carried_by_pieces() -> None:
    diagram, candidates = loop(), {"k": 2.0 * np.ones(2) * (1 + 1e-30j)}
    screened = Screening(diagram, TIMED)(candidates)
    ((_, gradient), _) = measure(diagram, TIMED, gradient=["k"])
    assert gradient is not None
    assert screened.values[0, 0].imag / 1e-30 == pytest.approx(2.0 * gradient.values[0], rel=1e-5)


def test_metrics_of_both_kinds_in_one_screening() -> None:
    # The integral and the poles are not the kernels': each is asked of whom has it, and nothing is left to the exact path.
    step = {"reference": make("step", {})}
    requests = [MetricRequest(metric=m, signals=step, output="position") for m in ("rise_time", "iae", "overshoot")]
    requests.append(MetricRequest(metric="damping_ratio"))
    diagram, kp = pneumatic_loop(), np.array([0.8e-2, 1e-2, 1.2e-2])
    assert Batch(diagram, ("kp",), requests).measured == (True, False, True, False)
    screened = Screening(diagram, requests)({"kp": kp})
    assert not screened.doubtful.any()
    for row, value in enumerate(kp):
        exact = measure(diagram, requests, overrides={"kp": float(value)})
        assert screened.values[row] == pytest.approx([m.value for m, _ in exact], rel=1e-8)


def test_a_command_that_is_no_step_at_zero_is_not_the_kernels() -> None:
    late = {"r": make("step", {"start": 0.5})}
    requests = [MetricRequest(metric="peak", signals=signals, output="y") for signals in (late, STEP)]
    batch = Batch(loop(), ("k",), requests)
    assert batch.measured == (False, True)
    screened = Screening(loop(), requests)({"k": np.array([2.0])})
    ((first, _), (second, _)) = measure(loop(), requests)
    assert screened.values[0] == pytest.approx([first.value, second.value], rel=1e-6)
