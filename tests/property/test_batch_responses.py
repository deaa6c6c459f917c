"""Whatever the diagram and the command, a number of a batch that is not doubtful is that of the exact path."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.analysis.measuring import MetricRequest, measure
from engine.batch.linear.responses import Responses
from engine.diagram.diagram import Diagram
from engine.model.metric_options import Options
from engine.signals import Signal, make
from tests.property.strategies import Plant, Servo, plants, servos
from tests.property.test_batch_kernels import around, scaled

AUTOMATIC = (
    "overshoot", "undershoot", "peak", "max_velocity", "iae", "ise", "itae", "residual_vibration", "steady_state_error",
    "settling_time", "rise_time",
)  # fmt: skip
WITHIN = ("iae", "ise", "itae", "ie", "peak", "control_effort_rms")
MAY_VANISH = frozenset({"overshoot", "undershoot", "steady_state_error", "ie", "residual_vibration"})
positive = st.floats(0.1, 10.0)
rates = st.floats(0.3, 30.0)


@st.composite
def commands(draw: st.DrawFn) -> Signal:
    kind = draw(st.sampled_from(["step", "trapezoid", "s_curve", "pulse", "sine", "sampled", "shaped"]))
    size = draw(positive)
    numbers: dict[str, dict[str, Any]] = {
        "step": {"amplitude": size, "start": draw(st.sampled_from([0.0, 0.3]))},
        "trapezoid": {"distance": size, "max_velocity": draw(rates), "max_acceleration": draw(rates)},
        "s_curve": {"distance": size, "max_velocity": draw(rates), "max_acceleration": draw(rates), "max_jerk": draw(rates)},
        "pulse": {"amplitude": size, "width": draw(positive)},
        "sine": {"amplitude": size, "frequency": draw(rates)},
        "sampled": {"time": [0.0, 0.2, 0.7, 1.5], "values": [0.0, size, -size, 0.5]},
        "shaped": {"frequency": draw(rates), "command": {"kind": "step", "amplitude": size}},
    }  # fmt: skip
    return make(kind, numbers[kind])


def assert_exact(
    diagram: Diagram, source: str, output: str, command: Signal, candidates: dict[str, np.ndarray], *,
    may_vanish: frozenset[str] = MAY_VANISH, slowest: float = 0.0,
) -> None:  # fmt: skip
    """Hold candidates that decay faster than ``slowest`` (1/s), and unstable ones, against the exact path."""
    signals, options = {source: command}, Options(derivative=0)
    wanted = [MetricRequest(metric=m, signals=signals, output=output, options=options) for m in AUTOMATIC]
    wanted += [MetricRequest(metric=m, signals=signals, output=output, options=options, duration=1.7) for m in WITHIN]
    found = Responses(diagram, wanted, list(candidates))(candidates)
    for row in range(len(found.valid)):
        if -slowest < found.growth[row] < 0.0:
            continue
        exact = measure(diagram, wanted, overrides={name: float(column[row]) for name, column in candidates.items()})
        size = max((abs(m.value) for m, _ in exact if m.value is not None and m.unit == "1"), default=1.0)
        for column, (request, (measured, _)) in enumerate(zip(wanted, exact, strict=True)):
            value = found.values[row, column]
            if found.doubtful[row, column] or found.growth[row] >= 0:
                continue
            if measured.value is None:
                assert not np.isfinite(value), (request, measured)
                continue
            least = 1e-3 * size if request.metric in may_vanish else 0.0
            assert value == pytest.approx(measured.value, rel=1e-9, abs=1e-9 * least), (request, measured)


@given(servos(), commands(), st.floats(0.05, 1.5), st.integers(0, 2**32))
def test_loops(servo: Servo, command: Signal, spread: float, seed: int) -> None:
    candidates = {name: column[:2] for name, column in around(asdict(servo), spread, seed).items()}
    assert_exact(servo.diagram(), "r", "y", command, candidates)


@given(plants(), commands(), st.floats(0.05, 2.0), st.integers(0, 2**32))
def test_plants(plant: Plant, command: Signal, spread: float, seed: int) -> None:
    candidates = {name: column[:2] for name, column in around({"k": 1.0, "t": 1.0}, spread, seed).items()}
    assert_exact(scaled(plant), "u", "y", command, candidates)
