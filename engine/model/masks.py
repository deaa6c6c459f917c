"""What a whole curve is held against: bounds on a signal over time, bounds on a gain over frequency.

over time:       straight lines between (t_k, y_k); two points at one instant are a jump; outside the points nothing is asked
over frequency:  straight lines between (ln ω_k, ln m_k), or the magnitude of a rational function, |N(jω) / D(jω)|
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from engine.model.errors import MaskError

Real = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Segment:
    """A straight line over time: ``value + slope (t - start)`` from ``start`` to ``end``."""

    start: float
    end: float
    value: float
    slope: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Polyline:
    """Straight lines between points over time.

    Parameters
    ----------
    times : tuple of float
        s, never falling; the same instant twice is a jump.
    values : tuple of float
        SI, one for each instant.

    Raises
    ------
    MaskError
        If there are not two points, numbers that are not finite, or times that fall.
    """

    times: tuple[float, ...]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        _check_points(self.times, self.values, "times")
        for index, (before, after) in enumerate(pairwise(self.times)):
            if after < before:
                raise MaskError(f"times must not fall, got {before:g} s then {after:g} s", at=(index + 1, 0))
        if self.times[0] < 0:
            raise MaskError(f"times must be >= 0 s, got {self.times[0]:g}", at=(0, 0))
        if not self.segments:
            raise MaskError(f"times must reach over more than one instant, got {self.times[0]:g} s alone", at=(0, 0))

    @property
    def segments(self) -> tuple[Segment, ...]:
        """The lines, in the order of time; a jump is none."""
        points = list(zip(self.times, self.values, strict=True))
        return tuple(Segment(a, b, u, (v - u) / (b - a)) for (a, u), (b, v) in pairwise(points) if b > a)

    @property
    def size(self) -> float:
        """Largest magnitude of the points."""
        return max(abs(value) for value in self.values)


@dataclass(frozen=True, slots=True, kw_only=True)
class Envelope:
    """Where a signal may be: below ``upper``, above ``lower``; an excess is measured in units of ``scale``.

    Raises
    ------
    MaskError
        If there is neither, or the lower one lies above the upper one somewhere.
    """

    upper: Polyline | None = None
    lower: Polyline | None = None
    scale: float | None = None

    def __post_init__(self) -> None:
        if self.upper is None and self.lower is None:
            raise MaskError("bounds must have an upper or a lower line, got neither")
        if self.scale is not None and not (self.scale > 0 and math.isfinite(self.scale)):
            raise MaskError(f"scale must be > 0, got {self.scale:g}", at=("scale",))
        if self.upper is None or self.lower is None:
            return
        for top in self.upper.segments:
            for bottom in self.lower.segments:
                for t in (max(top.start, bottom.start), min(top.end, bottom.end)):
                    if max(top.start, bottom.start) < min(top.end, bottom.end):
                        high = top.value + top.slope * (t - top.start)
                        low = bottom.value + bottom.slope * (t - bottom.start)
                        if low > high * (1 + 1e-12) + 1e-300 and low - high > 1e-12 * abs(low):
                            raise MaskError(
                                f"upper must be >= lower at every instant, got {high:g} < {low:g} at {t:g} s",
                                at=("upper",),
                            )

    @property
    def unit(self) -> float:
        """What an excess is divided by: ``scale``, or the largest magnitude of the lines (1 where all are 0)."""
        if self.scale is not None:
            return self.scale
        return max(line.size for line in (self.upper, self.lower) if line is not None) or 1.0

    @property
    def sides(self) -> tuple[tuple[Polyline, float], ...]:
        """The lines that are there, each with its sign: 1 for the upper one, -1 for the lower one."""
        both = ((self.upper, 1.0), (self.lower, -1.0))
        return tuple((line, sign) for line, sign in both if line is not None)


@runtime_checkable
class Magnitude(Protocol):
    """A bound on a gain over angular frequency."""

    @property
    def span(self) -> tuple[float, float]:
        """Where it holds, rad/s; the upper end may be infinite."""
        ...

    @property
    def corners(self) -> tuple[float, ...]:
        """Where it bends, rad/s."""
        ...

    @property
    def ends(self) -> tuple[float, float]:
        """The bound at both ends of its span; at infinite frequency its limit."""
        ...

    def __call__(self, frequencies: Real) -> Real:
        """Return the bound at angular frequencies within the span."""
        ...

    def steepness(self, frequency: float) -> float:
        """Return d ln m / d ln ω between its bends."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Corners:
    """Straight lines on logarithmic axes between points.

    Raises
    ------
    MaskError
        If there are not two points, frequencies that do not rise, or a number that is not > 0.
    """

    frequencies: tuple[float, ...]
    magnitudes: tuple[float, ...]

    def __post_init__(self) -> None:
        _check_points(self.frequencies, self.magnitudes, "frequencies")
        for index, (frequency, magnitude) in enumerate(zip(self.frequencies, self.magnitudes, strict=True)):
            if frequency <= 0:
                raise MaskError(f"frequencies must be > 0 rad/s, got {frequency:g}", at=(index, 0))
            if magnitude <= 0:
                raise MaskError(f"magnitudes must be > 0, got {magnitude:g}", at=(index, 1))
            if index and frequency <= self.frequencies[index - 1]:
                raise MaskError(
                    f"frequencies must rise, got {self.frequencies[index - 1]:g} then {frequency:g} rad/s",
                    at=(index, 0),
                )

    @property
    def span(self) -> tuple[float, float]:
        """Where it holds, rad/s."""
        return self.frequencies[0], self.frequencies[-1]

    @property
    def corners(self) -> tuple[float, ...]:
        """Where it bends, rad/s."""
        return self.frequencies

    @property
    def ends(self) -> tuple[float, float]:
        """The bound at both ends of its span."""
        return self.magnitudes[0], self.magnitudes[-1]

    def __call__(self, frequencies: Real) -> Real:
        """Return the bound at angular frequencies (rad/s)."""
        return np.asarray(np.exp(np.interp(np.log(frequencies), np.log(self.frequencies), np.log(self.magnitudes))))

    def steepness(self, frequency: float) -> float:
        """Return d ln m / d ln ω between its bends."""
        after = int(np.clip(np.searchsorted(self.frequencies, frequency), 1, len(self.frequencies) - 1))
        rise = math.log(self.magnitudes[after] / self.magnitudes[after - 1])
        return rise / math.log(self.frequencies[after] / self.frequencies[after - 1])


@dataclass(frozen=True, slots=True, kw_only=True)
class Rational:
    """The magnitude of a rational function, highest power of s first, at every frequency.

    Raises
    ------
    MaskError
        If a polynomial is 0 or a coefficient is not finite.
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]

    def __post_init__(self) -> None:
        for name in ("numerator", "denominator"):
            coefficients = getattr(self, name)
            if not any(coefficients) or not all(math.isfinite(c) for c in coefficients):
                raise MaskError(
                    f"{name} must have finite coefficients, one of them not 0, got {list(coefficients)}", at=(name,)
                )

    @property
    def span(self) -> tuple[float, float]:
        """Every frequency."""
        return 0.0, math.inf

    @property
    def corners(self) -> tuple[float, ...]:
        """Magnitudes of the roots: where it bends."""
        roots = np.concatenate([np.roots(self.numerator), np.roots(self.denominator)])
        return tuple(sorted(float(size) for size in np.abs(roots) if size > 0))

    @property
    def ends(self) -> tuple[float, float]:
        """The bound at rest, and its limit at infinite frequency."""
        top, bottom = (np.trim_zeros(c, "f") for c in (self.numerator, self.denominator))
        size = abs(top[0] / bottom[0])
        limit = size if len(top) == len(bottom) else 0.0 if len(top) < len(bottom) else math.inf
        low, under = abs(self.numerator[-1]), abs(self.denominator[-1])
        return low / under if under else math.inf, limit

    def __call__(self, frequencies: Real) -> Real:
        """Return the bound at angular frequencies (rad/s)."""
        s = 1j * np.asarray(frequencies, dtype=float)
        return np.asarray(np.abs(np.polyval(self.numerator, s) / np.polyval(self.denominator, s)))

    def steepness(self, frequency: float) -> float:
        """Return d ln m / d ln ω = Re (s N'/N - s D'/D) at s = jω."""
        s = 1j * frequency
        top, bottom = (s * np.polyval(np.polyder(c), s) / np.polyval(c, s) for c in (self.numerator, self.denominator))
        return float((top - bottom).real)


@dataclass(frozen=True, slots=True, kw_only=True)
class FrequencyBounds:
    """Where a gain may be: below ``upper``, above ``lower``.

    Raises
    ------
    MaskError
        If there is neither.
    """

    upper: Magnitude | None = None
    lower: Magnitude | None = None

    def __post_init__(self) -> None:
        if self.upper is None and self.lower is None:
            raise MaskError("bounds must have an upper or a lower line, got neither")

    @property
    def sides(self) -> tuple[tuple[Magnitude, float], ...]:
        """The lines that are there, each with its exponent: a gain counts as (gain / bound)^exponent, met at 1."""
        both = ((self.upper, 1.0), (self.lower, -1.0))
        return tuple((line, power) for line, power in both if line is not None)


Mask = Envelope | Polyline | FrequencyBounds
"""What a metric of a whole curve needs: an envelope, a reference to follow, bounds over frequency."""


def _check_points(places: Sequence[float], values: Sequence[float], name: str) -> None:
    if len(places) < 2 or len(places) != len(values):
        raise MaskError(f"{name} must be at least two, each with a value, got {len(places)} and {len(values)}")
    for index, (place, value) in enumerate(zip(places, values, strict=True)):
        if not (math.isfinite(place) and math.isfinite(value)):
            raise MaskError(f"points must be finite, got [{place:g}, {value:g}]", at=(index,))
