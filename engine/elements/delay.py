"""Transport delay, exact; as a Padé approximant where that is asked for.

y(t) = u(t - time);   Padé of order n: y/u = Q(-s time)/Q(s time), Q(x) = Σ_k (2n - k)! n! / ((2n)! k! (n - k)!) x^k
"""

from __future__ import annotations

import math

import numpy as np

from engine.elements._base import Array, Element, Ports, Realization, Values, matrix
from engine.elements._canonical import rational
from engine.model.parameters import Param, Scalar


class Delay(Element):
    """Dead time, kept as a delay channel; no rational approximation is made unless ``approximation`` asks for one.

    The Padé approximant is all-pass, so it answers at once where a delay is silent, and its phase is right up to about
    order/time rad/s only. It serves to compare with what others compute.

    A delay of exactly 0 is a direct connection, from which no infinitesimal leads to a delay: it is dropped here, and
    derivatives by ``time`` at 0 are taken right beside it (`engine.analysis.measuring`).

    Beyond 1e6 s (12 days) an instant would no longer be known to the fraction of a microsecond that responses need.
    """

    kind = "delay"
    title = "Transport delay"
    equation = "y(t) = u(t - time)"
    source = (
        "P. Gahinet and L. Shampine, Software for modeling and analysis of linear systems with delays, ACC 2004. "
        "Padé: G. Golub and C. Van Loan, Matrix Computations, 4th ed., section 9.3."
    )
    parameters = (
        Param(name="time", symbol="T", unit="s", lower=0.0, largest=1e6, doc="dead time"),
        Param(
            name="approximation", symbol="≈", shape="text", default="exact", choices=("exact", "pade"),
            doc="exact, or a rational approximant",
        ),
        Param(name="order", symbol="n", shape="integer", default=3, lower=1, upper=10, doc="order of the approximant"),
    )  # fmt: skip
    example = {"time": 0.01}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return one delay channel from input to output, or the approximant; a direct connection where the time is 0."""
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
        if values["approximation"] == "pade":
            return _approximant(int(values["order"]), length, open_channel)
        return Realization(
            a=np.zeros((0, 0)), b=np.zeros((0, 1)), c=np.zeros((1, 0)), d=matrix([[1.0 - open_channel]]),
            delays=matrix([[length]])[..., 0], d12=matrix([[open_channel]]), d21=np.ones((1, 1)),
        )  # fmt: skip


def _approximant(order: int, time: Scalar, open_channel: Scalar) -> Realization:
    """Return the approximant of a delay of 1 s, made as fast as the delay is."""
    n = order
    share = [
        math.factorial(2 * n - k) * math.factorial(n) / (math.factorial(2 * n) * math.factorial(k) * math.factorial(n - k))
        for k in range(n, -1, -1)
    ]  # fmt: skip
    turned = [c * (-1.0) ** k for c, k in zip(share, range(n, -1, -1), strict=True)]
    unit = rational(turned, share)

    def faster(rows: Array) -> Array:
        return matrix([[float(entry) / time for entry in row] for row in rows])

    direct = float(unit.d[0, 0])
    return Realization(
        a=faster(unit.a),
        b=faster(unit.b),
        c=matrix([[float(entry) * open_channel for entry in unit.c[0]]]),
        d=matrix([[1.0 + (direct - 1.0) * open_channel]]),
    )
