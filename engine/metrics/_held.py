"""A response beside straight lines over time: the pieces on which both are polynomials."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from engine.exact.time.chebyshev import NODES
from engine.exact.time.curve import Curve
from engine.metrics._base import Absent, TimeSubject, unsettled
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.model.linear_system import Array
    from engine.model.masks import Polyline


def beyond_reach(subject: TimeSubject, last: float) -> Absent | None:
    """Return why a response cannot be looked at up to ``last`` (s), or None when it can."""
    if subject.y is None:
        return unsettled(subject.verdict)
    if subject.final is None and subject.y.end < last * (1 - 1e-12):
        return Absent(
            verdict=Verdict.TOO_SHORT,
            advice=f"the response is followed up to {subject.y.end:g} s only: give the experiment a duration of {last:g} s",
        )
    return None


def differences(subject: TimeSubject, line: Polyline) -> Iterator[Curve]:
    """Yield y minus the line on each of its straight parts; behind its end a settled response stays where it is."""
    curve = subject.curve
    for part in line.segments:
        end = min(part.end, curve.end)
        if part.start < end:
            piece = curve.since(part.start).until(end)
            width = np.diff(piece.edges, axis=0)
            instants = piece.edges[:-1, None, :] + NODES[None, :, None] * width[:, None, :]
            yield Curve(edges=piece.edges, values=piece.values - (part.value + part.slope * (instants - part.start)))
        if subject.final is not None and part.end > curve.end:
            yield _rest(
                subject.final, max(part.start, curve.end), part.end, part.value - part.slope * part.start, part.slope
            )


def _rest(final: Array, start: float, end: float, value: float, slope: float) -> Curve:
    edges = np.repeat(np.array([[start], [end]]), len(final), axis=1)
    instants = start + NODES * (end - start)
    return Curve(edges=edges, values=final[None, None, :] - (value + slope * instants)[None, :, None])
