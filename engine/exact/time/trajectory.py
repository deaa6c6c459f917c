"""The exact time response of a linear system with delays, as polynomial pieces (the method of steps).

    x' = A x + B1 u + B2 w,  w_i(t) = z_i(t - τ_i): on a segment no longer than a delay, w is already known

A first pass on the real parts places the segments: their ends fall on every instant where something jumps or kinks (the
command, and its echoes through the delays), and a segment is halved until a polynomial of degree 16 holds outputs,
delayed signals and (with delays) states to 1e-13. Where the echoes have become smooth a segment may be longer than a
delay; it is then solved together with what returns to itself. Without delays a command that is constant or linear is
followed over many equal segments at once, and so is what goes on when any command has ended. The lanes then replay the
same segments; an end that moves with a delay carries that delay's infinitesimal, so derivatives with respect to delays
are exact too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from engine.exact.time.breaking import gaps
from engine.exact.time.curve import Curve
from engine.exact.time.march import March, Propagators, Segment
from engine.exact.time.resolution import Resolution
from engine.exact.time.struck import struck
from engine.model.errors import UnresolvedError

if TYPE_CHECKING:
    from engine.exact.time.origin import Origin
    from engine.model.linear_system import Array, LaneSystem
    from engine.signals import Signal

MAX_SEGMENTS = 1_000_000
MAX_STEPS = 30_000
"""So many segments may be computed one by one: some 10 s."""

MOST_AT_ONCE = 8192


@dataclass(kw_only=True, eq=False)
class Trajectory:
    """Inputs and outputs on the pieces of one response.

    Shapes: ``edges`` (pieces + 1, lanes); ``u`` (pieces, N + 1, lanes, inputs), ``y`` (pieces, N + 1, lanes, outputs).
    """

    edges: Array
    u: Array
    y: Array
    plan: list[Segment] = field(repr=False)
    propagators: Propagators = field(repr=False, default_factory=dict)

    def output(self, index: int) -> Curve:
        """Return output ``index`` as a curve."""
        return Curve(edges=self.edges, values=self.y[..., index])

    def input(self, index: int) -> Curve:
        """Return input ``index`` as a curve."""
        return Curve(edges=self.edges, values=self.u[..., index])


def respond(
    system: LaneSystem,
    signals: Sequence[Signal],
    horizon: float,
    *,
    plan: list[Segment] | None = None,
    propagators: Propagators | None = None,
    origin: Origin | None = None,
) -> Trajectory:
    """Return the response to ``signals`` from t = 0 to ``horizon``.

    Parameters
    ----------
    system : LaneSystem
        All lanes share the real part.
    signals : sequence of Signal
        One for each input, in order.
    horizon : float
        End of the response, s.
    plan : list, optional
        Segments of an earlier response of the same real system; placed anew when absent.
    propagators : dict, optional
        Those of an earlier response of the very same system, which need not be made again.
    origin : Origin, optional
        Equations at rest, from which everything is counted, outputs as well; 0 where absent.

    Raises
    ------
    SignalError
        When an impulse goes straight to an output or into a delay.
    UnresolvedError
        When more than :data:`MAX_SEGMENTS` segments would be needed (a very lightly damped or very stiff system).
    """
    if plan is None:
        return Response(system, signals, origin=origin).to(horizon)
    march = March(struck(system, signals), signals, sum(segment.count for segment in plan), origin)
    march.propagators = {} if propagators is None else propagators
    for segment in plan:
        march.append(segment, march.step(segment))
    return _trajectory(march, plan)


class Response:
    """A response that can be followed further: what is known of it already is not computed again.

    Parameters and errors are those of :func:`respond`.
    """

    def __init__(self, system: LaneSystem, signals: Sequence[Signal], *, origin: Origin | None = None) -> None:
        system = struck(system, signals)
        self._real, self._signals = system.value, signals
        self._march = March(self._real, signals, 64, None if origin is None else origin.value)
        plain = system.dtype is np.float64 and system.lanes == 1
        self._lanes = None if plain else March(system, signals, 64, origin)
        self._watch = Resolution(self._real)
        self._basis = np.concatenate([[1.0], self._real.delays[0].real])
        fastest = float(np.abs(np.linalg.eigvals(self._real.a[0].real)).max()) if self._real.n else 0.0
        self._width = np.inf if fastest == 0.0 else 4.0 / fastest  # of the last segment, s
        # e^{At} is held by degree 16 to rounding on this length, whatever the coefficients of a noisy output say
        self._smallest = 0.25 / max(self._march.size, 1e-300)
        self._dearer = 1 + self._real.m / 10  # what a step costs with many delays
        self._plan: list[Segment] = []
        self._end = 0.0

    def to(self, horizon: float) -> Trajectory:
        """Return the response from t = 0 to ``horizon``, s, which must not come before that of the call before."""
        known = len(self._plan)
        for a, b in self._gaps(horizon):
            self._cross(a, b, horizon)
        self._end = horizon
        plan = list(self._plan)
        if self._lanes is None:
            return _trajectory(self._march, plan)
        self._lanes.reserve(self._march.count)
        for segment in plan[known:]:
            self._lanes.append(segment, self._lanes.step(segment))
        return _trajectory(self._lanes, plan)

    def _gaps(self, horizon: float) -> list[tuple[Array, Array]]:
        """Return the intervals between breaking points that are still to be crossed."""
        between = gaps(self._real, self._signals, horizon, int(MAX_STEPS / self._dearer))
        if between is None:  # each takes a step at least
            raise _unresolved("the echoes of its delays and commands have more instants", horizon)
        here = np.zeros_like(self._basis)
        here[0] = self._end
        ahead = [(a, b) for a, b in between if float(b @ self._basis) - self._end > 1e-12 * horizon]
        return [(a if float(a @ self._basis) >= self._end else here, b) for a, b in ahead]

    def _cross(self, a: Array, b: Array, horizon: float) -> None:
        """Place the segments between two breaking points so that everything is resolved."""
        march, watch = self._march, self._watch
        gap = b - a
        whole, straight = float(gap @ self._basis), march.strides(float(a @ self._basis))
        level = max(0, int(np.ceil(np.log2(whole / self._width)))) if self._width < whole else 0
        position, most = 0.0, 1
        # a trial of twice the width that fails is not repeated soon: it would be most of the work
        waiting, patience, trial = 0, 1, False
        while position < 1.0:
            width = 0.5**level
            count = min(round((1.0 - position) / width), most) if straight else 1
            segment = Segment(start=a + position * gap, width=gap * width, key=(tuple(gap), level), count=count)
            nodes = march.step(segment)
            held, roomy = watch.judge(
                nodes.x, nodes.y, nodes.z, partial(march.terms, segment, nodes), states=not straight
            )
            good = count if held.all() or (straight and width * whole <= self._smallest) else int(held.argmin())
            good = 0 if good and march.overlooks(segment, nodes) else good
            if not good:
                level, most = level + 1, 1
                waiting, patience = (4 * patience, 4 * patience) if trial else (waiting, patience)
                trial = False
                continue
            if trial:
                patience = 1
            # twice the width fits where the segments behind it begin at an even place
            place = np.arange(1, good + 1)
            grows = roomy[:good] & ((position / width + place) % 2 == 0) & (place > waiting) & (level > 0)
            trial = bool(grows.any())
            if trial:
                good = int(grows.argmax()) + 1
            waiting = max(0, waiting - good)
            watch.accept(good)
            march.append(replace(segment, count=good), nodes)
            self._plan.append(replace(segment, count=good))
            if march.count > MAX_SEGMENTS or len(self._plan) * self._dearer > MAX_STEPS:
                raise _unresolved("it is too lightly damped, too stiff or has too many delays", horizon)
            position += good * width
            most = min(2 * most, MOST_AT_ONCE)
            if trial:
                level, most = level - 1, 1
            self._width = whole * 0.5**level


def _trajectory(march: March, plan: list[Segment]) -> Trajectory:
    k = march.count
    return Trajectory(
        edges=march.edges[: k + 1], u=march.u[:k], y=march.y[:k], plan=plan, propagators=march.propagators
    )


def _unresolved(why: str, horizon: float) -> UnresolvedError:
    return UnresolvedError(f"a response must be resolved by at most {MAX_STEPS} steps over {horizon:.3g} s, but {why}")
