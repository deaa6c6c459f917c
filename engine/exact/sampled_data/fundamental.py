"""What comes back of e^{jωt} at the same frequency from a sampled system, over one common period P.

    x(P) = Φ x(0) + ψ(ω) = e^{jωP} x(0),   G(jω) = mean of e^{-jωt} y over the period

Φ does not depend on ω. Complex numbers are carried as real and imaginary part, the first axis of all that is called a pair, so that
both keep their infinitesimals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.exact.sampled_data.resolvent import Resolvent
from engine.exact.sampled_data.system import Event
from engine.exact.time.propagate import exponentials
from engine.model.errors import UnresolvedError
from engine.model.tangent import INFINITESIMAL, slopes

if TYPE_CHECKING:
    from engine.exact.sampled_data.system import SampledSystem
    from engine.model.linear_system import Array

_NODES: Final = 24
_REACH: Final = 12.0
"""Nodes of a quadrature, and how far an exponent may reach within them: 6^48/48! is below rounding."""
_MOST_PANELS: Final = 1024


@dataclass(frozen=True, kw_only=True, eq=False)
class Cut:
    """A system with one input and one output and the events of its period; ``read_at`` are those at which the sequence is read.

    Empty where the signals are followed between the samples.
    """

    system: SampledSystem
    events: tuple[Event, ...]
    read_at: tuple[int, ...]
    length: Array
    memory: dict[Any, Any] = field(default_factory=dict)

    @cached_property
    def value(self) -> Cut:
        """The common real part alone, as one lane."""
        events = [Event(time=e.time[:1].real, jump=e.jump[:1].real, entering=e.entering[:1].real) for e in self.events]
        return replace(self, system=self.system.value, events=tuple(events), length=self.length[:1].real, memory={})

    @cached_property
    def moved(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """The states that flow, and these with what they flow from and what is read."""
        s = self.system
        acts = np.any(s.flow != 0, axis=0)
        rows = acts.any(axis=1) | np.any(s.driven != 0, axis=(0, 2))
        others = (acts.any(axis=0) | np.any(s.read != 0, axis=(0, 1))) & ~rows
        return np.flatnonzero(rows), np.concatenate([np.flatnonzero(rows), np.flatnonzero(others)])

    @cached_property
    def flow(self) -> Array:
        """How the states of the second kind of :attr:`moved` flow, (lanes, k, k)."""
        columns = self.moved[1]
        return np.asarray(self.system.flow[:, columns[:, None], columns])

    @cached_property
    def jumps(self) -> list[tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Array]]:
        """The states that each event changes, those that they become, and by which matrix (lanes, rows, columns)."""
        found = []
        for event in self.events:
            rows = np.flatnonzero(np.any(event.jump != np.eye(self.system.n), axis=(0, 2)))
            columns = np.flatnonzero(np.any(event.jump[:, rows] != 0, axis=(0, 1)))
            found.append((rows, columns, event.jump[:, rows[:, None], columns]))
        return found

    def passed(self, width: Array) -> Array:
        """Return what the states that flow become over ``width`` (lanes,), (lanes, rows, columns)."""
        key = np.ascontiguousarray(width).tobytes()
        if key not in self.memory:
            self.memory[key] = exponentials(width[:, None, None] * self.flow)[:, : len(self.moved[0])]
        return np.asarray(self.memory[key])


def cut(system: SampledSystem, *, sequence: bool) -> Cut:
    """Return a system with its events; where the cut carries a sequence, with the events at which it is read.

    Where samplers read what a hold has written, the slower of both makes the sequence.
    """
    events, length = system.events(), system.period
    followed = Cut(system=system, events=tuple(events), read_at=(), length=length)
    if not sequence or np.any(system.direct):
        return followed
    sampled = [] if np.any(system.driven) else [k for k, event in enumerate(events) if np.any(event.entering)]
    flows = np.any(system.read @ system.flow) or np.any(system.read @ system.driven)
    changed = [k for k, event in enumerate(events) if np.any(system.read @ (event.jump - np.eye(system.n)))]
    written = [] if flows else changed
    if written and (not sampled or len(written) < len(sampled)):
        return _holding(system, events, written, length)
    return replace(followed, read_at=tuple(sampled))


def _holding(system: SampledSystem, events: list[Event], written: list[int], length: Array) -> Cut:
    """Return the system with a hold in front of its input, which takes the sequence whenever the output has changed."""
    lanes, n = system.lanes, system.n

    def grown(matrix: Array, column: Array) -> Array:
        found = np.zeros((lanes, n + 1, n + 1), dtype=np.result_type(matrix, column))
        found[:, :n, :n], found[:, :n, n:] = matrix, column
        return found

    nothing, taking = np.zeros((lanes, n + 1, 1)), np.zeros((lanes, n + 1, 1))
    taking[:, n] = 1.0
    held = np.diag([*np.zeros(n), 1.0])
    listed: list[Event] = []
    read_at = []
    for k, event in enumerate(events):
        listed.append(Event(time=event.time, jump=grown(event.jump, event.entering) + held, entering=nothing))
        if k in written:
            read_at.append(len(listed))
            listed.append(
                Event(time=event.time, jump=np.zeros((lanes, n + 1, n + 1)) + np.eye(n + 1) - held, entering=taking)
            )
    read = np.concatenate([system.read, np.zeros((lanes, 1, 1))], axis=2)
    whole = replace(system, flow=grown(system.flow, system.driven), driven=nothing, read=read)
    return Cut(system=whole, events=tuple(listed), read_at=tuple(read_at), length=length)


def fundamental(part: Cut, omega: Array) -> Array:
    """Return the fundamental at each ω of shape (k,) or (lanes,), infinitesimals following, as a pair (2, k)."""
    return _of_sequence(part, omega) if part.read_at else _followed(part, omega)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sequence:
    """What a period makes of a sequence that enters at some events, e, and is read at others, r: nothing of it depends on ω.

    ``whole`` (lanes, n, n) is Φ; ``entered`` (lanes, n, e) what each entry has become at the end of the period; ``read`` (lanes, r, n)
    and ``through`` (lanes, r, e) what is read of the first state and of each entry; ``times`` (lanes, e) and ``seen`` (lanes, r), s.
    """

    whole: Array
    entered: Array
    read: Array
    through: Array
    times: Array
    seen: Array


def _sequence(part: Cut) -> _Sequence:
    if "sequence" not in part.memory:
        s, (rows, columns) = part.system, part.moved
        entries = [k for k, event in enumerate(part.events) if np.any(event.entering)]
        kind = np.result_type(
            s.flow, s.read, part.length, *(a for e in part.events for a in (e.time, e.jump, e.entering))
        )
        state = np.zeros((s.lanes, s.n, s.n + len(entries)), dtype=kind)
        state[:, :, : s.n] = np.eye(s.n)
        reading = []
        before: Array = np.zeros(s.lanes)
        for number, event in enumerate(part.events):
            if np.any(event.time - before):
                state[:, rows] = part.passed(event.time - before) @ state[:, columns]
            before = event.time
            if number in part.read_at:
                reading.append((s.read @ state)[:, 0] / len(part.read_at))
            changed, taken, jump = part.jumps[number]
            state[:, changed] = jump @ state[:, taken]
            if number in entries:
                state[:, :, s.n + entries.index(number)] += event.entering[:, :, 0]
        state[:, rows] = part.passed(part.length - before) @ state[:, columns]
        read = np.stack(reading, axis=1)
        part.memory["sequence"] = _Sequence(
            whole=state[:, :, : s.n], entered=state[:, :, s.n :], read=read[:, :, : s.n], through=read[:, :, s.n :],
            times=_instants(part, entries), seen=_instants(part, part.read_at),
        )  # fmt: skip
    found: _Sequence = part.memory["sequence"]
    return found


def _instants(part: Cut, numbers: Sequence[int]) -> Array:
    return np.stack([part.events[k].time for k in numbers], axis=1) if numbers else np.zeros((part.system.lanes, 0))


def _of_sequence(part: Cut, omega: Array) -> Array:
    own = _sequence(part)
    entries, readings = (_turns(sign * omega[:, None] * at) for sign, at in ((1, own.times), (-1, own.seen)))
    forced = _times(entries, own.entered.swapaxes(1, 2))
    through = _product(readings, _times(entries, own.through.swapaxes(1, 2))).sum(axis=2)
    first = _solved(part, own.whole, _turns(omega * part.length), forced)
    return np.asarray(through + _product(_times(readings, own.read), first).sum(axis=2))


def _followed(part: Cut, omega: Array) -> Array:
    s, (rows, columns) = part.system, part.moved
    count, driven = max(len(omega), s.lanes), bool(np.any(s.driven))
    kind = np.result_type(s.flow, omega, part.length, s.read, s.driven, s.direct,
                          *(a for e in part.events for a in (e.time, e.jump, e.entering)))  # fmt: skip
    forced, seen = np.zeros((2, count, s.n), dtype=kind), np.zeros((2, count, s.n), dtype=kind)
    total = np.zeros((2, count), dtype=kind)
    whole = np.zeros((s.lanes, s.n, s.n), dtype=kind) + np.eye(s.n)
    before: Array = np.zeros(s.lanes)
    same: dict[bytes, tuple[Array, Array, Array]] = {}
    for number, event in enumerate([*part.events, None]):
        time = part.length if event is None else event.time
        width = time - before
        if np.any(width):
            key = np.ascontiguousarray(width).tobytes()
            if key not in same:
                same[key] = _between(part, omega, width)
            entered, read, through = same[key]
            flow, row = part.passed(width), _turned(read, -omega * before)
            seen += _times(row, whole[:, columns])
            total += through + _product(row, forced[:, :, columns]).sum(axis=2)
            forced[:, :, rows] = _applied(flow, forced[:, :, columns])
            if driven:
                forced[:, :, columns] += _turned(entered, omega * time)
            whole[:, rows] = flow @ whole[:, columns]
        before = time
        if event is None:
            break
        changed, taken, jump = part.jumps[number]
        forced[:, :, changed] = _applied(jump, forced[:, :, taken])
        whole[:, changed] = jump @ whole[:, taken]
        if np.any(event.entering):
            column = event.entering[:, :, 0]
            forced += _turned(np.stack([column, np.zeros_like(column)]), omega * time)
    first = _solved(part, whole, _turns(omega * part.length), forced)
    return np.asarray((total + _product(seen, first).sum(axis=2)) / part.length)


def _turns(angle: Array) -> Array:
    """Return e^{j angle} as a pair."""
    return np.stack([np.cos(angle), np.sin(angle)])


def _turned(pair: Array, angle: Array) -> Array:
    """Return a pair (2, k or lanes, n) times e^{j angle}, of shape (k,)."""
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return np.stack([pair[0] * cos - pair[1] * sin, pair[0] * sin + pair[1] * cos])


def _product(one: Array, other: Array) -> Array:
    """Return the product of two pairs, element by element."""
    return np.stack([one[0] * other[0] - one[1] * other[1], one[0] * other[1] + one[1] * other[0]])


def _times(row: Array, matrix: Array) -> Array:
    """Return pairs of rows (2, k, m) times a matrix (lanes, m, n)."""
    return np.asarray(row @ matrix[0] if len(matrix) == 1 else (row[:, :, None] @ matrix)[:, :, 0])


def _applied(matrix: Array, columns: Array) -> Array:
    """Return a matrix (lanes, m, n) times pairs of columns (2, k, n)."""
    return np.asarray(columns @ matrix[0].T if len(matrix) == 1 else (matrix @ columns[..., None])[..., 0])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Within:
    """Nodes of a quadrature over a stretch, all (nodes, lanes, ...): e^{Mσ} B, C e^{Mσ} and C e^{Mσ} B at each instant σ."""

    instants: Array
    weights: Array
    driven: Array
    read: Array
    through: Array


def _between(part: Cut, omega: Array, width: Array) -> tuple[Array, Array, Array]:
    """Return ∫ e^{(M-jω)σ} B dσ, ∫ C e^{(M-jω)σ} dσ and what the input has passed on to the output by itself, as pairs."""
    within = _within(part, float(np.abs(omega).max(initial=0.0)), width)
    angle = omega * within.instants
    turn = np.stack([np.cos(angle), -np.sin(angle)]) * within.weights  # (2, nodes, k)
    left = (width - within.instants) * within.through
    through = (turn * left).sum(axis=1)
    through[0] = through[0] + part.system.direct[:, 0, 0] * width
    if len(within.driven[0]) == 1:
        driven, read = (np.swapaxes(turn, 1, 2) @ one[:, 0] for one in (within.driven, within.read))
    else:
        driven, read = ((turn[..., None] * one).sum(axis=1) for one in (within.driven, within.read))
    return driven, read, through


def _within(part: Cut, fastest: float, width: Array) -> _Within:
    """Return nodes so dense that integrals of e^{(M - jω)σ} are exact to rounding for ω up to ``fastest``, rad/s."""
    s, columns = part.system, part.moved[1]
    reach = (float(np.abs(part.flow[0].real).sum(axis=1).max(initial=0.0)) + fastest) * abs(float(width[0].real))
    panels = 1 << max(0, int(np.ceil(np.log2(max(reach / _REACH, 1e-300)))))
    if panels > _MOST_PANELS:
        raise UnresolvedError(
            f"the response between two samples must be followed in at most {_MOST_PANELS} steps, got {panels}: the fastest "
            "state is much faster than the samples"
        )
    key = (panels, np.ascontiguousarray(width).tobytes())
    if key not in part.memory:
        x, w = np.polynomial.legendre.leggauss(_NODES)
        parts = ((np.arange(panels)[:, None] + 0.5 * (x + 1)) / panels).ravel()
        instants = parts[:, None] * width
        grown = exponentials(instants[:, :, None, None] * part.flow)
        driven = (grown @ s.driven[:, columns])[..., 0]
        read = s.read[:, :, columns]
        part.memory[key] = _Within(
            instants=instants, weights=np.tile(0.5 * w / panels, panels)[:, None] * width, driven=driven,
            read=(read @ grown)[:, :, 0], through=(read @ driven[..., None])[:, :, 0, 0],
        )  # fmt: skip
    found: _Within = part.memory[key]
    return found


def _solved(part: Cut, whole: Array, turn: Array, right: Array) -> Array:
    """Solve (turn - whole) x = right for pairs, (2, k) and (2, k, n), exact to first order; NaN where it is singular."""
    value, own = turn[0].real + 1j * turn[1].real, right[0].real + 1j * right[1].real
    if "resolvent" not in part.memory:
        part.memory["resolvent"] = Resolvent(whole[0].real)
    solve: Resolvent = part.memory["resolvent"]
    found = solve(value, own)
    if not any(np.iscomplexobj(one) for one in (whole, turn, right)):
        return np.stack([found.real, found.imag])
    turned = (slopes(turn[0]) + 1j * slopes(turn[1]))[:, None] * found
    moved = slopes(whole) if np.iscomplexobj(whole) else np.zeros((1, 1, 1))
    if np.any(moved):
        turned = turned - (moved @ found[:, :, None])[:, :, 0]
    left = slopes(right[0]) + 1j * slopes(right[1]) - turned
    later = INFINITESIMAL * 1j * solve(value, left)
    return np.stack([found.real + 1j * later.imag, found.imag - 1j * later.real])
