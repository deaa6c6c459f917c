"""Transport delay, exact.

y(t) = u(t - time)
"""

from __future__ import annotations

import numpy as np

from engine.elements._base import Element, Ports, Realization, Values, matrix
from engine.parameters import Param, Scalar


class Delay(Element):
    """Dead time, kept as a delay channel; no rational approximation is made anywhere.

    A delay of exactly 0 is a direct connection. There the derivative in ``time`` does not exist (the response would
    have to be differentiated), so an infinitesimal on a delay of 0 is dropped.
    """

    kind = "delay"
    title = "Transport delay"
    equation = "y(t) = u(t - time)"
    source = "P. Gahinet and L. Shampine, Software for modeling and analysis of linear systems with delays, ACC 2004."
    parameters = (Param(name="time", symbol="T", unit="s", lower=0.0, doc="dead time"),)
    example = {"time": 0.01}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return one delay channel from input to output, or a direct connection where the time is 0."""
        time = values["time"]
        direct = np.real(time) == 0
        if np.all(direct):
            return Realization.static(np.ones((1, 1)))
        open_channel: Scalar = 1.0
        length: Scalar = time
        if isinstance(time, np.ndarray):
            # A member of a batch without delay keeps an idle channel, with a length of the kind that the others have.
            open_channel = np.where(direct, 0.0, 1.0)
            length = np.where(direct, np.max(time.real, where=np.isfinite(time.real), initial=0.0), time)
        return Realization(
            a=np.zeros((0, 0)), b=np.zeros((0, 1)), c=np.zeros((1, 0)), d=matrix([[1.0 - open_channel]]),
            delays=matrix([[length]])[..., 0], d12=matrix([[open_channel]]), d21=np.ones((1, 1)),
        )  # fmt: skip
