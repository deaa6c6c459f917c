"""Transfer function of a digital controller, in z.

y/u = (b_m z^m + ... + b_0) / (a_n z^n + ... + a_0),   m <= n, from sample to sample, held in between
"""

from __future__ import annotations

from engine.elements._base import Ports, Realization, Values
from engine.elements._canonical import rational
from engine.elements._discrete import Discrete
from engine.elements._sampler import TIMING
from engine.model.parameters import Param


class DiscreteTransferFunction(Discrete):
    """A controller or filter as it runs: computed at regular instants, its output held until the next."""

    kind = "discrete_transfer_function"
    title = "Discrete transfer function"
    equation = "y/u = (b_m z^m + ... + b_0) / (a_n z^n + ... + a_0), held between samples"
    source = "K. J. Åström, B. Wittenmark, Computer-Controlled Systems, 3rd ed., chapter 2."
    parameters = (
        Param(name="numerator", symbol="b", shape="list", doc="coefficients, highest power of z first"),
        Param(name="denominator", symbol="a", shape="list", doc="coefficients, highest power of z first"),
        *TIMING,
    )
    example = {"numerator": [0.5, -0.3], "denominator": [1.0, -0.8], "sample_time": 0.01, "delay": 0.002}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def discrete(cls, values: Values) -> Realization:
        """Return the controllable canonical form."""
        return rational(values["numerator"], values["denominator"])
