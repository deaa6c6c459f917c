"""The worst ratio of the frequency responses of many systems to bounds.

A bound bends at its corners, which are looked at besides the summit that the scan brackets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from engine.batch.frequency.margins import solved
from engine.batch.frequency.scan import Path, Readings, Scan
from engine.model.linear_system import Array
from engine.model.masks import FrequencyBounds, Magnitude, Mask

_OUTSIDE = -1.0
"""Below every ratio."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """What of a gain G is bounded, and its derivative by G."""

    shape: Callable[[Array], Array]
    slope: Callable[[Array], Array]


@dataclass(frozen=True, slots=True)
class _Height:
    """The ratio of a quantity to one bound, nothing outside the span of the bound."""

    quantity: Quantity
    line: Magnitude
    power: float

    def __call__(self, g: Array, omega: Array) -> Array:
        low, high = self.line.span
        inside = (omega >= low) & (omega <= high)
        with np.errstate(all="ignore"):
            bound = self.line(np.where(inside, omega, max(low, 1e-300)))
            ratio = (np.abs(self.quantity.shape(g)) / bound) ** self.power
        return np.where(inside, ratio, _OUTSIDE)


def ratio(path: Path, scan: Scan, mask: Mask, quantity: Quantity) -> Readings:
    """Return the worst ratio of a quantity to its bounds."""
    assert isinstance(mask, FrequencyBounds)
    everyone = np.arange(path.batch)
    worst: Array | None = None
    for line, power in mask.sides:
        height = _Height(quantity, line, power)
        omega = scan.peak(height)
        top = height(scan.at(everyone, omega[:, None]), omega[:, None])[:, 0]
        marks = np.array([corner for corner in line.corners if corner > 0])
        if marks.size:
            at = np.broadcast_to(marks, (path.batch, marks.size))
            beside = np.nan_to_num(height(scan.at(everyone, at), at), nan=np.inf)
            best = beside.argmax(axis=1)
            omega = np.where(beside[everyone, best] > top, marks[best], omega)
        g, tangent, _ = solved(path, everyone, omega)
        shaped = quantity.shape(g)
        size = np.abs(shaped)
        moved = (np.conj(shaped) * quantity.slope(g) * tangent).real / np.where(size > 0, size, 1.0)
        with np.errstate(all="ignore"):
            here = ((size + 1j * moved) / line(omega)) ** power
        worst = here if worst is None else np.where(here.real > worst.real, here, worst)
    assert worst is not None
    return Readings(value=worst, doubtful=~np.isfinite(worst.real))


_GAIN = Quantity(lambda g: g, np.ones_like)
_ERROR = Quantity(lambda g: 1 - g, lambda g: -np.ones_like(g))
_SENSITIVITY = Quantity(lambda g: 1 / (1 + g), lambda g: -1 / (1 + g) ** 2)
_COMPLEMENTARY = Quantity(lambda g: g / (1 + g), lambda g: 1 / (1 + g) ** 2)

PATH_MASKS: Mapping[str, Quantity] = MappingProxyType({"path_bound": _GAIN, "error_bound": _ERROR})
LOOP_MASKS: Mapping[str, Quantity] = MappingProxyType(
    {"sensitivity_bound": _SENSITIVITY, "complementary_bound": _COMPLEMENTARY, "loop_bound": _GAIN}
)
"""What screening can bound of paths and loops."""
