"""Sampler with hold: the input is taken at regular instants, and the output keeps it until the next one arrives.

y(t) = u(k T)   for   k T + delay <= t < (k + 1) T + delay,   k = 0, 1, ...
"""

from __future__ import annotations

import numpy as np

from engine.elements._base import Ports, Realization, Values, matrix
from engine.elements._nonlinear import Mode, Moment, NonlinearElement, Pattern, Signals
from engine.errors import DiagramError
from engine.parameters import Param, Scalar


class ZeroOrderHold(NonlinearElement):
    """The sampling of a digital controller, with the time that it takes to compute."""

    kind = "zero_order_hold"
    title = "Zero-order hold"
    equation = "y(t) = u(k T) for k T + delay <= t < (k + 1) T + delay"
    source = "K. J. Åström, B. Wittenmark, Computer-Controlled Systems, 3rd ed., chapters 2 and 3."
    note = "a hold is linearised as a delay of half its sample time and its own delay"
    states = ("output", "sample")
    parameters = (
        Param(
            name="sample_time", symbol="T", unit="s", lower=0.0, lower_open=True, scale="log",
            doc="time between samples; the first is taken at 0",
        ),
        Param(
            name="delay", symbol="τ", unit="s", default=0.0, lower=0.0,
            doc="time from a sample until the output follows it, at most the sample time",
        ),
    )  # fmt: skip
    example = {"sample_time": 0.01, "delay": 0.002}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse a delay longer than the sample time."""
        if values["delay"].real > values["sample_time"].real:
            limit, got = values["sample_time"].real, values["delay"].real
            raise DiagramError(f"delay must be <= sample_time ({limit:g} s), got {got:g}", at=("delay",))

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def feed_through(cls, values: Values) -> Pattern:
        """Return none: between samples the output does not follow the input."""
        return np.zeros((1, 1), dtype=bool)

    @classmethod
    def rates(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return 0: both states move at samples only."""
        return [0.0 * m.z[0], 0.0 * m.z[0]]

    @classmethod
    def unrest(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far output and sample are from the input."""
        return [m.z[0] - m.x[0], m.z[0] - m.x[1]]

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the sample that is held."""
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
    def sample(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the sample, and the output where there is no delay."""
        return [m.x[0] if np.any(values["delay"]) else m.z[0], m.z[0]]

    @classmethod
    def update(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the output at the last sample."""
        return [m.x[1], m.x[1]]

    @classmethod
    def small_signal(cls, m: Moment, mode: Mode, values: Values) -> Realization | None:
        """Return the delay of the same phase at low frequencies."""
        delay = matrix([[0.5 * values["sample_time"] + values["delay"]]])[..., 0, :]
        return Realization(
            a=np.zeros((0, 0)), b=np.zeros((0, 1)), c=np.zeros((1, 0)), d=np.zeros((1, 1)), delays=delay,
            d12=np.ones((1, 1)), d21=np.ones((1, 1)),
        )  # fmt: skip
