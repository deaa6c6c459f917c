"""The largest value of a response, over time or over frequency.

max |y(t)|,   max |G(jω)|;   of two peaks of one height each has a slope of its own, so that the larger of them has a kink
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from engine.exact.frequency import touching
from engine.exact.frequency.shapes import squared_magnitude
from engine.metrics._base import TOUCHES, Absent, Found, unsettled
from engine.model.tangent import parted
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.exact.frequency.response import FrequencyResponse
    from engine.exact.frequency.shapes import Shape
    from engine.exact.time.curve import Curve
    from engine.metrics._base import Finding, PathSubject, TimeSubject
    from engine.model.linear_system import Array


def largest_magnitude(subject: TimeSubject) -> Finding:
    """Return the largest absolute value of the output: within its duration; without one its final value where that is only approached."""
    if subject.duration is None:
        refusal = unsettled(subject.verdict)
        if refusal is not None and subject.verdict is not Verdict.NOT_SETTLED:
            return refusal
        if refusal is None and subject.final is None and subject.end is None and _grows(subject):
            return Absent(verdict=Verdict.DIVERGES, advice="the output grows without bound under this command")
    curve = seen(subject)
    top, top_at = curve.largest()
    bottom, bottom_at = curve.smallest()
    value, at = (top, top_at) if top[0].real >= -bottom[0].real else (-bottom, bottom_at)
    if subject.final is not None and subject.duration is None:
        limit = abs(float(subject.final[0].real))
        if limit >= float(value[0].real) * (1 - 1e-13):
            sign = 1.0 if subject.final[0].real >= 0 else -1.0
            return Found(value=sign * subject.final)
    tied = has_rival(curve, value, at, below=True)
    verdict = Verdict.NOT_SETTLED if subject.verdict is Verdict.NOT_SETTLED else Verdict.OK
    return Found(value=value, at=at, kinked=tied, verdict=verdict)


def seen(subject: TimeSubject) -> Curve:
    """Return what is looked at of the output: what lies within its duration, all of it without one."""
    return subject.curve if subject.duration is None else subject.during(subject.curve, subject.final)


def _grows(subject: TimeSubject) -> bool:
    """Return whether the far end of the curve still climbs to new values, as under a ramp."""
    sizes = np.abs(subject.curve.values[:, :, 0].real).max(axis=1)
    times = subject.curve.times
    early = times[1:] < 0.8 * times[-1]
    return bool(sizes[~early].max() > 1.1 * sizes[early].max(initial=0.0))


def has_rival(curve: Curve, value: Array, at: float, *, below: bool = False) -> bool:
    """Return whether another turning point is as high as the largest ``value`` and moves otherwise with a parameter.

    ``below`` says that lows count as well.
    """
    if not np.iscomplexobj(value):
        return False
    peak = float(value[0].real)
    instants, turns = curve.turnings(0.9 * abs(peak))
    rivals = (np.abs(instants - at) > TOUCHES * curve.end) & (np.abs(turns) >= (1 - TOUCHES) * abs(peak))
    if not below:
        rivals &= turns * peak > 0
    return any(
        parted(value, curve.read(float(instant)) * (1.0 if turn * peak > 0 else -1.0))
        for instant, turn in zip(instants[rivals], turns[rivals], strict=True)
    )


def highest_magnitude(subject: PathSubject) -> Finding:
    """Return the largest magnitude of a path over all frequencies, 0 included."""
    refusal = unsettled(subject.verdict)
    if refusal is not None:
        if subject.verdict in (Verdict.UNSTABLE, Verdict.DOUBTFUL):
            return refusal
        return Absent(verdict=Verdict.DIVERGES, advice="the path has poles on the imaginary axis: the peak is infinite")
    assert subject.static is not None
    return highest(subject.response, squared_magnitude, at_rest=subject.static, at_infinity=subject.response.direct)


def highest(response: FrequencyResponse, shape: Shape, *, at_rest: Array, at_infinity: Array) -> Finding:
    """Return the peak of a magnitude whose square is ``shape``; at either end of the axis it may only be approached."""
    value, at = response.peak(shape)
    tied = touching.has_rival(response, shape, value, at, tolerance=TOUCHES)
    top = math.sqrt(max(float(value[0].real), 0.0)) * (
        1 - 1e-12
    )  # a gain of 0 with an infinitesimal has a negative square
    static = at_rest * np.sign(at_rest.real)
    if float(static[0].real) >= top:
        return Found(value=static, at=0.0)
    limit = at_infinity * np.sign(at_infinity.real)
    if not response.system.m and float(limit[0].real) >= top:
        return Found(value=limit)
    return Found(value=np.sqrt(value), at=at, kinked=tied)
