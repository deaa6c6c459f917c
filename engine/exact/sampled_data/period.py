"""One common period of a sampled system: the map from its start to its end, with a loop closed by any gain.

Φ(κ) = Π (J + κ K C) e^{(M + κ B C) h},   u = κ y at the place where the loop is cut

Every factor changes a few states only; the rest of it is the unit matrix and never multiplied. Where the cut carries what is held,
C M = 0 and C B = 0, the flow is linear in the gain: e^{M h} + κ ∫ e^{M s} B ds C.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from engine.exact.time.propagate import exponentials
from engine.model.tangent import slopes

if TYPE_CHECKING:
    from engine.exact.sampled_data.crossings import Crossing
    from engine.exact.sampled_data.system import Event, SampledSystem
    from engine.model.linear_system import Array

Real = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
States = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Factor:
    """A factor of the map: states ``rows`` become ``own`` + κ ``back`` times states ``columns``, (lanes, rows, columns)."""

    rows: States
    columns: States
    own: Array
    back: Array | None

    def value(self, gains: Complex | Real) -> Complex | Real:
        """Return the common real part for each gain (k,), (k or 1, rows, columns)."""
        own: Real = self.own[:1].real
        return own if self.back is None else own + gains[:, None, None] * self.back[:1].real

    def motion(self, gain: complex, turned: Complex) -> Complex:
        """Return the change along every lane, with that of the gain, (lanes,)."""
        found = slopes(self.own).astype(complex)
        if self.back is not None:
            found = found + gain * slopes(self.back) + turned[:, None, None] * self.back.real
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
    """

    def __init__(
        self, system: SampledSystem, marks: Iterable[float] = (), events: Sequence[Event] | None = None
    ) -> None:
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
        back = (grown[:, :, :count, n:] @ c[:, :, columns]) if through else [None] * len(grown)
        return [
            _Factor(rows=rows, columns=columns, own=own[:, :count, :n], back=through)
            for own, through in zip(grown, back, strict=True)
        ]

    @cached_property
    def _jumps(self) -> list[_Factor]:
        """The factor of each event."""
        found = []
        c = self._ends[1]
        n = self.system.n
        for event in self.events:
            enters = event.entering[:, :, -1:]
            entered = np.any(enters != 0, axis=(0, 2)) & bool(np.any(c))  # no column where there is no input
            rows = np.flatnonzero(np.any(event.jump != np.eye(n), axis=(0, 2)) | entered)
            columns = np.any(event.jump[:, rows] != 0, axis=(0, 1))
            if entered.any():
                columns = columns | np.any(c != 0, axis=(0, 1))
            seen = np.flatnonzero(columns)
            back = enters[:, rows] @ c[:, :, seen] if entered.any() else None
            found.append(_Factor(rows=rows, columns=seen, own=event.jump[:, rows[:, None], seen], back=back))
        return found

    def _factors(self, flows: Sequence[Any]) -> Iterator[tuple[States, States, Any]]:
        """Yield what changes which states by which, in the order of the period; ``flows`` stand for the distinct widths."""
        for kind, number in zip(self._kinds, [*self._stops, None], strict=True):
            if not self._nothing[kind]:
                yield (*self._moved, flows[kind])
            if number is not None and len(self._jumps[number].rows):
                jump = self._jumps[number]
                yield jump.rows, jump.columns, jump

    def _valued(self, gains: Complex | Real | None) -> tuple[Complex | Real, list[Complex | Real]]:
        """Return κ / (1 - κ d), for a direct gain at the cut closes a loop of its own, and the flows of the common real part."""
        if gains is None:
            closed: Complex | Real = np.zeros(1)
        else:
            closed = gains / (1 - gains * float(self._ends[2][0].real))
        if self._flows is not None:
            return closed, [factor.value(closed) for factor in self._flows]
        rows, columns = self._moved
        b, c, flow = self._ends[0][0].real, self._ends[1][0].real, self.system.flow[0].real
        own, back = flow[columns[:, None], columns], b[columns] @ c[:, columns]
        matrix = own + closed[:, None, None] * back
        return closed, [exponentials(width[0].real * matrix)[:, : len(rows)] for width in self._distinct]

    def maps(self, gains: Complex | Real | None = None) -> Complex | Real:
        """Return Φ(κ) of the common real part for gains of shape (k,), shape (k, N, N); the cut open where there are none."""
        n = self.system.n
        with np.errstate(all="ignore"):
            closed, flows = self._valued(gains)
            found = np.zeros((len(closed), n, n), dtype=closed.dtype) + np.eye(n)
            for rows, columns, factor in self._factors(flows):
                matrix = factor.value(closed) if isinstance(factor, _Factor) else factor
                found[:, rows] = matrix @ found[:, columns]
        return np.asarray(found)

    def passage(self, start: Complex, gain: complex) -> tuple[Real, Complex]:
        """Return the instants (k,) and the states (k, N) behind each stop of one that begins the period at ``start``."""
        closed, flows = self._valued(np.array([gain]) if gain else None)
        rows, columns = self._moved
        time, state = 0.0, start.astype(complex)
        times, states = [], []
        for kind, width, number in zip(self._kinds, self._widths, self._stops, strict=False):
            time, state = time + float(width[0].real), state.copy()
            state[rows] = flows[kind][0] @ state[columns]
            if number is not None:
                jump = self._jumps[number]
                state[jump.rows] = jump.value(closed)[0] @ state[jump.columns]
            times.append(time)
            states.append(state)
        return np.array(times), np.array(states)

    def whole(self) -> Array:
        """Return Φ with the cut open and all infinitesimals, shape (lanes, N, N)."""
        rows, columns = self._moved
        flow = self.system.flow[:, columns[:, None], columns]
        flows = [exponentials(width[:, None, None] * flow)[:, : len(rows)] for width in self._distinct]
        kind = np.result_type(*flows, *(event.jump for event in self.events))
        found = np.zeros((self.system.lanes, self.system.n, self.system.n), dtype=kind) + np.eye(self.system.n)
        for changed, seen, factor in self._factors(flows):
            found[:, changed] = (factor.own if isinstance(factor, _Factor) else factor) @ found[:, seen]
        return found

    def rate(self, crossing: Crossing, re: Array, im: Array) -> Complex:
        """Return d ln z of a simple eigenvalue of Φ(κ) along every lane, shape (lanes,).

        Parameters
        ----------
        crossing : Crossing
            The eigenvalue with its vectors.
        re, im : ndarray, shape (lanes,) or (1,)
            Real and imaginary part of κ, with their infinitesimals.
        """
        gain = complex(re[0].real, im[0].real)
        direct = self._ends[2]
        turned = (slopes(re) + 1j * slopes(im) + gain**2 * slopes(direct)) / (1 - gain * direct.real) ** 2
        turned = np.broadcast_to(turned, (self.system.lanes,))
        closed, flows = self._valued(np.array([gain]))
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
