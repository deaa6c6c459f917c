"""Complex mechanical correction of two masses: eq. (5) of the paper, with the physical coefficients.

m3 x3'' = h1 (x1' - x3') + k1 (x1 - x3) - h2 (x3' - x2') - k3 (x3 - x2) - k2 x3
m2 x2'' = h2 (x3' - x2') + k3 (x3 - x2) - k4 x2

x2/x1 = (b2 s² + b1 s + b0) / (a4 s⁴ + a3 s³ + a2 s² + a1 s + a0)
b2 = h1 h2,   b1 = h1 k3 + h2 k1,   b0 = k1 k3
a4 = m2 m3,   a3 = m3 h2 + m2 h1 + m2 h2,   a2 = h1 h2 + m2 (k1 + k2 + k3) + m3 (k3 + k4)
a1 = h1 (k3 + k4) + h2 (k1 + k2 + k4),   a0 = k1 k3 + k1 k4 + k2 k3 + k2 k4 + k3 k4
"""

from __future__ import annotations

import numpy as np

from engine.elements._base import Element, Ports, Realization, Values, matrix
from engine.model.parameters import Param


class TwoMassCorrection(Element):
    """A mass m3 that follows the motion x1 through (h1, k1) and carries the mass m2 on (h2, k3).

    The paper prints h2 k3 in place of h2 k2 in a1, and k3² in place of k2 k3 in a0: printed less physical is h2 (k3 - k2)
    and k3 (k3 - k2), nothing only where k2 = k3. The force balances above leave no doubt, so this element follows them.
    """

    kind = "two_mass_correction"
    title = "Two-mass mechanical correction"
    equation = (
        "m3 x3'' = h1 (x1' - x3') + k1 (x1 - x3) - h2 (x3' - x2') - k3 (x3 - x2) - k2 x3;  "
        "m2 x2'' = h2 (x3' - x2') + k3 (x3 - x2) - k4 x2"
    )
    source = (
        "Assisted optimization of the dynamic behaviour of industrial robots, eq. (5), Figs. 9-10; a1 and a0 corrected: "
        "they are printed with h2 k3 for h2 k2 and k3² for k2 k3."
    )
    parameters = (
        Param(
            name="m2", symbol="m2", unit="kg", lower=0.0, lower_open=True, scale="log",
            doc="mass whose motion is the output",
        ),
        Param(
            name="m3", symbol="m3", unit="kg", lower=0.0, lower_open=True, scale="log",
            doc="mass between the input and m2",
        ),
        Param(
            name="h1", symbol="h1", unit="N*s/m", lower=0.0, scale="log",
            doc="damping from the input to m3",
        ),
        Param(
            name="h2", symbol="h2", unit="N*s/m", lower=0.0, scale="log",
            doc="damping between m3 and m2",
        ),
        Param(
            name="k1", symbol="k1", unit="N/m", lower=0.0, scale="log",
            doc="stiffness from the input to m3",
        ),
        Param(
            name="k2", symbol="k2", unit="N/m", lower=0.0, scale="log",
            doc="stiffness from m3 to the ground",
        ),
        Param(
            name="k3", symbol="k3", unit="N/m", lower=0.0, scale="log",
            doc="stiffness between m3 and m2",
        ),
        Param(
            name="k4", symbol="k4", unit="N/m", lower=0.0, scale="log",
            doc="stiffness from m2 to the ground",
        ),
    )  # fmt: skip
    example = {
        "m2": 50.0, "m3": 20.0, "h1": 400.0, "h2": 300.0, "k1": 6e4, "k2": 2e4, "k3": 4e4, "k4": 1e4,
    }  # fmt: skip

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return the motions x1 and x2."""
        return Ports(inputs=("x1",), outputs=("x2",), output_units=("m",))

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return x2, x3 - x2 and the momenta of both masses together and of m2 without their dampers' share as states.

        m2 x2' = h2 e + p2,   m3 x3' = h1 (x1 - x3) - h2 e + p - p2,   e = x3 - x2
        p' = k1 (x1 - x3) - k2 x3 - k4 x2,   p2' = k3 e - k4 x2

        So no stiffness or damping is the difference of two, however stiff one of them is.
        """
        m2, m3, h1, h2 = (values[name] for name in ("m2", "m3", "h1", "h2"))
        k1, k2, k3, k4 = (values[name] for name in ("k1", "k2", "k3", "k4"))
        return Realization(
            a=matrix([
                [0.0, h2 / m2, 0.0, 1.0 / m2],
                [-h1 / m3, -(h1 + h2) / m3 - h2 / m2, 1.0 / m3, -1.0 / m3 - 1.0 / m2],
                [-(k1 + k2 + k4), -(k1 + k2), 0.0, 0.0],
                [-k4, k3, 0.0, 0.0],
            ]),
            b=matrix([[0.0], [h1 / m3], [k1], [0.0]]),
            c=np.array([[1.0, 0.0, 0.0, 0.0]]),
            d=np.zeros((1, 1)),
        )  # fmt: skip
