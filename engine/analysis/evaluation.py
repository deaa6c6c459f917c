"""What metrics measure on a diagram at one set of values: its poles, loops, paths and exact responses, each computed once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from engine.analysis.commanded import CommandParameter, Motions, last_start, repeats, span_of
from engine.analysis.dc_gain import Resting, without_digits
from engine.analysis.derivatives import differentiated
from engine.analysis.realized import RealizedDiagram
from engine.analysis.sampled_subjects import loop_subject, path_subject
from engine.exact.frequency.dc_gain import static_gain
from engine.exact.frequency.path import path
from engine.exact.frequency.response import FrequencyResponse
from engine.exact.nonlinear import response as nonlinear
from engine.exact.time.curve import Curve
from engine.exact.time.horizon import followed
from engine.exact.time.run import Trajectory
from engine.exact.time.settling_tail import fading
from engine.exact.time.trajectory import respond
from engine.metrics._base import Absent, LoopSubject, PathSubject, SystemSubject, TimeSubject
from engine.metrics._window import still_to_go
from engine.model.errors import UnresolvedError
from engine.model.linear_system import LaneSystem
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.diagram.connections import Opening
    from engine.diagram.diagram import Diagram
    from engine.exact.frequency.poles import Poles
    from engine.exact.nonlinear.outcome import Outcome
    from engine.model.linear_system import Array
    from engine.signals import Signal

_CANCELLED = 1e-13
"""What is left of the difference of two equal numbers, relative to the output: an integral leaves no error."""

_LOST = 1e-3
"""An output has no metrics whose rest is known to no better than this part of its largest value."""

LARGEST = 1e100
"""Beyond this a growing response is not followed."""

_BEYOND_REACH = (
    f"the response grows beyond {LARGEST:g} within its {{:g}} s: lower the loop gain, add phase lead or shorten the run"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class TimeResponse:
    """The response of some outputs to the same command.

    ``joint`` follows every output whose path decays, to its very end; ``columns`` tells which column each of them is.
    ``left`` says how far from rest rounding leaves them.
    """

    joint: Trajectory | None
    columns: Mapping[str, int]
    verdicts: Mapping[str, Verdict]
    finals: Mapping[str, Array | None]
    initials: Mapping[str, Array]
    hidden: tuple[str, ...]
    left: Mapping[str, float]
    unresolved: UnresolvedError | None = None
    """Why nobody can follow it until it rests; its verdicts are those of runs that end before."""


class Evaluation(RealizedDiagram):
    """A diagram at given values: what its metrics measure, each computed once.

    Parameters
    ----------
    diagram : Diagram
    overrides : mapping, optional
        Parameter values (SI) by path that replace the document's.
    gradient : sequence of str, optional
        Parameters whose derivatives are wanted; each is a lane.
    commands : sequence of CommandParameter, optional
        Numbers of commands whose derivatives are wanted, in place of ``gradient``; each is a lane.
    """

    def __init__(
        self,
        diagram: Diagram,
        overrides: Mapping[str, float] | None = None,
        gradient: Sequence[str] = (),
        commands: Sequence[CommandParameter] = (),
    ) -> None:
        super().__init__(diagram, overrides, gradient, commands)
        self._loops: dict[Opening, LoopSubject] = {}
        self._responses: dict[tuple[object, ...], TimeResponse] = {}
        self._paths: dict[tuple[str, str], PathSubject] = {}
        self._fadings: dict[tuple[object, ...], Trajectory] = {}
        self._simulated: dict[tuple[object, ...], nonlinear.Response] = {}

    @property
    def system_subject(self) -> SystemSubject:
        """What a metric of the poles measures."""
        return SystemSubject(poles=self.poles)

    def loop(self, open_at: Opening) -> LoopSubject:
        """Return the open loop at ``open_at``, signed so that 1 + L = 0 is the characteristic equation.

        Of several places opened together the loop is cut at the first, and closed there again with the others left open.
        """
        sampled = None
        if open_at not in self._loops and self.diagram.sampled:
            sampled = loop_subject(self.diagram.sampled_laws(self.overrides, self._steps, open_at))
        if sampled is not None:
            self._loops[open_at] = sampled
        if open_at not in self._loops:
            whole = self._realize(open_at)
            ends = [len(whole.inputs) - 1], [len(whole.outputs) - 1]
            cut = path(whole, *ends, self._poles_of)
            opened, exact = _negated(cut), self._by_rates(cut, *ends, open_at)
            closed = self._closed_again(opened.value, open_at)
            own = self._poles_of(opened.value)
            resting = Resting(self.diagram, self.overrides, self._steps, open_at)
            gain = resting.gain(exact, own, ends[0][0], ends[1][0])
            static = None if gain is None else -gain
            response = FrequencyResponse.near(opened, closed, solved=_negated(exact))
            self._loops[open_at] = LoopSubject(
                response=response, static=static, opened=own, closed=closed, verdict=closed.verdict
            )
        return self._loops[open_at]

    def _closed_again(self, opened: LaneSystem, open_at: Opening) -> Poles:
        """Return the poles of a loop when it is closed; those of the whole system where it is all of that."""
        alone = not isinstance(open_at, tuple)
        # with delays poles take as long as all else of a loop; without, the whole system may not even be there
        if alone and opened.m and (opened.n, opened.m) == (self.system.n, self.system.m):
            return self.poles
        return self._poles_of(_closed(opened))

    def path(self, source: str, target: str) -> PathSubject:
        """Return the frequency response from an input to an output of the diagram."""
        key = (source, target)
        ends = [self.input_index(source)], [self.output_index(target)]
        sampled = None
        if key not in self._paths and self.diagram.sampled:
            sampled = path_subject(self._sampled, ends[0][0], ends[1][0])
        if sampled is not None:
            self._paths[key] = sampled
        if key not in self._paths:
            part = path(self.system, *ends, self._poles_of)
            exact, own = self._by_rates(part, *ends), self._poles_of(part.value)
            static = self._resting.gain(exact, own, ends[0][0], ends[1][0])
            response = FrequencyResponse.near(part, own, solved=exact)
            integrates = bool(np.any(own.at_zero))
            if static is None and not integrates:  # poles that miss an integral say nothing of stability either
                raise without_digits()
            verdict = Verdict.DOUBTFUL if integrates and static is not None else own.verdict
            self._paths[key] = PathSubject(response=response, static=static, own=own, verdict=verdict)
        return self._paths[key]

    def simulated(self, signals: Mapping[str, Signal], duration: float | None) -> nonlinear.Response:
        """Return the response of a nonlinear system up to ``duration``, or until it settles."""
        key = (tuple((name, id(signal)) for name, signal in signals.items()), duration)
        if key not in self._simulated:
            for name in signals:
                self.input_index(name)
            pace = self.pace.lifetime or 1.0
            laws = self.diagram.laws(self.overrides, self._steps)
            self._simulated[key] = nonlinear.respond(laws, signals, duration, pace)
        return self._simulated[key]

    @property
    def smooth(self) -> bool:
        """Whether every nonlinear response so far depends smoothly on the parameters: no guard was only touched."""
        return all(response.outcome.smooth for response in self._simulated.values())

    def _nonlinear_subject(self, signals: Mapping[str, Signal], output: str, duration: float | None) -> TimeSubject:
        """Return what a time metric of ``output`` measures on a nonlinear response."""
        response = self.simulated(signals, duration)
        self.output_index(output)
        y, final, verdict = response.output(output), response.finals[output], response.verdicts[output]
        start, end = span_of(signals)
        reference = self.diagram.references.input_of(signals, output)
        own = output in self.diagram.references.errors
        error = y if own else y * -1.0
        error_final = final if own or final is None else -final
        if reference is not None:
            error = response.outcome.input(self.input_index(reference)).minus(y)
            target = signals[reference].final()
            error_final = None if final is None or target is None else target - final
        return TimeSubject(
            y=y, initial=response.initials[output], final=final, start=start, end=end, error=error,
            error_final=error_final, duration=duration, verdict=verdict, incomplete=_cut_short(response.outcome, duration),
            loading=last_start(signals),
            to_go=_to_go(response, output, y, end),
        )  # fmt: skip

    def time_response(self, signals: Mapping[str, Signal], outputs: Sequence[str]) -> TimeResponse:
        """Return the whole response of ``outputs`` to ``signals`` (absent inputs are 0)."""
        return self.response_within(signals, outputs, None)

    def response_within(
        self, signals: Mapping[str, Signal], outputs: Sequence[str], duration: float | None
    ) -> TimeResponse:
        """Return the whole response; of what nobody can follow until it rests none, where no more than a duration is asked for."""
        key = (tuple((name, id(signal)) for name, signal in signals.items()), tuple(outputs))
        if key not in self._responses:
            self._responses[key] = self._respond(signals, outputs)
        found = self._responses[key]
        if found.unresolved is not None and duration is None:
            raise found.unresolved
        return found

    def _motions(self, signals: Mapping[str, Signal]) -> Motions | None:
        return Motions(signals=signals, lanes=self.commands) if self.commands else None

    def _respond(self, signals: Mapping[str, Signal], outputs: Sequence[str]) -> TimeResponse:
        motions = self._motions(signals)
        inputs = [self.input_index(name) for name in signals]
        verdicts: dict[str, Verdict] = {}
        lifetime = 0.0
        for name in outputs:
            own = self._poles_of(path(self.rated, inputs, [self.output_index(name)], self._poles_of).value)
            verdicts[name] = own.verdict
            if own.verdict is Verdict.OK:
                lifetime = max(lifetime, own.lifetime)
        decaying = [name for name in outputs if verdicts[name] is Verdict.OK]
        x0 = np.einsum("poi,pi->po", self.rated.c1, self.rated.x0)
        initials = {name: x0[:, self.output_index(name)] for name in outputs}
        finals: dict[str, Array | None] = dict.fromkeys(outputs)
        joint, left = None, {}
        if decaying:
            columns = [self.output_index(name) for name in decaying]
            part = path(self.rated, inputs, columns, self._poles_of)
            ends = [signal.final() for signal in signals.values()]
            if all(end is not None for end in ends):
                settled = motions.finals() if motions else np.array([[float(end or 0.0) for end in ends]])
                gains = self._gains(part, inputs, columns)
                values = np.asarray((gains @ settled[:, :, None])[:, :, 0])
                finals.update({name: values[:, k] for k, name in enumerate(decaying)})
            try:
                found = followed(part, signals, lifetime, [finals[name] for name in decaying])
            except UnresolvedError as error:
                verdicts.update(dict.fromkeys(decaying, Verdict.NOT_SETTLED))
                return TimeResponse(
                    joint=None, columns={}, verdicts=verdicts, finals=finals, initials=initials, hidden=(), left={}, unresolved=error,
                )  # fmt: skip
            joint = motions.moved(found.response, part) if motions else found.response
            left = {name: float(found.left[k]) for k, name in enumerate(decaying)}
            lost = [
                name
                for k, name in enumerate(decaying)
                if not found.rounded[k] or found.left[k] > _LOST * found.largest[k]
            ]
            verdicts.update(dict.fromkeys(lost, Verdict.DOUBTFUL))
        whole = self.poles.verdict
        hidden = tuple(name for name in decaying if whole is not Verdict.OK)
        return TimeResponse(
            joint=joint,
            columns={name: k for k, name in enumerate(decaying)},
            verdicts=verdicts,
            finals=finals,
            initials=initials,
            hidden=hidden,
            left=left,
        )

    def _gains(self, part: LaneSystem, inputs: Sequence[int], columns: Sequence[int]) -> Array:
        """Return the gains at rest from inputs to outputs, (lanes, outputs, inputs); those of derivatives in double precision."""
        known = len(self.diagram.outputs)
        own = [k for k, column in enumerate(columns) if column < known]
        if len(own) == len(columns):
            return self._resting.gains(self._by_rates(part, inputs, columns), inputs, columns)
        gains = static_gain(part)
        if own:
            named = [columns[k] for k in own]
            gains[:, own] = self._gains(path(self.rated, inputs, named, self._poles_of), inputs, named)
        return gains

    def time_subject(
        self,
        signals: Mapping[str, Signal],
        output: str,
        duration: float | None = None,
        outputs: Sequence[str] | None = None,
        *,
        order: int = 0,
    ) -> TimeSubject:
        """Return what a time metric of ``output``, differentiated ``order`` times, measures; ``outputs`` are computed together with it."""
        if self.diagram.nonlinear:
            return differentiated(self._nonlinear_subject(signals, output, duration), order)
        name, left = self._rate(output, order)
        together = outputs if name == output else None
        return differentiated(self._linear_subject(signals, name, duration, together), left)

    def _linear_subject(
        self, signals: Mapping[str, Signal], output: str, duration: float | None, outputs: Sequence[str] | None
    ) -> TimeSubject:
        response = self.response_within(signals, [output] if outputs is None else outputs, duration)
        verdict = response.verdicts[output]
        final = response.finals[output]
        start, end = span_of(signals)
        motions = self._motions(signals)
        y = error = error_final = incomplete = None
        named = self.diagram.references.input_of(signals, output)
        reference = None if named is None else list(signals).index(named)
        own = output in self.diagram.references.errors
        trajectory, column = response.joint, response.columns.get(output, 0)
        too_short = duration is not None and trajectory is not None and trajectory.edges[-1, 0].real < duration
        if verdict is not Verdict.OK or (final is None and too_short):
            trajectory, column = None if duration is None else self._limited(signals, output, duration), 0
            if trajectory is None and duration is not None:
                incomplete = Absent(verdict=verdict, advice=_BEYOND_REACH.format(duration))
        if trajectory is not None:
            y = trajectory.output(column)
            error = trajectory.input(reference).minus(y) if reference is not None else y if own else y * -1.0
        if error is not None and verdict is Verdict.OK:
            target: Array | float | None = 0.0 if reference is None else list(signals.values())[reference].final()
            if motions and reference is not None and target is not None:
                target = motions.finals()[:, reference]
            if final is not None and target is not None:
                error_final = _without_rounding(final if own else target - final, y)
            elif y is not None and not repeats(signals) and _has_settled(error, y):
                error_final = error.values[-1, -1]
        return TimeSubject(
            y=y, initial=response.initials[output], final=final, start=start, end=end, error=error,
            error_final=error_final, duration=duration, verdict=verdict, incomplete=incomplete,
            moving_start=motions.start() if motions else None, moving_end=motions.end() if motions else None,
            loading=motions.last_start() if motions else last_start(signals),
            fading=partial(self._fading, signals, output, response),
        )  # fmt: skip

    def _fading(self, signals: Mapping[str, Signal], output: str, response: TimeResponse) -> Curve | None:
        """Return how far an output is from where it goes, from the moment on in which the commands stand still.

        None where it does not settle, and where lanes move the commands.
        """
        _, end = span_of(signals)
        if response.joint is None or response.finals[output] is None or end is None or self.commands:
            return None
        if response.joint.edges[-1, 0].real <= end:
            return None
        key = (tuple((name, id(signal)) for name, signal in signals.items()), tuple(response.columns))
        if key not in self._fadings:
            inputs = [self.input_index(name) for name in signals]
            part = path(self.rated, inputs, [self.output_index(name) for name in response.columns], self._poles_of)
            settled = np.array([[float(signal.final() or 0.0) for signal in signals.values()]])
            self._fadings[key] = fading(part, list(signals.values()), settled, response.joint)
        return self._fadings[key].output(response.columns[output]).since(end)

    def _limited(self, signals: Mapping[str, Signal], output: str, duration: float) -> Trajectory | None:
        """Return the response of an output that does not settle, up to ``duration``; None beyond what can be followed."""
        inputs = [self.input_index(name) for name in signals]
        part = path(self.rated, inputs, [self.output_index(output)], self._poles_of)
        if float(self._poles_of(part.value).values.real.max(initial=0.0)) * duration > np.log(LARGEST):
            return None
        found, motions = respond(part, list(signals.values()), duration), self._motions(signals)
        return motions.moved(found, part) if motions else found


def _without_rounding(error: Array, y: Curve | None) -> Array:
    """Return the error that remains; what rounding leaves of the difference of two equal numbers is none."""
    assert y is not None
    largest = float(np.abs(y.values[:, :, 0].real).max())
    return error - error.real if abs(float(error[0].real)) <= _CANCELLED * largest else error


def _cut_short(outcome: Outcome, duration: float | None) -> Absent | None:
    """Return why nothing is measured on a nonlinear response: what ended it before its time."""
    if outcome.verdict is Verdict.OK:
        return None
    wanted = "before it has settled" if duration is None else f"of {duration:g} s"
    return Absent(verdict=outcome.verdict, advice=f"the run ends at {outcome.end:.6g} s {wanted}: {outcome.advice}")


def _to_go(response: nonlinear.Response, output: str, y: Curve, end: float | None) -> tuple[float, float] | None:
    """Return how far an output that has not settled may still go, where its run shows that and goes on behind the commands."""
    unsettled = response.verdicts[output] is Verdict.NOT_SETTLED and not response.on_its_way
    return still_to_go(y, end) if unsettled and end is not None and end < y.end else None


def _has_settled(error: Curve, y: Curve) -> bool:
    """Return whether the last tenth of the time is constant: a ramp's error does not move any more."""
    values, largest = error.values[:, :, 0].real, float(np.abs(y.values[:, :, 0].real).max())
    last = error.since(0.9 * error.end).values[:, :, 0].real
    return bool(np.ptp(last) <= max(1e-9 * np.abs(values).max(), _CANCELLED * largest))


def _negated(system: LaneSystem) -> LaneSystem:
    return replace(system, c1=-system.c1, d11=-system.d11, d12=-system.d12)


def _closed(loop: LaneSystem) -> LaneSystem:
    """Return the loop closed by u = -L u: its poles decide what a margin means."""
    gain = 1 / (1 + loop.d11[:, 0, 0]) if abs(1 + loop.d11[0, 0, 0]) > 1e-12 else np.array([np.inf])
    k = -gain[:, None, None]
    if not np.isfinite(k).all():
        return loop
    return replace(
        loop,
        a=loop.a + loop.b1 @ (k * loop.c1), b2=loop.b2 + loop.b1 @ (k * loop.d12),
        c2=loop.c2 + loop.d21 @ (k * loop.c1), d22=loop.d22 + loop.d21 @ (k * loop.d12),
    )  # fmt: skip
