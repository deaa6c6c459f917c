"""The exact frequency response of one path, and where it crosses a level or peaks, without a frequency grid.

A scan brackets: it starts from the corner frequencies of poles and zeros and is refined until ln G is nearly straight
between neighbours. Inside its bracket each crossing and each peak is then found on G itself to rounding.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigvals

from engine.exact.frequency.poles import Poles, poles
from engine.exact.frequency.roots import roots
from engine.exact.frequency.transfer_function import TransferFunction

if TYPE_CHECKING:
    from engine.exact.frequency.shapes import Shape
    from engine.model.linear_system import Array, LaneSystem

Real = npt.NDArray[np.float64]
SMALLEST_LOOP_GAIN = 1e-3
"""Crossings of a loop gain below this are not listed."""

_STRAIGHT = 0.01
_NEAR = 0.03
"""Part of the magnitude within which a curve that is so straight may touch a level between two points of its scan."""
_SILENT = 1e-20
"""Below this part of 1, and of the largest magnitude, nobody looks: 400 dB."""
_TOLD = 1e3
"""A response bends where it does only if it is so many times what rounding may have made of it."""
_ROUNDING = 1e-12
_MOST_POINTS = 40_000


class FrequencyResponse(TransferFunction):
    """The response of a system with one input and one output.

    Parameters
    ----------
    system : LaneSystem
        One input, one output.
    corners : ndarray
        Further corner frequencies, rad/s (those of the closed loop, say), at which the scan looks closely; none at 0.
    needles : ndarray
        Poles at which the scan looks closely only where it comes by, down to the slowest: a chain of echoes has no end.
    floor : float
        The scan ends where the magnitude has fallen below this part of its low-frequency or peak value.
    solved : LaneSystem, optional
        The same response in equations that keep more digits (see :mod:`engine.diagram.rates`).
    """

    def __init__(
        self,
        system: LaneSystem,
        *,
        corners: npt.NDArray[np.complex128] | None = None,
        needles: npt.NDArray[np.complex128] | None = None,
        floor: float = 1e-3,
        solved: LaneSystem | None = None,
    ) -> None:
        super().__init__(system, solved=solved)
        self._corners = np.zeros(0, dtype=complex) if corners is None else corners
        self._needles = np.zeros(0, dtype=complex) if needles is None else needles
        self._floor = floor

    @classmethod
    def near(cls, system: LaneSystem, found: Poles, *, floor: float = 1e-3, solved: LaneSystem | None = None) -> Self:
        """Return the response of ``system``, looked at closely where these poles are; at 0 there is nothing to look at."""
        corners, endless = found.values[~found.at_zero], found.endless[~found.at_zero]
        return cls(system, corners=corners[~endless], needles=corners[endless], floor=floor, solved=solved)

    @cached_property
    def corner_frequencies(self) -> npt.NDArray[np.complex128]:
        """Poles and zeros of the delay-free part and the corners given, as complex numbers (damping matters).

        Poles that cannot be told from 0 are no corners: rounding parts two integrators by its square root, and below that
        the response is not what it says.
        """
        s = self.system.value
        a = s.a[0]
        own = poles(s.part(np.arange(s.n), np.arange(0)))
        found = [own.values[~own.at_zero], self._corners]
        if not s.m and s.n:
            pencil = np.block([[a, s.b1[0]], [s.c1[0], s.d11[0]]])
            weight = np.diag([*([1.0] * s.n), 0.0])
            size = max(float(np.abs(a).max()), 1e-300)
            zeros = eigvals(pencil, weight)
            found.append(zeros[np.isfinite(zeros) & (np.abs(zeros) < 1e8 * size)])
        corners = np.concatenate(found)
        top = float(np.abs(corners).max(initial=0.0))
        return np.asarray(corners[np.abs(corners) > 1e-12 * top])

    @property
    def bends(self) -> Real:
        """Where the magnitude bends, rad/s: its corners, and of an endless chain of poles the slowest."""
        return np.append(np.abs(self.corner_frequencies), np.sort(np.abs(self._needles))[:1])

    @property
    def scan(self) -> tuple[Real, npt.NDArray[np.complex128]]:
        """Frequencies (rad/s, rising) and the response there, fine enough that nothing hides between neighbours."""
        return self._scan[:2]

    @property
    def resolved(self) -> float:
        """The frequency, rad/s, up to which the scan follows the turns of the delays; infinite where that is all there is."""
        return self._scan[2]

    @cached_property
    def _scan(self) -> tuple[Real, npt.NDArray[np.complex128], float]:
        corners = self.corner_frequencies
        size = np.abs(corners)
        total_delay = float(self.system.delays[0].real.sum())
        if total_delay:
            size = np.append(size, 1 / total_delay)
        if not len(size):
            size = np.ones(1)
        # the chain has no end, but a slowest link: an integral that hardly acts meets the rest far below every corner
        low, high = 1e-3 * min(size.min(), np.abs(self._needles).min(initial=np.inf)), 1e3 * size.max()
        low, high = self._extend(low, high)
        omega = np.geomspace(low, high, int(np.clip(30 * np.log10(high / low), 60, 1200)))
        # a lightly damped pair is a needle on the frequency axis: look at it on its own scale
        for corner in np.concatenate([corners, self._needles]):
            width = max(abs(corner.real), 1e-9 * abs(corner))
            around = abs(corner.imag) + width * np.array([-8, -4, -2, -1, -0.5, 0, 0.5, 1, 2, 4, 8])
            omega = np.concatenate([omega, around[(around > low) & (around < high)]])
        resolved, faint = np.inf, 0.0
        if total_delay:
            turns, resolved, faint = self._turns(low, high, total_delay)
            omega = np.concatenate([omega, turns])
        omega = np.unique(omega)
        # two points that differ by rounding alone make a false summit between them, and hide the bracket of the true one
        omega = omega[np.diff(omega, prepend=0.0) > 1e-12 * omega]
        return *self._refined(omega, faint), resolved

    def _extend(self, low: float, high: float) -> tuple[float, float]:
        """Move the ends until an integrator has lifted, and a roll-off has lowered, the magnitude enough."""
        for _ in range(12):
            ends = np.abs(self(np.array([low, 10 * low])))
            if ends[0] > 10 or not ends[0] > 3 * ends[1]:
                break
            low /= 10
        top = np.abs(self(np.array([low, np.sqrt(low * high)]))).max()
        for _ in range(12):
            ends = np.abs(self(np.array([high / 10, high])))
            if ends[1] < self._floor * min(1.0, top) or not ends[1] < 0.5 * ends[0]:
                break
            high *= 10
        return low, high

    def _turns(self, low: float, high: float, total_delay: float) -> tuple[Real, float, float]:
        """Return points at equal steps of the delays' phase, how far they suffice, and below which magnitude there are none."""
        coarse = np.geomspace(low, high, 400)
        magnitude = np.abs(self(coarse))
        faint = 0.3 * self._floor * min(1.0, magnitude.max())
        matters = np.flatnonzero(magnitude > faint)
        last = coarse[min(matters[-1] + 1, len(coarse) - 1)] if len(matters) else high
        step = 0.2 / total_delay
        enough = step * _MOST_POINTS / 2
        return np.arange(step, min(last, enough), step), enough if last > enough else np.inf, faint

    def _refined(self, omega: Real, faint: float = 0.0) -> tuple[Real, npt.NDArray[np.complex128]]:
        """Return frequencies and the response with points between neighbours where it bends, as far as rounding lets it be told.

        Below ``faint`` the turns of delays are not followed, only the magnitude.
        """
        values, rounding = self.with_rounding(omega)
        silent = _SILENT * min(1.0, float(np.abs(values[np.isfinite(values)]).max(initial=0.0)))
        fresh = np.ones(len(omega) - 1, dtype=bool)
        for _ in range(30):
            where = np.flatnonzero(fresh)
            if not len(where) or len(omega) > _MOST_POINTS:
                break
            middle = np.sqrt(omega[where] * omega[where + 1])
            between, unsure = self.with_rounding(middle)
            left, right = values[where], values[where + 1]
            bent = np.zeros(len(where), dtype=bool)
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                for shift in (0.0, 1.0):  # ln L and ln (1 + L): the sensitivity is sharp where L passes -1
                    ratio = (between + shift) ** 2 / ((left + shift) * (right + shift))
                    bent |= ~(np.abs(np.log(ratio)) < _STRAIGHT)
                level = np.abs(np.log(np.abs(between) ** 2 / np.abs(left * right))) < _STRAIGHT
            size = np.maximum(np.abs(left), np.abs(right))
            bent &= omega[where + 1] / omega[where] > 1 + 1e-9
            bent &= ~((size < faint) & level)
            doubtful = np.maximum(unsure, np.maximum(rounding[where], rounding[where + 1]))
            bent &= size > np.maximum(silent, _TOLD * doubtful)
            keep = where[bent]
            position = keep + 1
            omega = np.insert(omega, position, middle[bent])
            values = np.insert(values, position, between[bent])
            rounding = np.insert(rounding, position, unsure[bent])
            fresh = np.zeros(len(omega) - 1, dtype=bool)
            shifted = keep + np.arange(len(keep))
            fresh[shifted] = fresh[shifted + 1] = True
        return omega, values

    def crossings(
        self, shape: Shape, level: Array | float, *, floor: float = 0.0, until: float = np.inf
    ) -> list[Array]:
        """Return the frequencies where ``shape`` passes through ``level``, rising, each of shape (lanes,).

        Where the magnitude stays below ``floor`` nothing is looked for: behind a delay a fading response crosses an axis
        thousands of times. Neither is it beyond ``until`` (rad/s).
        """
        base = float(np.ravel(np.asarray(level))[0].real)
        omega, values = self.scan
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            level_of = shape(values.real, values.imag) - base
        omega, values, level_of = self._with_turns(shape, base, omega, values, level_of)
        finite = np.isfinite(level_of)
        magnitude = np.abs(values)
        # the scan is straight to one percent: half the floor at both neighbours keeps what lies between below it
        matters = np.maximum(magnitude[:-1], magnitude[1:]) >= 0.5 * floor
        matters &= omega[1:] <= until
        changes = (level_of[:-1] < 0) != (level_of[1:] < 0)
        where = np.flatnonzero(changes & matters & finite[:-1] & finite[1:])

        def height(w: Real) -> Real:
            g = self(w)
            return np.asarray(shape(g.real, g.imag) - base)

        found = roots(height, omega[where], omega[where + 1])
        # at a pole on the axis the sign changes through infinity; a neighbour on the level itself is as near as rounding
        sides = np.minimum(np.abs(level_of[where]), np.abs(level_of[where + 1]))
        size = np.minimum(magnitude[where], magnitude[where + 1])
        passes = np.abs(height(found)) <= np.maximum(sides, _ROUNDING * np.maximum(size, size * size))
        found = found[passes]
        return [self._moving(shape, float(root), level) for root in found]

    def _with_turns(
        self, shape: Shape, base: float, omega: Real, values: npt.NDArray[np.complex128], level_of: Real
    ) -> tuple[Real, npt.NDArray[np.complex128], Real]:
        """Add the turning points between neighbours on one side of a level, where they may lie on the other side.

        The scan is straight to one percent, so that only what is about as near to the level can.
        """
        with np.errstate(invalid="ignore", over="ignore"):
            magnitude = np.abs(values)
            reach = _NEAR * np.maximum(magnitude, magnitude * magnitude)
            near = np.abs(level_of) <= reach
            together = (level_of[:-1] < 0) == (level_of[1:] < 0)
        left = np.flatnonzero((near[:-1] | near[1:]) & together & np.isfinite(level_of[:-1] + level_of[1:]))
        if not len(left):
            return omega, values, level_of
        ends = np.unique(np.concatenate([left, left + 1]))
        away = self.slope(shape, omega[ends]) * np.where(level_of[ends] < 0, -1.0, 1.0)
        left = left[(away[np.searchsorted(ends, left)] < 0) & (away[np.searchsorted(ends, left + 1)] > 0)]
        turns = roots(lambda w: self.slope(shape, w), omega[left], omega[left + 1])
        between = self(turns)
        heights = np.asarray(shape(between.real, between.imag) - base)
        return (
            np.insert(omega, left + 1, turns),
            np.insert(values, left + 1, between),
            np.insert(level_of, left + 1, heights),
        )

    def _moving(self, shape: Shape, root: float, level: Array | float) -> Array:
        """Let the root at ``root`` carry its derivatives: dω/dp = -(∂g/∂p) / (∂g/∂ω)."""
        if self.system.dtype is np.float64 and not np.iscomplexobj(level):
            return np.full(self.system.lanes, root)
        slope = float(self.slope(shape, np.array([root]))[0])
        value = self.shape(shape, np.asarray(root)) - level
        return np.asarray(root - 1j * value.imag / slope) if slope else np.full(self.system.lanes, root)

    def peak(self, shape: Shape) -> tuple[Array, float]:
        """Return (largest value, frequency) of ``shape`` over the scan, its two ends included."""
        omega, values = self.scan
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            heights = shape(values.real, values.imag)
        heights = np.where(np.isfinite(heights), heights, np.inf)
        best = (float(heights[0]), float(omega[0]))
        if heights[-1] > best[0]:
            best = (float(heights[-1]), float(omega[-1]))
        tops, summits = self.summits(shape, omega, heights)
        if len(tops):
            at = int(np.argmax(summits))
            best = max(best, (float(summits[at]), float(tops[at])))
        return self.shape(shape, np.asarray(best[1])), best[1]

    def summits(self, shape: Shape, omega: Real, heights: Real) -> tuple[Real, Real]:
        """Return (frequencies, heights) of those summits between the ends of the scan that may be the highest."""
        inner = np.flatnonzero((heights[1:-1] >= heights[:-2]) & (heights[1:-1] >= heights[2:])) + 1
        if not len(inner) or not np.isfinite(heights.max()):
            return np.zeros(0), np.zeros(0)
        # the scan is straight to one percent: a summit rises above its point by less than that falls to the neighbours
        fall = heights[inner] - np.minimum(heights[inner - 1], heights[inner + 1])
        inner = inner[heights[inner] + fall >= heights[inner].max()]
        tops = roots(lambda w: self.slope(shape, w), omega[inner - 1], omega[inner + 1])
        summits = self(tops)
        return tops, np.asarray(shape(summits.real, summits.imag))
