"""One step of a nonlinear response: solved, judged, and carried over to the infinitesimals of its parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from engine.elements._nonlinear import Mode
from engine.errors import EngineError
from engine.linear.chebyshev import NODES, differentiation_matrix, tail, weights
from engine.nonlinear.collocation import MANY_STATES, SHORT_STAGES, STAGES, Scheme, infinitesimal, scheme, solve
from engine.nonlinear.pieces import Command, Record
from engine.nonlinear.switching import StoppedError
from engine.nonlinear.system import Flow, Instants, NonlinearSystem
from engine.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

Array = npt.NDArray[Any]
Real = npt.NDArray[np.float64]

_ROUNDING = 30 * 2.3e-16
_FEEBLE = 1e-13
_NOISE = 1e-12


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
    polynomials miss in parts of the tolerance, ``error`` what the outputs miss in parts of their largest values.
    """

    width: float
    path: Real
    command: Command
    nodes: Nodes
    guards: list[tuple[int, int, Real]]
    miss: float
    error: float

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
        self._largest: dict[str, Real] = {}
        parts = {"y": ("c1", "d11", "d13"), "z": ("c2", "d21", "d23"), "e": ("c3", "d31", "d33")}
        self._rows = {name: [np.abs(self.real.matrices[m][0]) for m in of] for name, of in parts.items()}
        self._last: tuple[Real, float] | None = None

    def forget(self) -> None:
        """Begin the next step without the last one's polynomial as a guess."""
        self._last = None

    def delayed(self, times: Array) -> Array:
        """Return the delayed signals on a step, (lanes, N, m)."""
        if not self.system.delays.shape[-1]:
            return np.zeros((*times.shape, 0))
        delays = self.system.delays if np.iscomplexobj(times) else self.system.delays[:1].real
        found = self.record.delayed(times, delays, later=False)
        return found if np.iscomplexobj(times) else found[:1].real

    def attempt(self, start: Real, drive: Command, modes: Sequence[Mode]) -> Step | None:
        """Return a step from the state ``start`` (n,), None where it cannot be solved."""
        real, points, width = self.real, self.method.points, drive.width
        times = (drive.start + width * points)[None]
        u, du = (part[None] for part in drive.at(points))
        w = self.delayed(times)

        def instants(x: Real) -> Instants:
            return Instants(t=times, x=x[None], u=u, du=du, w=w, modes=modes)

        scale = np.maximum(self.scale, np.abs(start))
        scale = np.maximum(scale, 1e-12 * scale.max(initial=0.0))
        scale[scale == 0] = 1.0
        try:
            stages = solve(
                lambda x: np.asarray(real.flow(instants(x)).f[0]),
                lambda x: real.tangent(instants(x)).total,
                start=start,
                guess=self._guess(start, width),
                width=width,
                method=self.method,
                scale=scale,
            )
            if stages is None:
                return None
            return self.judge(np.concatenate([start[None], stages]), drive, modes)
        except (np.linalg.LinAlgError, EngineError):
            return None

    def _guess(self, start: Real, width: float) -> Real:
        if self._last is not None and width <= 1.5 * self._last[1]:
            path, old = self._last
            return np.asarray(self.method.at(1 + self.method.points * width / old) @ path)
        return np.repeat(start[None], len(self.method.points), axis=0)

    def cut(self, step: Step, theta: float, drive: Command) -> Step:
        """Return the part of a step before ``theta``; ``drive`` is the command on it."""
        path = self.method.at(theta * np.concatenate([[0.0], self.method.points])) @ step.path
        path[0] = step.path[0]
        return self.judge(path, drive, step.nodes.at.modes)

    def judge(self, path: Real, drive: Command, modes: Sequence[Mode]) -> Step:
        """Return the step whose start and stages are ``path``."""
        times = (drive.start + drive.width * NODES)[None]
        nodes = self._nodes(self.real, path[None], times, drive, modes)
        guards: list[tuple[int, int, Real]] = []
        for number, law in enumerate(self.real.laws):
            seen = self.real.seen(number, nodes.at, nodes.flow.e, nodes.flow.v, nodes.slope)
            found = law.element.guards(seen, modes[number], law.real)
            guards.extend((number, k, np.broadcast_to(g, (1, len(NODES)))[0]) for k, g in enumerate(found))
        states = self._missed_states(path, nodes, drive.width)
        watched = _watched(nodes)
        loud = self.loudness({name: np.abs(values).max(axis=0) for name, values in watched.items()})
        signals = {name: float(np.max(tail(watched[name]) / loud[name], initial=0.0)) for name in ("e", "y", "z")}
        worst = max(states, *(self.share * missed for missed in signals.values()))
        return Step(
            width=drive.width, path=path, command=drive, nodes=nodes, guards=guards, error=max(states, signals["y"]),
            miss=worst / self.tolerance if math.isfinite(worst) else math.inf,
        )  # fmt: skip

    def _missed_states(self, path: Real, nodes: Nodes, width: float) -> float:
        return float(self.missed_by(path[None], nodes.at.x, nodes.flow.f, np.array([width]), self.method)[0])

    def missed_by(self, path: Real, x: Real, f: Real, widths: Real, method: Scheme) -> Real:
        """Return what the polynomials of K steps miss of their states, (K,), relative to the largest values.

        Starts and stages ``path`` (K, s + 1, n), states and rates at the nodes (K, 17, n).
        """
        if not path.shape[2]:
            return np.zeros(len(path))
        largest = np.abs(x).max(axis=1)
        floor = _ROUNDING * (largest + widths[:, None] * np.abs(f).max(axis=1)) / self.tolerance
        size = np.maximum(np.maximum(self.scale, largest), floor)
        size = np.maximum(size, _FEEBLE * size.max(axis=1, keepdims=True))
        missed = np.abs(method.tail @ path).sum(axis=1)
        return np.asarray(np.max(missed / np.where(size > 0, size, 1.0), axis=1))

    def noise(self) -> Real:
        """Return what rounding makes of the laws' inputs, (channels,)."""
        of_states, of_inputs, of_laws = self._rows["e"]
        terms = of_states @ self._largest["x"] + of_inputs @ self._largest["u"] + of_laws @ self._largest["v"]
        return np.asarray(_ROUNDING * terms)

    def loudness(self, largest: Mapping[str, Real]) -> dict[str, Real]:
        """Return how large laws' inputs, outputs and delayed signals are, now that all are as large as ``largest``.

        A difference of large signals is not known better than they are.
        """
        size = {name: np.maximum(self._largest.get(name, 0.0), values) for name, values in largest.items()}
        found = {}
        for name, (of_states, of_inputs, of_laws) in self._rows.items():
            terms = of_states @ size["x"] + of_inputs @ size["u"] + of_laws @ size["v"]
            own = np.maximum(size[name], _ROUNDING * terms / self.tolerance)
            own = np.maximum(own, _FEEBLE * own.max(initial=0.0))
            found[name] = np.where(own > 0, own, 1.0)
        return found

    def quiet(self, slope: Array, e: Array, widths: Array) -> Array:
        """Return slopes (K, 17, channels) without what differentiation makes of rounding, which is no motion."""
        noise = _NOISE * np.abs(e).max(axis=1, keepdims=True) / np.abs(widths)[:, None, None]
        return np.where(np.abs(slope) <= noise, 0.0, slope)

    def accept(self, step: Step, *, whole: bool) -> None:
        """Remember how large the signals of a step are; a ``whole`` one is the guess of the next."""
        self.remember(step.nodes.at.x[0].real, _watched(step.nodes))
        self._last = (step.path, step.width) if whole else None

    def remember(self, x: Real, signals: Mapping[str, Real]) -> None:
        """Note how large states and signals are, arrays (N, ·)."""
        self.scale = np.maximum(self.scale, np.abs(x).max(axis=0, initial=0.0))
        for name, values in signals.items():
            self._largest[name] = np.maximum(self._largest.get(name, 0.0), np.abs(values).max(axis=0, initial=0.0))

    def _nodes(
        self, system: NonlinearSystem, path: Array, times: Array, drive: Command, modes: Sequence[Mode]
    ) -> Nodes:
        u, du = drive.near(NODES, times)
        at = Instants(t=times, x=self.method.to_nodes @ path, u=u, du=du, w=self.delayed(times), modes=modes)
        flow = system.flow(at)
        y, z = system.read(at, flow.v)
        widths = times[:, -1] - times[:, 0]
        slope = self.quiet(differentiation_matrix() @ flow.e / widths[:, None, None], flow.e, widths)
        return Nodes(at=at, flow=flow, y=y, z=z, slope=slope, linear=system.linear_states)

    def quiet_slope(self, e: Array, width: float) -> Array:
        """Return the slopes in time of signals ``e`` (lanes, 17, channels) on one step."""
        return self.quiet(differentiation_matrix() @ e / width, e, np.full(len(e), width))

    def lanes(self, step: Step, start: Array, begin: Array, end: Array) -> tuple[Array, Nodes]:
        """Return the step with its infinitesimals: start and stages (lanes, s + 1, n), and its nodes.

        Parameters
        ----------
        step : Step
        start : ndarray, shape (lanes, n)
        begin, end : ndarray, shape (lanes,)
            Its ends in time, which carry their own infinitesimals.
        """
        real, points = step.path[1:], self.method.points
        path = np.empty((self.system.lanes, len(real) + 1, real.shape[1]), dtype=complex)
        path[:, 0], path[:, 1:] = start, real
        modes = step.nodes.at.modes
        width = end - begin
        if real.shape[1]:
            times = begin[:, None] + points * width[:, None]
            u, du = step.command.near(points, times)
            at = Instants(t=times, x=path[:, 1:], u=u, du=du, w=self.delayed(times), modes=modes)
            residual = start[:, None] + width[:, None, None] * (self.method.a @ self.system.flow(at).f)
            slope = self.real.tangent(at.real).total
            scale = np.where(self.scale > 0, self.scale, 1.0)
            moved = infinitesimal(slope, residual.imag, step.width, self.method, scale)
            if moved is None:
                raise StoppedError(Verdict.DOUBTFUL, "the derivatives of the response cannot be followed")
            path[:, 1:] = real + 1j * moved
        return path, self._nodes(self.system, path, begin[:, None] + NODES * width[:, None], step.command, modes)


def _watched(nodes: Nodes) -> dict[str, Real]:
    return {
        "e": nodes.flow.e[0].real, "y": nodes.y[0].real, "z": nodes.z[0].real, "v": nodes.flow.v[0].real,
        "u": nodes.at.u[0].real, "x": nodes.at.x[0, :, : nodes.linear].real,
    }  # fmt: skip
