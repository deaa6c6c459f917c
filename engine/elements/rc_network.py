"""Passive correction of resistors and capacitors.

y/u = Z2/(Z1 + Z2),   Z1 = r1 ∥ 1/(c1 s),   Z2 = r2 + 1/(c2 s)

::

    u ──┬── r1 ──┬──┬── y      low_pass    1/(1 + r1 c2 s)
        └── c1 ──┘  │          high_pass   r2 c1 s/(1 + r2 c1 s)
                    r2         lead        (1 + r1 c1 s)/((r1 + r2)/r2 + r1 c1 s)
                    │          lag         (1 + r2 c2 s)/(1 + (r1 + r2) c2 s)
                    c2         lead_lag    (1 + r1 c1 s)(1 + r2 c2 s) /
    0 ──────────────┴── 0                  (1 + (r1 c1 + r2 c2 + r1 c2) s + r1 c1 r2 c2 s²)

A network names the components it has; of the others c1 and r1 are left out (open), r2 and c2 bridged.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from engine.elements._base import Element, Ports, Reading, Realization, Values, matrix
from engine.model.errors import DiagramError
from engine.model.parameters import Param

COMPONENTS: Final[Mapping[str, tuple[str, ...]]] = {
    "low_pass": ("r1", "c2"),
    "high_pass": ("c1", "r2"),
    "lead": ("r1", "c1", "r2"),
    "lag": ("r1", "r2", "c2"),
    "lead_lag": ("r1", "c1", "r2", "c2"),
}
"""Which components each network is made of."""


def _component(name: str, symbol: str, unit: str, doc: str) -> Param:
    return Param(
        name=name, symbol=symbol, unit=unit, required=False, lower=0.0, lower_open=True, scale="log", doc=doc
    )  # fmt: skip


class RcNetwork(Element):
    """Classic network between an ideal source and an amplifier that draws no current; its states are the voltages."""

    kind = "rc_network"
    title = "RC network"
    equation = "y/u = Z2/(Z1 + Z2),  Z1 = r1 ∥ 1/(c1 s),  Z2 = r2 + 1/(c2 s)"
    source = (
        "K. Ogata, Modern Control Engineering, Prentice-Hall 2010, sections 3-3 and 6-5 to 6-8 (networks of Table 6)."
    )
    parameters = (
        Param(
            name="network", symbol="network", shape="text", choices=tuple(COMPONENTS),
            doc="which of the components there are: low_pass r1 c2, high_pass c1 r2, lead r1 c1 r2, lag r1 r2 c2, lead_lag all",
        ),
        _component("r1", "R₁", "ohm", "resistor from input to output"),
        _component("c1", "C₁", "F", "capacitor from input to output, beside r1"),
        _component("r2", "R₂", "ohm", "resistor from output to ground"),
        _component("c2", "C₂", "F", "capacitor from output to ground, in series with r2"),
    )  # fmt: skip
    example = {"network": "lead_lag", "r1": 1e5, "c1": 1e-6, "r2": 1e4, "c2": 1e-5}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse a component that the network has not, and one that is missing."""
        network = values["network"]
        listed = " and ".join(COMPONENTS[network])
        for name in ("r1", "c1", "r2", "c2"):
            if (name in given) != (name in COMPONENTS[network]):
                rule = "absent" if name in given else "given"
                raise DiagramError(f"{name} must be {rule}: a {network} network has {listed}", at=(name,))

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the voltages of the capacitors as states."""
        r1, c1, r2, c2 = (values[name] for name in ("r1", "c1", "r2", "c2"))
        if c1 is None:
            # The current is (u - v2)/(r1 + r2), and y = v2 + r2 current = v2 + r2 c2 v2'.
            total = r1 if r2 is None else r1 + r2
            share = 0.0 if r2 is None else r2 / total
            rate = 1.0 / (total * c2)
            charge = 0.0 if r2 is None else r2 * c2
            return Realization(
                a=matrix([[-rate]]), b=matrix([[rate]]), c=matrix([[1.0 - share]]), d=matrix([[share]]),
                reading=Reading(c=matrix([[1.0]]), d=matrix([[0.0]]), k=matrix([[charge]])),
            )  # fmt: skip
        # The current through r2 is (u - v1 - v2)/r2, that through r1 is v1/r1, and y = u - v1 = v2 + r2 current.
        charging = 1.0 / (r2 * c1)
        leaking = 0.0 if r1 is None else 1.0 / (r1 * c1)
        if c2 is None:
            resting = 0.0 if r1 is None else r2 / r1
            return Realization(
                a=matrix([[-charging - leaking]]), b=matrix([[charging]]), c=matrix([[-1.0]]), d=matrix([[1.0]]),
                reading=Reading(c=matrix([[resting]]), d=matrix([[0.0]]), k=matrix([[r2 * c1]])),
            )  # fmt: skip
        passing = 1.0 / (r2 * c2)
        return Realization(
            a=matrix([[-charging - leaking, -charging], [-passing, -passing]]),
            b=matrix([[charging], [passing]]), c=matrix([[-1.0, 0.0]]), d=matrix([[1.0]]),
            reading=Reading(c=matrix([[0.0, 1.0]]), d=matrix([[0.0]]), k=matrix([[0.0, r2 * c2]])),
        )  # fmt: skip
