"""What the result of a job is a reply of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from servotune.replies.base import Reply
from servotune.replies.fits import BlackBox, DriveParameters, Identification, StaticCurve, Validation
from servotune.replies.frfs import Frf
from servotune.replies.influence import Influence
from servotune.replies.optimizations import Optimization
from servotune.replies.spectra import Spectrum
from servotune.replies.studies import FrequencyResponse, Simulation

_BY_KIND: Mapping[str, type[Reply]] = {
    "frequency_response": FrequencyResponse,
    "frf": Frf,
    "influence": Influence,
    "optimization": Optimization,
    "simulation": Simulation,
    "spectrum": Spectrum,
    "validation": Validation,
}
_IDENTIFIED: Mapping[str, type[Reply]] = {
    "equation_error": DriveParameters,
    "static_fit": StaticCurve,
    "order": BlackBox,
    "residuals": Identification,
}
"""An identification, by what its result alone has."""


def result_of(kind: str, raw: Mapping[str, Any]) -> Reply:
    """Return the result of a job of this kind; of a kind that is not known, a plain reply."""
    own = _IDENTIFIED.items() if kind == "identification" else ()
    return next((made(raw) for key, made in own if key in raw), _BY_KIND.get(kind, Reply)(raw))
