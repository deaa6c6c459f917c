"""Sampler with hold: the input is taken at regular instants, and the output keeps it until the next one arrives.

y(t) = u(k T)   for   k T + delay <= t < (k + 1) T + delay,   k = 0, 1, ...
"""

from __future__ import annotations

import numpy as np

from engine.elements._base import Realization, Values, matrix
from engine.elements._nonlinear import Mode, Moment, Signals
from engine.elements._sampler import TIMING, Sampler


class ZeroOrderHold(Sampler):
    """The sampling of a digital controller, with the time that it takes to compute."""

    kind = "zero_order_hold"
    title = "Zero-order hold"
    equation = "y(t) = u(k T) for k T + delay <= t < (k + 1) T + delay"
    source = "K. J. Åström, B. Wittenmark, Computer-Controlled Systems, 3rd ed., chapters 2 and 3."
    note = "as a continuous block (exports, describing functions) a hold is a delay of half its sample time and its own delay"
    states = ("output", "sample")
    parameters = TIMING
    example = {"sample_time": 0.01, "delay": 0.002}

    @classmethod
    def unrest(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far output and sample are from the input."""
        return [m.z[0] - m.x[0], m.z[0] - m.x[1]]

    @classmethod
    def sample(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the sample, and the output where there is no delay."""
        return [m.x[0] if np.any(values["delay"]) else m.z[0], m.z[0]]

    @classmethod
    def small_signal(cls, m: Moment, mode: Mode, values: Values) -> Realization | None:
        """Return the delay of the same phase at low frequencies."""
        delay = matrix([[0.5 * values["sample_time"] + values["delay"]]])[..., 0, :]
        return Realization(
            a=np.zeros((0, 0)), b=np.zeros((0, 1)), c=np.zeros((1, 0)), d=np.zeros((1, 1)), delays=delay,
            d12=np.ones((1, 1)), d21=np.ones((1, 1)),
        )  # fmt: skip
