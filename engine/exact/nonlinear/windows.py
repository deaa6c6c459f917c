"""Many short steps at once: where a recorded command kinks at every sample, the steps between are solved together.

Step k begins where step k - 1 ends:  x_kj = x_{k-1,s} + h_k Σ_i a_ji f(t_ki, x_ki). Newton's method sees a chain of
blocks, each solved for its own residual and for a change of its start; the starts then follow one after the other. The
laws are evaluated at all instants of all steps in one call.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from engine.exact.laws.system import Instants
from engine.exact.nonlinear.guards import crosses
from engine.exact.time.chebyshev import NODES, coefficient_matrix, differentiation_matrix
from engine.model.errors import EngineError
from engine.model.failures import numerical

if TYPE_CHECKING:
    from engine.exact.nonlinear.steps import Stepper
    from engine.exact.nonlinear.switching import Switchboard
    from engine.signals import Signal

Array = npt.NDArray[Any]
Real = npt.NDArray[np.float64]

_NEWTON = 10
_INSIDE = np.array([0.25, 0.75])


@dataclass(frozen=True, kw_only=True, eq=False)
class Lines:
    """Commands that are straight between ``times`` (K + 1,): ``first`` and ``last`` value of each step, (K, inputs)."""

    times: Real
    first: Real
    last: Real

    @property
    def widths(self) -> Real:
        """Lengths of the steps, s."""
        return np.diff(self.times)

    def until(self, count: int) -> Lines:
        """Return the first ``count`` steps."""
        return Lines(times=self.times[: count + 1], first=self.first[:count], last=self.last[:count])

    def at(self, theta: Real, x: Array, modes: Sequence[int]) -> Instants:
        """Return the instants at ``theta`` of every step, one step after the other, with states ``x`` (lanes, K, N, n)."""
        lanes, count = x.shape[0], x.shape[1] * x.shape[2]
        rise = self.last - self.first
        times = (self.times[:-1, None] + self.widths[:, None] * theta).reshape(1, count)
        u = np.concatenate(self.first[:, None] + rise[:, None] * theta[:, None])[None]
        du = np.repeat(rise / self.widths[:, None], len(theta), axis=0)[None]
        return Instants(
            t=np.broadcast_to(times, (lanes, count)), x=x.reshape(lanes, count, x.shape[3]), u=u, du=du,
            w=np.zeros((1, count, 0)), modes=modes,
        )  # fmt: skip


def lines(signals: Sequence[Signal | None], times: Real, constants: Real) -> Lines | None:
    """Return the commands between ``times``, None where they are not straight there, or jump from one to the next."""
    if any(signal is not None and signal.degree() not in {0, 1} for signal in signals):
        return None
    inside = (times[:-1, None] + np.diff(times)[:, None] * _INSIDE).ravel()
    first, last = np.zeros((2, len(times) - 1, len(signals)))
    for k, signal in enumerate(signals):
        if signal is not None:
            early, late = signal.value(inside).reshape(-1, 2).T
            first[:, k], last[:, k] = 1.5 * early - 0.5 * late, 1.5 * late - 0.5 * early
    if np.any(np.abs(first[1:] - last[:-1]) > 1e-9 * np.maximum(np.abs(first), np.abs(last)).max(axis=0, initial=0.0)):
        return None
    return Lines(times=times, first=first + constants, last=last + constants)


@dataclass(frozen=True, kw_only=True, eq=False)
class Chain:
    """Solved steps, with all that is recorded of them.

    ``edges`` (K, lanes) where each ends; ``x`` (K, 17, n), ``y`` and the other nodes (lanes, K, 17, ·); ``error`` of the outputs.
    """

    edges: Array
    x: Real
    u: Array
    y: Array
    e: Array
    v: Array
    error: float
    end: Array


def solve(stepper: Stepper, board: Switchboard, straight: Lines) -> Chain | None:
    """Return as many steps from the present instant as are accurate and without an event; None for none.

    Parameters
    ----------
    stepper : Stepper
    board : Switchboard
        The present state and modes.
    straight : Lines
        The commands.
    """
    path = None
    with contextlib.suppress(EngineError), numerical("a chain of steps"):
        path = _newton(stepper, board, straight)
    return None if path is None else _accepted(stepper, board, straight, path)


def _newton(stepper: Stepper, board: Switchboard, straight: Lines) -> Real | None:
    """Return starts and stages (K, s + 1, n), None where Newton's method does not converge."""
    real, method, begin = stepper.real, stepper.short, board.x[0].real
    count, s, n = len(straight.first), len(method.points), len(begin)
    scale = np.maximum(stepper.scale, np.abs(begin))
    scale = np.where(scale > 0, scale, 1.0)
    x = np.broadcast_to(begin, (count, s, n)).copy()
    last = np.inf
    for _ in range(_NEWTON):
        at = straight.at(method.points, x[None], board.modes)
        f = real.flow(at).f[0].reshape(count, s, n)
        starts = np.concatenate([begin[None], x[:-1, -1]])
        residual = starts[:, None] + straight.widths[:, None, None] * (method.a @ f) - x
        slope = real.tangent(at).total.reshape(count, s, n, n) * (scale / scale[:, None])
        step = _correction(slope, (residual / scale)[None], np.zeros((1, n)), straight.widths, method.a)[0] * scale
        size = float(np.max(np.abs(step) / scale, initial=0.0))
        if not np.isfinite(size) or (size > 2 * last and size > 1e-9):
            return None
        x = x + step
        if size <= 1e-13 or (size <= 1e-8 and size <= 1e-2 * last):
            still = ~f.any(axis=(0, 1))
            x[:, :, still] = begin[still]
            return np.concatenate([np.concatenate([begin[None], x[:-1, -1]])[:, None], x], axis=1)
        last = size
    return None


def _accepted(stepper: Stepper, board: Switchboard, straight: Lines, path: Real) -> Chain | None:
    """Return the steps before the first that is not accurate or has an event."""
    real, count, nodes = stepper.real, len(path), len(NODES)
    at = straight.at(NODES, (stepper.short.to_nodes @ path)[None], board.modes)
    flow = real.flow(at)
    y, _ = real.read(at, flow.v)
    x, f, e, out = (_stepwise(part, count)[0] for part in (at.x, flow.f, flow.e, y))
    miss = stepper.missed_by(path, x, f, straight.widths, stepper.short)
    u, v = (_stepwise(part, count)[0] for part in (at.u, flow.v))
    parts, sums = np.concatenate([x[:, :, : real.linear_states], u, v], axis=2), np.concatenate([out, e, v], axis=2)
    loud = stepper.loudness(np.abs(parts).max(axis=(0, 1), initial=0.0), np.abs(sums).max(axis=(0, 1), initial=0.0))
    missed = stepper.heard(np.abs(coefficient_matrix()[-2:] @ sums).sum(axis=1) / loud, board.modes)
    seen = np.max(missed[:, : out.shape[2]], axis=1, initial=0.0)
    miss = np.maximum(miss, stepper.share * np.max(missed, axis=1, initial=0.0))
    good = miss <= stepper.tolerance
    slope = stepper.quiet(differentiation_matrix() @ e / straight.widths[:, None, None], e, straight.widths)
    for number, law in enumerate(real.laws):
        moment = real.seen(number, at, flow.e, flow.v, np.concatenate(slope)[None])
        for k, guard in enumerate(law.element.guards(moment, board.modes[number], law.real)):
            values = np.broadcast_to(guard, (1, count * nodes)).reshape(count, nodes)
            good &= ~crosses(values, board.tolerance(number, k, values))
            board.note(number, k, values)
    done = count if good.all() else int(np.argmin(good))
    if not done:
        return None
    straight, path, error = straight.until(done), path[:done], float(np.maximum(miss, seen)[:done].max())
    end: Array = path[-1:, -1]
    if stepper.system.complex:
        whole = _lanes(stepper, board, straight, path)
        end = whole[:, -1, -1]
        at = straight.at(NODES, stepper.short.to_nodes @ whole, board.modes)
        flow = stepper.system.flow(at)
        y, _ = stepper.system.read(at, flow.v)
    kept = slice(0, done * nodes)
    recorded = {
        name: _stepwise(part[:, kept], done) for name, part in (("u", at.u), ("y", y), ("e", flow.e), ("v", flow.v))
    }
    edges = np.repeat(straight.times[1:, None], stepper.system.lanes, axis=1)
    return Chain(edges=edges, x=x[:done], error=error, end=end, **recorded)


def _stepwise(part: Array, count: int) -> Array:
    """Return arrays (lanes, K · N, ·) as (lanes, K, N, ·)."""
    return part.reshape(len(part), count, part.shape[1] // count, part.shape[2])


def _lanes(stepper: Stepper, board: Switchboard, straight: Lines, path: Real) -> Array:
    """Return starts and stages (lanes, K, s + 1, n) with their infinitesimals."""
    system, method, x = stepper.system, stepper.short, path[:, 1:]
    count, s, n = x.shape
    lanes = system.lanes
    whole = np.broadcast_to(x, (lanes, count, s, n)).astype(complex)
    f = system.flow(straight.at(method.points, whole, board.modes)).f.reshape(lanes, count, s, n)
    residual = (straight.widths[:, None, None] * (method.a @ f)).imag
    at = straight.at(method.points, x[None], board.modes)
    scale = np.where(stepper.scale > 0, stepper.scale, 1.0)
    slope = stepper.real.tangent(at).total.reshape(count, s, n, n) * (scale / scale[:, None])
    moved = _correction(slope, residual / scale, board.x.imag / scale, straight.widths, method.a) * scale
    found = np.empty((lanes, count, s + 1, n), dtype=complex)
    found[:, :, 1:] = x + 1j * moved
    found[:, 0, 0] = board.x
    found[:, 1:, 0] = found[:, :-1, -1]
    return found


def _correction(slope: Real, residual: Real, begin: Real, widths: Real, a: Real) -> Real:
    """Return the corrections (lanes, K, s, n) of a chain of steps whose first start moves by ``begin`` (lanes, n)."""
    lanes, count, s, n = residual.shape
    matrix = np.einsum("k,ij,kjab->kiajb", -widths, a, slope).reshape(count, s * n, s * n)
    matrix[:, np.arange(s * n), np.arange(s * n)] += 1.0
    right = np.empty((count, s * n, lanes + n))
    right[:, :, :lanes] = residual.reshape(lanes, count, s * n).transpose(1, 2, 0)
    right[:, :, lanes:] = np.tile(np.eye(n), (s, 1))
    solved = np.linalg.solve(matrix, right)
    moved = np.empty((count, n, lanes))
    start = begin.T
    for k in range(count):
        moved[k] = start
        start = solved[k, -n:, :lanes] + solved[k, -n:, lanes:] @ start
    found = solved[:, :, :lanes] + solved[:, :, lanes:] @ moved
    return np.asarray(found.transpose(2, 0, 1).reshape(lanes, count, s, n))
