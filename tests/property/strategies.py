"""Random stable systems for the property tests: well separated poles, both signs of gain, with and without zeros."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from hypothesis import strategies as st

from engine.diagram.diagram import Diagram
from tests.reference.systems import block, system


@dataclass(frozen=True)
class Plant:
    """gain * prod(1 + s/z) / prod(1 + s/p), poles in the left half plane, conjugates complete."""

    gain: float
    zeros: tuple[float, ...]
    poles: tuple[complex, ...]

    def polynomials(self, time_scale: float = 1.0) -> tuple[list[float], list[float]]:
        """Return numerator and denominator; ``time_scale`` makes everything that many times slower."""
        numerator, denominator = np.array([self.gain]), np.array([1.0])
        for zero in self.zeros:
            numerator = np.polymul(numerator, [time_scale / zero, 1.0])
        for pole in self.poles:
            denominator = np.polymul(denominator, [-time_scale / pole, 1.0])
        return [float(c) for c in numerator.real], [float(c) for c in denominator.real]


def gains() -> st.SearchStrategy[float]:
    return st.builds(lambda sign, size: sign * 10**size, st.sampled_from([-1.0, 1.0]), st.floats(-2, 2))


@st.composite
def plants(draw: st.DrawFn) -> Plant:
    """Two to five poles between 0.2 and 50 rad/s, damping ratios from 0.1 to 0.95, at most one zero."""
    pairs = draw(st.integers(0, 2))
    reals = draw(st.integers(0 if pairs else 2, 3 if pairs < 2 else 1))
    # Frequencies a factor of 1.25 apart at least: coinciding poles have their own reference test.
    exponents = draw(st.lists(st.integers(0, 24), min_size=pairs + reals, max_size=pairs + reals, unique=True))
    frequencies = [0.2 * 1.25**k for k in exponents]
    poles: list[complex] = []
    for frequency in frequencies[:pairs]:
        damping = draw(st.floats(0.1, 0.95))
        pole = frequency * complex(-damping, np.sqrt(1 - damping**2))
        poles += [pole, pole.conjugate()]
    poles += [complex(-frequency) for frequency in frequencies[pairs:]]
    zeros = draw(st.lists(st.floats(0.3, 30.0).map(lambda z: round(z, 3)), max_size=1))
    return Plant(draw(gains()), tuple(zeros), tuple(poles))


@dataclass(frozen=True)
class Servo:
    """Position loop round a second-order drive and a sensor lag; all four numbers are parameters of the system."""

    gain: float
    frequency: float
    damping: float
    lag: float

    def diagram(self) -> Diagram:
        return system(
            {
                "r": block("input"),
                "error": block("sum", signs="+-"),
                "controller": block("gain", gain="=gain"),
                "drive": block(
                    "transfer_function",
                    numerator=["=frequency**2"],
                    denominator=[1.0, "=2*damping*frequency", "=frequency**2", 0.0],
                ),
                "sensor": block("transfer_function", numerator=[1.0], denominator=["=lag", 1.0]),
            },
            ["r -> error.in1", "sensor -> error.in2", "error -> controller", "controller -> drive", "drive -> sensor"],
            {"y": "drive", "control": "controller"},
            asdict(self),
        )


@st.composite
def servos(draw: st.DrawFn) -> Servo:
    """Stable ones: without the lag, Hurwitz wants gain < 2 damping frequency; here it is at most 0.48 of that."""
    frequency, damping = draw(st.floats(5.0, 80.0)), draw(st.floats(0.15, 0.9))
    lag = draw(st.floats(0.02, 0.2)) / frequency
    return Servo(draw(st.floats(0.04, 0.48)) * 2 * damping * frequency, frequency, damping, lag)
