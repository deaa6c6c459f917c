"""The exact time response of a linear system with delays, as polynomial pieces (the method of steps).

    x' = A x + B1 u + B2 w,  w_i(t) = z_i(t - τ_i): on a segment no longer than a delay, w is already known

A first pass on the real parts places the segments: their ends fall on every instant where something jumps or kinks (the
command, and its echoes through the delays), and a segment is halved until a polynomial of degree 16 holds outputs,
delayed signals and (with delays) states to 1e-13. Where the echoes have become smooth a segment may be longer than a
delay; it is then solved together with what returns to itself. Without delays a command that is constant or linear is
followed over many equal segments at once, and so is what goes on when any command has ended. With delays what goes on then
is counted from where it will rest, once it is near: solving for a long segment leaves rounding of all that is counted, and what
is left of a transient has no room for it; from then on equal segments are many at once here, too. The lanes then replay the
same segments; an end that moves with a delay carries that delay's infinitesimal, so derivatives with respect to delays are
exact too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.exact.time.breaking import gaps
from engine.exact.time.resolution import Resolution
from engine.exact.time.run import Nodes, Propagators, Run, Segment, Trajectory
from engine.exact.time.struck import struck
from engine.model.errors import UnresolvedError

if TYPE_CHECKING:
    from engine.exact.time.origin import Origin
    from engine.model.linear_system import LaneSystem
    from engine.signals import Signal

MAX_SEGMENTS = 1_000_000
MAX_STEPS = 30_000
"""So many segments may be computed one by one: some 10 s."""

_TELLING, _HOPELESS = 1000, 3
"""So many segments in a row tell how many the rest needs; one that needs so many times :data:`MAX_STEPS` is given up at once."""

MOST_AT_ONCE = 8192
_MOST_HALVINGS = 1000


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
    system = struck(system, signals)
    if plan is None:
        placed = _place(system.value, signals, horizon, None if origin is None else origin.value)
        if system.dtype is np.float64 and system.lanes == 1:
            return placed
        plan = placed.plan
    run = Run(system, signals, sum(segment.count for segment in plan), origin)
    run.propagators = {} if propagators is None else propagators
    return run.replay(plan)


def _place(system: LaneSystem, signals: Sequence[Signal], horizon: float, origin: Origin | None) -> Trajectory:
    """Return the real response on segments placed so that it is resolved."""
    run = Run(system, signals, 64, origin)
    watch = Resolution(system)
    basis = np.concatenate([[1.0], system.delays[0].real])
    fastest = float(np.abs(np.linalg.eigvals(system.a[0].real)).max()) if system.n else 0.0
    plan: list[Segment] = []
    resting = False
    effort = _Effort(horizon, dearer := 1 + system.m / 10)  # what a step costs with many delays
    previous = np.inf if fastest == 0.0 else 4.0 / fastest
    # e^{At} is held by degree 16 to rounding on this length, whatever the coefficients of a noisy output say
    smallest = 0.25 / max(run.size, 1e-300)
    between = gaps(system, signals, horizon, int(MAX_STEPS / dearer))
    if between is None:  # each takes a step at least
        raise _unresolved("the echoes of its delays and commands have more instants", horizon)
    for a, b, apart in between:
        gap = b - a
        whole, straight = float(gap @ basis), run.strides(float(a @ basis))
        level = max(0, int(np.ceil(np.log2(whole / previous)))) if previous < whole else 0
        effort.begin()
        # a trial of twice the width that fails is not repeated soon: it would be most of the work
        position, most, waiting, patience, trial = 0.0, 1, 0, 1, False
        while position < 1.0:
            width = 0.5**level
            segment = Segment(
                start=a + position * gap, width=gap * width, key=(tuple(gap), level), resting=resting,
                apart=apart if position == 0.0 else None,
            )  # fmt: skip
            if most > 1 and (straight or run.repeats(segment)):
                segment = replace(segment, count=min(round((1.0 - position) / width), most))
            nodes = run.step(segment)
            good, roomy = _held(
                run, watch, segment, nodes, straight=straight, surely=straight and width * whole <= smallest
            )
            if not good:
                if level > _MOST_HALVINGS:
                    raise _unresolved("some of it is held by no segment, however short", horizon)
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
            run.append(replace(segment, count=good), nodes)
            plan.append(replace(segment, count=good))
            resting = resting or _rests(run, watch, segment)
            position += good * width
            effort.add(run.count, position)
            most = min(2 * most, MOST_AT_ONCE)
            if trial:
                level, most = level - 1, 1
            previous = whole * 0.5**level
    return run.trajectory(plan)


class _Effort:
    """Steps that were computed, each so many times ``dearer``, and whether the rest of a gap can be reached with those that are left."""

    def __init__(self, horizon: float, dearer: float) -> None:
        self._horizon, self._dearer = horizon, dearer
        self._taken = self._known = 0
        self._reached = 0.0

    def begin(self) -> None:
        """Enter a gap, in which no command and no echo jumps."""
        self._known, self._reached = self._taken, 0.0

    def add(self, segments: int, position: float) -> None:
        """Count a step of a gap that leads to a position, 0 to 1, of it; the response has so many segments in all."""
        self._taken += 1
        hopeless = False
        if self._taken - self._known == _TELLING:
            hopeless = (1.0 - position) * _TELLING > _HOPELESS * MAX_STEPS * (position - self._reached)
            self._known, self._reached = self._taken, position
        if hopeless or segments > MAX_SEGMENTS or self._taken * self._dearer > MAX_STEPS:
            raise _unresolved("it is too lightly damped, too stiff or has too many delays", self._horizon)


def _held(
    run: Run, watch: Resolution, segment: Segment, nodes: Nodes, *, straight: bool, surely: bool
) -> tuple[int, npt.NDArray[np.bool_]]:
    """Return how many of the segments hold the response, and which would hold it were they twice as wide."""
    terms = partial(run.terms, segment, nodes)
    held, roomy = watch.judge(nodes.x, nodes.y, nodes.z, terms, states=not straight, resting=segment.resting)
    good = segment.count if held.all() or surely else int(held.argmin())
    return 0 if good and run.overlooks(segment, nodes) else good, roomy


def _rests(run: Run, watch: Resolution, segment: Segment) -> bool:
    """Return whether a response is counted from where it goes from the end of a segment on."""
    if not run.nears_rest(segment, watch.largest_state):
        return False
    watch.rests(*run.rest())
    return True


def _unresolved(why: str, horizon: float) -> UnresolvedError:
    return UnresolvedError(f"a response must be resolved by at most {MAX_STEPS} steps over {horizon:.3g} s, but {why}")
