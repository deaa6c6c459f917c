"""What a nonlinear system does under its commands, followed until it settles, and where each output settles.

A response has settled where the state of rest under the final commands is what the outputs approach; that state gives
their final values exactly. Where there is none (a position that runs on), an output that has stopped moving is final. What moves at
a constant rate is an integrator only if it does so for ever: a drive at its limit, on its way to a target, is followed until it arrives.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.nonlinear.integrate import Integration
from engine.nonlinear.operating_point import operating_point
from engine.nonlinear.outcome import Outcome
from engine.nonlinear.running_on import Motion, motion
from engine.nonlinear.switching import StoppedError
from engine.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Callable

    from engine.linear.curve import Curve
    from engine.nonlinear.system import NonlinearSystem
    from engine.signals import Signal

Array = npt.NDArray[Any]

WALL_LIMIT: Final = 30.0
"""A simulation that takes longer to compute ends here, s."""
EXTENSIONS: Final = 5
"""A response of free length that has not settled is followed twice as long, so many times."""

_NEAR = 1e-3
"""The last tenth of a curve within this part of its range of the state of rest approaches it."""
_SAME = 1e-3
_STILL = 1e-6
"""An output whose last tenth moves by no more than this part of its range has stopped: far within every settling band."""
_STEADY = 1e-6
_ROUNDING = 1e-14
_MOST_EXTENSIONS = 20
"""So many doublings are the end also for what is on its way, where a step may be as long as it likes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Response:
    """A response with what is known of its end.

    ``verdicts`` and ``finals`` (lanes,) by output; a final value is None where the commands or the output do not settle.
    """

    outcome: Outcome
    outputs: tuple[str, ...]
    verdicts: Mapping[str, Verdict]
    finals: Mapping[str, Array | None]
    initials: Mapping[str, Array]
    on_its_way: bool = False
    """Whether an output moves at a constant rate that it will not keep."""

    @property
    def settled(self) -> bool:
        """Whether all outputs have come to their end."""
        return all(v in {Verdict.OK, Verdict.INTEGRATING} for v in self.verdicts.values())

    def output(self, name: str) -> Curve:
        """Return an output as a curve."""
        return self.outcome.output(self.outputs.index(name))

    def limits(self, name: str) -> tuple[float, float]:
        """Return what an output never leaves."""
        index = self.outputs.index(name)
        return float(self.outcome.limits[0][index]), float(self.outcome.limits[1][index])


def respond(
    system: NonlinearSystem,
    signals: Mapping[str, Signal],
    duration: float | None,
    pace: float,
    *,
    clock: Callable[[], float] = time.monotonic,
    wall_limit: float = WALL_LIMIT,
) -> Response:
    """Return the response to ``signals``.

    Parameters
    ----------
    system : NonlinearSystem
    signals : mapping of input name to Signal
        Inputs left out are 0.
    duration : float or None
        End of the simulation, s; None to follow it until it settles.
    pace : float
        First guess of the time (s) after the last change of the commands until nothing moves any more.
    clock, wall_limit : callable, float
        The computation ends, with a verdict, when ``clock`` has gone on by ``wall_limit`` seconds.
    """
    run = Integration(system, signals, clock=clock, wall_limit=wall_limit)
    initials = _initials(system)
    last = max((t for s in signals.values() for t in (*s.breakpoints(), s.end() or 0.0)), default=0.0)
    if duration is not None:
        outcome = run.advance(duration)
        return _judged(system, signals, outcome, initials=initials, last=last, unsettled=Verdict.NOT_SETTLED)
    periods = max((s.repeats_after() or 0.0 for s in signals.values()), default=0.0)
    length = max(pace, 3 * periods, 1e-9)
    endless = any(s.final() is None for s in signals.values())
    sampled = any(law.element.period(law.values) is not None for law in system.laws)
    extension = 0
    while True:
        outcome = run.advance(last + length * 2**extension)
        response = _judged(system, signals, outcome, initials=initials, last=last, unsettled=Verdict.NOT_SETTLED)
        most = _MOST_EXTENSIONS if response.on_its_way and not sampled else EXTENSIONS
        done = endless or response.settled or outcome.verdict is not Verdict.OK or extension >= most
        if done or (not response.on_its_way and _repeats(response, last)):
            return response
        extension += 1


def _repeats(response: Response, last: float) -> bool:
    """Return whether what has not settled swings in the last quarter as it did in the one before: a limit cycle."""
    end = response.outcome.end
    for name in response.outputs:
        if response.verdicts[name] is Verdict.NOT_SETTLED:
            curve = response.output(name).since(end - 0.5 * (end - last))
            middle = end - 0.25 * (end - last)
            early = float(np.ptp(curve.until(middle).values[:, :, 0].real))
            late = float(np.ptp(curve.since(middle).values[:, :, 0].real))
            if abs(late - early) > _SAME * early:
                return False
    return True


def _initials(system: NonlinearSystem) -> dict[str, Array]:
    """Return the outputs of the initial state with all inputs 0: just before the commands begin."""
    still = Integration(system, {})
    with contextlib.suppress(StoppedError):  # laws that do not come to agree: what they have come to is the beginning
        still.rest()
    values = still.outputs()
    return {name: values[:, k] for k, name in enumerate(system.outputs)}


def _judged(
    system: NonlinearSystem,
    signals: Mapping[str, Signal],
    outcome: Outcome,
    *,
    initials: Mapping[str, Array],
    last: float,
    unsettled: Verdict,
) -> Response:
    """Return the response with its ends; ``last`` is when the commands change for the last time, s."""
    verdicts: dict[str, Verdict] = {}
    finals: dict[str, Array | None] = dict.fromkeys(system.outputs)
    constant = all(signal.final() is not None for signal in signals.values())
    if outcome.verdict is not Verdict.OK or not constant:
        verdicts = dict.fromkeys(system.outputs, outcome.verdict)
        return Response(outcome=outcome, outputs=system.outputs, verdicts=verdicts, finals=finals, initials=initials)
    if outcome.end <= last:
        verdicts = dict.fromkeys(system.outputs, unsettled)
        return Response(outcome=outcome, outputs=system.outputs, verdicts=verdicts, finals=finals, initials=initials)
    ends = {name: float(s.final() or 0.0) for name, s in signals.items()}
    point = operating_point(system, ends, start=outcome.state, modes=outcome.modes)
    rests = {name: point.y[:, k] if point.rests else None for k, name in enumerate(system.outputs)}
    for k, name in enumerate(system.outputs):
        verdicts[name], finals[name] = _end(outcome.output(k), rests[name], last, unsettled)
    # what has come near to rest is there; what has stopped, or moves evenly, may still be on its way
    even = [
        name
        for name, verdict in verdicts.items()
        if verdict is Verdict.INTEGRATING or (verdict is Verdict.OK and finals[name] is not rests[name])
    ]
    on_its_way = bool(even) and (
        motion(system, point.inputs, outcome.state, outcome.modes, outcome.end) is Motion.FOR_A_WHILE
    )
    if on_its_way:
        verdicts.update(dict.fromkeys(even, unsettled))
        finals.update(dict.fromkeys(even))
    return Response(
        outcome=outcome,
        outputs=system.outputs,
        verdicts=verdicts,
        finals=finals,
        initials=initials,
        on_its_way=on_its_way,
    )


def _end(curve: Curve, rest: Array | None, last: float, unsettled: Verdict) -> tuple[Verdict, Array | None]:
    """Return how one output ends, and where: at rest (the given array itself), still, or moving at a constant rate."""
    late = curve.since(curve.end - 0.1 * (curve.end - last)).values[:, :, 0].real
    whole = curve.values[:, :, 0].real
    size = max(float(np.ptp(whole)), 1e-12 * float(np.abs(whole).max()))
    if rest is not None and float(np.abs(late - float(rest[0].real)).max()) <= _NEAR * size:
        return Verdict.OK, rest
    if float(np.ptp(late)) <= max(_STILL * size, _ROUNDING * float(np.abs(whole).max())):
        return Verdict.OK, curve.values[-1, -1]
    slope = curve.slope.since(curve.end - 0.1 * (curve.end - last)).values[:, :, 0].real
    if float(np.ptp(slope)) <= _STEADY * float(np.abs(slope).max()) and math.isfinite(size):
        return Verdict.INTEGRATING, None
    return unsettled, None
