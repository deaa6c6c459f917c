"""What is read off a response: extremes and crossings of the polynomial of each step, found by its roots."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import chebyshev

from optimizers.independent_check.march import NODES, TO_SERIES, March
from optimizers.independent_check.passage import passage

if TYPE_CHECKING:
    from engine.model.masks import Envelope, Polyline
    from engine.signals import Signal
    from optimizers.independent_check.march import Real

_LOOKS = np.linspace(0.0, 1.0, 33)
_TO_LOOKS = chebyshev.chebvander(2 * _LOOKS - 1, len(NODES) - 1) @ TO_SERIES
_STILL = 1e-13
"""A step that varies by less than this part of the response turns nowhere but in its rounding."""
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(12)


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """One output: ``values`` (K, nodes) on steps from ``starts`` of ``widths``; where it settles, and where it was before."""

    starts: Real
    widths: Real
    values: Real
    final: float | None
    initial: float
    begin: float

    @classmethod
    def of(cls, march: March, column: int, *, initial: float, begin: float) -> Trace:
        """Return one output of a march; commands begin at ``begin`` (s)."""
        final = None if march.finals is None else float(march.finals[column])
        return cls(
            starts=march.starts, widths=march.widths, values=march.values[:, :, column], final=final, initial=initial, begin=begin
        )  # fmt: skip

    @property
    def end(self) -> float:
        """Last instant, s."""
        return float(self.starts[-1] + self.widths[-1])

    def settled_at(self, final: float) -> Trace:
        """Return the output with a value at which it settles."""
        return replace(self, final=final)

    def minus(self, line: Callable[[Real], Real]) -> Trace:
        """Return what remains above a function of time that is smooth on every step."""
        times = self.starts[:, None] + self.widths[:, None] * NODES
        times[:, -1] = np.nextafter(times[:, -1], 0.0)
        return Trace(
            starts=self.starts, widths=self.widths, values=self.values - line(times), final=None, initial=0.0, begin=self.begin
        )  # fmt: skip

    def turned(self) -> Trace:
        """Return the output upside down."""
        return Trace(
            starts=self.starts, widths=self.widths, values=-self.values, final=None, initial=-self.initial, begin=self.begin
        )  # fmt: skip

    def cut(self, start: float, end: float) -> Trace:
        """Return the part between two instants."""
        ends = self.starts + self.widths
        chosen = (ends > start * (1 + 1e-14) + 1e-300) & (self.starts < end * (1 - 1e-14))
        first = np.maximum(self.starts[chosen], start)
        width = np.minimum(ends[chosen], end) - first
        values = np.empty((int(chosen.sum()), len(NODES)))
        for row, k in enumerate(np.flatnonzero(chosen)):
            place = 2 * (first[row] + width[row] * NODES - self.starts[k]) / self.widths[k] - 1
            values[row] = chebyshev.chebval(place, TO_SERIES @ self.values[k])
        return Trace(
            starts=first, widths=width, values=values, final=self.final, initial=self.initial, begin=self.begin
        )  # fmt: skip

    def largest(self) -> float:
        """Return the greatest value."""
        looks = self.values @ _TO_LOOKS.T
        best = float(max(looks.max(), self.values.max()))
        reach = np.ptp(looks, axis=1)
        near = (looks.max(axis=1) + 0.05 * reach >= best) & (reach > _STILL * np.abs(self.values).max())
        for k in np.flatnonzero(near):
            series = TO_SERIES @ self.values[k]
            best = max([best, *(float(chebyshev.chebval(place, series)) for place in _turns(series))])
        return best

    def crossings(self, level: float) -> list[float]:
        """Return every instant at which the level is passed, rising."""
        found: list[float] = []
        below = self.values @ _TO_LOOKS.T < level
        jumps = np.zeros(len(below), dtype=bool)
        jumps[1:] = below[1:, 0] != below[:-1, -1]
        changes = below[:, 1:] != below[:, :-1]
        for k in np.flatnonzero(jumps | changes.any(axis=1)):
            if jumps[k]:
                found.append(float(self.starts[k]))
            series = TO_SERIES @ self.values[k]
            series[0] -= level
            for j in np.flatnonzero(changes[k]):
                ends = 2 * _LOOKS[j] - 1, 2 * _LOOKS[j + 1] - 1
                root = passage(partial(chebyshev.chebval, c=series), *ends, xtol=1e-15)
                found.append(float(self.starts[k] + self.widths[k] * (root + 1) / 2))
        return found

    def integral(self, of: Callable[[Real, Real], Real], cuts: list[float]) -> float:
        """Return the integral of a function of (t, y), smooth between ``cuts``."""
        edges = np.unique(np.concatenate([self.starts, [self.end], [c for c in cuts if self.starts[0] < c < self.end]]))
        middles, halves = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
        owner = np.clip(np.searchsorted(self.starts, middles, side="right") - 1, 0, len(self.starts) - 1)
        t = middles[:, None] + halves[:, None] * _POINTS
        place = 2 * (t - self.starts[owner, None]) / self.widths[owner, None] - 1
        series = (self.values @ TO_SERIES.T)[owner]
        y = chebyshev.chebval(place, series.T[:, :, None], tensor=False)
        return float(halves @ (of(t, y) @ _WEIGHTS))


def _turns(series: Real) -> list[float]:
    """Return where a step turns back, -1…1."""
    slope = np.trim_zeros(chebyshev.chebder(series), "b")
    if len(slope) < 2:
        return []
    roots = np.asarray(chebyshev.chebroots(slope))
    found: list[float] = roots.real[(np.abs(roots.imag) < 1e-6) & (np.abs(roots.real) <= 1)].tolist()
    return found


def _way(trace: Trace) -> float:
    assert trace.final is not None
    way = trace.final - trace.initial
    if abs(way) <= 1e-9 * float(np.abs(trace.values).max(initial=0.0)):
        raise ValueError("no way")
    return way


def rise_time(trace: Trace) -> float:
    """First passages of 10 % and 90 %."""
    way = _way(trace)
    instants = []
    for part in (0.1, 0.9):
        level = trace.initial + part * way
        if np.sign(way) * (trace.values[0, 0] - level) >= 0:
            instants.append(float(trace.starts[0]))
        else:
            instants.append(trace.crossings(level)[0])
    return instants[1] - instants[0]


def last_entry(trace: Trace, band: float) -> float:
    """Last passage of either edge of a band around the final value, since the command began."""
    way = _way(trace)
    assert trace.final is not None
    found = [t for edge in (band, -band) for t in trace.crossings(trace.final + edge * way)]
    return max(found) - trace.begin if found else float(trace.starts[0]) - trace.begin


def recovery_time(trace: Trace, band: float, start: float) -> float:
    """Last passage of either edge of an absolute band around where the output was just before a load, since the load.

    Raises
    ------
    ValueError
        Where the output does not come back.
    """
    first = float(trace.starts[0])
    before = trace.initial if start <= first else float(trace.cut(first, start).values[-1, -1])
    if trace.final is None or abs(trace.final - before) > band:
        raise ValueError("not back")
    after = trace.cut(start, trace.end)
    found = [t for edge in (band, -band) for t in after.crossings(before + edge)]
    return max(found) - start if found else 0.0


def overshoot(trace: Trace) -> float:
    """(max - final) / way, of an output that rises."""
    way = _way(trace)
    assert trace.final is not None
    beyond = (trace.largest() - trace.final) / way if way > 0 else (trace.turned().largest() + trace.final) / -way
    return float(beyond) if beyond > 1e-9 else 0.0


def undershoot(trace: Trace) -> float:
    """(initial - min) / way, of an output that rises."""
    way = _way(trace)
    below = (trace.turned().largest() + trace.initial) / way if way > 0 else (trace.largest() - trace.initial) / -way
    return float(below) if below > 1e-9 else 0.0


def peak(trace: Trace) -> float:
    """Greatest |y|, its final value included."""
    return max(trace.largest(), trace.turned().largest(), abs(trace.final or 0.0))


def peak_within(trace: Trace, duration: float) -> float:
    """Greatest |y| up to an instant, s."""
    part = trace.cut(0.0, duration)
    return max(part.largest(), part.turned().largest())


def peak_time(trace: Trace) -> float:
    """When |y| is greatest, since the command began.

    Raises
    ------
    ValueError
        Where the final value is barely exceeded, or the peak is no turning point.
    """
    top = peak(trace)
    if top - abs(trace.final or 0.0) <= 1e-7 * top:
        raise ValueError("no peak")
    part = trace if trace.largest() >= top * (1 - 1e-15) else trace.turned()
    for k in np.flatnonzero((part.values @ _TO_LOOKS.T).max(axis=1) >= 0.99 * top):
        series = TO_SERIES @ part.values[k]
        for place in _turns(series):
            if chebyshev.chebval(place, series) >= top * (1 - 1e-14):
                return float(part.starts[k] + part.widths[k] * (place + 1) / 2) - trace.begin
    raise ValueError("the peak is an edge")


def residual_vibration(trace: Trace, end: float) -> float:
    """Half of the swing that is left when the command has ended."""
    rest = trace.cut(end, trace.end)
    return (rest.largest() + rest.turned().largest()) / 2


def error_integral(trace: Trace, kind: str, reference: Signal | None, duration: float | None) -> float:
    """∫|e|, ∫e² or ∫t|e|, from the command on."""
    error = trace.minus(
        lambda t: np.zeros_like(t) if reference is None else np.asarray(reference.value(t), dtype=float)
    )
    target = 0.0 if reference is None else reference.final()
    if duration is None and (
        target is None or trace.final is None or abs(target - trace.final) > 1e-9 * np.abs(error.values).max()
    ):
        raise ValueError("the error does not go to zero")
    error = error.cut(trace.begin, trace.end if duration is None else duration)
    if kind == "ie":
        return abs(error.integral(_itself, []))
    zeros = error.crossings(0.0)
    forms: dict[str, Callable[[Real, Real], Real]] = {
        "iae": lambda _, e: np.abs(e), "ise": _square, "itae": lambda t, e: (t - trace.begin) * np.abs(e),
    }  # fmt: skip
    return error.integral(forms[kind], zeros)


def envelope(trace: Trace, bounds: Envelope) -> float:
    """1 plus the worst excess."""
    worst = -np.inf
    for line, sign in bounds.sides:
        for a, b, u, v in _straight(line):
            slope = (v - u) / (b - a)
            if a < trace.end:
                part = trace.cut(a, min(b, trace.end)).minus(_line(a, u, slope))
                above = Trace(
                    starts=part.starts,
                    widths=part.widths,
                    values=sign * part.values,
                    final=None,
                    initial=0.0,
                    begin=0.0,
                )
                worst = max(worst, above.largest())
            if b > trace.end:
                assert trace.final is not None
                first = max(a, trace.end)
                worst = max(worst, *(sign * (trace.final - u - slope * (t - a)) for t in (first, b)))
    return 1 + worst / bounds.unit


def tracking_error(trace: Trace, line: Polyline) -> float:
    """Root of the mean square of y - r."""
    total = span = 0.0
    for a, b, u, v in _straight(line):
        slope, span = (v - u) / (b - a), span + b - a
        if a < trace.end:
            total += trace.cut(a, min(b, trace.end)).minus(_line(a, u, slope)).integral(_square, [])
        if b > trace.end:
            assert trace.final is not None
            first = max(a, trace.end)
            d0, d1 = (trace.final - u - slope * (t - a) for t in (first, b))
            total += (b - first) * (d0 * d0 + d0 * d1 + d1 * d1) / 3
    return float(np.sqrt(total / span))


def _itself(_t: Real, e: Real) -> Real:
    return e


def _square(_t: Real, e: Real) -> Real:
    return e * e


def _line(start: float, value: float, slope: float) -> Callable[[Real], Real]:
    def line(t: Real) -> Real:
        return np.asarray(value + slope * (t - start))

    return line


def _straight(line: Polyline) -> list[tuple[float, float, float, float]]:
    """Return (start, end, value at the start, value at the end) of the straight parts."""
    points = zip(line.times, line.values, strict=True)
    return [(a, b, u, v) for (a, u), (b, v) in pairwise(points) if b > a]


READINGS: Mapping[str, Callable[[Trace], float]] = {
    "rise_time": rise_time,
    "settling_time": lambda trace: last_entry(trace, 0.02),
    "response_time": lambda trace: last_entry(trace, 0.05),
    "overshoot": overshoot,
    "undershoot": undershoot,
    "peak": peak,
    "max_velocity": peak,
    "max_acceleration": peak,
    "control_effort": peak,
    "peak_time": peak_time,
}
OF_THE_END = frozenset({"rise_time", "settling_time", "response_time", "overshoot", "undershoot"})
INTEGRALS = frozenset({"iae", "ie", "ise", "itae"})
