"""From block realisations to one state space: the interconnection, solved once for all signals.

Every block input is one output, one external signal or 0, so with all signals s = (outputs, externals) written as rows
over the columns v = (x, r, w):  s = S v,  x' = [A 0 0] v + B S[sources] v,  z = D21 S[sources] v.
Rows with direct feed-through follow each other in topological order; only the rows of a true algebraic loop are solved as
a linear system, S = (I - M)^-1 (...), and a loop without a solution is refused by the names of its ports.
Transfer functions are never divided, so no order is added and nothing has to cancel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.linalg import lapack

from engine.elements import Ports, Realization
from engine.model.errors import DiagramError, IllPosedError, Path
from engine.model.strongly_connected_components import circles

Array = npt.NDArray[Any]

RECIPROCAL_CONDITION: Final = 1e-12
"""An algebraic loop whose equations are closer to singular than this has no trustworthy solution."""

_REMEMBERED: Final = 64
_OVERFLOW: Final = "the coefficients of the system must be finite, but they overflow at these values"


@dataclass(frozen=True, slots=True, kw_only=True)
class FlatBlock:
    """A block of the flattened diagram: its path, its place in the document and where its ports lie among all ports."""

    path: str
    at: Path
    ports: Ports
    first_input: int
    first_output: int

    @classmethod
    def after(cls, before: FlatBlock | None, *, path: str, at: Path, ports: Ports) -> FlatBlock:
        """Return a block whose ports are numbered on from those of the block before it."""
        if before is None:
            return cls(path=path, at=at, ports=ports, first_input=0, first_output=0)
        return cls(
            path=path, at=at, ports=ports,
            first_input=before.first_input + len(before.ports.inputs),
            first_output=before.first_output + len(before.ports.outputs),
        )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Wiring:
    """What drives each block input, and what is read.

    ``sources`` holds a signal number for every block input: 0...outputs-1 are block outputs, then come the externals,
    the last one is the signal that is always 0. ``reads`` are the signals of the system's outputs.
    """

    sources: tuple[int, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    reads: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Term:
    """One feed-through: signal ``row`` contains entry (``i``, ``j``) of the block's D times signal ``source``."""

    row: int
    block: int
    i: int
    j: int
    source: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Loop:
    """The rows of one algebraic loop, with the feed-through inside it and into it."""

    rows: tuple[int, ...]
    inner: tuple[Term, ...]
    outer: tuple[Term, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Assembled:
    """All matrices of the interconnection with a leading batch axis or without; ``valid`` tells which members exist."""

    matrices: dict[str, Array]
    valid: npt.NDArray[np.bool_]


class _Layout:
    """Where the states and delay channels of each block lie among the columns (states, externals, delay channels)."""

    def __init__(self, realizations: Sequence[Realization], *, externals: int, batch: tuple[int, ...]) -> None:
        arrays = [
            array for r in realizations for array in (r.a, r.b, r.c, r.d, r.delays, r.initial) if array is not None
        ]
        self._dtype = np.dtype(complex if any(np.iscomplexobj(array) for array in arrays) else float)
        self._batch = batch
        self.externals = externals
        self.states = sum(r.a.shape[-1] for r in realizations)
        self.delays = sum(r.delays.shape[-1] for r in realizations)
        self.columns = self.states + externals + self.delays
        self.x: list[slice] = []
        self.w: list[slice] = []
        x = w = 0
        for realization in realizations:
            self.x.append(slice(x, x := x + realization.a.shape[-1]))
            self.w.append(slice(w, w := w + realization.delays.shape[-1]))

    def zeros(self, *shape: int) -> Array:
        """Return zeros of the type of all coefficients, with the batch axis in front."""
        return np.zeros((*self._batch, *shape), dtype=self._dtype)

    def split(self, rows: Array, *names: str) -> dict[str, Array]:
        """Return the parts of ``rows`` that multiply states, externals and delay channels."""
        n, r = self.states, self.states + self.externals
        return dict(zip(names, (rows[..., :n], rows[..., n:r], rows[..., r:]), strict=True))


class Interconnection:
    """The blocks of a diagram with their ports numbered through, ready to be connected for any values.

    Attributes
    ----------
    blocks : tuple of FlatBlock
        In the order of their states and delay channels.
    inputs, outputs : int
        Number of input and output ports of all blocks together.
    """

    def __init__(self, blocks: Sequence[FlatBlock]) -> None:
        self.blocks = tuple(blocks)
        self._labels = [f"{block.path}.{port}" for block in blocks for port in block.ports.outputs]
        self.inputs = sum(len(block.ports.inputs) for block in blocks)
        self.outputs = len(self._labels)
        self._owner = [block for block in blocks for _ in block.ports.outputs]
        self._steps: dict[Any, tuple[Term | Loop, ...]] = {}

    def assemble(
        self, realizations: Sequence[Realization], wiring: Wiring, *, admitted: npt.NDArray[np.bool_] | None = None
    ) -> Assembled:
        """Connect the realised blocks.

        Parameters
        ----------
        realizations : sequence of Realization
            One for each block, with a leading batch axis or without.
        admitted : ndarray (B,) of bool, optional
            The members of a batch that may exist. Without it there is a single system, and what is wrong is raised.

        Raises
        ------
        IllPosedError
            If an algebraic loop of a single system has no (unique) solution.
        DiagramError
            If a coefficient of a single system is not finite.
        """
        with np.errstate(all="ignore"):
            # What overflows is found at the end, once, as a coefficient that is not finite.
            return self._assemble(realizations, wiring, admitted)

    def _assemble(
        self, realizations: Sequence[Realization], wiring: Wiring, admitted: npt.NDArray[np.bool_] | None
    ) -> Assembled:
        single = admitted is None
        valid = np.ones((), dtype=bool) if admitted is None else admitted.copy()
        layout = _Layout(realizations, externals=len(wiring.inputs), batch=valid.shape)
        signals = self._sources(realizations, layout)
        for step in self.order(realizations, wiring):
            if isinstance(step, Term):
                factor = realizations[step.block].d[..., step.i, step.j, None]
                signals[..., step.row, :] += factor * signals[..., step.source, :]
            else:
                self._solve(step, realizations, signals, valid, single=single)
        matrices = {
            **self._dynamics(realizations, wiring, layout, signals),
            **layout.split(signals[..., list(wiring.reads), :], "c1", "d11", "d12"),
        }
        finite = np.ones_like(valid)
        for array in matrices.values():
            finite &= np.isfinite(array).all(axis=tuple(range(valid.ndim, array.ndim)))
        if single and not finite:
            raise DiagramError(_OVERFLOW)
        valid &= finite
        if not valid.all():
            matrices = {name: _cleared(array, valid) for name, array in matrices.items()}
        return Assembled(matrices={name: np.ascontiguousarray(array) for name, array in matrices.items()}, valid=valid)

    def _sources(self, realizations: Sequence[Realization], layout: _Layout) -> Array:
        """Return the rows of all signals as far as they follow from states, externals and delay channels alone."""
        signals = layout.zeros(self.outputs + layout.externals + 1, layout.columns)
        externals = np.arange(layout.externals)
        signals[..., self.outputs + externals, layout.states + externals] = 1.0
        for block, realization, x, w in zip(self.blocks, realizations, layout.x, layout.w, strict=True):
            rows = slice(block.first_output, block.first_output + len(block.ports.outputs))
            if x.stop > x.start:
                signals[..., rows, x] = realization.c
            if realization.d12 is not None:
                first = layout.states + layout.externals
                signals[..., rows, first + w.start : first + w.stop] = realization.d12
        return signals

    def _dynamics(
        self, realizations: Sequence[Realization], wiring: Wiring, layout: _Layout, signals: Array
    ) -> dict[str, Array]:
        """Return what drives the states and enters the delay channels, all signals being known."""
        flow = layout.zeros(layout.states, layout.columns)
        entering = layout.zeros(layout.delays, layout.columns)
        lengths, start = layout.zeros(layout.delays), layout.zeros(layout.states)
        for block, realization, x, w in zip(self.blocks, realizations, layout.x, layout.w, strict=True):
            sources = wiring.sources[block.first_input : block.first_input + len(block.ports.inputs)]
            if x.stop > x.start:
                flow[..., x, x] = realization.a
                for j, source in enumerate(sources):
                    flow[..., x, :] += realization.b[..., :, j, None] * signals[..., source, None, :]
                if realization.initial is not None:
                    start[..., x] = realization.initial
            if realization.d21 is not None:
                lengths[..., w] = realization.delays
                for j, source in enumerate(sources):
                    entering[..., w, :] += realization.d21[..., :, j, None] * signals[..., source, None, :]
        return {
            **layout.split(flow, "a", "b1", "b2"),
            **layout.split(entering, "c2", "d21", "d22"),
            "delays": lengths,
            "x0": start,
        }

    def order(self, realizations: Sequence[Realization], wiring: Wiring) -> tuple[Term | Loop, ...]:
        """Return the feed-through in the order in which it can be followed; remembered for each pattern of zeros in D."""
        patterns = [_pattern(r.d) for r in realizations]
        key = (wiring.sources, tuple(pattern.tobytes() for pattern in patterns))
        steps = self._steps.get(key)
        if steps is None:
            if len(self._steps) >= _REMEMBERED:
                self._steps.clear()
            steps = self._steps[key] = self._plan(patterns, wiring.sources)
        return steps

    def sources_of(self, block: int, wiring: Wiring) -> tuple[int, ...]:
        """Return the signal number of each input of a block."""
        first = self.blocks[block].first_input
        return wiring.sources[first : first + len(self.blocks[block].ports.inputs)]

    def _plan(self, patterns: Sequence[Array], sources: Sequence[int]) -> tuple[Term | Loop, ...]:
        outputs = self.outputs
        terms: list[list[Term]] = [[] for _ in range(outputs)]
        for number, (block, pattern) in enumerate(zip(self.blocks, patterns, strict=True)):
            for i, j in zip(*np.nonzero(pattern), strict=True):
                source = sources[block.first_input + int(j)]
                row = block.first_output + int(i)
                terms[row].append(Term(row=row, block=number, i=int(i), j=int(j), source=source))
        component = circles([[t.source for t in row if t.source < outputs] for row in terms])
        steps: list[Term | Loop] = []
        for rows in component:
            own = [term for row in rows for term in terms[row]]
            inner = tuple(term for term in own if term.source in rows)
            if inner:
                outer = tuple(term for term in own if term.source not in rows)
                steps.append(Loop(rows=tuple(rows), inner=inner, outer=outer))
            else:
                steps.extend(own)
        return tuple(steps)

    def _solve(
        self,
        loop: Loop,
        realizations: Sequence[Realization],
        signals: Array,
        valid: npt.NDArray[np.bool_],
        *,
        single: bool,
    ) -> None:
        """Replace the rows of an algebraic loop by their solution, in place."""
        for term in loop.outer:
            factor = realizations[term.block].d[..., term.i, term.j, None]
            signals[..., term.row, :] += factor * signals[..., term.source, :]
        place = {row: k for k, row in enumerate(loop.rows)}
        size = len(loop.rows)
        feedback = np.zeros((*valid.shape, size, size), dtype=signals.dtype)
        for term in loop.inner:
            feedback[..., place[term.row], place[term.source]] += realizations[term.block].d[..., term.i, term.j]
        # Signals of a loop differ in unit; balanced, the distance to singularity is that of 1 - (loop gain).
        magnitude = np.nan_to_num(np.abs(feedback.real))
        typical = magnitude if single else np.median(magnitude, axis=0)
        scale = lapack.dgebal(typical, scale=1, permute=0)[3]
        feedback = feedback * (scale / scale[:, None])
        finite = np.isfinite(feedback).all(axis=(-2, -1))
        if single and not finite:
            raise DiagramError(_OVERFLOW, at=self._owner[loop.rows[0]].at)
        equations = np.eye(size) - np.where(finite[..., None, None], feedback, 0.0)
        spread = np.linalg.svd(equations.real, compute_uv=False)
        posed = spread[..., -1] > RECIPROCAL_CONDITION * np.maximum(1.0, spread[..., 0])
        if single and not posed:
            raise self._ill_posed(loop)
        valid &= finite & posed
        equations = np.where(posed[..., None, None], equations, np.eye(size))
        rows = list(loop.rows)
        signals[..., rows, :] = np.linalg.solve(equations, signals[..., rows, :] / scale[:, None]) * scale[:, None]

    def _ill_posed(self, loop: Loop) -> IllPosedError:
        circle = _shortest_circle({row: [t.row for t in loop.inner if t.source == row] for row in loop.rows})
        ports = tuple(self._labels[row] for row in circle)
        return IllPosedError(
            f"the algebraic loop {' -> '.join((*ports, ports[0]))} must have a loop gain other than 1 to have a solution; "
            "change a gain on it, or put a lag or a delay into it",
            at=self._owner[circle[0]].at,
            ports=ports,
        )


def _cleared(array: Array, valid: npt.NDArray[np.bool_]) -> Array:
    """Return ``array`` with zeros in place of the members that do not exist, so that they cannot disturb the others."""
    return np.where(valid.reshape(-1, *[1] * (array.ndim - 1)), array, 0.0)


def _pattern(d: Array) -> npt.NDArray[np.bool_]:
    return np.asarray((d != 0).any(axis=0) if d.ndim > 2 else d != 0)


def _shortest_circle(successors: dict[int, list[int]]) -> list[int]:
    """Return the shortest way from the first row back to itself, by breadth-first search."""
    first = min(successors)
    ways = [[first]]
    seen: set[int] = set()
    while ways:
        further = []
        for way in ways:
            for following in successors[way[-1]]:
                if following == first:
                    return way
                if following not in seen:
                    seen.add(following)
                    further.append([*way, following])
        ways = further
    return [first]
