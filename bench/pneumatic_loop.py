"""One loop, the same metrics: a PID round a pneumatic motor, stated once for this engine and once for its peers.

The PID (100, 20, 5; filter 100 rad/s) and the motor are those of the seed paper's mid-range example, 1000 points on 0 to 15 s.
In daN, cm and s the motor is y/u = A / (s (c m s² + (c b + m a) s + A² + a b)) with c = V/(χ p).
The exact values were computed with mpmath at 40 digits from partial fractions of the closed loop.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system

Real = npt.NDArray[np.float64]
Gains = Mapping[str, float]
Sets = Mapping[str, Real]

GAINS: Final[Gains] = {"kp": 100.0, "ki": 20.0, "kd": 5.0}
FILTER: Final = 100.0
DURATION: Final = 15.0
SAMPLES: Final = 1000
SETS: Final = 1000
PER_SI: Final = 1e-4  # 1 cm3/s per cm in m3/s per m

_COMPLIANCE = 750.0 / (1.4 * 5.0)
MOTOR_NUMERATOR: Final = [65.0]
MOTOR_DENOMINATOR: Final = [_COMPLIANCE * 0.3, _COMPLIANCE * 1.2 + 0.3 * 0.4, 65.0**2 + 0.4 * 1.2, 0.0]

EXACT: Final[Mapping[str, float]] = {
    "rise_time": 1.12926550584625,
    "settling_time": 10.2149965109608,
    "overshoot": 0.0873231787804261,
    "peak_time": 3.0654123189545,
    "gain_margin": 2.93536534998578,
    "phase_margin": 1.47325789684602,
    "bandwidth": 1.70918875182118,
}
EXACT_RISE_ELASTICITY: Final = (-0.2383634865477, -0.0985015700989508, 0.0120495301082388)


class Contender(Protocol):
    """Who can evaluate the loop. ``remark`` says what the metrics leave out or how they were asked for."""

    name: str
    remark: str

    def metrics(self, gains: Gains) -> dict[str, float]:
        """Return the metrics of one set of gains, as far as there are any; angles in rad, overshoot as a ratio."""
        ...


@runtime_checkable
class Batched(Contender, Protocol):
    """Who can evaluate many sets of gains at once."""

    def many(self, sets: Sets) -> Mapping[str, Real]:
        """Evaluate the arrays of gains (sets,)."""
        ...


@runtime_checkable
class Differentiated(Contender, Protocol):
    """Who can differentiate what it computes; ``derivation`` says of what and how."""

    derivation: str

    def rise_elasticities(self) -> list[float]:
        """Return d ln rise_time/d ln gain for the three gains."""
        ...


def neighbours(count: int) -> dict[str, Real]:
    """Return sets of gains within 20 % of the example's."""
    rng = np.random.default_rng(0)
    return {name: value * rng.uniform(0.8, 1.2, count) for name, value in GAINS.items()}


def diagram() -> Diagram:
    """Return the loop as a diagram with the three gains as parameters."""
    motor = {
        "area": 65e-4,
        "volume": 750e-6,
        "pressure": 5e5,
        "adiabatic_index": 1.4,
        "leakage": 0.4e-11,
        "mass": 300.0,
        "viscous_friction": 1200.0,
    }
    gains = {"kp": "=kp", "ki": "=ki", "kd": "=kd", "filter_frequency": FILTER}
    wires = [
        ("reference", "error.in1"),
        ("motor.position", "error.in2"),
        ("error", "controller"),
        ("controller", "motor.flow"),
    ]
    return compile_system(
        System(
            name="pneumatic position loop",
            parameters={name: Parameter(value=value * PER_SI) for name, value in GAINS.items()},
            blocks={
                "reference": Block(kind="input"),
                "error": Block(kind="sum", values={"signs": "+-"}),
                "controller": Block(kind="pid", values=gains),
                "motor": Block(kind="linear_pneumatic_motor", values=motor),
            },
            connections=tuple(Connection(source=source, target=target) for source, target in wires),
            outputs={"position": "motor.position"},
        )
    )
