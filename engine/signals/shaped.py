"""Shaped command: any command convolved with an impulse shaper, so that a mode of the structure is left at rest.

u(t) = Σ_i A_i c(t - t_i), Σ A_i = 1
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from engine.model.parameters import Param
from engine.signals._copies import Copied, Copies
from engine.signals._shapers import KINDS, impulses


@dataclass(frozen=True, slots=True, kw_only=True)
class Shaped(Copied):
    """Command that does not excite a known mode; a shaped command may be shaped again for another mode."""

    shaper: str
    frequency: float
    damping_ratio: float
    tolerance: float

    kind = "shaped"
    title = "Shaped command"
    equation = "u(t) = Σ A_i · command(t − t_i); A_i, t_i of ZV, ZVD, ZVDD or EI"
    source = (
        "N. Singer, W. Seering, ASME J. Dyn. Syst. Meas. Control 112 (1990) 76-82; "
        "W. Singhose, W. Seering, N. Singer, ASME J. Mech. Des. 116 (1994) 654-659 (EI)."
    )
    parameters = (
        Param(
            name="shaper", symbol="A_i, t_i", shape="text", choices=KINDS, default="zv",
            doc="zv: nothing is left at the frequency itself; zvd, zvdd: little beside it too; ei: most room around it",
        ),
        Param(
            name="frequency", symbol="ω", unit="rad/s", lower=0.0, lower_open=True, scale="log",
            doc="undamped angular frequency of the mode",
        ),
        Param(
            name="damping_ratio", symbol="ζ", unit="1", default=0.0, lower=0.0, upper=0.99,
            doc="of the mode; at most 0.3 for ei",
        ),
        Param(
            name="tolerance", symbol="V", unit="1", default=0.05, lower=0.001, upper=0.15,
            doc="vibration that ei allows at the frequency itself, relative to the unshaped command",
        ),
        Param(name="command", symbol="c", shape="signal", doc="what is shaped"),
    )  # fmt: skip
    example: ClassVar[Mapping[str, Any]] = {"frequency": 10.0, "command": {"kind": "step"}}

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the shaped command."""
        made = impulses(
            values["shaper"], frequency=values["frequency"], damping_ratio=values["damping_ratio"],
            tolerance=values["tolerance"],
        )  # fmt: skip
        copies = Copies(command=values["command"], times=made.times, amplitudes=made.amplitudes)
        return cls(**values, copies=copies)
