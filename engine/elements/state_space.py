"""Linear state space given by its matrices.

x' = A x + B u,   y = C x + D u
"""

from __future__ import annotations

from engine.elements._base import Element, Ports, Realization, Values, matrix
from engine.elements._state_space import MATRICES, check, ports


class StateSpace(Element):
    """State space whose ports have names of one's own, or ``in``/``out``, or ``in1``, ``in2``, ... where several."""

    kind = "state_space"
    title = "State space"
    equation = "x' = A x + B u;  y = C x + D u"
    source = "T. Kailath, Linear Systems, Prentice-Hall 1980, chapter 2."
    parameters = MATRICES
    example = {"A": [[0.0, 1.0], [-4.0, -0.4]], "B": [[0.0], [1.0]], "C": [[1.0, 0.0]], "D": [[0.0]]}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse matrices whose sizes do not fit, and names that are not one for each port."""
        check(values)

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return the ports that are named, or that the size of D tells."""
        return ports(values)

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the matrices as they are."""
        d = matrix(values["D"])
        if not values["A"]:
            return Realization.static(d)
        return Realization(a=matrix(values["A"]), b=matrix(values["B"]), c=matrix(values["C"]), d=d)
