"""The verdict of a validation: within the limit or not, and what the comparison cannot show.

    pass: relative error of every output <= limit (10 % unless asked otherwise);   best: <= 1 % and within the limit

10 % is what the literature on servo drives accepts of a simulation, 1 % the best that it reports.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from engine.recordings.fit import Fit, passes

LIMIT_PERCENT = 10.0
BEST_PERCENT = 1.0


class Grade(StrEnum):
    """How good a model is."""

    BEST = "best"
    PASS = "pass"  # noqa: S105 - a word, no secret
    FAIL = "fail"


def grade(fits: Mapping[str, Fit], limit_percent: float = LIMIT_PERCENT) -> Grade:
    """Return the grade of all outputs together; an output without a relative error fails.

    Parameters
    ----------
    fits : mapping of output to Fit
    limit_percent : float
    """
    if not passes(fits, limit_percent):
        return Grade.FAIL
    return Grade.BEST if passes(fits, min(BEST_PERCENT, limit_percent)) else Grade.PASS


def remarks(name: str, fit: Fit, trivial: Mapping[str, Fit]) -> tuple[str, ...]:
    """Return sentences on what one output's comparison cannot show.

    Parameters
    ----------
    name : str
        Of the output.
    fit : Fit
        Of the model.
    trivial : mapping of baseline to Fit
    """
    said = []
    if fit.fit_percent is None:
        said.append(f"{name} is constant in the window: it shows nothing of the dynamics, and FIT and VAF do not exist")
    if fit.relative_error_percent is None:
        said.append(f"{name} is 0 throughout the window: no error can be relative to it")
    else:
        error = fit.relative_error_percent
        better = {
            kind: other.relative_error_percent
            for kind, other in trivial.items()
            if other.relative_error_percent is not None and other.relative_error_percent <= error
        }
        said += [
            f"the trivial model {_WORDS.get(kind, kind)} does as well for {name} ({value:.3g} % beside {error:.3g} %): "
            "the comparison says nothing of the model's dynamics"
            for kind, value in better.items()
            if fit.fit_percent is not None
        ]
    return tuple(said)


_WORDS = {
    "mean": '"the mean of the measurement"',
    "input": '"output = input"',
    "static_gain": '"a constant gain"',
}
