"""One step of a nonlinear response: solved, judged, and carried over to the infinitesimals of its parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from engine.elements._nonlinear import Mode
from engine.exact.laws.magnitudes import magnitudes
from engine.exact.laws.straight import until
from engine.exact.laws.system import Flow, Instants, NonlinearSystem
from engine.exact.nonlinear.collocation import MANY_STATES, SHORT_STAGES, STAGES, Scheme, infinitesimal, scheme, solve
from engine.exact.nonlinear.pieces import Command, Record
from engine.exact.nonlinear.switching import ROUNDING, StoppedError
from engine.exact.nonlinear.unknowns import Unknowns
from engine.exact.time.chebyshev import NODES, coefficient_matrix, differentiation_matrix, weights
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from engine.exact.laws.straight import Straight

Array = npt.NDArray[Any]
Real = npt.NDArray[np.float64]

_FEEBLE = 1e-13
_NOISE = 1e-12
_BLOWN = 1e4
_ROUGH = 1e-2
"""A polynomial that misses this part of the range of a signal on its step does not follow it."""
_MADE_OF = (("c1", "d11", "d13"), ("c2", "d21", "d23"), ("c3", "d31", "d33"))
"""What outputs, delayed signals and laws' inputs are made of; laws' outputs follow them, made of themselves."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Nodes:
    """What a step does at its Chebyshev nodes, arrays (lanes, 17, ·); ``slope`` of the laws' inputs in time.

    The first ``linear`` states belong to the linear part.
    """

    at: Instants
    flow: Flow
    y: Array
    z: Array
    slope: Array
    linear: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Step:
    """A solved step on real values.

    ``path`` (s + 1, n) holds start and stages; ``guards`` are (law, guard, values at the nodes); ``miss`` is what the
    polynomials miss in parts of the tolerance, ``error`` what the outputs miss in parts of their largest values;
    ``singular`` names a law that leaps or goes to infinity on it. A step that a linear map gave has the map, ``straight``;
    cut short, it has the ends of its path only, unless there are infinitesimals. ``heard`` (s + 1, m) are the delayed signals at
    start and stages of a step longer than a delay.
    """

    width: float
    path: Real
    command: Command
    nodes: Nodes
    guards: list[tuple[int, int, Real]]
    miss: float
    error: float
    singular: str = ""
    straight: Straight | None = None
    heard: Real | None = None

    def slope_of(self, guard: int, theta: float) -> float:
        """Return the slope in time of a guard at ``theta`` of the step."""
        slope = differentiation_matrix() @ self.guards[guard][2] / self.width
        return float(weights(np.asarray(theta)) @ slope)


class Stepper:
    """Solves steps of one system, and remembers how large its signals are.

    Parameters
    ----------
    system : NonlinearSystem
    record : Record
        What the delays look back at.
    tolerance : float
        What the polynomial of a step may miss, relative to the largest value of each state so far.
    """

    share = 0.02
    """Coefficients of an output are cheaper to miss than those of a state, which feed back."""

    def __init__(self, system: NonlinearSystem, record: Record, tolerance: float) -> None:
        self.system, self.real = system, system.value
        self.record, self.tolerance = record, tolerance
        self.method = scheme(STAGES if system.states <= MANY_STATES else SHORT_STAGES)
        self.short = scheme(SHORT_STAGES)
        self.scale = np.zeros(system.states)
        m = {name: np.abs(matrix[0]) for name, matrix in self.real.matrices.items()}
        rows = [np.concatenate([m[name] for name in of], axis=1) for of in _MADE_OF]
        own = rows[0].shape[1]
        rows.append(np.eye(own)[own - m["d13"].shape[1] :])
        self._made_of = np.concatenate(rows)
        ends = np.cumsum([0, *(len(part) for part in rows)])
        self._groups = [slice(*pair) for pair in pairwise(ends) if pair[1] > pair[0]]
        self._laws, self._entering = slice(int(ends[-3]), int(ends[-2])), slice(int(ends[1]), int(ends[2]))
        self._parts, self._sums = np.zeros(self._made_of.shape[1]), np.zeros(len(self._made_of))
        self._last: tuple[Real, Real | None, float] | None = None

    @property
    def order(self) -> int:
        """What a step misses falls with its width to this power."""
        return len(self.method.points)

    def forget(self) -> None:
        """Begin the next step without the last one's polynomial as a guess."""
        self._last = None

    def delayed(self, times: Array) -> Array:
        """Return the delayed signals on a step, (lanes, N, m); at its ends those inside it count."""
        if not self.system.delays.shape[-1]:
            return np.zeros((*times.shape, 0))
        real = times[0].real
        return self.record.delayed(times, self.system.delays, later=real < 0.5 * (real[0] + real[-1]))

    def attempt(self, start: Real, drive: Command, modes: Sequence[Mode]) -> Step | None:
        """Return a step from the state ``start`` (n,), None where it cannot be solved.

        Raises
        ------
        EngineError, numpy.linalg.LinAlgError, ArithmeticError
            Where the equations themselves fail on it.
        """
        n, begin, width = len(start), np.array([drive.start]), np.array([drive.width])
        step = Unknowns(
            self.real,
            drive,
            modes,
            start=start[None],
            begin=begin,
            width=width,
            method=self.method,
            delayed=self.delayed,
        )
        known = step.known[0]
        scale = self._sizes(known, len(start))
        stages = solve(
            lambda y: step.g(y[None])[0], lambda y: step.slope(y[None]), step.sums, known=known,
            guess=self._guess(known, drive.width), scale=scale,
        )  # fmt: skip
        if stages is None:
            return None
        heard = step.heard(stages[None])
        path = np.concatenate([start[None], stages[:, :n]])
        return self.judge(path, None if heard is None else heard[0], drive, modes)

    def _sizes(self, known: Real, n: int) -> Real:
        """Return how large the unknowns of a step are, of which so many are states."""
        states = np.maximum(self.scale, np.abs(known[0, :n]))
        heard = np.maximum(self._sums[self._entering], np.abs(known[:, n:]).max(axis=0)) if known.shape[1] > n else ()
        sizes = np.concatenate([np.maximum(part, 1e-12 * np.max(part, initial=0.0)) for part in (states, heard)])
        sizes[sizes == 0] = 1.0
        return sizes

    def _guess(self, known: Real, width: float) -> Real:
        """Return the last step's polynomials gone on, where they are those of all unknowns."""
        if self._last is None or width > 1.5 * self._last[2]:
            return known.copy()
        path, heard, old = self._last
        if heard is not None:
            path = np.concatenate([path, heard], axis=1)
        ahead = self.method.at(1 + self.method.points * width / old) @ path[:, : known.shape[1]]
        return np.concatenate([ahead, known[:, ahead.shape[1] :]], axis=1)

    def leap(self, start: Real, drive: Command, modes: Sequence[Mode], straight: Straight) -> Step:
        """Return a step of a system that is a linear map in these modes."""
        path, table = straight.step(start, drive.values, drive.width, self.method)
        nodes = self._leapt(table, drive, modes, straight)
        return self._judged(path, nodes, drive, straight, states=self._missed_states(path, nodes, drive.width))

    def _leapt(self, table: Real, drive: Command, modes: Sequence[Mode], straight: Straight) -> Nodes:
        """Return the nodes whose [x; f; z; e; v; y] are a table (17, ·)."""
        rows = straight.map.rows
        x, f, _, into, out, y = np.split(table[None], np.cumsum([rows[0], *rows[:-1]]), axis=-1)
        times = (drive.start + drive.width * NODES)[None]
        slope = self.quiet(differentiation_matrix() @ into / drive.width, into, np.array([drive.width]))
        u, none = drive.values[None], np.zeros((1, len(NODES), 0))
        at = Instants(t=times, x=x, u=u, du=none, w=none, modes=modes)
        return Nodes(at=at, flow=Flow(f=f, e=into, v=out), y=y, z=none, slope=slope, linear=self.real.linear_states)

    def blown(self, step: Step, theta: float) -> bool:
        """Return whether a state grows so much on a step that rounding is seen in what it was at ``theta``."""
        there = np.abs(self.method.at(np.array([theta])) @ step.path)[0] if len(step.path) > 2 else 0.0
        known = np.maximum(np.maximum(self.scale, np.abs(step.path[0])), there)
        return bool(np.any(np.abs(step.path).max(axis=0, initial=0.0) > _BLOWN * known))

    def cut(self, step: Step, theta: float, drive: Command) -> Step:
        """Return the part of a step before ``theta``; ``drive`` is the command on it."""
        if step.straight is not None:
            return self._cut_leap(step, theta, drive, step.straight)
        part = self.method.at(theta * np.concatenate([[0.0], self.method.points]))
        path, heard = part @ step.path, step.heard
        path[0] = step.path[0]
        if heard is not None:
            longer = drive.width > float(self.real.delays.min())
            heard = np.concatenate([heard[:1], part[1:] @ heard]) if longer else None
        return self.judge(path, heard, drive, step.nodes.at.modes)

    def _cut_leap(self, step: Step, theta: float, drive: Command, straight: Straight) -> Step:
        nodes = step.nodes
        table = np.concatenate([nodes.at.x, nodes.flow.f, nodes.flow.e, nodes.flow.v, nodes.y], axis=2)[0]
        part, still = until(theta) @ table, straight.still
        part = np.where((table == table[0]).all(axis=0), table[0], part)  # a level stays that level, without rounding
        part[:, still] = step.path[0, still]
        part[0] = table[0]
        path = np.zeros_like(step.path)
        if self.system.complex:
            path = self.method.at(theta * np.concatenate([[0.0], self.method.points])) @ step.path
            path[:, still] = step.path[0, still]
        path[0], path[-1] = step.path[0], part[-1, : path.shape[1]]
        kept = self._leapt(part, drive, nodes.at.modes, straight)
        if self.system.complex:
            return self._judged(path, kept, drive, straight, states=step.error)
        return replace(step, width=drive.width, path=path, command=drive, nodes=kept)  # no worse than the whole

    def judge(self, path: Real, heard: Real | None, drive: Command, modes: Sequence[Mode]) -> Step:
        """Return the step whose start and stages are ``path``, with the delayed signals ``heard`` on one longer than a delay."""
        times = (drive.start + drive.width * NODES)[None]
        nodes = self._nodes(path[None], None if heard is None else heard[None], times, drive, modes)
        states = self._missed_states(path, nodes, drive.width)
        return replace(self._judged(path, nodes, drive, None, states=states), heard=heard)

    def _judged(self, path: Real, nodes: Nodes, drive: Command, straight: Straight | None, *, states: float) -> Step:
        """Return the step; ``states`` is what its polynomials miss of the states."""
        modes = nodes.at.modes
        guards: list[tuple[int, int, Real]] = []
        for number, law in enumerate(self.real.laws):
            seen = self.real.seen(number, nodes.at, nodes.flow.e, nodes.flow.v, nodes.slope)
            found = law.element.guards(seen, modes[number], law.real)
            guards.extend((number, k, _row(g)) for k, g in enumerate(found))
        parts, sums = _watched(nodes)
        missed = self._missed_sums(parts, sums, modes)
        worst, singular = self._worst(states, missed), ""
        if self.tolerance < worst < math.inf:
            singular = self._singular(nodes)
        if self.tolerance < worst < math.inf and not singular:  # perhaps no more than rounding leaves of large parts
            rates, outputs = magnitudes(self.real, nodes.at, nodes.flow)
            states = min(states, self._missed_states(path, nodes, drive.width, rates))
            parts = np.concatenate([parts[:, : -outputs.shape[1] or None], outputs], axis=1)
            missed = np.minimum(missed, self._missed_sums(parts, sums, modes))
            worst = self._worst(states, missed)
        seen_of_it = float(np.max(missed[: nodes.y.shape[2]], initial=0.0))
        return Step(
            width=drive.width, path=path, command=drive, nodes=nodes, guards=guards, error=max(states, seen_of_it),
            miss=worst / self.tolerance, singular=singular, straight=straight,
        )  # fmt: skip

    def _worst(self, states: float, missed: Real) -> float:
        """Return what counts of all that is missed; infinity where something has no value."""
        worst = np.maximum(states, self.share * np.max(missed, initial=0.0))
        return float(worst) if np.isfinite(worst) else math.inf

    def _singular(self, nodes: Nodes) -> str:
        """Name the law that leaps or goes to infinity on a step: an output is far less resolved than what it is made of.

        Such a step must be shortened. Next to a pole the rounding of the inputs would excuse any value of the law.
        What a law holds is not made of its inputs alone.
        """
        e, v, x = (_rough(part[0].real) for part in (nodes.flow.e, nodes.flow.v, nodes.at.x))
        v[[output for output, _ in self.system.holds(nodes.at.modes)]] = 0.0
        for law in self.real.laws:
            given = max(float(np.max(e[law.inputs], initial=0.0)), float(np.max(x[law.states], initial=0.0)))
            if float(np.max(v[law.outputs], initial=0.0)) > max(_ROUGH, 4.0 * given):
                return law.label
        return ""

    def _missed_states(self, path: Real, nodes: Nodes, width: float, rates: Real | None = None) -> float:
        """Return what the polynomials miss of the states; ``rates`` (17, n) says how large what these follow from is."""
        f = nodes.flow.f if rates is None else rates[None]
        return float(self.missed_by(path[None], nodes.at.x, f, np.array([width]), self.method)[0])

    def _missed_sums(self, parts: Real, sums: Real, modes: Sequence[Mode]) -> Real:
        """Return what the polynomials miss of outputs, delayed signals, laws' inputs and held outputs, relative to their loudness."""
        loud = self.loudness(np.abs(parts).max(axis=0, initial=0.0), np.abs(sums).max(axis=0, initial=0.0))
        return self.heard(np.abs(coefficient_matrix()[-2:] @ sums).sum(axis=0) / loud, modes)

    def heard(self, missed: Real, modes: Sequence[Mode]) -> Real:
        """Return what is missed, (..., sums), with 0 for those laws' outputs that no guard looks at: all but the held ones."""
        deaf = np.ones(missed.shape[-1], dtype=bool)
        deaf[: self._laws.stop] = False
        deaf[[self._laws.stop + output for output, _ in self.system.holds(modes)]] = False
        return np.where(deaf, 0.0, missed)

    def missed_by(self, path: Real, x: Real, f: Real, widths: Real, method: Scheme) -> Real:
        """Return what the polynomials of K steps miss of their states, (K,), relative to the largest values.

        Starts and stages ``path`` (K, s + 1, n), states and rates at the nodes (K, 17, n).
        """
        if not path.shape[2]:
            return np.zeros(len(path))
        largest = np.abs(x).max(axis=1)
        floor = ROUNDING * (largest + widths[:, None] * np.abs(f).max(axis=1)) / self.tolerance
        size = np.maximum(np.maximum(self.scale, largest), floor)
        size = np.maximum(size, _FEEBLE * size.max(axis=1, keepdims=True))
        missed = np.abs(method.tail @ path).sum(axis=1)
        return np.asarray(np.max(missed / np.where(size > 0, size, 1.0), axis=1))

    def noise(self) -> Real:
        """Return what rounding makes of the laws' inputs, (channels,)."""
        return np.asarray(ROUNDING * (self._made_of[self._laws] @ self._parts))

    def loudness(self, parts: Real, sums: Real) -> Real:
        """Return how large outputs, delayed signals and laws' inputs count, now that all are as large as this.

        A difference of large signals is not known better than they are; ``parts`` and ``sums`` as in `remember`.
        """
        terms = self._made_of @ np.maximum(self._parts, parts)
        found = np.maximum(np.maximum(self._sums, sums), ROUNDING * terms / self.tolerance)
        for group in self._groups:
            own = found[group]
            np.maximum(own, _FEEBLE * own.max(), out=own)
        found[found == 0] = 1.0
        return np.asarray(found)

    def quiet(self, slope: Array, e: Array, widths: Array) -> Array:
        """Return slopes (K, 17, channels) without what differentiation makes of rounding, which is no motion.

        Their infinitesimals are judged by themselves: a signal that stands still may do so sooner or later.
        """
        if np.iscomplexobj(slope):
            return self.quiet(slope.real, e.real, widths) + 1j * self.quiet(slope.imag, e.imag, widths)
        noise = _NOISE * np.abs(e).max(axis=1, keepdims=True) / np.abs(widths)[:, None, None]
        return np.where(np.abs(slope) <= noise, 0.0, slope)

    def accept(self, step: Step, *, whole: bool) -> None:
        """Remember how large the signals of a step are; a ``whole`` one is the guess of the next."""
        parts, sums = _watched(step.nodes)
        self.remember(step.nodes.at.x[0].real, parts, sums)
        self._last = (step.path, step.heard, step.width) if whole and step.straight is None else None

    def remember(self, x: Real, parts: Real, sums: Real) -> None:
        """Note how large states and signals are, arrays (N, ·).

        ``parts`` are linear states, inputs and laws' outputs; ``sums`` what is made of them: outputs, delayed signals, laws'
        inputs and outputs.
        """
        self.scale = np.maximum(self.scale, np.abs(x).max(axis=0, initial=0.0))
        self._parts = np.maximum(self._parts, np.abs(parts).max(axis=0, initial=0.0))
        self._sums = np.maximum(self._sums, np.abs(sums).max(axis=0, initial=0.0))

    def _nodes(self, path: Array, heard: Array | None, times: Array, drive: Command, modes: Sequence[Mode]) -> Nodes:
        system = self.system if np.iscomplexobj(path) else self.real
        u, du = drive.near(NODES, times)
        w = self.delayed(times)
        if heard is not None:
            shorter = self.real.delays[0] < drive.width
            w[..., shorter] = (self.method.to_nodes @ heard)[..., shorter]
        at = Instants(t=times, x=self.method.to_nodes @ path, u=u, du=du, w=w, modes=modes)
        flow = system.flow(at)
        y, z = system.read(at, flow.v)
        widths = times[:, -1] - times[:, 0]
        slope = self.quiet(differentiation_matrix() @ flow.e / widths[:, None, None], flow.e, widths)
        return Nodes(at=at, flow=flow, y=y, z=z, slope=slope, linear=system.linear_states)

    def quiet_slope(self, e: Array, width: float) -> Array:
        """Return the slopes in time of signals ``e`` (lanes, 17, channels) on one step."""
        return self.quiet(differentiation_matrix() @ e / width, e, np.full(len(e), np.real(width)))

    def lanes(self, step: Step, start: Array, begin: Array, end: Array) -> tuple[Array, Nodes]:
        """Return the step with its infinitesimals: start and stages (lanes, s + 1, n), and its nodes.

        Parameters
        ----------
        step : Step
        start : ndarray, shape (lanes, n)
        begin, end : ndarray, shape (lanes,)
            Its ends in time, which carry their own infinitesimals.
        """
        system, modes, real = self.system, step.nodes.at.modes, step.path[1:]
        path = np.empty((system.lanes, *step.path.shape), dtype=complex)
        path[:, 0], path[:, 1:], heard = start, real, None
        if real.shape[1] or step.heard is not None:
            own = Unknowns(
                system, step.command, modes, start=start, begin=begin, width=end - begin, method=self.method,
                delayed=self.delayed,
            )  # fmt: skip
            y = own.values(real, None if step.heard is None else step.heard[1:])
            scale = np.concatenate([self.scale, self._sums[self._entering]])[: y.shape[2]]
            moved = infinitesimal(own.slope(y), own.missed(y).imag, own.sums, np.where(scale > 0, scale, 1.0))
            if moved is None:
                raise StoppedError(Verdict.DOUBTFUL, "the derivatives of the response cannot be followed")
            y = y + 1j * moved
            path[:, 1:], heard = y[..., : real.shape[1]], own.heard(y)
        times = begin[:, None] + NODES * (end - begin)[:, None]
        return path, self._nodes(path, heard, times, step.command, modes)


def _rough(values: Real) -> Real:
    """Return what the polynomials of some signals (17, ·) miss of their ranges, (·,)."""
    ranges = np.ptp(values, axis=0)
    missed = np.abs(coefficient_matrix()[-4:] @ values).sum(axis=0)  # two alone may happen to be small
    return np.asarray(missed / np.where(ranges > 0, ranges, np.inf))


def _row(guard: Any) -> Real:
    """Return a guard at the nodes, (17,); one that is constant may be a single number."""
    known: Real = guard if np.shape(guard) == (1, len(NODES)) else np.broadcast_to(guard, (1, len(NODES)))
    row: Real = known[0]
    return row


def _watched(nodes: Nodes) -> tuple[Real, Real]:
    """Return the parts and the sums of a step at its nodes, (17, ·) each; see `Stepper.remember`."""
    parts = (nodes.at.x[0, :, : nodes.linear], nodes.at.u[0], nodes.flow.v[0])
    sums = (nodes.y[0], nodes.z[0], nodes.flow.e[0], nodes.flow.v[0])
    return np.concatenate(parts, axis=1).real, np.concatenate(sums, axis=1).real
