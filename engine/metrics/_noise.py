"""What a path makes of white noise: the root of the energy of its impulse response."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from engine.exact.frequency.h2 import passes_impulses, squared_norm
from engine.exact.sampled_data.response import SampledResponse
from engine.metrics._base import Absent, Found, unsettled
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.metrics._base import Finding, PathSubject

_FEEDS_THROUGH = (
    "the path has a direct gain, which passes white noise of infinite power on: put a lag or a filter into it"
)
_SAMPLED = (
    "samplers lie on the path: what they make of white noise is not known here, take an output's recording of noise"
)
_LASTS = "what an impulse leaves does not decay: the path has poles on the imaginary axis"


def h2_norm(subject: PathSubject) -> Finding:
    """Return ‖G‖₂ of a path, or why it has none."""
    if isinstance(subject.response, SampledResponse):
        return Absent(verdict=Verdict.NOT_APPLICABLE, advice=_SAMPLED)
    refusal = unsettled(subject.verdict)
    if refusal is not None:
        if subject.verdict in (Verdict.UNSTABLE, Verdict.DOUBTFUL):
            return refusal
        return Absent(verdict=Verdict.DIVERGES, advice=_LASTS)
    system = subject.response.system
    if passes_impulses(system):
        return Absent(verdict=Verdict.DIVERGES, advice=_FEEDS_THROUGH)
    assert subject.static is not None
    square = squared_norm(system, subject.static)
    if not square[0].real > 0:
        return Found(value=np.zeros(system.lanes))
    through = np.iscomplexobj(system.d11) and bool(np.any(system.d11.imag != 0))
    return Found(value=np.sqrt(square), one_sided=through)
