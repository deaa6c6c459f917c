"""A linear system with samplers: states that flow, and events at which some of them jump.

    ξ' = M ξ + B u   between events,   ξ -> J ξ + K u   at an event,   y = C ξ + D u,   ξ = (continuous states, samplers' states)

Sampler i acts at offset_i + k T_i and, where its output comes later, again delay_i after that. Where the sample times are in
rational ratios, everything repeats after their least common multiple.

References
----------
T. Chen, B. Francis, Optimal Sampled-Data Control Systems, chapters 3, 8 and 10 (lifting).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.elements._limiting import Shape
from engine.model.errors import UnresolvedError

if TYPE_CHECKING:
    from engine.model.linear_system import Array

_LARGEST_RATIO: Final = 1000
_RATIO: Final = 1e-9
"""Two sample times are in a rational ratio where they miss it by less than this part."""
_TOGETHER: Final = 1e-10
"""Instants closer than this part of the common period are one: the ratio of the rates may be rounded."""
_MOST_EVENTS: Final = 4000
_DIRECT: Final = 1e-12


@dataclass(frozen=True, kw_only=True, eq=False)
class Limit:
    """What a sample makes of an output v of its linear part (`Limiting`), its values of shape (lanes,).

    It stands in the row ``computed`` of the joint state, and ``output`` where that follows at once (None: it does not).
    """

    computed: int
    output: int | None
    integral: int | None
    lower: Array
    upper: Array
    reach: Array
    share: Array
    shape: Shape

    def part(self, states: npt.NDArray[Any]) -> Limit | None:
        """Return the limit among these states alone; None where its output is not among them."""
        place = {int(state): k for k, state in enumerate(states)}
        if self.computed not in place:
            return None
        output, integral = (None if row is None else place.get(row) for row in (self.output, self.integral))
        return replace(self, computed=place[self.computed], output=output, integral=integral)


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampling:
    """One sampler: its times (s), each of shape (lanes,), and how its events move the joint state.

    ``taken`` (lanes, N, N) with ``entering`` (lanes, N, inputs) is a sample, ``updated`` (lanes, N, N) the output that follows
    it after the delay, None where there is none. ``number`` tells it from the others in the order of the document; of those
    that act together the lower ``turn`` comes first: what arrives, samples, what takes account of both. ``sampler`` is False
    where it only tells what is under way in a delay, ``piece`` True where that flows. A ``limit`` is no part of the linear system:
    it acts behind the jump of a sample.
    """

    label: str
    number: float
    period: Array
    delay: Array
    offset: Array
    taken: Array
    entering: Array
    updated: Array | None = None
    turn: int = 1
    sampler: bool = True
    piece: bool = False
    limit: Limit | None = None

    @cached_property
    def pattern(self) -> npt.NDArray[np.bool_]:
        """Which state (row) jumps to what others make it, (N, N); of states that are left alone none."""
        jumps = [self.taken] if self.updated is None else [self.taken, self.updated]
        same = np.eye(self.taken.shape[-1])
        return np.asarray(np.logical_or.reduce([np.any(jump != same, axis=0) for jump in jumps]))

    @cached_property
    def moved(self) -> npt.NDArray[np.bool_]:
        """Which states it changes, (N,)."""
        return np.asarray(self.pattern.any(axis=1))


@dataclass(frozen=True, kw_only=True, eq=False)
class Event:
    """An instant within the common period, s, (lanes,), with the jump there: ξ -> ``jump`` ξ + ``entering`` u, then a ``limit``."""

    time: Array
    jump: Array
    entering: Array
    limit: Limit | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledSystem:
    """A linear system with samplers; all arrays have a lane axis in front, lanes sharing the real part.

    Shapes: ``flow`` (lanes, N, N), ``driven`` (lanes, N, inputs), ``read`` (lanes, outputs, N), ``direct`` (lanes, outputs,
    inputs). ``known`` (outputs,) tells which outputs are known at all times: one that comes through a pure delay is not,
    unless it is held. Modes of its delays that change faster than ``pace``, 1/s, are not followed.
    """

    flow: Array
    driven: Array
    read: Array
    direct: Array
    samplings: tuple[Sampling, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    known: npt.NDArray[np.bool_]
    pace: float = np.inf

    @property
    def lanes(self) -> int:
        """Number of lanes."""
        return int(self.flow.shape[0])

    @property
    def n(self) -> int:
        """Number of states."""
        return int(self.flow.shape[1])

    def part(self, states: npt.NDArray[Any]) -> SampledSystem:
        """Return the system of these states alone, with the samplers that have one of them."""
        x = np.asarray(states)
        own = [
            replace(
                s, taken=s.taken[:, x][:, :, x], entering=s.entering[:, x],
                updated=None if s.updated is None else s.updated[:, x][:, :, x],
                limit=None if s.limit is None else s.limit.part(x),
            )
            for s in self.samplings
            if s.moved[x].any()
        ]  # fmt: skip
        return replace(
            self, flow=self.flow[:, x][:, :, x], driven=self.driven[:, x], read=self.read[:, :, x], samplings=tuple(own)
        )

    def between(self, inputs: Sequence[int], outputs: Sequence[int]) -> SampledSystem:
        """Return the system with these inputs and outputs alone, all its states kept.

        Raises
        ------
        UnresolvedError
            If one of these outputs is not known at all times.
        """
        if not self.known[list(outputs)].all():
            late = ", ".join(self.outputs[k] for k in outputs if not self.known[k])
            raise UnresolvedError(
                f"outputs must be seen where they are made, but {late} comes through a pure delay: take the signal in front of it"
            )
        return replace(
            self, known=self.known[list(outputs)],
            driven=self.driven[:, :, inputs], read=self.read[:, outputs], direct=self.direct[:, outputs][:, :, inputs],
            samplings=tuple(replace(s, entering=s.entering[:, :, inputs]) for s in self.samplings),
            inputs=tuple(self.inputs[k] for k in inputs), outputs=tuple(self.outputs[k] for k in outputs),
        )  # fmt: skip

    def path(self, source: int, target: int) -> SampledSystem:
        """Return the part of the system that lies between an input and an output, with these two alone."""
        return self.part(np.flatnonzero(self.lying_between([source], [target]))).between([source], [target])

    def lying_between(
        self, sources: Sequence[int], targets: Sequence[int], *, limited: bool = False
    ) -> npt.NDArray[np.bool_]:
        """Return which states lie between some inputs and some outputs, (N,), its limits left out unless it is ``limited``."""
        acts = self.pattern
        for limit in [s.limit for s in self.samplings if limited and s.limit is not None]:
            rows = [row for row in (limit.output, limit.integral) if row is not None]
            acts = acts.copy()
            acts[rows, limit.computed] = True
        entered = np.any(self.driven[:, :, sources] != 0, axis=(0, 2))
        for sampling in self.samplings:
            entered |= np.any(sampling.entering[:, :, sources] != 0, axis=(0, 2))
        seen = np.any(self.read[:, targets] != 0, axis=(0, 1))
        return _spread(acts, entered) & _spread(acts.T, seen)

    def closed(self) -> SampledSystem:
        """Return the system with its last output fed back into its last input, u = y, and that input left in place.

        Raises
        ------
        UnresolvedError
            If a direct gain of 1 makes that impossible.
        """
        direct = self.direct[:, -1, -1]
        if np.any(np.abs(1 - direct) < _DIRECT):
            raise UnresolvedError("the direct gain of the loop must not be 1, or closing it has no solution")
        back = self.read[:, -1:] / (1 - direct)[:, None, None]
        own = [replace(s, taken=s.taken + s.entering[:, :, -1:] @ back) for s in self.samplings]
        return replace(self, flow=self.flow + self.driven[:, :, -1:] @ back, samplings=tuple(own))

    @property
    def limited(self) -> bool:
        """Whether one of its samplers has a limit."""
        return any(sampling.limit is not None for sampling in self.samplings)

    @property
    def sampled(self) -> bool:
        """Whether there is a sampler in it."""
        return any(sampling.sampler for sampling in self.samplings)

    @cached_property
    def pattern(self) -> npt.NDArray[np.bool_]:
        """Which state (row) follows which other, at once or in a jump, (N, N)."""
        acts: npt.NDArray[np.bool_] = np.any(self.flow != 0, axis=0)
        for sampling in self.samplings:
            acts |= sampling.pattern
        return acts

    @property
    def period(self) -> Array:
        """The common period, s, shape (lanes,).

        Raises
        ------
        UnresolvedError
            If two sample times are in no rational ratio, naming both, or a lane changes their ratio.
        """
        if self.uneven.any():
            names = ", ".join(dict.fromkeys(s.label for s in self.samplings))
            raise UnresolvedError(
                f"a derivative by a sample time must change all rates of a loop alike, got one by that of some of {names}: "
                "they would have no common period any more"
            )
        return common_period([(s.label, s.period) for s in self.samplings])

    @property
    def moves(self) -> bool:
        """Whether a lane carries an infinitesimal."""
        own = [array for s in self.samplings for array in (s.taken, s.entering, s.period, s.delay, s.offset)]
        return any(np.iscomplexobj(array) for array in (self.flow, self.driven, self.read, self.direct, *own))

    @property
    def value(self) -> SampledSystem:
        """The common real part alone, as one lane."""
        samplings = [
            replace(
                s, period=s.period[:1].real, delay=s.delay[:1].real, offset=s.offset[:1].real, taken=s.taken[:1].real,
                entering=s.entering[:1].real, updated=None if s.updated is None else s.updated[:1].real,
            )
            for s in self.samplings
        ]  # fmt: skip
        return replace(
            self, flow=self.flow[:1].real, driven=self.driven[:1].real, read=self.read[:1].real,
            direct=self.direct[:1].real, samplings=tuple(samplings),
        )  # fmt: skip

    @property
    def uneven(self) -> npt.NDArray[np.bool_]:
        """Which lanes change the ratio of two sample times, so that nothing repeats any more, (lanes,)."""
        moved = np.stack([s.period.imag / s.period.real for s in self.samplings])
        size = np.abs(moved).max(axis=0)
        return np.asarray(np.ptp(moved, axis=0) > 1e-12 * size)

    def events(self) -> list[Event]:
        """Return the events of one common period in their order: updates first, then the samples of the slower rates.

        That is the order in which a simulation takes those that fall together.

        Raises
        ------
        UnresolvedError
            If the sample times are in no rational ratio, or in one that makes too many events.
        """
        period = self.period
        total = float(period[0].real)
        count = [round(total / float(s.period[0].real)) for s in self.samplings]
        if 2 * sum(count) > _MOST_EVENTS:
            slow, fast = max(self.samplings, key=_length), min(self.samplings, key=_length)
            msg = (
                f"the samples of a common period must be at most {_MOST_EVENTS // 2}, got {sum(count)}: {slow.label} samples "
                f"every {_length(slow):g} s and {fast.label} every {_length(fast):g} s, together every {total:g} s"
            )
            raise UnresolvedError(msg)
        listed: list[tuple[float, tuple[float, ...], Event]] = []
        rank: tuple[float, ...]
        for sampling, turns in zip(self.samplings, count, strict=True):
            for k in range(turns):
                at = wrapped(sampling.offset + k * sampling.period, period)
                rank = (float(sampling.turn), -_length(sampling), float(sampling.number), 0.0)
                listed.append(
                    (
                        _real(at),
                        rank,
                        Event(time=at, jump=sampling.taken, entering=sampling.entering, limit=sampling.limit),
                    )
                )
                if sampling.updated is not None:
                    at = wrapped(at + sampling.delay, period)
                    later = (0.0,) if _real(sampling.delay) else (*rank[:3], 1.0)
                    none = np.zeros_like(sampling.entering)
                    listed.append((_real(at), later, Event(time=at, jump=sampling.updated, entering=none)))
        return ordered(listed, _TOGETHER * total)


def ordered(listed: Sequence[tuple[float, tuple[float, ...], Event]], together: float) -> list[Event]:
    """Return events by their instants, s, and those that are closer than ``together`` by their ranks, at one and the same instant."""
    order: list[tuple[int, tuple[float, ...], Event]] = []
    group, before, common = 0, -math.inf, 0.0
    for instant, rank, event in sorted(listed, key=lambda one: one[0]):
        if instant > before + together:
            group, common = group + 1, max(instant, 0.0)
        before = instant
        # what follows sorts by time: rounding must not undo the ranks
        order.append((group, rank, replace(event, time=event.time + (common - event.time.real))))
    order.sort(key=lambda one: one[:2])
    return [event for _, _, event in order]


def _spread(acts: npt.NDArray[np.bool_], begun: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Return which states (N,) follow, by ``acts`` of each row on each column, those with which it has begun."""
    found = begun
    for _ in range(len(begun)):
        further = found | (acts & found).any(axis=1)
        if (further == found).all():
            break
        found = further
    return found


def _length(sampling: Sampling) -> float:
    return float(sampling.period[0].real)


def _real(time: Array) -> float:
    return float(time[0].real)


def wrapped(time: Array, period: Array) -> Array:
    """Return the same instant in [0, period), the infinitesimals following."""
    turns = math.floor(_real(time) / _real(period) + _TOGETHER)
    return np.asarray(time - turns * period)


def common_period(rates: Sequence[tuple[str, Array]]) -> Array:
    """Return the least common multiple of sample times, s, (lanes,); each has the label of its sampler.

    Raises
    ------
    UnresolvedError
        If two are in no rational ratio.
    """
    first, *others = rates
    turns = Fraction(1)
    for other in others:
        turns = _common(turns, _ratio(first, other))
    return np.asarray(first[1] * float(turns))


def _ratio(first: tuple[str, Array], other: tuple[str, Array]) -> Fraction:
    """Return the ratio of two sample times.

    Raises
    ------
    UnresolvedError
        If it is not rational.
    """
    own, its = float(first[1][0].real), float(other[1][0].real)
    exact = its / own
    found = Fraction(exact).limit_denominator(_LARGEST_RATIO)
    if not found or abs(float(found) / exact - 1) > _RATIO:
        msg = (
            f"sample times must be in the ratio of whole numbers up to {_LARGEST_RATIO}, got {own:.12g} s of {first[0]} and "
            f"{its:.12g} s of {other[0]}: there is no common period"
        )
        raise UnresolvedError(msg)
    return found


def _common(one: Fraction, other: Fraction) -> Fraction:
    """Return the least common multiple."""
    return Fraction(math.lcm(one.numerator, other.numerator), math.gcd(one.denominator, other.denominator))
