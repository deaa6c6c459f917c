"""What could be done about a model that fails, with the error that would be left."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

RemedyKind = Literal["offset", "gain", "delay", "saturation", "friction", "direction"]

WORTHWHILE = 0.9
"""What leaves more than this share of the error is no explanation."""
_ROUNDING = 1e-6
"""An error (%) below this needs none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Remedy:
    """A cause, and what the error would be without it.

    Attributes
    ----------
    kind : str
        The suspicion.
    relative_error_percent : float
        Predicted, of the same window.
    values : mapping of str to float
        What was estimated on the way, SI: ``delay``, ``gain``, ``half_width``, a parameter's path ...
    sentence : str
        What to try, for a person.
    """

    kind: RemedyKind
    relative_error_percent: float
    values: Mapping[str, float]
    sentence: str


def worthwhile(predicted: float | None, present: float | None) -> bool:
    """Return whether an error would become so much smaller that it is worth saying."""
    return predicted is not None and present is not None and present > _ROUNDING and predicted < WORTHWHILE * present
