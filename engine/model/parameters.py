"""What is known of a parameter: symbol, SI unit, default, bounds, natural scale and meaning."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, Union

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from engine.model.traced import Traced

LARGEST = 1e100
"""Numbers beyond this, or nearer to 0 than its inverse, would overflow in squares and quotients."""

Scale = Literal["linear", "log"]
Shape = Literal["scalar", "list", "lists", "roots", "matrix", "text", "integer", "names", "signal"]
Scalar: TypeAlias = Union[float, complex, npt.NDArray[Any], "Traced"]  # a string has no |
"""One value, one with an infinitesimal in its imaginary part, a batch of values (B,), or one that traces its making."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Param:
    """Declaration of one parameter of an element or signal.

    ``unit`` is a coherent SI unit ("" = a generic gain of any unit, "1" = a ratio). ``shape`` is "scalar", "list",
    "lists" (of any length each), "roots" (a list of numbers or ``[re, im]`` pairs), "matrix" (list of rows), "text" (one of
    ``choices`` where these are given), "integer" (a whole number that decides the structure, as an order does), "names" (a list of port names) or
    "signal" (a command that another one is made of). The bounds of a list are those of its entries.
    ``scale`` is how its values spread wherever they are positive. A parameter without a default must be given, unless
    ``required`` is False: then it may be absent.
    ``largest`` is the size beyond which no element computes with it: a limit of arithmetic, which no range is made of.
    Only scalars have a parameter path and can be varied; entries of a list follow system parameters through expressions.
    """

    name: str
    symbol: str
    doc: str
    unit: str = ""
    default: Any = None
    required: bool = True
    lower: float = -math.inf
    upper: float = math.inf
    lower_open: bool = False
    scale: Scale = "linear"
    shape: Shape = "scalar"
    choices: tuple[str, ...] = ()
    largest: float = LARGEST

    def admits(self, value: Scalar) -> bool | npt.NDArray[np.bool_]:
        """Tell for every entry of ``value`` whether its real part is within the bounds and can be computed with."""
        real: Any = value.real
        size = abs(real)
        above = real > self.lower if self.lower_open else real >= self.lower
        within = (size <= self.largest) & ((size >= self._smallest) | (size == 0.0))  # False for a NaN
        if isinstance(real, np.ndarray):
            return np.asarray(within & above & (real <= self.upper))
        return bool(within and above and real <= self.upper)

    @property
    def _smallest(self) -> float:
        """Coefficients of a polynomial of high order may be tiny; no quantity is."""
        return 1 / LARGEST if self.shape == "scalar" else 0.0

    def rule(self, value: float | None = None) -> str:
        """Return the bounds as words, e.g. ``> 0 m**2``; of a ``value`` within them what else is wrong with it."""
        unit = f" {self.unit}" if self.unit not in ("", "1") else ""
        if value is not None and math.isfinite(value) and self.lower <= value <= self.upper:
            if abs(value) > self.largest:
                return f"<= {self.largest:g}{unit} in size"
            if 0 < abs(value) < self._smallest:
                return (
                    f"0 or >= {self._smallest:g}{unit} in size"
                    if not self.lower_open
                    else f">= {self._smallest:g}{unit}"
                )
        parts = []
        if math.isfinite(self.lower):
            parts.append(f"{'>' if self.lower_open else '>='} {self.lower:g}")
        if math.isfinite(self.upper):
            parts.append(f"<= {self.upper:g}")
        return ("finite" if not parts else " and ".join(parts)) + unit


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterInfo:
    """One addressable scalar of a diagram.

    ``value`` is in SI; ``bound`` is True where an expression gives the value, so that it cannot be varied itself.
    """

    path: str
    value: float
    unit: str
    lower: float
    upper: float
    scale: Scale
    doc: str
    bound: bool
    lower_open: bool = False
