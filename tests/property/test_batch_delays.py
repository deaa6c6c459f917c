"""Whatever the loop and its delays, a number of a batch that is not doubtful is that of the exact path, and so are its slopes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.analysis.measuring import MetricRequest, measure
from engine.batch.linear.responses import Responses
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram
from engine.model.metric_options import Options
from engine.signals import Signal, make
from tests.property.strategies import Plant, plants
from tests.property.test_batch_kernels import around
from tests.property.test_batch_responses import MAY_VANISH, assert_exact, commands
from tests.reference.systems import block, system

SLOWEST = 0.1
"""1/s: the exact path follows what decays more slowly over thousands of pieces, for minutes."""

delays = st.floats(-1.2, 0.3).map(lambda exponent: 10.0**exponent)


@dataclass(frozen=True)
class Delayed:
    """A PI loop round a random plant, with a delay before it and, of another length, in its sensor."""

    plant: Plant
    gain: float
    forward: float
    back: float | None

    def diagram(self) -> Diagram:
        numerator, denominator = self.plant.polynomials()
        size = abs(numerator[-1]) or 1.0
        blocks = {
            "r": block("input"), "error": block("sum", signs="+-"),
            "controller": block("pi", kp="=gain", ki="=gain"), "line": block("delay", time="=forward"),
            "plant": block("transfer_function", numerator=[n / size for n in numerator], denominator=denominator),
        }  # fmt: skip
        wires = ["r -> error.in1", "error -> controller", "controller -> line", "line -> plant"]
        numbers = {"gain": self.gain, "forward": self.forward}
        if self.back is None:
            wires.append("plant -> error.in2")
        else:
            blocks["sensor"] = block("delay", time="=back")
            wires += ["plant -> sensor", "sensor -> error.in2"]
            numbers["back"] = self.back
        return system(blocks, wires, {"y": "plant", "control": "controller", "late": "line"}, numbers)

    def around(self, spread: float, seed: int) -> dict[str, np.ndarray]:
        values = {"gain": self.gain, "forward": self.forward} | ({} if self.back is None else {"back": self.back})
        return {name: column[:2] for name, column in around(values, spread, seed).items()}


@st.composite
def loops(draw: st.DrawFn) -> Delayed:
    return Delayed(draw(plants()), 10.0 ** draw(st.floats(-1.5, 0.5)), draw(delays), draw(st.one_of(st.none(), delays)))


@given(loops(), commands(), st.floats(0.05, 1.0), st.integers(0, 2**32))
def test_delayed_loops(loop: Delayed, command: Signal, spread: float, seed: int) -> None:
    # A delay longer than the window: nothing is there yet, to rounding.
    idle = MAY_VANISH | {"peak", "control_effort_rms"}
    candidates = loop.around(spread, seed)
    assert_exact(loop.diagram(), "r", "y", command, candidates, may_vanish=idle, slowest=SLOWEST)


@given(loops(), st.sampled_from(["y", "control"]), st.integers(0, 2**32))
def test_slopes_by_gains_and_delays(loop: Delayed, output: str, seed: int) -> None:
    """Beside differences of the batch itself, which the test above holds against the exact path."""
    diagram, candidates = loop.diagram(), loop.around(0.05, seed)
    signals = {"r": make("step", {})}
    wanted = [
        MetricRequest(metric=m, signals=signals, output=output, options=Options(derivative=0))
        for m in ("overshoot", "settling_time", "rise_time", "peak")
    ]
    wanted += [
        MetricRequest(metric=m, signals=signals, output=output, duration=3.0)
        for m in ("iae", "ise", "itae", "control_effort_rms")
    ]
    batch = Responses(diagram, wanted, list(candidates))
    for name in candidates:

        def at(shift: complex, name: str = name) -> np.ndarray:
            moved = {n: c * (1.0 + shift) if n == name else c.astype(type(1.0 + shift)) for n, c in candidates.items()}
            found = batch(moved)
            return np.where(found.doubtful | (found.growth >= 0)[:, None], np.nan, found.values)

        slopes = at(1e-30j).imag / 1e-30
        near, wide = [(at(h) - at(-h)) / (2 * h) for h in (1e-5, 2e-5)]
        told = np.isfinite(slopes) & np.isfinite(near) & (np.abs(near - wide) <= 1e-7 * (1.0 + np.abs(near)))
        assert slopes[told] == pytest.approx(near[told], rel=1e-5, abs=1e-6), name


@given(loops(), st.floats(0.05, 1.0), st.integers(0, 2**32))
def test_margins_with_delays_of_two_lengths(loop: Delayed, spread: float, seed: int) -> None:
    diagram, candidates = loop.diagram(), loop.around(spread, seed)
    wanted = [
        MetricRequest(metric=m, open_at="controller")
        for m in ("gain_margin", "phase_margin", "delay_margin", "sensitivity_peak")
    ]
    wanted.append(MetricRequest(metric="bandwidth", source="r", target="y"))
    found = Screening(diagram, wanted)(candidates)
    for row in range(len(found.valid)):
        exact = measure(diagram, wanted, overrides={name: float(column[row]) for name, column in candidates.items()})
        for column, (request, (measured, _)) in enumerate(zip(wanted, exact, strict=True)):
            if found.growth[row] >= 0:
                assert measured.value is None, (request, measured)
            elif not found.doubtful[row, column]:
                value = found.values[row, column]
                if measured.value is None:
                    assert not np.isfinite(value), (request, measured)
                else:
                    assert value == pytest.approx(measured.value, rel=1e-6), (request, measured)
