"""Integrals of the error, ∫|e|, ∫e², ∫t|e| and |∫e|, from the command's start on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from engine.linear.curve import Curve
from engine.metrics._base import NEGLIGIBLE, Absent, Found, unsettled
from engine.verdicts import Verdict

if TYPE_CHECKING:
    from engine.linear.system import Array
    from engine.metrics._base import Finding, TimeSubject


def integral_of_error(subject: TimeSubject, kind: Literal["iae", "ise", "itae", "ie"]) -> Finding:
    """Return ∫|e|, ∫e², ∫t|e| or |∫e| from the command's start to the duration or to infinity."""
    error = _error_to_its_end(subject)
    if isinstance(error, Absent):
        return error
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
    if subject.error is None or subject.duration is None:
        refusal = unsettled(subject.verdict)
        if refusal is not None:
            return refusal
    if subject.error is None:
        return Absent(verdict=Verdict.DIVERGES, advice="the error grows beyond what can be followed")
    if subject.duration is not None:
        return subject.error.until(subject.duration).since(subject.start)
    size = float(np.abs(subject.error.values[:, :, 0].real).max())
    if subject.error_final is None or abs(float(subject.error_final[0].real)) > NEGLIGIBLE * size:
        return Absent(
            verdict=Verdict.DIVERGES, advice="the error does not go to zero: add integral action or give a duration"
        )
    return subject.error.since(subject.start)


def _since_start(subject: TimeSubject, curve: Curve) -> Array:
    """Return the integral of a curve that has been cut at the command's start, which may move."""
    if subject.moving_start is None:
        return curve.integral()
    return np.asarray(curve.integral() - curve.values[0, 0].real * (subject.moving_start - subject.start))
