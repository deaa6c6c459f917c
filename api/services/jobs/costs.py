"""What a request is expected to cost, before it is computed: about the seconds that it takes.

::

    cost = variants * (1 + states / 20)^2 * (1 + oscillations / 100) * 10 ms    (nonlinear, or with delays or samplers: * 5)
    oscillations = horizon * (largest |pole|) / (2 pi)
    horizon = the duration, or 5 / (slowest decay) where the service is to choose it

It only tells what is quick from what is large. Whoever is taken for quick, and is not, is computed as large a second later.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from engine.diagram.diagram import Diagram
from engine.model.errors import EngineError

#: s for the simplest response, with its metrics.
_SIMPLEST = 0.01
#: States above which not even the poles are computed here.
_MANY_STATES = 60
#: Time constants that a horizon of the service's own covers.
_CONSTANTS = 5.0
#: s for a number of a reply, or of a recording that is transformed.
_NUMBER = 1e-6


def of_numbers(count: float) -> float:
    """Return the cost of so many numbers, read or written."""
    return _NUMBER * count


def of_system(
    diagram: Diagram,
    *,
    duration: float | None = None,
    variants: float = 1,
    overrides: Mapping[str, float] | None = None,
) -> float:
    """Return the cost of as many variants of a response; 0 for a system that cannot be realised, which is then told."""
    try:
        system = diagram.realize(overrides or {})
    except EngineError:
        return 0.0
    states = int(system.a.shape[0])
    hard = 5.0 if diagram.nonlinear or diagram.sampled or system.delays.size else 1.0
    each: float = hard * (1.0 + states / 20.0) ** 2
    if states > _MANY_STATES or not np.isfinite(system.a).all():
        return variants * each
    poles = np.linalg.eigvals(system.a) if states else np.zeros(0)
    fastest = float(np.abs(poles).max(initial=0.0))
    decays = -poles.real[poles.real < -1e-9 * fastest]
    horizon = duration if duration is not None else _CONSTANTS / float(decays.min()) if decays.size else 0.0
    return variants * each * _SIMPLEST * (1.0 + horizon * fastest / (200.0 * np.pi))
