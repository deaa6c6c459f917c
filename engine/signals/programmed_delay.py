"""Programmed delay: a command given as two movements, the second one later.

u(t) = (1 - share) c(t) + share c(t - delay)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from engine.model.parameters import Param
from engine.signals._copies import Copied, Copies


@dataclass(frozen=True, slots=True, kw_only=True)
class ProgrammedDelay(Copied):
    """Two movements whose delay puts a zero into the spectrum: at π/delay, 3π/delay, ... when the share is one half."""

    delay: float
    share: float

    kind = "programmed_delay"
    title = "Programmed delay"
    equation = "u(t) = (1 − share) · command(t) + share · command(t − delay)"
    source = "N. Singer, W. Seering, ASME J. Dyn. Syst. Meas. Control 112 (1990) 76-82 (two impulses)."
    parameters = (
        Param(name="delay", symbol="τ", unit="s", lower=0.0, doc="how much later the second movement begins"),
        Param(
            name="share", symbol="σ", unit="1", default=0.5, lower=0.0, upper=1.0, doc="part that the second one moves"
        ),
        Param(name="command", symbol="c", shape="signal", doc="the whole movement"),
    )
    example: ClassVar[Mapping[str, Any]] = {"delay": 0.1, "command": {"kind": "step"}}

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the two movements."""
        share, delay = values["share"], values["delay"]
        copies = Copies(
            command=values["command"], times=np.array([0.0 * delay, delay]), amplitudes=np.array([1 - share, share])
        )
        return cls(**values, copies=copies)
