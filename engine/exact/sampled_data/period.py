"""One common period of a sampled system: the map from its start to its end, with a loop closed by any gain.

Φ(κ) = Π (J + κ K C) e^{(M + κ B C) h},   u = κ y at the place where the loop is cut

Every factor changes a few states only; the rest of it is the unit matrix and never multiplied. Where the cut carries what is held,
C M = 0 and C B = 0, the flow is linear in the gain: e^{M h} + κ ∫ e^{M s} B ds C.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.exact.sampled_data.crossings import Crossing
from engine.exact.sampled_data.sequence import MANY, SequenceMap, null_vector, shortened
from engine.exact.time.propagate import exponentials
from engine.model.linear_system import balancing
from engine.model.tangent import INFINITESIMAL, slopes

if TYPE_CHECKING:
    from engine.exact.sampled_data.system import Event, SampledSystem
    from engine.model.linear_system import Array

Real = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
States = npt.NDArray[np.int64]

_AT_ONCE: Final = 16
"""Gains whose maps are made together."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Factor:
    """A factor of the map: states ``rows`` become ``own`` + κ ``entered`` ``seen`` times states ``columns``.

    Shapes: ``own`` (lanes, rows, columns), ``entered`` (lanes, rows, 1), ``seen`` (lanes, 1, columns).
    """

    rows: States
    columns: States
    own: Array
    entered: Array | None
    seen: Array

    @cached_property
    def back(self) -> Array | None:
        """The product of both."""
        return None if self.entered is None else self.entered @ self.seen

    @cached_property
    def acts(self) -> npt.NDArray[np.bool_]:
        """Which state follows which other, whatever the gain."""
        own: npt.NDArray[np.bool_] = np.any(self.own != 0, axis=0)
        return own if self.back is None else own | np.any(self.back != 0, axis=0)

    def value(self, gains: Complex | Real) -> Complex | Real:
        """Return the common real part for each gain (k,), (k or 1, rows, columns)."""
        own, back = self.own[:1].real, self.back
        return own if back is None else own + gains[:, None, None] * back[:1].real

    def motion(self, gain: complex, turned: Complex) -> Complex:
        """Return the change along every lane, with that of the gain, (lanes,)."""
        found, back = slopes(self.own).astype(complex), self.back
        if back is not None:
            found = found + gain * slopes(back) + turned[:, None, None] * back.real
        return np.asarray(found)


class Period:
    """One common period of a system.

    Parameters
    ----------
    system : SampledSystem
        With at least one sampler; of its inputs and outputs the last are the two ends of the cut.
    marks : iterable of float
        Further instants, s, in [0, period), at which :meth:`passage` looks at the state.
    events : sequence of Event, optional
        In place of those of the system's samplers.
    alive : ndarray of int, optional
        The states whose values at the start of a period matter, where more do than follow from the system: to a lane that it is the
        real part of.
    """

    def __init__(
        self,
        system: SampledSystem,
        marks: Iterable[float] = (),
        events: Sequence[Event] | None = None,
        alive: States | None = None,
    ) -> None:
        self._known_alive = alive
        self.system = system
        self.length: Array = system.period
        self.events = system.events() if events is None else list(events)
        lanes = system.lanes
        stops: list[tuple[Array, int | None]] = [(event.time, k) for k, event in enumerate(self.events)]
        stops += [(np.full(lanes, mark), None) for mark in marks]
        stops.sort(key=lambda stop: float(stop[0][0].real))
        self._stops = [number for _, number in stops]
        times = [np.zeros(lanes), *(time for time, _ in stops), self.length]
        self._widths = [after - before for before, after in pairwise(times)]
        same: dict[bytes, int] = {}
        self._kinds = [same.setdefault(np.ascontiguousarray(w).tobytes(), len(same)) for w in self._widths]
        self._distinct = [self._widths[self._kinds.index(k)] for k in range(len(same))]
        self._nothing = [not np.any(width) for width in self._distinct]

    @cached_property
    def _ends(self) -> tuple[Array, Array, Array]:
        """What the cut drives of the states (lanes, N, 1), what is read there (lanes, 1, N), and its direct gain (lanes,)."""
        s = self.system
        if not (s.inputs and s.outputs):
            return np.zeros((s.lanes, s.n, 1)), np.zeros((s.lanes, 1, s.n)), np.zeros(s.lanes)
        return s.driven[:, :, -1:], s.read[:, -1:], s.direct[:, -1, -1]

    @cached_property
    def _moved(self) -> tuple[States, States]:
        """The states that flow, and those that they flow from, these first, whatever the gain."""
        flow, (b, c, _) = self.system.flow, self._ends
        acts = np.any(flow != 0, axis=0)
        if np.any(b) and np.any(c):
            acts |= np.any(b != 0, axis=(0, 2))[:, None] & np.any(c != 0, axis=(0, 1))
        rows = acts.any(axis=1)
        return np.flatnonzero(rows), np.concatenate([np.flatnonzero(rows), np.flatnonzero(acts.any(axis=0) & ~rows)])

    @cached_property
    def _held(self) -> bool:
        """Whether the cut changes nothing that flows, or carries what is held."""
        b, c, _ = self._ends
        return not (np.any(c @ self.system.flow) or np.any(c @ b)) or not (np.any(b) and np.any(c))

    @cached_property
    def _flows(self) -> list[_Factor] | None:
        """The factors of each distinct width; None where the gain changes them as a whole."""
        if not self._held:
            return None
        (rows, columns), (b, c, _) = self._moved, self._ends
        n, count = len(columns), len(rows)
        through = bool(np.any(b) and np.any(c))
        kind = np.result_type(self.system.flow, b, c, *self._distinct)
        flow = np.zeros((self.system.lanes, n + through, n + through), dtype=kind)
        flow[:, :n, :n] = self.system.flow[:, columns[:, None], columns]
        if through:
            flow[:, :n, n:] = b[:, columns]
        grown = exponentials(np.stack(self._distinct)[:, :, None, None] * flow)
        return [
            _Factor(
                rows=rows, columns=columns, own=one[:, :count, :n], entered=one[:, :count, n:] if through else None,
                seen=c[:, :, columns],
            )
            for one in grown
        ]  # fmt: skip

    @cached_property
    def _jumps(self) -> list[_Factor]:
        """The factor of each event; a sampler's are one and the same."""
        same: dict[tuple[int, int], _Factor] = {}
        for event in self.events:
            if (id(event.jump), id(event.entering)) not in same:
                same[id(event.jump), id(event.entering)] = self._jump(event)
        return [same[id(event.jump), id(event.entering)] for event in self.events]

    def _jump(self, event: Event) -> _Factor:
        c, enters = self._ends[1], event.entering[:, :, -1:]
        entered = np.any(enters != 0, axis=(0, 2)) & bool(np.any(c))  # no column where there is no input
        rows = np.flatnonzero(np.any(event.jump != np.eye(self.system.n), axis=(0, 2)) | entered)
        columns = np.any(event.jump[:, rows] != 0, axis=(0, 1))
        if entered.any():
            columns = columns | np.any(c != 0, axis=(0, 1))
        seen = np.flatnonzero(columns)
        return _Factor(
            rows=rows, columns=seen, own=event.jump[:, rows[:, None], seen],
            entered=enters[:, rows] if entered.any() else None, seen=c[:, :, seen],
        )  # fmt: skip

    def _factors(self, flows: Sequence[Any]) -> Iterator[tuple[States, States, Any]]:
        """Yield what changes which states by which, in the order of the period; ``flows`` stand for the distinct widths."""
        for kind, number in zip(self._kinds, [*self._stops, None], strict=True):
            if not self._nothing[kind]:
                yield (*self._moved, flows[kind])
            if number is not None and len(self._jumps[number].rows):
                jump = self._jumps[number]
                yield jump.rows, jump.columns, jump

    @cached_property
    def alive(self) -> States:
        """The states whose values at the start of a period matter: the others are overwritten before anything follows them."""
        if self._known_alive is not None:
            return self._known_alive
        rows, columns = self._moved
        whole = np.ones((len(rows), len(columns)), dtype=bool)
        flows = [whole] * len(self._distinct)
        passed = [
            (rows, columns, factor.acts if isinstance(factor, _Factor) else factor)
            for rows, columns, factor in self._factors(flows)
        ]
        needed = np.ones(self.system.n, dtype=bool)
        while True:
            before = needed.copy()
            for rows, columns, acts in reversed(passed):
                followed = before[rows]
                before[rows] = False
                before[columns] |= acts[followed].any(axis=0)
            before &= needed
            if (before == needed).all():
                return np.flatnonzero(needed)
            needed = before

    @cached_property
    def sequence(self) -> SequenceMap | None:
        """The map of the common real part as one of the gain at a cut that carries a sequence; None where its signal flows."""
        if self._flows is None or any(s.piece and np.any(s.entering[:, :, -1:]) for s in self.system.samplings):
            return None
        c = self._ends[1][0].real
        looks, flowing = np.any(c != 0, axis=0), bool(np.any(c @ self.system.flow[0].real))
        passed = list(self._factors(self._flows))
        most = sum(factor.entered is not None for _, _, factor in passed)
        states = len(self.alive)
        found = np.zeros((self.system.n, states + most))
        found[self.alive, np.arange(states)] = 1.0
        read: list[Real] = []
        fresh = True  # whether what is read may have changed since it was last taken
        for rows, columns, factor in passed:
            if factor.entered is not None and fresh:
                read.append((c @ found)[0])
                fresh = False
            found[rows] = factor.own[0].real @ found[columns]
            if factor.entered is not None:
                found[rows, states + len(read) - 1] += factor.entered[0, :, 0].real
            fresh |= bool(looks[rows].any()) and (flowing or factor not in self._flows)
        count = len(read)
        rows_read = np.array(read).reshape(count, -1)
        ends = found[self.alive]
        return SequenceMap(
            whole=ends[:, :states], entered=ends[:, states : states + count], read=rows_read[:, :states],
            through=rows_read[:, states : states + count],
        )  # fmt: skip

    @cached_property
    def _reached(self) -> SequenceMap | None:
        return None if self.sequence is None else self.sequence.reached()

    def _closed(self, gains: Complex | Real) -> Complex | Real:
        """Return κ / (1 - κ d), for a direct gain at the cut closes a loop of its own."""
        return gains / (1 - gains * float(self._ends[2][0].real))

    def _flows_at(self, closed: Complex | Real) -> list[Complex | Real]:
        """Return what the distinct widths do, of the common real part."""
        if self._flows is not None:
            return [factor.value(closed) for factor in self._flows]
        rows, columns = self._moved
        b, c, flow = self._ends[0][0].real, self._ends[1][0].real, self.system.flow[0].real
        own, back = flow[columns[:, None], columns], b[columns] @ c[:, columns]
        matrix = own + closed[:, None, None] * back
        widths = np.array([width[0].real for width in self._distinct])
        return list(exponentials(widths[:, None, None, None] * matrix)[:, :, : len(rows)])

    def maps(self, gains: Complex | Real) -> Array:
        """Return maps (k, n, n) for gains of shape (k,) whose eigenvalues are those of Φ(κ), but for small ones."""
        with np.errstate(all="ignore"):
            if self._reached is not None:
                return self._reached.at(self._closed(gains))
            parts = np.array_split(gains, len(gains) // _AT_ONCE + 1)
            return shortened(np.concatenate([self._whole_at(few) for few in parts]))

    def _whole_at(self, gains: Array) -> Array:
        """Return Φ(κ) of the common real part for gains of shape (k,), shape (k, alive, alive)."""
        closed = self._closed(gains)
        if self.sequence is not None:
            return self.sequence.at(closed)
        count = len(self.alive)
        found = np.zeros((len(closed), self.system.n, count), dtype=closed.dtype)
        found[:, self.alive, np.arange(count)] = 1.0
        for rows, columns, factor in self._factors(self._flows_at(closed)):
            matrix = factor.value(closed) if isinstance(factor, _Factor) else factor
            found[:, rows] = matrix @ found[:, columns]
        return np.asarray(found[:, self.alive])

    def lifted(self, crossing: Crossing, gain: complex) -> Crossing:
        """Return a crossing of :meth:`maps` with the vectors of all states."""
        left, right = crossing.left, crossing.right
        if len(self.alive) > MANY:
            whole = self._whole_at(np.array([gain]))[0]
            scale = balancing(np.abs(whole))
            left_over = whole * scale / scale[:, None] - crossing.eigenvalue * np.eye(len(whole))
            left, right = null_vector(left_over.conj().T) / scale, null_vector(left_over) * scale
        return replace(crossing, left=self.of_all(left), right=self.of_all(right))

    def of_all(self, states: Complex) -> Complex:
        """Return states (alive, ...) among all."""
        found = np.zeros((self.system.n, *states.shape[1:]), dtype=complex)
        found[self.alive] = states
        return found

    def passage(self, start: Complex, gain: complex, rows: States | None = None) -> Complex:
        """Return some states (marks, rows, ...) behind each mark of those (N, ...) that begin the period at ``start``."""
        closed = self._closed(np.array([gain]))
        flows = self._flows_at(closed)
        flown, from_ = self._moved
        state, seen = start.astype(complex), []
        for kind, number in zip(self._kinds, self._stops, strict=False):
            if not self._nothing[kind]:
                state[flown] = flows[kind][0] @ state[from_]
            if number is None:
                seen.append(state.copy() if rows is None else state[rows])
            else:
                jump = self._jumps[number]
                state[jump.rows] = jump.value(closed)[0] @ state[jump.columns]
        return np.array(seen)

    def whole(self) -> Array:
        """Return Φ with the cut open and all infinitesimals, of the states that matter, shape (lanes, alive, alive)."""
        rows, columns = self._moved
        flow = self.system.flow[:, columns[:, None], columns]
        flows = [exponentials(width[:, None, None] * flow)[:, : len(rows)] for width in self._distinct]
        kind = np.result_type(*flows, *(event.jump for event in self.events))
        count = len(self.alive)
        found = np.zeros((self.system.lanes, self.system.n, count), dtype=kind)
        found[:, self.alive, np.arange(count)] = 1.0
        for changed, seen, factor in self._factors(flows):
            found[:, changed] = (factor.own if isinstance(factor, _Factor) else factor) @ found[:, seen]
        return found[:, self.alive]

    def pull(self, crossing: Crossing, gain: complex) -> complex:
        """Return d ln z / dκ of a simple eigenvalue of :meth:`maps`."""
        if self._reached is None:
            moved = self.rate(
                self.lifted(crossing, gain), np.array([gain.real + 1j * INFINITESIMAL]), np.array([gain.imag])
            )
            return complex(moved[0])
        closed = complex(self._closed(np.array([gain]))[0])
        turned = (1 + closed * float(self._ends[2][0].real)) ** 2
        change = crossing.left.conj() @ self._reached.slope(closed, crossing.right)
        with np.errstate(divide="ignore", invalid="ignore"):  # a double eigenvalue has no rate
            below = np.complex128(crossing.left.conj() @ crossing.right) * crossing.eigenvalue
            return complex(turned * change / below)

    def rate(self, crossing: Crossing, re: Array, im: Array) -> Complex:
        """Return d ln z of a simple eigenvalue of Φ(κ) along every lane, shape (lanes,).

        Parameters
        ----------
        crossing : Crossing
            The eigenvalue with its vectors, of all states.
        re, im : ndarray, shape (lanes,) or (1,)
            Real and imaginary part of κ, with their infinitesimals.
        """
        gain = complex(re[0].real, im[0].real)
        direct = self._ends[2]
        turned = (slopes(re) + 1j * slopes(im) + gain**2 * slopes(direct)) / (1 - gain * direct.real) ** 2
        turned = np.broadcast_to(turned, (self.system.lanes,))
        closed = self._closed(np.array([gain]))
        flows = self._flows_at(closed)
        moving = self._flows if self._flows is not None else self._whole_motions(re, im)
        passed: list[tuple[States, States, Complex | Real, Complex, Any]] = []
        state = crossing.right.astype(complex)
        for (rows, columns, factor), (_, _, motion) in zip(self._factors(flows), self._factors(moving), strict=True):
            matrix = factor.value(closed)[0] if isinstance(factor, _Factor) else factor[0]
            passed.append((rows, columns, matrix, state[columns], motion))
            state[rows] = matrix @ state[columns]
        looking = crossing.left.conj().astype(complex)
        found = np.zeros(self.system.lanes, dtype=complex)
        for rows, columns, matrix, before, motion in reversed(passed):
            change = motion.motion(complex(closed[0]), turned) if isinstance(motion, _Factor) else motion
            seen = looking[rows]
            found += (change @ before) @ seen
            looking[rows] = 0.0
            np.add.at(looking, columns, seen @ matrix)
        overlap = crossing.left.conj() @ crossing.right
        with np.errstate(divide="ignore", invalid="ignore"):  # a double eigenvalue has no rate
            return np.asarray(found / (overlap * crossing.eigenvalue))

    def _whole_motions(self, re: Array, im: Array) -> list[Complex]:
        """Return the changes of flows that depend on the gain as a whole: real and imaginary part carry their infinitesimals."""
        (rows, columns), (b, c, d) = self._moved, self._ends
        below = (1 - re * d) ** 2 + (im * d) ** 2
        factor_re, factor_im = (re * (1 - re * d) - im * im * d) / below, im / below
        back = b[:, columns] @ c[:, :, columns]
        own = self.system.flow[:, columns[:, None], columns] + factor_re[:, None, None] * back
        own, other = np.broadcast_arrays(own, factor_im[:, None, None] * back)
        pair = np.concatenate([np.concatenate([own, -other], axis=2), np.concatenate([other, own], axis=2)], axis=1)
        n, count = len(columns), len(rows)
        found = []
        for width in self._distinct:
            moved = slopes(exponentials(width[:, None, None] * pair))
            found.append(np.asarray(moved[:, :count, :n] + 1j * moved[:, n : n + count, :n]))
        return found
