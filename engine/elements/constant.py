"""Constant: a source that is always on, such as a weight, a preload or an offset.

y = value
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from engine.elements._base import Ports, Realization, Values
from engine.elements._nonlinear import Mode, Moment, NonlinearElement, Signals
from engine.model.parameters import Param


class Constant(NonlinearElement):
    """What a linear system cannot have of its own: with it a response is no longer proportional to its command."""

    kind: ClassVar[str] = "constant"
    title: ClassVar[str] = "Constant source"
    equation: ClassVar[str] = "y = value, at all times"
    source: ClassVar[str] = "Definition."
    parameters: ClassVar[tuple[Param, ...]] = (Param(name="value", symbol="y₀", default=1.0, doc="what it gives"),)
    example: ClassVar[dict[str, Any]] = {"value": 1.0}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one output and no input."""
        return Ports(inputs=(), outputs=("out",))

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the value."""
        return [values["value"]]

    @classmethod
    def affine(cls, mode: Mode, values: Values) -> bool:
        """Return True: a constant is all there is."""
        return True

    @classmethod
    def small_signal(cls, m: Moment, mode: Mode, values: Values) -> Realization:
        """Return nothing that moves: there is no input."""
        return Realization.static(np.zeros((1, 0)))
