"""Measured and simulated frequency responses of a validation as a body."""

from __future__ import annotations

from typing import Any

import numpy as np

from api.convert.values import number, numbers
from engine.recordings.spectra.frf import unwrapped
from engine.recordings.validation.spectrum import FrequencyDomain


def frequency_domain_to_wire(found: FrequencyDomain, points: int | None) -> dict[str, Any]:
    """Return the comparison with its curves, every so many lines where there are more than ``points``."""
    measured, simulated, comparison = found.measured, found.simulated, found.comparison
    count = measured.frequency.size
    part = slice(None, None, 1 if points is None else max(-(-count // points), 1))
    bounds = found.bounds
    return {
        "input": found.source,
        "estimator": "H1",
        "averages": measured.averages,
        "lines": count,
        "lines_of": found.lines,
        "frequency": numbers(measured.frequency[part]),
        "coherence": None if measured.coherence is None else numbers(measured.coherence[part]),
        "measured": {
            "magnitude": numbers(np.abs(measured.value)[part]),
            "phase": numbers(unwrapped(measured.value)[part]),
        },
        "simulated": {"magnitude": numbers(np.abs(simulated)[part]), "phase": numbers(unwrapped(simulated)[part])},
        "bounds": None
        if bounds is None
        else {
            "confidence": bounds.level,
            "magnitude_lower": numbers(bounds.magnitude_lower[part]),
            "magnitude_upper": numbers(bounds.magnitude_upper[part]),
            "phase_lower": numbers(bounds.phase_lower[part]),
            "phase_upper": numbers(bounds.phase_upper[part]),
        },
        "relative_error_percent": number(comparison.relative_error_percent),
        "median_deviation": number(comparison.median_deviation),
        "worst_deviation": number(comparison.worst_deviation),
        "worst_frequency": number(comparison.worst_frequency),
        "within_percent": number(comparison.within_percent),
        "unexplained_percent": number(found.unexplained_percent),
    }
