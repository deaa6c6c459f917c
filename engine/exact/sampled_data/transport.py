"""Pure delays beside samplers: values under way are states that move from sample to sample.

w(t) = v(t - τ) has finitely many states where v is held, so that its values arrive one after the other, and where only samplers
read w, so that v counts at their instants less τ alone. Anything else has endless many: see :mod:`engine.exact.sampled_data.pieces`.

K. J. Åström, B. Wittenmark, Computer-Controlled Systems, 3rd ed., section 2.3 (systems with time delay).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import TYPE_CHECKING, Final

import numpy as np

from engine.model.errors import UnresolvedError

if TYPE_CHECKING:
    from engine.model.linear_system import Array

_MOST_VALUES: Final = 1000
_SHORTEST: Final = 1e-9
"""Parts of a sample time: a shorter delay cannot be told from none."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Clock:
    """Regular instants: the first and the time between them, s, each (lanes,)."""

    label: str
    period: Array
    first: Array

    def moved(self, by: Array) -> Clock:
        """Return the same instants at another time."""
        return replace(self, first=self.first + by)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sampler:
    """What a line must know of a sampler: its inputs and outputs among all, and when it takes and gives."""

    inputs: slice
    outputs: slice
    takes: Clock
    gives: Clock


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Line:
    """Values of one channel on their way.

    ``states`` hold them, the youngest first; each instant of ``begins`` lets them move on by one and the first take what is
    ``put``: a row over signals, of which there are three kinds: what channels see, samplers' outputs, ends of other lines. Of a held
    signal an instant of ``arrives`` makes the oldest the ``end``; of one that a sampler reads the oldest is the end itself.
    """

    channel: int
    states: range
    end: int
    begins: Clock
    arrives: Clock | None = None
    outputs: slice | None = None
    before: Line | None = None


@dataclass(kw_only=True, eq=False)
class Lines:
    """The lines of a system: those of held signals by channel, and by (channel, sampler) those of what samplers read.

    ``size`` is the number of states with those of the lines. What flows through the channels ``flowing`` flows on from them;
    of those ``seen`` it is only an output.
    """

    size: int
    held: dict[int, list[Line]] = field(default_factory=dict)
    read: dict[tuple[int, int], Line] = field(default_factory=dict)
    flowing: list[int] = field(default_factory=list)
    seen: list[int] = field(default_factory=list)

    @property
    def all(self) -> Iterator[Line]:
        """All lines; one stands behind those that it goes on from."""
        yield from chain(*self.held.values(), self.read.values())

    def _states(self, delay: Array, clock: Clock) -> range:
        """Return new states for the values that are under way at a time."""
        share = float(delay[0].real) / float(clock.period[0].real)
        if share < _SHORTEST:
            got = float(delay[0].real)
            raise UnresolvedError(
                f"a pure delay beside samplers must be > {_SHORTEST:g} of the sample time of {clock.label}, got {got:g} s"
            )
        count = math.ceil(share - _SHORTEST)
        if count > _MOST_VALUES:
            raise UnresolvedError(
                f"a pure delay must be at most {_MOST_VALUES} sample times of {clock.label} long, got {share:g}"
            )
        self.size += count
        return range(self.size - count, self.size)

    def hold(self, channel: int, delay: Array, clock: Clock, outputs: slice | None, before: Line | None) -> None:
        """Add the line of a signal that is held from each instant of a clock to the next."""
        states = self._states(delay, clock)
        self.size += 1
        arrives = clock.moved(delay)
        line = Line(channel=channel, states=states, end=states.stop, begins=clock, arrives=arrives, outputs=outputs, before=before)  # fmt: skip
        self.held[channel].append(line)

    def take(self, channel: int, delay: Array, clock: Clock, sampler: int) -> None:
        """Add the line of what a sampler reads at the instants of a clock."""
        states = self._states(delay, clock)
        self.read[channel, sampler] = Line(
            channel=channel, states=states, end=states.stop - 1, begins=clock.moved(-delay)
        )


def lines(m: Mapping[str, Array], samplers: Sequence[Sampler], size: int) -> Lines:
    """Return the lines of all delay channels, as far as samplers read them or what they carry is held.

    Parameters
    ----------
    m : mapping
        Matrices of the fractional form, whose third kind of channels is that of the samplers.
    samplers : sequence of Sampler
    size : int
        Number of states without the lines.

    Raises
    ------
    UnresolvedError
        If too many values are under way, or a delay is too short beside a sample time.
    """
    found = Lines(size=size)
    acts = {name: np.any(m[name] != 0, axis=0) for name in ("b2", "d12", "d22", "d32")}
    held = held_channels(m)
    for j in held:
        _hold(found, j, m, samplers)
    for j in sorted(set(range(m["delays"].shape[-1])) - set(held)):
        if acts["b2"][:, j].any() or acts["d22"][:, j].any():
            found.flowing.append(j)
        elif acts["d12"][:, j].any():
            found.seen.append(j)
        for number, sampler in enumerate(samplers):
            if acts["d32"][sampler.inputs, j].any():
                found.take(j, np.asarray(m["delays"][:, j]), sampler.takes, number)
    return found


def _hold(found: Lines, channel: int, m: Mapping[str, Array], samplers: Sequence[Sampler]) -> None:
    """Add the lines of a channel that carries what samplers, and channels with lines already, hold."""
    delay = np.asarray(m["delays"][:, channel])
    found.held[channel] = []
    for sampler in samplers:
        if np.any(m["d23"][:, channel, sampler.outputs]):
            found.hold(channel, delay, sampler.gives, sampler.outputs, None)
    for k in np.flatnonzero(np.any(m["d22"][:, channel] != 0, axis=0)):
        for before in found.held[int(k)]:
            assert before.arrives is not None
            found.hold(channel, delay, before.arrives, None, before)


def held_channels(m: Mapping[str, Array]) -> list[int]:
    """Return the channels that carry nothing but what samplers and channels before them in this list hold."""
    flows = np.any(m["c2"] != 0, axis=(0, 2)) | np.any(m["d21"] != 0, axis=(0, 2))
    takes = np.any(m["d22"] != 0, axis=0)
    found: list[int] = []
    waiting = set(np.flatnonzero(~flows).tolist())
    while known := sorted(j for j in waiting if set(np.flatnonzero(takes[j]).tolist()) <= set(found)):
        found += known
        waiting -= set(known)
    return found


def merged(m: Mapping[str, Array]) -> dict[str, Array]:
    """Return the matrices with one delay in place of each that takes nothing but what another one gives."""
    found = {name: np.array(matrix) for name, matrix in m.items()}
    takes = ("c2", "d21", "d22", "d23")
    for _ in range(found["delays"].shape[-1]):
        for j in range(found["delays"].shape[-1]):
            before = np.flatnonzero(np.any(found["d22"][:, j] != 0, axis=0))
            if len(before) != 1 or before[0] == j or any(np.any(found[name][:, j]) for name in takes if name != "d22"):
                continue
            k, factor = int(before[0]), found["d22"][:, j, before]
            for name in takes:
                found[name] = found[name].astype(np.result_type(found[name], factor))
                found[name][:, j] = factor * found[name][:, k]
            found["delays"][:, j] += found["delays"][:, k]
            if not any(np.any(found[name][..., k]) for name in ("b2", "d12", "d22", "d32")):
                for name in takes:
                    found[name][:, k] = 0.0
    return found
