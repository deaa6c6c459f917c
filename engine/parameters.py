"""What is known of a parameter: symbol, SI unit, default, bounds, natural scale and meaning."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, Union

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from engine.traced import Traced

Scale = Literal["linear", "log"]
Shape = Literal["scalar", "list", "roots", "matrix", "text", "integer", "names", "signal"]
Scalar: TypeAlias = Union[float, complex, npt.NDArray[Any], "Traced"]  # a string has no |
"""One value, one with an infinitesimal in its imaginary part, a batch of values (B,), or one that traces its making."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Param:
    """Declaration of one parameter of an element or signal.

    ``unit`` is a coherent SI unit ("" = a generic gain of any unit, "1" = a ratio). ``shape`` is "scalar", "list",
    "roots" (a list of numbers or ``[re, im]`` pairs), "matrix" (list of rows), "text" (one of ``choices`` where these are
    given), "integer" (a whole number that decides the structure, as an order does), "names" (a list of port names) or
    "signal" (a command that another one is made of). The bounds of a list are those of its entries.
    ``scale`` is how its values spread wherever they are positive. A parameter without a default must be given, unless
    ``required`` is False: then it may be absent.
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

    def admits(self, value: Scalar) -> bool | npt.NDArray[np.bool_]:
        """Tell for every entry of ``value`` whether its real part is finite and within the bounds."""
        real = value.real
        above = real > self.lower if self.lower_open else real >= self.lower
        if isinstance(real, np.ndarray):
            return np.asarray(np.isfinite(real) & above & (real <= self.upper))
        return bool(above and real <= self.upper and math.isfinite(real))

    def rule(self) -> str:
        """Return the bounds as words, e.g. ``> 0 m**2``."""
        parts = []
        if math.isfinite(self.lower):
            parts.append(f"{'>' if self.lower_open else '>='} {self.lower:g}")
        if math.isfinite(self.upper):
            parts.append(f"<= {self.upper:g}")
        unit = self.unit if self.unit not in ("", "1") else ""
        return " ".join(["finite" if not parts else " and ".join(parts), unit]).strip()


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
