"""State space of a digital controller.

x_{k+1} = A x_k + B u_k,   y_k = C x_k + D u_k, held between samples
"""

from __future__ import annotations

import numpy as np

from engine.elements._base import Ports, Realization, Values, matrix
from engine.elements._discrete import Discrete
from engine.elements._sampler import TIMING
from engine.elements._state_space import MATRICES, check, ports


class DiscreteStateSpace(Discrete):
    """An observer, a state feedback or a filter as it runs, with any number of inputs and outputs."""

    kind = "discrete_state_space"
    title = "Discrete state space"
    equation = "x_{k+1} = A x_k + B u_k;  y_k = C x_k + D u_k, held between samples"
    source = "K. J. Åström, B. Wittenmark, Computer-Controlled Systems, 3rd ed., chapter 2."
    parameters = (*MATRICES, *TIMING)
    example = {"A": [[0.9]], "B": [[0.1]], "C": [[1.0]], "D": [[0.2]], "sample_time": 0.01}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse matrices whose sizes do not fit, and a delay longer than the sample time."""
        super().check(given, values)
        check(values)

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return the ports that are named, or that the size of D tells."""
        return ports(values)

    @classmethod
    def discrete(cls, values: Values) -> Realization:
        """Return the matrices as they are."""
        d = matrix(values["D"])
        if not values["A"]:
            outputs, inputs = d.shape[-2:]
            return Realization(a=np.zeros((0, 0)), b=np.zeros((0, inputs)), c=np.zeros((outputs, 0)), d=d)
        return Realization(a=matrix(values["A"]), b=matrix(values["B"]), c=matrix(values["C"]), d=d)
