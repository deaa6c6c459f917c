"""What sampling blocks share: a sample at regular instants, and an output that follows it after the time to compute.

y(t) = x_0(k)   for   t_k + delay <= t < t_(k+1) + delay,   t_k = offset + k T,   k = 0, 1, ...
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from engine.elements._base import Ports, Values
from engine.elements._nonlinear import Mode, Moment, NonlinearElement, Pattern, Signals
from engine.model.errors import DiagramError
from engine.model.parameters import Param, Scalar

Array = npt.NDArray[Any]

TIMING = (
    Param(
        name="sample_time", symbol="T", unit="s", lower=0.0, lower_open=True, scale="log",
        doc="time between samples",
    ),
    Param(
        name="delay", symbol="τ", unit="s", default=0.0, lower=0.0,
        doc="time from a sample until the output follows it, at most the sample time",
    ),
    Param(
        name="offset", symbol="t_0", unit="s", default=0.0, lower=0.0,
        doc="instant of the first sample, less than the sample time: samplers of one rate need not act together",
    ),
)  # fmt: skip


class Sampler(NonlinearElement):
    """States that move at samples only: the first is the output, the second what it becomes after the delay."""

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse a delay longer than the sample time, and a first sample that is none."""
        if values["delay"].real > values["sample_time"].real:
            limit, got = values["sample_time"].real, values["delay"].real
            raise DiagramError(f"delay must be <= sample_time ({limit:g} s), got {got:g}", at=("delay",))
        if values["offset"].real >= values["sample_time"].real:
            limit, got = values["sample_time"].real, values["offset"].real
            raise DiagramError(f"offset must be < sample_time ({limit:g} s), got {got:g}", at=("offset",))

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def feed_through(cls, values: Values) -> Pattern:
        """Return none: between samples the output does not follow the input."""
        return np.zeros((1, 1), dtype=bool)

    @classmethod
    def affine(cls, mode: Mode, values: Values) -> bool:
        """Return that nothing moves between samples."""
        return True

    @classmethod
    def rates(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return 0: all states move at samples only."""
        return [0.0 * m.z[0]] * len(m.x)

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return what is held."""
        return [m.x[0]]

    @classmethod
    def period(cls, values: Values) -> Scalar | None:
        """Return the sample time."""
        period: Scalar = values["sample_time"]
        return period

    @classmethod
    def latency(cls, values: Values) -> Scalar:
        """Return the delay."""
        latency: Scalar = values["delay"]
        return latency

    @classmethod
    def offset(cls, values: Values) -> Scalar:
        """Return when the first sample is taken, s."""
        offset: Scalar = values["offset"]
        return offset

    @classmethod
    def linear_part(cls, values: Values) -> Values:
        """Return the values of the same law without what is not linear in it, limits say; by default there is nothing such."""
        return values

    @classmethod
    def linear(cls, values: Values) -> bool:
        """Return whether the law has nothing but its linear part."""
        return cls.limiting(values) is None

    @classmethod
    def free(cls, before: Array, after: Array, values: Values) -> npt.NDArray[np.bool_]:
        """Return at which of K samples no limit acts, (K,): there the linear part takes the states (n, K) from ``before`` to ``after``."""
        return np.ones(before.shape[1], dtype=bool)

    @classmethod
    def update(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the output at what the last sample has made of it."""
        return [m.x[1], *m.x[1:]]
