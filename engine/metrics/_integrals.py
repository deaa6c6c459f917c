"""Integrals of the error, ∫|e|, ∫e², ∫t|e| and |∫e|, from the command's start on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from engine.exact.time.curve import Curve
from engine.exact.time.tail_of_integral import has_ended
from engine.metrics._base import NEGLIGIBLE, Absent, Found, unsettled
from engine.model.verdicts import Verdict

_INTEGRANDS = {
    "iae": lambda e, _: np.abs(e),
    "ie": lambda e, _: np.abs(e),
    "ise": lambda e, _: e * e,
    "itae": lambda e, t: np.abs(t * e),
}

if TYPE_CHECKING:
    from engine.metrics._base import Finding, TimeSubject
    from engine.model.linear_system import Array


def integral_of_error(subject: TimeSubject, kind: Literal["iae", "ise", "itae", "ie"]) -> Finding:
    """Return ∫|e|, ∫e², ∫t|e| or |∫e| from the command's start to the duration or to infinity."""
    error = _error_to_its_end(subject)
    if isinstance(error, Absent):
        return error
    if subject.duration is None and subject.fading() is None and not _has_ended(subject, error, kind):
        advice = "the error dies away so slowly that its integral has not come to an end: give a duration"
        return Absent(verdict=Verdict.NOT_SETTLED, advice=advice)
    if kind == "ise":
        return Found(value=_since_start(subject, error.squared()))
    if kind == "ie":
        total = _since_start(subject, error)
        return Found(value=total * (1.0 if total[0].real >= 0 else -1.0))
    error = error.absolute()
    if kind == "itae":
        shifted = Curve(edges=subject.since_start(error.edges), values=error.values)
        return Found(value=shifted.times_time().integral())
    return Found(value=_since_start(subject, error))


def _error_to_its_end(subject: TimeSubject) -> Curve | Absent:
    """Return the error from the command's start to the duration, or to where it is 0, or why its integral has no value."""
    refusal = unsettled(subject.verdict) if subject.duration is None else None
    if refusal is not None and refusal.verdict is Verdict.NOT_SETTLED:
        # it can be followed for no longer, as other metrics are: its integral would have no end then either
        advice = "the output goes on moving, so that the integral of its error has no end: give a duration"
        return Absent(verdict=Verdict.NOT_SETTLED, advice=advice)
    if refusal is not None:
        return refusal
    assert subject.error is not None
    if subject.duration is not None:
        return subject.during(_error(subject, subject.error), subject.error_final).since(subject.start)
    size = float(np.abs(subject.error.values[:, :, 0].real).max())
    if subject.error_final is None or abs(float(subject.error_final[0].real)) > NEGLIGIBLE * size:
        return Absent(
            verdict=Verdict.DIVERGES, advice="the error does not go to zero: add integral action or give a duration"
        )
    return _error(subject, subject.error).since(subject.start)


def _has_ended(subject: TimeSubject, error: Curve, kind: str) -> bool:
    """Return whether the integral lacks nothing where the run ends; a linear response is followed until nothing is left."""
    times, values = error.nodes()
    since = subject.start if subject.end is None else subject.end
    return bool(has_ended(times, values[:, None], since, _INTEGRANDS[kind])[0])


def _error(subject: TimeSubject, error: Curve) -> Curve:
    """Return the error, after the command as what it goes to and how far it is from that: a tail keeps its digits."""
    left = subject.fading()
    if left is None or subject.error_final is None:
        return error
    tail = left * -1.0 + subject.error_final
    if tail.times[0] <= error.times[0]:
        return tail
    before = error.until(float(tail.times[0]))
    return Curve(
        edges=np.concatenate([before.edges, tail.edges[1:]]), values=np.concatenate([before.values, tail.values])
    )


def _since_start(subject: TimeSubject, curve: Curve) -> Array:
    """Return the integral of a curve that has been cut at the command's start, which may move."""
    if subject.moving_start is None:
        return curve.integral()
    return np.asarray(curve.integral() - curve.values[0, 0].real * (subject.moving_start - subject.start))
