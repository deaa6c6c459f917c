"""Responses of a linear system with delays, step by step: the drive of a step is a polynomial, its answer exact.

    x' = A x + B v,   v(s) = Σ c_k T_k(2s - 1),   [x; c](s) = exp(s [[h A, h B T(-1)], [0, 2 D]]) [x; c](0)

v holds the commands and the delayed signals, read from the steps before and, where a step is longer than a delay, from the
step itself: that is one linear equation for its nodes. D differentiates Chebyshev series. A step is halved until the series of
all its signals end, doubled where they end early; it never crosses an instant where something breaks.

References
----------
C. Van Loan, "Computing integrals involving the matrix exponential", IEEE TAC 23 (1978) 395-404.
"""

from __future__ import annotations

import bisect
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from numpy.polynomial import chebyshev
from scipy.linalg import matrix_balance

if TYPE_CHECKING:
    from engine.model.linear_system import LinearSystem
    from engine.signals import Signal

Real = npt.NDArray[np.float64]

DEGREE = 10
NODES = (1 - np.cos(np.pi * np.arange(DEGREE + 1) / DEGREE)) / 2
"""Where a step is known, 0…1."""
TO_SERIES = np.linalg.inv(chebyshev.chebvander(2 * NODES - 1, DEGREE))
"""Values at the nodes -> Chebyshev coefficients."""
_DERIVATIVE = np.vstack([2 * chebyshev.chebder(np.eye(DEGREE + 1)), np.zeros(DEGREE + 1)])

_TERMS = 16
"""Of Taylor's series, for a norm of 1/2: 1e-18 of the first."""
_ENDS = 1e-10
"""The last coefficients of a resolved series, relative to the signal's largest value so far."""
_EARLY, _CALM = 1e-12, 2
"""A step is doubled after so many whose last coefficients are as small as this."""
_CANCELLED = 1e-3
"""What is left of a difference counts as this part of its terms at least: it is not known better than to their rounding."""
_DRIVE = 0.1
"""The drive is integrated: its last coefficients count less."""
_SAME = 1e-12
_DIVERGED = 1e60
_MOST_STEPS = 4000
_MOST_WIDTHS = 200
_ECHOES = 6
_MOST_BREAKS = 300
_SETTLED = 1e-9


class CannotFollowError(Exception):
    """The response is beyond what is followed here: too many steps, no end, or it diverges."""


@dataclass(frozen=True, kw_only=True, eq=False)
class March:
    """Steps of a response: ``starts``, ``widths`` (K,) in s, outputs at the nodes ``values`` (K, DEGREE + 1, outputs).

    ``finals`` (outputs,) are the values at which the outputs settle, None for commands that do not.
    """

    starts: Real
    widths: Real
    values: Real
    finals: Real | None

    @property
    def times(self) -> Real:
        """Instants of the nodes, (K, DEGREE + 1)."""
        return np.asarray(self.starts[:, None] + self.widths[:, None] * NODES)


class _Step:
    """The linear map of one width: from the state and the series of the drive to the states at the nodes."""

    def __init__(self, a: Real, b: Real, width: float) -> None:
        n, drives = b.shape
        size = DEGREE + 1
        whole = np.zeros((n + drives * size, n + drives * size))
        whole[:n, :n] = a * width
        whole[:n, n:] = width * np.kron(b, (-1.0) ** np.arange(size))
        whole[n:, n:] = np.kron(np.eye(drives), _DERIVATIVE)
        self.width = width
        self.maps = _exponentials(whole * NODES[:, None, None])[:, :n]

    def states(self, x: Real, series: Real) -> Real:
        """Return the states at the nodes, (DEGREE + 1, n), for a drive with ``series`` (DEGREE + 1, drives)."""
        return np.asarray(self.maps @ np.concatenate([x, series.T.ravel()]))

    def closed(self, read: Real, direct: Real, delays: Real) -> tuple[Real, Real]:
        """Return how delays that are shorter than the step close it: what they read of it, and the inverse of I - P J.

        z = z0 + J w over all nodes, w = past + P z:  w = (I - P J)⁻¹ (past + P z0).  ``read`` (m, n) and ``direct`` (m, m) give
        the delays' inputs z; ``P`` (nodes, nodes, m) interpolates them, earlier by each delay, where that is on the step.
        """
        m, size = len(delays), DEGREE + 1
        own = self.maps[:, :, -m * size :].reshape(size, -1, m, size) @ TO_SERIES  # states for w, node by node
        answer = np.einsum("kn,jnil->jkli", read, own)
        answer[range(size), :, range(size), :] += direct
        earlier = NODES[:, None] - delays / self.width
        place = np.where(earlier >= 0, earlier, 0.0)
        interpolation = np.where(
            (earlier >= 0)[:, :, None], chebyshev.chebvander(2 * place - 1, DEGREE) @ TO_SERIES, 0.0
        )
        through = np.einsum("ukj,jkli->ukli", interpolation, answer).reshape(size * m, size * m)
        return interpolation, np.linalg.inv(np.eye(size * m) - through)


def _exponentials(matrices: Real) -> Real:
    """Return the exponentials of stacked matrices: Taylor's series of the halved matrix, squared back."""
    halvings = max(0, int(np.ceil(np.log2(max(float(np.abs(matrices).sum(axis=2).max()), 1e-300)))) + 1)
    small = matrices / 2.0**halvings
    total = np.broadcast_to(np.eye(matrices.shape[1]), matrices.shape).copy()
    term = total
    for k in range(1, _TERMS):
        term = term @ small / k
        total += term
    for _ in range(halvings):
        total = total @ total
    return total


def _balanced(system: LinearSystem) -> LinearSystem:
    """Return the system in units of its states in which its matrix is even.

    In SI the pressures of a hydraulic axis make it 1e13 s⁻¹, of which rounding leaves no step that is resolved.
    """
    if not system.states:
        return system
    a, (units, _) = matrix_balance(np.asarray(system.a, dtype=float), permute=False, separate=True)
    inward, outward = {"b1": system.b1, "b2": system.b2}, {"c1": system.c1, "c2": system.c2}
    return replace(
        system, a=a, x0=system.x0 / units,
        **{name: matrix / units[:, None] for name, matrix in inward.items()},
        **{name: matrix * units for name, matrix in outward.items()},
    )  # fmt: skip


class Marcher:
    """A system under commands, followed from t = 0.

    Parameters
    ----------
    system : LinearSystem
    commands : sequence of (input index, Signal)
    outputs : sequence of int
        Which outputs.
    """

    def __init__(self, system: LinearSystem, commands: Sequence[tuple[int, Signal]], outputs: Sequence[int]) -> None:
        self._system = system = _balanced(system)
        self._signals = [signal for _, signal in commands]
        inputs = [index for index, _ in commands]
        chosen = list(outputs)
        self._b = np.hstack([system.b1[:, inputs], system.b2])
        self._read = np.vstack([system.c1[chosen], system.c2])
        self._direct = np.block(
            [[system.d11[np.ix_(chosen, inputs)], system.d12[chosen]], [system.d21[:, inputs], system.d22]]
        )
        self._count = len(chosen)
        self._delays = np.asarray(system.delays, dtype=float)
        self._loudest = np.full(self._b.shape[1], 1e-300)
        self._shortest = float(self._delays.min(initial=np.inf))
        self._steps: dict[float, _Step] = {}
        self._closed: dict[float, tuple[Real, Real]] = {}
        self._starts: list[float] = []
        self._widths: list[float] = []
        self._values: list[Real] = []
        self._series: list[Real] = []  # of the inputs of the delays

    def run(self, until: float | None = None) -> March:
        """Follow the response up to ``until`` (s), or until it has settled.

        Raises
        ------
        CannotFollowError
        """
        finals = self._finals()
        if until is None and finals is None:
            raise CannotFollowError
        last = max((t for signal in self._signals for t in (*signal.breakpoints(), signal.end() or 0.0)), default=0.0)
        breaks = deque(self._breaks(until))
        x = np.asarray(self._system.x0, dtype=float).copy()
        for column, signal in enumerate(self._signals):
            x += self._b[:, column] * signal.impulse()
        time, moved, width = 0.0, 0.0, self._first_width(until)
        calm, scale = 0, np.full(len(self._read), 1e-300)
        while until is None or time < until:
            while breaks and breaks[0] <= time:
                breaks.popleft()
            ahead = breaks[0] if breaks else np.inf
            whole = width >= (ahead - time) * (1 - _SAME)
            used = ahead - time if whole else width
            states, signals, size, quality = self._try(time, used, x, scale)
            if quality > _ENDS and used > _SAME * time:
                width, calm = used / 2, 0
                continue
            self._keep(time, used, signals)
            scale = size
            x, time = states[-1], ahead if whole else time + used
            calm = calm + 1 if quality < _EARLY else 0
            if calm > _CALM:
                width, calm = 2 * used, 0
            elif not whole:
                width = used
            if finals is not None and self._moves(signals, finals, scale):
                moved = time
            # at rest for a tenth of the time since the commands ended, and for longer than any echo takes
            since = time - last
            if until is None and time - moved >= since / 10 and since > 3 * float(self._delays.sum()) and since > 0:
                break
        values = np.stack(self._values)[:, :, : self._count]
        return March(starts=np.array(self._starts), widths=np.array(self._widths), values=values, finals=finals)

    def _keep(self, time: float, width: float, signals: Real) -> None:
        """Remember a step, unless it is one too many or diverges."""
        if len(self._starts) >= _MOST_STEPS or not np.abs(signals).max(initial=0.0) < _DIVERGED:
            raise CannotFollowError
        self._starts.append(time)
        self._widths.append(width)
        self._values.append(signals)
        self._series.append(TO_SERIES @ signals[:, self._count :])

    def _first_width(self, until: float | None) -> float:
        fastest = float(np.abs(np.linalg.eigvals(self._system.a)).max(initial=0.0))
        width = min(0.5 / fastest if fastest > 0 else np.inf, float(self._delays.min(initial=np.inf)))
        return min(width, until or np.inf) if np.isfinite(width) else (until or 1.0)

    def _breaks(self, until: float | None) -> list[float]:
        """Return the instants at which a command breaks, and their first echoes."""
        end = 0.0 if until is None else until
        found = {0.0, *(t for signal in self._signals for t in signal.breaks(end))}
        newest = set(found)
        for _ in range(_ECHOES):
            newest = {round(t + delay, 15) for t in newest for delay in self._delays} - found
            if len(found) + len(newest) > _MOST_BREAKS:
                break
            found |= newest
        # instants that differ by rounding alone are one
        instants = sorted(t for t in found if until is None or t < until * (1 - _SAME)) + (
            [] if until is None else [until]
        )
        return [t for t, before in zip(instants, [-1.0, *instants], strict=False) if t - before > _SAME * t]

    def _try(self, time: float, width: float, x: Real, scale: Real) -> tuple[Real, Real, Real, float]:
        """Return states and signals at the nodes, how large the signals count by now, and how far from resolved a step is."""
        step = self._step(width)
        drive = self._drive(time, width)
        if width > self._shortest * (1 + _SAME):
            drive = self._closed_by_delays(step, drive, x)
        series = TO_SERIES @ drive
        states = step.states(x, series)
        signals = states @ self._read.T + drive @ self._direct.T
        self._loudest = np.maximum(self._loudest, np.abs(drive).max(axis=0))
        parts = np.abs(states) @ np.abs(self._read.T) + np.abs(drive) @ np.abs(self._direct.T)
        size = np.maximum(scale, np.maximum(np.abs(signals), _CANCELLED * parts).max(axis=0))
        own = np.abs(TO_SERIES @ signals)[-2:].max(axis=0) / size
        driving = np.abs(series[-2:]).max(axis=0) / self._loudest
        return states, signals, size, float(max(own.max(initial=0.0), _DRIVE * driving.max(initial=0.0)))

    def _step(self, width: float) -> _Step:
        alike = float(f"{width:.12e}")  # widths that differ by rounding share their map
        if alike not in self._steps:
            if len(self._steps) >= _MOST_WIDTHS:
                raise CannotFollowError
            self._steps[alike] = _Step(np.asarray(self._system.a, dtype=float), self._b, alike)
        return self._steps[alike]

    def _closed_by_delays(self, step: _Step, drive: Real, x: Real) -> Real:
        """Return the drive of a step that is longer than a delay, so that it hears itself."""
        m, count = len(self._delays), self._count
        if step.width not in self._closed:
            direct = self._direct[count:, -m:]
            self._closed[step.width] = step.closed(self._read[count:], direct, self._delays)
        interpolation, inverse = self._closed[step.width]
        known = drive.copy()
        known[:, -m:] = 0.0
        inputs = step.states(x, TO_SERIES @ known) @ self._read[count:].T + known @ self._direct[count:].T
        right = drive[:, -m:] + np.einsum("ukj,jk->uk", interpolation, inputs)
        known[:, -m:] = (inverse @ right.ravel()).reshape(-1, m)
        return known

    def _drive(self, time: float, width: float) -> Real:
        """Return commands and delayed signals at the nodes, (DEGREE + 1, drives); the last node from its left.

        Of a delay that is shorter than the step only what comes from before the step.
        """
        t = time + width * NODES
        inner = t.copy()
        inner[-1] = np.nextafter(inner[-1], 0.0)
        columns = [np.asarray(signal.value(inner), dtype=float) for signal in self._signals]
        for channel, delay in enumerate(self._delays):
            before = NODES * width < delay if delay < width * (1 - _SAME) else np.ones(len(NODES), dtype=bool)
            column = np.zeros(len(NODES))
            column[before] = self._past(channel, t[before] - delay, width)
            columns.append(column)
        return np.stack(columns, axis=1)

    def _past(self, channel: int, t: Real, width: float) -> Real:
        """Return a delay's input at earlier instants: 0 before the beginning."""
        found = np.zeros(len(t))
        middle = 0.5 * (t[0] + t[-1])
        if middle < 0 or not self._starts:
            return found
        # instants at the seam of two steps belong to the side that the middle of this step lies on
        nudged = t + np.where(t < middle, 1, -1) * 1e-9 * width
        first = max(bisect.bisect_right(self._starts, nudged[0]) - 1, 0)
        last = bisect.bisect_right(self._starts, nudged[-1]) - 1
        for k in range(first, last + 1):
            end = self._starts[k + 1] if k < last else np.inf
            own = (nudged >= self._starts[k]) & (nudged < end) if k > first else nudged < end
            place = np.clip(2 * (t[own] - self._starts[k]) / self._widths[k] - 1, -1 - 1e-9, 1 + 1e-9)
            found[own] = chebyshev.chebval(place, self._series[k][:, channel])
        found[nudged < 0] = 0.0
        return found

    def _finals(self) -> Real | None:
        """Return where outputs and delays settle, None where a command does not or the system has no rest."""
        ends = [signal.final() for signal in self._signals]
        if any(end is None for end in ends):
            return None
        s = self._system
        n, m = s.states, len(self._delays)
        commands = np.array([float(end or 0.0) for end in ends])
        through = self._direct[self._count :, : len(commands)]
        matrix = np.block([[-s.a, -s.b2], [-s.c2, np.eye(m) - s.d22]])
        right = np.concatenate([self._b[:, : len(commands)] @ commands, through @ commands])
        if not n + m:
            return np.asarray(self._direct[: self._count, : len(commands)] @ commands)
        # rows and columns of one size: states differ by many decades
        rows = 1 / np.maximum(np.abs(matrix).max(axis=1), 1e-300)
        columns = 1 / np.maximum(np.abs(matrix * rows[:, None]).max(axis=0), 1e-300)
        even, target = matrix * rows[:, None] * columns, right * rows
        found, *_ = np.linalg.lstsq(even, target, rcond=1e-14)
        if np.abs(even @ found - target).max() > 1e-9 * max(np.abs(found).max(), np.abs(target).max()):
            return None
        found *= columns
        drive = np.concatenate([commands, found[n:]])
        return np.asarray(self._read[: self._count] @ found[:n] + self._direct[: self._count] @ drive)

    def _moves(self, signals: Real, finals: Real, scale: Real) -> bool:
        """Return whether some output is still away from where it settles during a step."""
        away = np.abs(signals[:, : self._count] - finals).max(axis=0)
        return bool((away > _SETTLED * np.maximum(scale[: self._count], np.abs(finals))).any())
