"""What metrics of loops, paths and poles measure on a system with samplers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from engine.exact.sampled_data.loop import SampledLoop
from engine.exact.sampled_data.poles import sampled_poles
from engine.exact.sampled_data.response import SampledResponse
from engine.metrics._base import LoopSubject, PathSubject
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.exact.frequency.poles import Poles
    from engine.exact.laws.system import NonlinearSystem
    from engine.exact.sampled_data.system import SampledSystem
    from engine.model.linear_system import Array


def loop_subject(laws: NonlinearSystem) -> LoopSubject | None:
    """Return the open loop of a system whose last input and output are the two ends of a cut; None without samplers in it."""
    loop = SampledLoop(laws)
    part = loop.whole
    if not part.sampled:
        return None
    own, closed = sampled_poles(part), sampled_poles(part.closed())
    response = SampledResponse.of_loop(loop, own)
    return LoopSubject(
        response=response, static=_static(response, own), opened=own, closed=closed, verdict=closed.verdict
    )


def path_subject(system: SampledSystem, source: int, target: int) -> PathSubject | None:
    """Return the fundamental response from an input to an output; None without samplers between them."""
    part = system.path(source, target)
    if not part.sampled:
        return None
    own = sampled_poles(part)
    response = SampledResponse(part, own)
    static = _static(response, own)
    verdict = own.verdict if static is not None or bool(np.any(own.at_zero)) else Verdict.DOUBTFUL
    return PathSubject(response=response, static=static, own=own, verdict=verdict)


def _static(response: SampledResponse, own: Poles) -> Array | None:
    """Return the gain at rest, None where an integral makes it grow for ever."""
    if np.any(own.at_zero):
        return None
    gain = response.pair(np.zeros(()))[0]
    return gain if np.isfinite(gain[0].real) else None
