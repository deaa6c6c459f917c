"""What a window says of an output that has not settled in it: what is told from its last value, and how far the rest may change that.

Of the last half of the window after the commands have ended, its two halves move by r₀ and r₁. Who goes one way goes on by
r₁ (q + q² + …) = r₁ q / (1 - q) with q = r₁ / r₀ < 1; who swings stays within r₁ of its last value while q ≤ 1.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from engine.metrics._base import Absent, Found, TimeMetric, TimeSubject
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.exact.time.curve import Curve
    from engine.metrics._base import Finding
    from engine.model.linear_system import Array

LAST_SAMPLE: Final = "last_sample"

_SAME: Final = 1e-3
"""A swing that grows by no more than this part of itself repeats itself."""
_ONE_WAY: Final = 1 - 1e-6


def still_to_go(curve: Curve, last: float) -> tuple[float, float] | None:
    """Return how far an output may still go down and up from its last value, None where nothing shows an end to it.

    Parameters
    ----------
    curve : Curve
        The output, up to the end of the window.
    last : float
        When the commands change for the last time, s: before the end.
    """
    whole = curve.end - last
    halves = [curve.since(curve.end - part * whole) for part in (0.5, 0.25)]
    quarters = [halves[0].until(curve.end - 0.25 * whole), halves[1]]
    (r0, way0), (r1, way1) = (_moved(quarter) for quarter in quarters)
    if way0 * way1 > 0 and abs(way0) >= _ONE_WAY * r0 and abs(way1) >= _ONE_WAY * r1:
        rest = way1 * r1 / (r0 - r1) if r1 < r0 else np.inf
        return (min(rest, 0.0), max(rest, 0.0)) if np.isfinite(rest) else None
    return (-r1, r1) if r1 <= (1 + _SAME) * r0 else None


def _moved(curve: Curve) -> tuple[float, float]:
    """Return the range of a curve, and its end less its beginning."""
    values = curve.values[:, :, 0].real
    return float(np.ptp(values)), float(values[-1, -1] - values[0, 0])


def applies(metric: type[TimeMetric], subject: TimeSubject) -> bool:
    """Return whether a metric of where an output settles is told from the end of a window."""
    return metric.of_the_end and subject.verdict is Verdict.NOT_SETTLED and subject.duration is not None


def measured(metric: type[TimeMetric], subject: TimeSubject) -> Finding:
    """Return a metric as if the last value were final, with how far the rest may change it.

    The doubt is the largest change of the metric when the final value is moved by what the output may still go; None where that is
    not known, or leaves no metric.
    """
    if subject.end is not None and not subject.end < subject.curve.end:
        return Absent(
            verdict=Verdict.TOO_SHORT, advice="the run ends before its commands do: give it a longer duration"
        )
    last = subject.curve.values[-1, -1]
    found = metric.measure(_settled(subject, last))
    if isinstance(found, Absent):  # never says more than a window shows
        return replace(found, verdict=Verdict.NOT_SETTLED) if found.verdict is Verdict.NEVER_CROSSES else found
    doubt = np.inf if subject.to_go is None else 0.0
    for way in set(subject.to_go or ()) - {0.0}:
        moved = metric.measure(_settled(subject, last + way))
        change = abs(float((moved.value - found.value)[0].real)) if isinstance(moved, Found) else np.inf
        doubt = max(doubt, change)
    return replace(
        found, verdict=Verdict.NOT_SETTLED, doubt=doubt if np.isfinite(doubt) else None, settled_from=LAST_SAMPLE
    )


def _settled(subject: TimeSubject, final: Array) -> TimeSubject:
    """Return the subject with a final value."""
    assert subject.error is not None
    shift = final - subject.curve.values[-1, -1]
    return replace(subject, verdict=Verdict.OK, final=final, error_final=subject.error.values[-1, -1] - shift)
