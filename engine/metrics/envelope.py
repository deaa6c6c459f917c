"""How far a response leaves its envelope.

1 + max over t of (y - upper) / scale and (lower - y) / scale
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.metrics._base import Found, TimeMetric
from engine.metrics._held import beyond_reach, differences
from engine.model.masks import Envelope as Bounds

if TYPE_CHECKING:
    from engine.metrics._base import Finding, MaskKind, TimeSubject


@final
class Envelope(TimeMetric):
    """How far a response leaves its envelope."""

    kind: ClassVar[str] = "envelope"
    title: ClassVar[str] = "Envelope"
    unit: ClassVar[str] = "1"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = (
        "1 plus the worst excess over an envelope of straight lines over time, relative to its scale; met at 1."
    )
    range: ClassVar[tuple[float, float]] = (-math.inf, math.inf)
    source: ClassVar[str] = "H. A. Nye, A. L. Tits, Int. J. Control 43 (1986) 1693-1721 (functional specifications)"
    mask: ClassVar[MaskKind] = "envelope"

    @classmethod
    def measure(cls, subject: TimeSubject) -> Finding:
        """Return the value or the reason why there is none."""
        assert isinstance(subject.mask, Bounds)
        bounds = subject.mask
        refusal = beyond_reach(subject, max(line.times[-1] for line, _ in bounds.sides))
        if refusal is not None:
            return refusal
        worst = None
        for line, sign in bounds.sides:
            for difference in differences(subject, line):
                value, at = (difference * sign).largest()
                if worst is None or value[0].real > worst[0][0].real:
                    worst = value, at
        assert worst is not None
        return Found(value=1 + worst[0] / bounds.unit, at=worst[1])
