"""A number that may not exist, with the word that says why."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Verdict(StrEnum):
    """The words of a metric, an elasticity or a variant."""

    OK = "ok"
    UNSTABLE = "unstable"
    MARGINAL = "marginal"
    INTEGRATING = "integrating"
    NOT_SETTLED = "not_settled"
    NEVER_CROSSES = "never_crosses"
    ZERO_STATIC_GAIN = "zero_static_gain"
    NOT_OSCILLATORY = "not_oscillatory"
    DIVERGES = "diverges"
    ILL_POSED = "ill_posed"
    DISCONTINUOUS = "discontinuous"
    ZERO_BASE = "zero_base"
    NOT_APPLICABLE = "not_applicable"
    TOO_SHORT = "too_short"
    DOUBTFUL = "doubtful"


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """The value of a metric, or the verdict that says why there is none.

    ``value`` is None unless the metric exists; ``at`` is the time (s) or angular
    frequency (rad/s) where it is found; ``advice`` is a sentence for the user.
    Where the output has not settled, ``settled_from`` is what was taken for where it settles,
    and ``doubt`` how far the rest may change the value (in its unit; None where that is not known).
    ``reference`` is what an error compares the output with: an input, "0", or "itself" for an output that is the error.
    """

    value: float | None
    unit: str
    verdict: Verdict = Verdict.OK
    advice: str = ""
    at: float | None = None
    doubt: float | None = None
    settled_from: str = ""
    reference: str = ""
