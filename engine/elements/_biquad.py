"""Quotient of two quadratics over one frequency, the form of every second-order correction.

y/u = (n0 + n1 (s/w) + n2 (s/w)²) / (1 + 2 d (s/w) + (s/w)²)
"""

from __future__ import annotations

from engine.elements._base import Reading, Realization, matrix
from engine.model.parameters import Scalar


def biquad(n0: Scalar, n1: Scalar, n2: Scalar, *, frequency: Scalar, damping_ratio: Scalar) -> Realization:
    """Return the states x1 = filtered input and x2 = x1'/w, both of the size of the input: y = n0 x1 + n1 x2 + n2 x2'/w."""
    w, d = frequency, damping_ratio
    return Realization(
        a=matrix([[0.0, w], [-w, -2.0 * d * w]]), b=matrix([[0.0], [w]]),
        c=matrix([[n0 - n2, n1 - 2.0 * d * n2]]), d=matrix([[n2]]),
        reading=Reading(c=matrix([[n0, n1]]), d=matrix([[0.0]]), k=matrix([[0.0, n2 / w]])),
    )  # fmt: skip
