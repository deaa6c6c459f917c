"""Where candidates come to rest under constant inputs: Newton's method from where their responses have come to.

    x ← x - (∂f/∂x)⁺ f(x, u),   for all candidates at once

The slopes are written into the graph by the same rules as the slopes in time. Directions in which the state may lie anywhere stay where
they are, as on the exact path, and modes that laws remember follow the state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from engine.batch.frequency.balance import balance
from engine.batch.nonlinear.arithmetic import Formulas, operands
from engine.batch.nonlinear.equations import Equations
from engine.batch.nonlinear.slopes import slopes
from engine.model.traced import Op, nodes_of

Real = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

_ITERATIONS: Final = 20
_CHANGES: Final = 4
"""Modes may change so often in one step."""
_STILL: Final = 1e-9
"""A state rests when the correction is this part of it."""
_MOVES: Final = 1e-3
"""A state that moves by more than this part of it, in the time simulated, may change what stands still;"""
_NOTHING: Final = 1e-9
"""one that moves by less than this does not."""
_REACHED: Final = 1e-8
"""Part of the rates that no correction may leave."""
_SINGULAR: Final = 1e-10


@dataclass(frozen=True, kw_only=True, eq=False)
class Rested:
    """Outputs at rest (watched, B), NaN where none was found; ``single`` (B,): there is no other rest nearby."""

    outputs: Real
    single: Flags


def reaching(equations: Equations, output: int) -> Flags:
    """Return which states and delayed signals (unknowns,) an output of the diagram follows, at once or by way of others."""
    graph = equations.graph
    rates = nodes_of(graph, [*equations.rates, *equations.entering])
    found = np.zeros(len(rates), dtype=bool)
    seen: set[int] = set()
    pending = nodes_of(graph, [equations.outputs[output]])
    while pending:
        seen |= operands(graph, pending)
        new = [k for k, state in enumerate(equations.unknowns) if state.node in seen and not found[k]]
        found[new] = True
        pending = [rates[k] for k in new]
    return found


def _times(matrices: Real, vectors: Real) -> Real:
    """Return A x for stacks (B, n, n) and (B, n)."""
    return np.asarray((matrices @ vectors[:, :, None])[:, :, 0])


class _Places:
    """Where among the parameters of a graph its signals are."""

    def __init__(self, equations: Equations) -> None:
        nodes = equations.graph.nodes
        self._count = sum(op is Op.PARAMETER for op, _, _ in nodes)
        self.unknowns, self.modes, self._inputs = (
            [nodes[signal.node][1] for signal in signals]
            for signals in (equations.unknowns, equations.changes.modes, equations.inputs)
        )

    def filled(self, points: Real, unknowns: Real, modes: Real, inputs: Sequence[float]) -> Real:
        """Return the parameters of all candidates, (parameters, B)."""
        values = np.zeros((self._count, len(points)))
        values[: points.shape[1]] = points.T
        values[self.unknowns], values[self.modes] = unknowns, modes
        values[self._inputs] = np.asarray(inputs, dtype=float)[:, None]
        return values


class Moving:
    """What goes on moving under constant inputs."""

    def __init__(self, equations: Equations) -> None:
        self._places, self._states = _Places(equations), len(equations.rates)
        self._drifts = Formulas(equations.graph, equations.drifts)

    def __call__(self, points: Real, unknowns: Real, modes: Real, inputs: Sequence[float], elapsed: float) -> Flags:
        """Return which unknowns (unknowns, B) move, by what they would in ``elapsed`` s; delayed signals by what is on its way."""
        with np.errstate(all="ignore"):
            moved = self._drifts(self._places.filled(points, unknowns, modes, inputs))
            moved[: self._states] *= elapsed
            return np.asarray(~(np.abs(moved) <= _MOVES * np.abs(unknowns) + _NOTHING))


class Rest:
    """The search for rest of one structure.

    Parameters
    ----------
    equations : Equations
    watched : sequence of int
        Outputs of the diagram that are asked for.
    """

    def __init__(self, equations: Equations, watched: Sequence[int]) -> None:
        graph = equations.graph
        self._places = _Places(equations)
        outside = -1.0 if equations.outside is None else equations.outside
        self._outputs = Formulas(graph, [*(equations.outputs[output] for output in watched), outside])
        drifts = equations.drifts
        with np.errstate(all="ignore"):
            columns = [
                slopes(graph, drifts, {s.node: float(s is unknown) for s in equations.signals})
                for unknown in equations.unknowns
            ]
        self._fitting = Formulas(graph, equations.changes.fitting)
        self._wanted = Formulas(graph, [*drifts, *(entry for column in columns for entry in column)])

    def __call__(self, points: Real, unknowns: Real, modes: Real, inputs: Sequence[float]) -> Rested:
        """Return the rest near ``unknowns`` (unknowns, B) of candidates ``points`` (B, varied), in modes (modes, B) that are remembered."""
        n, batch = unknowns.shape
        values = self._places.filled(points, unknowns, modes, inputs)
        x = unknowns.copy()
        open_: Flags = np.asarray(np.isfinite(unknowns).all(axis=0))
        found, single = np.zeros(batch, dtype=bool), np.zeros(batch, dtype=bool)
        scale = np.ones((batch, n))
        with np.errstate(all="ignore"):
            for iteration in range(_ITERATIONS):
                values[self._places.unknowns] = x
                both = self._wanted(values)
                f, slope = both[:n].T, both[n:].reshape(n, n, batch).transpose(2, 1, 0)
                open_ = np.asarray(open_ & np.isfinite(f).all(axis=1) & np.isfinite(slope).all(axis=(1, 2)))
                if not open_.any():
                    break
                if iteration == 0:
                    scale = balance(np.where(open_[:, None, None], slope, 0.0))
                balanced = slope * scale[:, None] / scale[:, :, None]
                open_ = np.asarray(open_ & np.isfinite(balanced).all(axis=(1, 2)))
                balanced = np.where(open_[:, None, None], balanced, np.eye(n))
                try:
                    u, s, v = np.linalg.svd(balanced)
                except np.linalg.LinAlgError:
                    break
                inverse = np.where(s > 1e-12 * s[:, :1], 1 / s, 0.0)
                rate = np.where(open_[:, None], f / scale, 0.0)
                step = -_times(v.swapaxes(1, 2), inverse * _times(u.swapaxes(1, 2), rate))
                left = np.linalg.norm(_times(balanced, step) + rate, axis=1)
                open_ = np.asarray(open_ & (left <= _REACHED * np.linalg.norm(rate, axis=1)))
                step = np.where(open_[:, None], step * scale, 0.0)
                x = x + step.T
                values[self._places.unknowns] = x
                self._follow(values)
                done = open_ & (np.abs(step.T) <= _STILL * np.maximum(np.abs(x), 1e-6)).all(axis=0)
                found |= done
                # what nothing follows and nothing moves, as the place of a play while its flank pushes, is nowhere else either
                idle = ~slope.any(axis=1) & ~slope.any(axis=2)
                least = np.take_along_axis(s, np.maximum(n - 1 - idle.sum(axis=1), 0)[:, None], axis=1)[:, 0]
                single = np.where(done, least > _SINGULAR * s[:, 0], single)
                open_ = np.asarray(open_ & ~done)
            values[self._places.unknowns] = x
            settled = self._follow(values)
            outputs = self._outputs(values)
        found &= settled & (outputs[-1] <= 0)
        return Rested(outputs=np.where(found, outputs[:-1], np.nan), single=np.asarray(single & found))

    def _follow(self, values: Real) -> Flags:
        """Let modes that are remembered come to those that fit the state; return whose were so already, (B,)."""
        places = self._places.modes
        before = values[places]
        for _ in range(_CHANGES if places else 0):
            last = values[places]
            values[places] = self._fitting(values)
            if np.array_equal(values[places], last):
                break
        return np.asarray((values[places] == before).all(axis=0))
