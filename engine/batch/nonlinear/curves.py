"""Many sampled curves: Hermite's cubic between the samples, so that nothing is ever read off the grid.

    y(θ) = (1 - θ)² (1 + 2θ) y_0 + θ² (3 - 2θ) y_1 + θ (1 - θ)² h y'_0 - θ² (1 - θ) h y'_1

Metrics are read from them in `engine.batch.nonlinear.readings`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from engine.exact.time.tail_of_integral import has_ended

Real = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Reading = tuple[Real, Flags]
"""Values (B,), NaN where the metric does not exist, and who is doubtful."""

STILL: Final = 1e-6
"""A curve whose last tenth stays within this part of its size has settled."""
NEAR: Final = 1e-3
"""One whose last tenth stays within this part of its size of the state of rest has settled on the exact path;"""
_BETWEEN: Final = 0.1
"""this much nearer or further there is no doubt about it."""
_STEADY: Final = 1e-4
"""A rate that changes by less than this part of itself in the last tenth is constant."""
RESOLVED: Final = 1e-4
"""What a kink between two samples may change at most in a metric, relatively."""
NEARLY: Final = 1e-4
"""A turning point this near to a level, in parts of it, leaves open whether it is passed."""
_ROUNDING: Final = 1e-12
_HALVINGS: Final = 40


@dataclass(frozen=True, kw_only=True, eq=False)
class Corners:
    """Corners of curves that lie between samples.

    Attributes
    ----------
    extremes : ndarray, shape (4, B) of one output, (4, watched, B) of all
        The largest value at a corner, its instant, the smallest one and its instant.
    before : ndarray of bool, shape (N, B)
        Whether there is one between a sample and that before.
    """

    extremes: Real
    before: Flags

    def of(self, output: int) -> Corners:
        """Return those of one of several outputs."""
        return Corners(extremes=self.extremes[:, output], before=self.before)


@dataclass(frozen=True, kw_only=True, eq=False)
class Curves:
    """One output of B candidates.

    Attributes
    ----------
    times : ndarray, shape (N,)
        s; twice where a command breaks.
    values, slopes : ndarray, shape (N, B)
    errors : ndarray, shape (N, 2, B) or None
        Reference minus output at the samples, and in the middle of what follows them.
    start, last : float
        When the command begins, and when it changes for the last time, s.
    initial : ndarray, shape (B,)
        Value just before the command.
    constant : bool
        Whether all commands settle.
    target : float or None
        Where the reference settles.
    duration : float or None
        The limit that was asked for.
    echoes : float
        How long what has happened may still be under way through the delays, s.
    corners : Corners or None
        The corners that are known.
    rest : ndarray, shape (B,), or None
        Where the output is when everything rests, NaN where that is not known or no rest is there.
    single : ndarray of bool, shape (B,), or None
        Whether that is the only rest nearby.
    moving : ndarray of bool, shape (B,), or None
        Whether a state that the output follows goes on moving in the end, so that what stands still may do so for a while.
    """

    times: Real
    values: Real
    slopes: Real
    errors: Real
    start: float
    last: float
    initial: Real
    constant: bool
    target: float | None
    duration: float | None
    echoes: float = 0.0
    corners: Corners | None = None
    rest: Real | None = None
    single: Flags | None = None
    moving: Flags | None = None

    @cached_property
    def size(self) -> Real:
        """Largest absolute sample, (B,)."""
        return np.asarray(np.abs(self.values).max(axis=0))

    @cached_property
    def late(self) -> npt.NDArray[np.intp]:
        """Samples in the last tenth of what follows the last change of the commands, and the echoes before; the last one where nothing follows."""
        end = float(self.times[-1])
        return np.flatnonzero(self.times >= min(end, max(self.last, 0.1 * self.last + 0.9 * end - self.echoes)))

    @cached_property
    def _constant(self) -> bool:
        return self.constant and bool(self.times[-1] > self.last)

    @cached_property
    def _spread(self) -> Real:
        return np.asarray(np.maximum(np.ptp(self.values, axis=0), 1e-12 * self.size))

    @cached_property
    def _away(self) -> Real:
        """How far the last tenth is from rest, in parts of the size; NaN where no rest is known, (B,)."""
        if self.rest is None:
            return np.full(self.values.shape[1], np.nan)
        return np.asarray(np.abs(self.values[self.late] - self.rest).max(axis=0) / self._spread)

    @cached_property
    def still(self) -> Flags:
        """Who does not move any more under constant commands, (B,)."""
        if not self._constant:
            return np.zeros(self.values.shape[1], dtype=bool)
        return self._stands if self.moving is None else np.asarray(self._stands & ~self.moving)

    @cached_property
    def _stands(self) -> Flags:
        """Whose last tenth stands still, whatever it may do later, (B,)."""
        return np.asarray(np.ptp(self.values[self.late], axis=0) <= STILL * self._spread)

    @cached_property
    def dies_away(self) -> Flags:
        """Whose distance from the last value, weighted with time, has an integral that lacks nothing, (B,)."""
        behind = self.times >= self.last
        away = self.values[behind] - self.values[-1]
        return has_ended(self.times[behind], away, self.last, lambda away, t: t * np.abs(away))

    @cached_property
    def slow(self) -> Flags:
        """Who moves so little in the end that rest may be near, (B,)."""
        return np.asarray(np.ptp(self.values[self.late], axis=0) <= 3 * NEAR * self._spread)

    @cached_property
    def steady(self) -> Flags:
        """Who goes on moving at a constant rate in the end, (B,)."""
        rates = self.slopes[self.late]
        return np.asarray(~self.settled & (np.ptp(rates, axis=0) <= _STEADY * np.abs(rates).max(axis=0)))

    @cached_property
    def _rising(self) -> Flags:
        """Who is further beyond rest in the end than ever before, in no time that was asked for: a peak is to come, (B,)."""
        last, rest = self.values[-1], self.rest
        if rest is None or self.duration is not None:
            return np.zeros(len(last), dtype=bool)
        above = (last > rest) & (last >= self.values.max(axis=0))
        return np.asarray(above | (last < rest) & (last <= self.values.min(axis=0)))

    @cached_property
    def settled(self) -> Flags:
        """Who has come to rest, or near to the only rest there is, (B,)."""
        if not self._constant or self.single is None:
            return self.still
        return np.asarray(self.still | (self.single & (self._away <= (1 - _BETWEEN) * NEAR) & ~self._rising))

    @cached_property
    def restless(self) -> Flags:
        """Who has not settled by any standard in a time that was asked for, (B,)."""
        if self.duration is None or not self._constant:
            return np.zeros(self.values.shape[1], dtype=bool)
        return np.asarray(~self.still & (~self.slow | (self._away > (1 + _BETWEEN) * NEAR)))

    @cached_property
    def stuck(self) -> Flags:
        """Who stands still in the end, in a time that was asked for, and not near to rest: what drives it may tear it loose, (B,)."""
        if self.duration is None or not self._constant or self.rest is None:
            return np.zeros(self.values.shape[1], dtype=bool)
        near = self._away <= (1 + _BETWEEN) * NEAR
        return np.asarray(self._stands & ~self.settled & ~near)

    @cached_property
    def ended(self) -> Flags:
        """Who has settled, is stuck, or shows by any standard that it has not and moves unevenly: its last value is then its end, (B,)."""
        return np.asarray(self.settled | self.stuck | (self.restless & ~self.steady))

    @cached_property
    def final(self) -> Real:
        """Where the settled ones rest, and the others have come to, (B,)."""
        if self.rest is None:
            return np.asarray(self.values[-1])
        return np.where(self.settled & ~np.isnan(self.rest), self.rest, self.values[-1])

    @cached_property
    def turning(self) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], Real, Real]:
        """Turning points between samples: number of the sample before, candidate, value, time."""
        width = np.diff(self.times)[:, None]
        passes = (self.slopes[:-1] * self.slopes[1:] < 0) & (width > 0)
        if self.corners is not None:  # a cubic swings beyond a corner
            passes &= ~self.corners.before[1:]
        k, b = np.nonzero(passes)
        h = width[k, 0]
        y0, y1, d0, d1 = self.values[k, b], self.values[k + 1, b], h * self.slopes[k, b], h * self.slopes[k + 1, b]
        # y' = d0 + 2 (3 Δ - 2 d0 - d1) θ + 3 (d0 + d1 - 2 Δ) θ², of which one root lies between
        rise = y1 - y0
        c2, c1 = 3 * (d0 + d1 - 2 * rise), 2 * (3 * rise - 2 * d0 - d1)
        root = np.sqrt(np.maximum(c1 * c1 - 4 * c2 * d0, 0.0))
        q = -0.5 * (c1 + np.where(c1 >= 0, root, -root))
        with np.errstate(all="ignore"):
            first, second = q / c2, d0 / q
        theta = np.where((first >= 0) & (first <= 1), first, second)
        theta = np.clip(np.nan_to_num(theta), 0.0, 1.0)
        return k, b, _hermite(theta, y0, y1, d0, d1), self.times[k] + theta * h

    @cached_property
    def extremes(self) -> tuple[Real, Real, Real, Real]:
        """Largest value and its time, smallest value and its time, each (B,)."""
        _, b, value, time = self.turning
        found: list[Real] = []
        for sign in (1.0, -1.0):
            place = np.argmax(sign * self.values, axis=0)
            best = np.take_along_axis(self.values, place[None], axis=0)[0]
            at = self.times[place].copy()
            order = np.argsort(sign * value, kind="stable")  # the best of a candidate comes last
            top = np.full(len(best), -np.inf)
            when = at.copy()
            top[b[order]], when[b[order]] = (sign * value)[order], time[order]
            better = top > sign * best
            best, at = np.where(better, sign * top, best), np.where(better, when, at)
            if self.corners is not None:
                corner, time_of_it = self.corners.extremes[:2] if sign > 0 else self.corners.extremes[2:]
                better = sign * corner >= sign * best - _ROUNDING * self.size
                best, at = np.where(better, corner, best), np.where(better, time_of_it, at)
            found += [best, at]
        return found[0], found[1], found[2], found[3]

    @cached_property
    def bend(self) -> Real:
        """What a kink between samples is worth where the curve is furthest from 0, (B,).

        It reaches no further than to where the straight lines through both samples meet: at a limit, not at all.
        """
        place = np.argmax(np.abs(self.values), axis=0)
        b = np.arange(self.values.shape[1])
        sign = np.sign(self.values[place, b])
        worth = np.zeros(len(b))
        for before in (np.maximum(place - 1, 0), np.minimum(place, len(self.times) - 2)):
            h = self.times[before + 1] - self.times[before]
            y0, y1 = sign * self.values[before, b], sign * self.values[before + 1, b]
            d0, d1 = sign * self.slopes[before, b], sign * self.slopes[before + 1, b]
            with np.errstate(all="ignore"):
                meet = np.clip(np.nan_to_num((y1 - d1 * h - y0) / (d0 - d1)), 0.0, h)
            top = np.maximum(y0, y1)
            if self.corners is not None:  # those that are known count, what follows them may not be
                corner = np.where(sign >= 0, self.corners.extremes[0], -self.corners.extremes[2])
                top = np.maximum(top, np.where(self.corners.before[before + 1, b], corner, top))
            beyond = np.maximum(y0 + d0 * meet - top, 0.0)
            worth = np.maximum(worth, np.minimum(beyond, self.kink(before)))
        return worth

    @cached_property
    def cornered(self) -> Flags:
        """Who is at a corner where the curve is furthest from 0: it may have come to it earlier, or stay there, (B,).

        Near to one that comes back through a delay nobody knows the instant of a turning point well.
        """
        if self.corners is None:
            return np.zeros(self.values.shape[1], dtype=bool)
        highest, _, lowest, _ = self.corners.extremes
        place = np.argmax(np.abs(self.values), axis=0)
        bent = np.maximum(self.kink(np.maximum(place - 1, 0)), self.kink(np.minimum(place, len(self.times) - 2)))
        return np.asarray((np.maximum(highest, -lowest) >= (1 - _ROUNDING) * self.size) | (bent > STILL * self.size))

    def kink(self, place: npt.NDArray[np.intp]) -> Real:
        """Return how far the curve may be from its cubic behind the samples ``place`` (B,): h |Δy'|/8 of what sticks out.

        A smooth curve bends as much there as on both sides.
        """
        h = self.times[place + 1] - self.times[place]
        own, left, right = (self._curvature(place + k) for k in (0, -1, 1))
        left, right = np.where(np.isnan(left), right, left), np.where(np.isnan(right), left, right)
        return np.asarray(h * h * np.abs(np.nan_to_num(own - 0.5 * (left + right))) / 8)

    def _curvature(self, place: npt.NDArray[np.intp]) -> Real:
        """Return the mean of y'' behind samples, NaN where there is no width."""
        inside = np.clip(place, 0, len(self.times) - 2)
        b = np.arange(self.values.shape[1])
        width = self.times[inside + 1] - self.times[inside]
        with np.errstate(all="ignore"):
            found = (self.slopes[inside + 1, b] - self.slopes[inside, b]) / width
        return np.where((place == inside) & (width > 0), found, np.nan)

    def first_passage(self, level: Real, sign: Real) -> Reading:
        """Return when the curve first comes to a level from the side ``sign`` says, and who may do so earlier unseen."""
        beyond = sign * (self.values - level) >= 0
        place = np.argmax(beyond, axis=0)
        exists = beyond.any(axis=0)
        time, unsure = self._passage(np.maximum(place - 1, 0), level)
        time = np.where(exists, np.where(place == 0, self.times[0], time), np.nan)
        k, b, value, _ = self.turning
        hidden = (k < np.where(exists, place, len(self.times))[b]) & (sign[b] * (value - level[b]) > -self._near(b))
        return time, self._any(b[hidden]) | unsure & exists

    def last_outside(self, half: Real) -> Reading:
        """Return when the curve enters the band of ± ``half`` around its end for good, and who may leave it unseen."""
        away = np.abs(self.values - self.final)
        outside = away > half
        count = len(self.times)
        place = count - 1 - np.argmax(outside[::-1], axis=0)
        exists = outside.any(axis=0)
        place = np.where(exists, np.minimum(place, count - 2), 0)
        value = np.take_along_axis(self.values, place[None], axis=0)[0]
        level = self.final + np.where(value > self.final, half, -half)
        time, unsure = self._passage(place, level)
        time = np.where(exists, time, self.times[0])
        k, b, turned, _ = self.turning
        later = k >= np.where(exists, place, -1)[b]
        hidden = later & (np.abs(turned - self.final[b]) > half[b] * (1 - NEARLY) - self._near(b))
        # the turning point of the last excursion, only just out of the band, may as well be inside
        k_before = np.where(exists, place, -1)[b]
        barely = (k <= k_before) & (np.abs(np.abs(turned - self.final[b]) / half[b] - 1) <= NEARLY)
        return time, self._any(b[hidden | barely]) | unsure & exists

    def integral(self, of: Callable[[Real, Real], Real]) -> Real:
        """Return the integral of a function of (error, time) since the start of the command, by Simpson's rule.

        Where the error changes its sign, its magnitude has a corner: both sides of it are integrated by themselves.
        """
        times = self.times[:, None]
        widths = np.diff(self.times)[:, None]
        middle = times[:-1] + 0.5 * widths
        t = times - self.start
        ends, inner = of(self.errors[:, 0], t), of(self.errors[:-1, 1], middle - self.start)
        whole = widths * (ends[:-1] + 4 * inner + ends[1:]) / 6
        k, b = np.nonzero(self.errors[:-1, 0] * self.errors[1:, 0] < 0)
        first, mid, last = self.errors[k, 0, b], self.errors[k, 1, b], self.errors[k + 1, 0, b]
        root = _passes(first, mid, last)
        total = np.zeros(len(k))
        for begin, end in ((0.0, root), (root, 1.0)):
            for weight, place in ((1, begin), (4, 0.5 * (begin + end)), (1, end)):
                error = np.where(place == root, 0.0, _parabola(place, first, mid, last))
                total += weight * (end - begin) * of(error, t[k, 0] + place * widths[k, 0])
        whole[k, b] = widths[k, 0] * total / 6
        # one after the other: a sum would take those of a candidate that is alone in another order
        return np.asarray(np.add.accumulate(whole[self.times[:-1] >= self.start], axis=0)[-1])

    def _near(self, b: npt.NDArray[np.intp]) -> Real:
        return np.asarray(1e-7 * self.size[b])

    def _any(self, b: npt.NDArray[np.intp]) -> Flags:
        return np.asarray(np.bincount(b, minlength=self.values.shape[1]) > 0)

    def _passage(self, place: npt.NDArray[np.intp], level: Real) -> Reading:
        """Return when the cubic behind each sample ``place`` (B,) passes a level, by bisection, and who may have a kink there."""
        b = np.arange(self.values.shape[1])
        h = self.times[place + 1] - self.times[place]
        y0, y1 = self.values[place, b] - level, self.values[place + 1, b] - level
        d0, d1 = h * self.slopes[place, b], h * self.slopes[place + 1, b]
        low, high = np.zeros_like(h), np.ones_like(h)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            same = (_hermite(middle, y0, y1, d0, d1) > 0) == (y0 > 0)
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        time = np.asarray(self.times[place] + 0.5 * (low + high) * h)
        unsure = h * self.kink(place) > RESOLVED * np.abs(time - self.start) * np.abs(y1 - y0)
        return time, unsure


def _parabola(theta: Real | float, first: Real, mid: Real, last: Real) -> Real:
    """Return the parabola through values at 0, 1/2 and 1."""
    return first + theta * (4 * mid - 3 * first - last + theta * 2 * (first - 2 * mid + last))


def _passes(first: Real, mid: Real, last: Real) -> Real:
    """Return where the parabola through values at 0, 1/2 and 1, whose ends differ in sign, is 0."""
    rise, bend = 4 * mid - 3 * first - last, 2 * (first - 2 * mid + last)
    q = -0.5 * (rise + np.copysign(np.sqrt(np.maximum(rise * rise - 4 * bend * first, 0.0)), rise))
    with np.errstate(all="ignore"):
        one, other = q / bend, first / q
    return np.clip(np.where((one >= 0) & (one <= 1), one, np.nan_to_num(other)), 0.0, 1.0)


def _hermite(theta: Real, y0: Real, y1: Real, d0: Real, d1: Real) -> Real:
    left, right = 1 - theta, theta
    return np.asarray(
        left * left * (1 + 2 * theta) * y0 + right * right * (3 - 2 * theta) * y1
        + theta * left * left * d0 - right * right * left * d1
    )  # fmt: skip


def middle_of(curves: Curves) -> Real:
    """Return the values in the middle between samples, and the last one again, (N, B)."""
    h = np.diff(curves.times)[:, None]
    between = 0.5 * (curves.values[:-1] + curves.values[1:]) + h * (curves.slopes[:-1] - curves.slopes[1:]) / 8
    return np.concatenate([between, curves.values[-1:]])
