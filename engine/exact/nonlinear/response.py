"""What a nonlinear system does under its commands, followed until it settles, and where each output settles.

A response has settled where the state of rest under the final commands is what the outputs approach; that state gives
their final values exactly. Where there is none (a position that runs on), an output that has stopped moving is final. What moves at
a constant rate is an integrator only if it does so for ever: a drive at its limit, on its way to a target, is followed until it arrives.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.exact.nonlinear.bounds import computing_time
from engine.exact.nonlinear.integrate import Integration
from engine.exact.nonlinear.operating_point import operating_point
from engine.exact.nonlinear.outcome import Outcome
from engine.exact.nonlinear.running_on import forecast, reach
from engine.exact.nonlinear.switching import StoppedError
from engine.exact.time.struck import areas_of, refuse_straight
from engine.exact.time.tail_of_integral import has_ended
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Callable

    from engine.exact.laws.system import NonlinearSystem
    from engine.exact.time.curve import Curve
    from engine.signals import Signal

Array = npt.NDArray[Any]

LIMIT: Final = 30.0
"""A simulation that takes longer to compute ends here, s: of its own thread, so that no verdict depends on what else runs beside it."""
EXTENSIONS: Final = 5
"""A response of free length that has not settled is followed twice as long, so many times."""

_NEAR = 1e-3
"""The last tenth of a curve within this part of its range of the state of rest approaches it."""
_SAME = 1e-3
_STILL = 1e-6
"""An output whose last tenth moves by no more than this part of its range has stopped: far within every settling band."""
_STEADY = 1e-6
_ROUNDING = 1e-14
_SWINGS = 3
"""What is on its way and has turned back so often, never sooner nor less than before, does not arrive."""
_PATIENCE = 4
"""So many doublings one that has settled has to come to a stop in: what hunts ever more slowly never does."""
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
    still: bool = True
    """Whether those that come to rest have stopped, and sooner than powers of time do: an integral of the error is then that of all time."""

    @property
    def settled(self) -> bool:
        """Whether all outputs have come to their end."""
        return all(v in {Verdict.OK, Verdict.INTEGRATING} for v in self.verdicts.values())

    def output(self, name: str) -> Curve:
        """Return an output as a curve."""
        return self.outcome.output(self.outputs.index(name))

    def sample(self, name: str, time: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return an output at these instants (s), just after each of them."""
        values, after = self.output(name).sample(time), self.outcome.after
        if after is not None:
            values[time == self.outcome.end] = after[0, self.outputs.index(name)].real
        return values

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
    clock: Callable[[], float] | None = None,
    limit: float = LIMIT,
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
    clock, limit : callable, float
        The computation ends, with a verdict, when ``clock``, by default that of this thread's computing, has gone on by ``limit`` seconds.
    """
    run = Integration(system, signals, state=_struck(system, signals), clock=clock or computing_time(), limit=limit)
    initials = _initials(system)
    last = max((t for s in signals.values() for t in (*s.breakpoints(), s.end() or 0.0)), default=0.0)
    if duration is not None:
        outcome = run.advance(duration)
        return _judged(system, signals, outcome, initials=initials, last=last, unsettled=Verdict.NOT_SETTLED)
    periods = max((s.repeats_after() or 0.0 for s in signals.values()), default=0.0)
    length = max(pace, 3 * periods, 1e-9)
    endless = any(s.final() is None for s in signals.values())
    sampled = any(law.element.period(law.values) is not None for law in system.laws)
    extension = waited = 0
    while True:
        outcome = run.advance(last + length * 2**extension)
        response = _judged(system, signals, outcome, initials=initials, last=last, unsettled=Verdict.NOT_SETTLED)
        most = _MOST_EXTENSIONS if response.on_its_way and not sampled else EXTENSIONS
        over = response.settled and (response.still or waited == _PATIENCE)
        long_enough = extension >= most and not response.settled
        if endless or over or outcome.verdict is not Verdict.OK or long_enough:
            return response
        if not response.settled and _swings(response, last):
            return response
        extension, waited = extension + 1, waited + response.settled


def _swings(response: Response, last: float) -> bool:
    """Return whether all that has not settled swings without coming nearer to an end.

    What is on its way turns back ever less, and ever sooner; else the last quarter is held against the one before.
    """
    end = response.outcome.end
    for name in response.outputs:
        if response.verdicts[name] is not Verdict.NOT_SETTLED:
            continue
        if response.on_its_way:
            if not _lasting(response.output(name).since(last)):
                return False
            continue
        curve = response.output(name).since(end - 0.5 * (end - last))
        middle = end - 0.25 * (end - last)
        early = float(np.ptp(curve.until(middle).values[:, :, 0].real))
        late = float(np.ptp(curve.since(middle).values[:, :, 0].real))
        if abs(late - early) > _SAME * early:
            return False
    return True


def _lasting(curve: Curve) -> bool:
    """Return whether the last swings of a curve are each as wide and as long as the one before, or more."""
    instants, turns = curve.turnings(0.0)
    order = np.argsort(instants)
    kept: list[tuple[float, float]] = []
    sign = 0.0
    for instant, turn in zip(instants[order], turns[order], strict=True):
        way = float(turn) - kept[-1][1] if kept else math.inf
        if abs(way) <= _SAME * float(np.ptp(turns)):
            continue
        if kept and math.copysign(1.0, way) == sign:
            kept[-1] = float(instant), float(turn)
        else:
            sign = math.copysign(1.0, way) if kept else 0.0
            kept.append((float(instant), float(turn)))
    if len(kept) <= _SWINGS:
        return False
    steps = np.abs(np.diff(np.array(kept[-_SWINGS - 1 :]), axis=0))
    return bool(np.all(steps[1:] >= (1 - _SAME) * steps[:-1]))


def _initials(system: NonlinearSystem) -> dict[str, Array]:
    """Return the outputs of the initial state with all inputs 0: just before the commands begin."""
    still = Integration(system, {})
    with contextlib.suppress(StoppedError):  # laws that do not come to agree: what they have come to is the beginning
        still.rest()
    values = still.outputs()
    return {name: values[:, k] for k, name in enumerate(system.outputs)}


def _struck(system: NonlinearSystem, signals: Mapping[str, Signal]) -> Array:
    """Return the states right after the impulses among the commands, (lanes, n).

    Raises
    ------
    SignalError
        If one goes straight to an output, into a delay or into a nonlinear law.
    """
    areas, start = areas_of([signals.get(name) for name in system.inputs]), system.start
    if areas is None:
        return start
    matrices = system.matrices
    laws = [law.label for law in system.laws for _ in range(law.inputs.stop - law.inputs.start)]
    for k in np.flatnonzero(areas):
        for rows, targets in (("d11", system.outputs), ("d31", laws), ("d21", ["a delay"] * system.delays.shape[-1])):
            refuse_straight(matrices[rows][0, :, k], system.inputs[k], targets)
    jump = matrices["b1"] @ areas
    return np.asarray(start + np.pad(jump, ((0, 0), (0, start.shape[-1] - jump.shape[-1]))))


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
    seen = max(last, 0.1 * last + 0.9 * outcome.end - _echoes(system))
    curves = [outcome.output(k) for k in range(len(system.outputs))]
    tails = [_Tail.of(curve, seen) for curve in curves]
    # where there are other places to rest, which one it is shows at the very end
    part = _NEAR if point.single else _STILL
    near = [point.rests and tail.within(part, float(point.y[0, k].real)) for k, tail in enumerate(tails)]
    far = reach(system, point, outcome.state, outcome.end) if any(near) else None
    open_ends = []
    for k, (name, tail) in enumerate(zip(system.outputs, tails, strict=True)):
        if near[k] and (far is None or far[k] <= 2 * _NEAR * tail.size):
            verdicts[name], finals[name] = Verdict.OK, point.y[:, k]
        else:
            verdicts[name], finals[name] = tail.end(unsettled)
            open_ends += [k] if verdicts[name] is not unsettled else []
    # what has stopped, or moves evenly, may still be on its way
    on_its_way = False
    if open_ends:
        future = forecast(system, point.inputs, outcome.state, outcome.modes, outcome.end)
        on_its_way = future is None
        for k in open_ends:
            name = system.outputs[k]
            if future is None or not tails[k].keeps(verdicts[name], future.ahead, future.outputs[:, k]):
                verdicts[name], finals[name] = unsettled, None
    return Response(
        outcome=outcome,
        outputs=system.outputs,
        verdicts=verdicts,
        finals=finals,
        initials=initials,
        on_its_way=on_its_way,
        still=all(
            final is None or (tail.within(_STILL, at := float(np.ravel(final)[0].real)) and _dies_away(curve, at, last))
            for tail, curve, final in zip(tails, curves, (finals[name] for name in system.outputs), strict=True)
        ),
    )


def _dies_away(curve: Curve, final: float, last: float) -> bool:
    """Return whether ∫ t |y - final| has come to its end."""
    times, values = curve.since(last).nodes()
    return bool(has_ended(times, (values - final)[:, None], last, lambda away, t: t * np.abs(away))[0])


def _echoes(system: NonlinearSystem) -> float:
    """Return how long what has happened may still be under way through the delays, s."""
    return float(system.delays[0].real.sum()) if system.delays.shape[-1] else 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class _Tail:
    """The last part of an output: its values and slopes, its last value (lanes,), the range and largest value of the whole."""

    values: npt.NDArray[np.float64]
    slopes: npt.NDArray[np.float64]
    last: Array
    size: float
    largest: float

    @classmethod
    def of(cls, curve: Curve, start: float) -> _Tail:
        """Return what follows ``start`` (s)."""
        whole = curve.values[:, :, 0].real
        largest = float(np.abs(whole).max())
        return cls(
            values=curve.since(start).values[:, :, 0].real, slopes=curve.slope.since(start).values[:, :, 0].real,
            last=curve.values[-1, -1], size=max(float(np.ptp(whole)), 1e-12 * largest), largest=largest,
        )  # fmt: skip

    def within(self, part: float, value: float) -> bool:
        """Return whether it stays within a part of the range around a value."""
        return float(np.abs(self.values - value).max()) <= part * self.size

    def end(self, unsettled: Verdict) -> tuple[Verdict, Array | None]:
        """Return how the output seems to end, and where: still, or moving at a constant rate."""
        if float(np.ptp(self.values)) <= max(_STILL * self.size, _ROUNDING * self.largest):
            return Verdict.OK, self.last
        steady = float(np.ptp(self.slopes)) <= _STEADY * float(np.abs(self.slopes).max()) and math.isfinite(self.size)
        return (Verdict.INTEGRATING if steady else unsettled), None

    def keeps(self, verdict: Verdict, ahead: npt.NDArray[np.float64], later: npt.NDArray[np.float64]) -> bool:
        """Return whether the output is, and remains, what it seems: ``later`` are its values at times ``ahead``, s."""
        rate = float(self.slopes[-1, -1]) if verdict is Verdict.INTEGRATING else 0.0
        away = np.abs(later - later[0] - rate * ahead)
        return bool(np.all(away <= _NEAR * (self.size + np.abs(rate) * ahead)))
