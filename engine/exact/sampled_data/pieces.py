"""Pure delays beside samplers through which a signal flows on: what is under way is a function, in pieces.

w(t) = v(t - τ). Between the instants at which anything jumps or bends v is smooth: on a piece of length h, in which nothing moves
faster than e^{σt}, a polynomial through N values of it is wrong by about 2 (σ h / 4)^N / N! of its size. The values are states
that move on once in a common period; the polynomial is played back by its derivatives, which a chain of N states carries along.

A jump of v bends what follows it, τ later, less sharply by each lag on the way: its images are followed until they do not matter.

D. Breda, S. Maset, R. Vermiglio, Stability of Linear Delay Differential Equations, chapters 5 and 6 (collocation of the
monodromy operator).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt
from numpy.polynomial import chebyshev

from engine.exact.sampled_data.transport import Clock
from engine.model.errors import UnresolvedError

if TYPE_CHECKING:
    from engine.model.linear_system import Array

_ACCURACY: Final = 1e-13
_SHARPEST: Final = 16
"""Bends of a higher derivative than this are never followed."""
_LONGEST: Final = 2.0
"""A piece is at most so many times as long as what moves fastest takes, 1/σ."""
_LOADS: Final = 4
"""A polynomial is begun anew so many times within its piece: rounding grows by 2.6^N instead of 5.8^N."""
_TOGETHER: Final = 1e-10
"""Instants closer than this part of the common period are one."""
_MOST_PIECES: Final = 400
_MOST_STATES: Final = 600


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Value:
    """The value of a channel at one instant of every period: ``states`` hold it, the youngest first."""

    begins: Clock
    states: range


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Load:
    """An instant of every period at which a polynomial begins: its derivatives are ``matrix`` (lanes, N, taken) times states."""

    at: Clock
    taken: list[int]
    matrix: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Course:
    """What is under way in one channel. ``chain`` are the derivatives of what arrives, each times the power of ``unit``, s."""

    channel: int
    chain: range
    unit: float
    values: list[Value]
    loads: list[Load]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bend:
    """A jump in the derivative of some ``order`` of what a channel takes, at an instant (lanes,) of the common period."""

    instant: Array
    order: int


def courses(
    m: Mapping[str, Array], channels: Sequence[int], jumps: Mapping[str, Sequence[Clock]], period: Array, size: int
) -> tuple[list[Course], int, float]:
    """Return what is under way in ``channels``, the number of states with theirs, and how fast modes are followed, 1/s.

    Parameters
    ----------
    m : mapping
        Matrices of the fractional form.
    channels : sequence of int
        Channels that carry what flows and go on into what flows.
    jumps : mapping
        Clocks at which what enters jumps, by the pair of matrices that it enters by: ``b2`` of other channels, ``b3``.
    period : ndarray, shape (lanes,)
        The common period, s.
    size : int
        Number of states without those of the channels.

    Raises
    ------
    UnresolvedError
        If too many pieces or states would be needed.
    """
    pace = _pace(m, min(float(c.period[0].real) for own in jumps.values() for c in own))
    found, begun = [], size
    for j, bends in _bends(m, channels, jumps, period, pace).items():
        delay = np.asarray(m["delays"][:, j])
        course, size = _course(j, _cut(bends, delay, period, pace), delay, period, pace=pace, size=size)
        found.append(course)
    if size - begun > _MOST_STATES:
        raise UnresolvedError(
            f"what is under way in pure delays beside samplers must be at most {_MOST_STATES} values, got {size - begun}: a "
            f"delay is long, or a state fast ({pace:.3g} rad/s), beside the common period of {float(period[0].real):g} s"
        )
    return found, size, pace


def _pace(m: Mapping[str, Array], shortest: float) -> float:
    """Return how fast signals may move between two jumps, rad/s: as the states do, and inputs below the Nyquist frequency."""
    a, through = m["a"][0].real, m["b2"][0].real @ m["c2"][0].real
    rates = [np.abs(np.linalg.eigvals(matrix)) for matrix in (a, a + through, a - through)]
    return float(max(np.pi / shortest, *(one.max(initial=0.0) for one in rates)))


def _bends(
    m: Mapping[str, Array], channels: Sequence[int], jumps: Mapping[str, Sequence[Clock]], period: Array, pace: float
) -> dict[int, list[Bend]]:
    """Return the bends of what each channel takes, those left out that do not matter."""
    own = list(channels)
    begun: dict[int, list[Bend]] = {j: [] for j in own}
    for enters, clocks in jumps.items():
        lags = _lags(m, enters, own)
        for clock in clocks:
            for k in range(round(float((period / clock.period)[0].real))):
                for place, j in enumerate(own):
                    order = int(lags[place].min(initial=_SHARPEST + 1))
                    instant = _wrapped(clock.first + k * clock.period, period)
                    begun[j].append(Bend(instant=instant, order=order))
    between = _lags(m, "b2", own)[:, own]
    found: dict[int, list[Bend]] = {}
    for sharpest in range(1, _SHARPEST + 1):
        found = _images(begun, own, between, m["delays"], period=period, sharpest=sharpest)
        count = min(len(one) for one in found.values())
        longest = float(period[0].real) if count < 2 else max(_longest(one, period) for one in found.values())
        reach = pace * min(longest, _LONGEST / pace) / 4
        if reach ** (sharpest + 1) / math.factorial(sharpest + 1) < _ACCURACY:
            break
    return found


def _lags(m: Mapping[str, Array], enters: str, channels: Sequence[int]) -> npt.NDArray[np.int64]:
    """Return how many integrations lie between what enters and what each channel takes at least, (channels, entering)."""
    acts, seen = np.any(m["a"] != 0, axis=0), np.any(m["c2"][:, channels] != 0, axis=0)
    entered = np.any(m[enters] != 0, axis=0)
    direct = np.any(m[f"d2{enters[1]}"][:, channels] != 0, axis=0)
    found = np.where(direct, 0, _SHARPEST + 1)
    for lag in range(1, _SHARPEST + 1):
        found = np.minimum(found, np.where(seen.astype(int) @ entered > 0, lag, _SHARPEST + 1))
        entered = acts.astype(int) @ entered > 0
    return np.asarray(found, dtype=np.int64)


def _images(
    begun: Mapping[int, list[Bend]],
    channels: Sequence[int],
    between: npt.NDArray[np.int64],
    delays: Array,
    *,
    period: Array,
    sharpest: int,
) -> dict[int, list[Bend]]:
    """Return the bends up to an order, with those that arrive through the channels."""
    found: dict[int, list[Bend]] = {j: [] for j in channels}
    waiting = [(j, bend) for j, own in begun.items() for bend in own if bend.order <= sharpest]
    while waiting:
        waiting.sort(key=lambda one: -one[1].order)
        j, bend = waiting.pop()
        if any(_apart(bend.instant, other.instant, period) < _TOGETHER for other in found[j]):
            continue
        found[j].append(bend)
        if len(found[j]) > _MOST_PIECES:
            raise UnresolvedError(
                f"what flows through a pure delay beside samplers must be smooth in at most {_MOST_PIECES} pieces of a common "
                "period, but its jumps go round without end: put a lag into the loop of the delay, or make the delay and the "
                "sample times whole multiples of one time"
            )
        after = _wrapped(bend.instant + delays[:, j], period)
        for place, k in enumerate(channels):
            order = bend.order + int(between[place, list(channels).index(j)])
            if order <= sharpest:
                waiting.append((k, Bend(instant=after, order=order)))
    return {j: sorted(own, key=lambda one: float(one.instant[0].real)) for j, own in found.items()}


def _apart(one: Array, other: Array, period: Array) -> float:
    """Return the distance of two instants round the period, as a part of it."""
    turns = float(((one - other) / period)[0].real)
    return abs(turns - round(turns))


def _wrapped(instant: Array, period: Array) -> Array:
    turns = math.floor(float(instant[0].real) / float(period[0].real) + _TOGETHER)
    return np.asarray(instant - turns * period)


def _longest(bends: Sequence[Bend], period: Array) -> float:
    instants = [float(bend.instant[0].real) for bend in bends]
    return float(np.diff([*instants, instants[0] + float(period[0].real)]).max())


def _cut(bends: Sequence[Bend], delay: Array, period: Array, pace: float) -> list[tuple[Array, Array]]:
    """Return (start, length) of the pieces of a period, each (lanes,): none longer than the delay."""
    most = min(_LONGEST / pace, float(delay[0].real) * (1 - 1e-6))
    starts = [bend.instant for bend in bends] or [np.zeros_like(period)]
    pieces: list[tuple[Array, Array]] = []
    for start, end in zip(starts, [*starts[1:], starts[0] + period], strict=True):
        parts = max(1, math.ceil(float((end - start)[0].real) / most - 1e-9))
        if len(pieces) + parts > _MOST_PIECES:
            raise UnresolvedError(
                f"what flows through a pure delay beside samplers must be followed in at most {_MOST_PIECES} pieces of a common "
                f"period, got more: the delay of {float(delay[0].real):g} s is short, or a state fast ({pace:.3g} rad/s), beside "
                f"the period of {float(period[0].real):g} s"
            )
        length = (end - start) / parts
        pieces += [(start + k * length, length) for k in range(parts)]
    return pieces


def _course(
    channel: int, pieces: Sequence[tuple[Array, Array]], delay: Array, period: Array, *, pace: float, size: int
) -> tuple[Course, int]:
    """Return what is under way in a channel that is cut into pieces, and the number of states with its own."""
    counts = [_nodes(pace * float(length[0].real)) for _, length in pieces]
    unit = max(float(length[0].real) for _, length in pieces)
    chain = range(size, size + max(counts))
    places = _Places(float(period[0].real), chain.stop)
    values, loads = [], []
    for (start, length), count in zip(pieces, counts, strict=True):
        nodes = 0.5 * (1 + chebyshev.chebpts1(count))
        last = delay + length * (1 - 1 / _LOADS)
        deep = [_ahead(node * length, last, start, period) + 1 for node in nodes]
        states = places.of(float(start[0].real), float(last[0].real), deep)
        clocks = [
            Clock(label="a delay", period=period, first=_wrapped(start + node * length, period)) for node in nodes
        ]
        values += [Value(begins=clock, states=own) for clock, own in zip(clocks, states, strict=True)]
        for turn in range(_LOADS):
            share = turn / _LOADS
            after = delay + length * share
            at = Clock(label="a delay", period=period, first=_wrapped(start + after, period))
            taken = [own[_ahead(node * length, after, start, period)] for own, node in zip(states, nodes, strict=True)]
            scales = (unit / length)[:, None, None] ** np.arange(len(chain))[:, None]
            loads.append(Load(at=at, taken=taken, matrix=scales * _derivatives(nodes, share, len(chain))))
    return Course(channel=channel, chain=chain, unit=unit, values=values, loads=loads), places.size


class _Places:
    """States for the values of pieces: two pieces share them where the values of one are used before those of the other come."""

    def __init__(self, period: float, size: int) -> None:
        self.size = size
        self._period = period
        self._shared: list[tuple[int, list[tuple[float, float]]]] = []

    def of(self, start: float, width: float, deep: Sequence[int]) -> list[range]:
        """Return the states of a piece whose values come from ``start`` on and are used within ``width``, s, ``deep`` of each."""
        if max(deep) > 1 or width >= self._period * (1 - _TOGETHER):
            own = []
            for count in deep:
                own.append(range(self.size, self.size + count))
                self.size += count
            return own
        found: list[int] = []
        for state, busy in self._shared:
            if len(found) < len(deep) and all(self._apart(start, width, *other) for other in busy):
                busy.append((start, width))
                found.append(state)
        while len(found) < len(deep):
            self._shared.append((self.size, [(start, width)]))
            found.append(self.size)
            self.size += 1
        return [range(state, state + 1) for state in found]

    def _apart(self, start: float, width: float, other: float, its: float) -> bool:
        """Return whether two stretches do not meet, round the period."""
        after = (start - other) % self._period
        return its <= after and after + width <= self._period


def _nodes(reach: float) -> int:
    """Return through how many values a polynomial must go where signals move by e^{reach}."""
    count = 2
    while 2 * (reach / 4) ** count / math.factorial(count) > _ACCURACY:
        count += 1
    return count


def _ahead(taken: Array, used: Array, start: Array, period: Array) -> int:
    """Return how many later values have been taken when one is used; both are times after the start of its piece."""
    whole = float(period[0].real)
    age = float((used - taken)[0].real)
    since = float((_wrapped(start + used, period) - _wrapped(start + taken, period))[0].real)
    if since <= _TOGETHER * whole:  # what is used with a sample is used before it
        since += whole
    return round((age - since) / whole)


def _derivatives(nodes: npt.NDArray[np.float64], at: float, count: int) -> npt.NDArray[np.float64]:
    """Return the derivatives of order 0, 1, ... at a place in [0, 1] of the polynomial through values at nodes, (count, nodes)."""
    x = 2 * nodes - 1
    n = len(nodes)
    # of Chebyshev's polynomials at their nodes the sums are orthogonal
    series = chebyshev.chebvander(x, n - 1).T * (2.0 / n)
    series[0] /= 2
    found = np.zeros((count, n))
    for order in range(min(count, n)):
        found[order] = chebyshev.chebval(2 * at - 1, series) * 2.0**order
        series = chebyshev.chebder(series) if n - order > 1 else np.zeros_like(series)
    return found
