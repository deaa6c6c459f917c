"""What stands beside the intervals: residuals that are not white or explained by inputs, a choice that might be another."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from engine.recordings.fit import ResidualTests
from optimizers.identification.result import Estimate, Judged, JudgedResponse
from optimizers.identification.ways import Tried
from optimizers.recorded.measured_response import FrequencyExperiment

_EXACT = 1e-4
"""In percent of the output's spread: residuals smaller than this are no measurement's, but rounding."""

_TELLING = 9.21
"""Twice a difference of log-likelihoods from which on one of two ways is a hundred times as likely as the other."""


def doubts(experiments: Sequence[Judged], inputs: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """Return a sentence on every output whose residuals say that the intervals may be wrong.

    Parameters
    ----------
    experiments : sequence of Judged
    inputs : sequence of sequence of str
        The recorded inputs of each experiment.
    """
    said = []
    for judged, names in zip(experiments, inputs, strict=True):
        where = f" in {judged.name}" if judged.name else ""
        for output, tests in judged.residuals.items():
            fit = judged.estimation[output].fit_percent
            if fit is not None and fit > 100.0 - _EXACT:
                continue
            if not tests.independent:
                said.append(
                    f"{_explained(tests, names, output + where)}: the model is wrong there, and no interval knows of it"
                )
            if not tests.white:
                said.append(
                    f"the residuals of {output}{where} are not white (Ljung-Box statistic {tests.ljung_box:.3g}, which white ones "
                    f"keep below {tests.ljung_box_limit:.3g} in 99 of 100 recordings): the intervals allow for their colour as "
                    "that of a noise, and are too narrow where it is an error of the model"
                )
    return tuple(said)


def doubted_responses(
    experiments: Sequence[FrequencyExperiment], judged: Sequence[Mapping[str, JudgedResponse]]
) -> tuple[str, ...]:
    """Return a sentence on every measured response that the intervals may be wrong about.

    Parameters
    ----------
    experiments : sequence of FrequencyExperiment
    judged : sequence of mapping of output to JudgedResponse
        Of each experiment; empty where the model has no response.
    """
    said = []
    for experiment, outputs in zip(experiments, judged, strict=bool(judged)):
        where = f" in {experiment.name}" if experiment.name else ""
        said += [f"{remark}{where}" for remark in experiment.remarks]
        for output, one in outputs.items():
            if one.fit_percent is not None and one.fit_percent > 100.0 - _EXACT:
                continue
            if one.lines_left_out:
                said.append(
                    f"{one.lines_left_out} of {one.lines + one.lines_left_out} lines of {output}{where} are left out: no input is "
                    "there, or too little coherence"
                )
            if one.scatter is not None and one.scatter_limit is not None and one.scatter > one.scatter_limit:
                said.append(
                    f"the measured response of {output}{where} is {math.sqrt(one.scatter):.3g} times as far from the model as its "
                    f"coherence explains (chance seldom exceeds {math.sqrt(one.scatter_limit):.3g}): the model is "
                    "wrong there, or the measurement has a systematic error, and no interval knows of it"
                )
            if one.white is False:
                said.append(
                    f"the errors of the measured response of {output}{where} are not independent from line to line: the intervals "
                    "allow for that as for a noise, and are too narrow where it is an error of the model"
                )
    return tuple(said)


def as_likely(best: Tried, other: Tried) -> bool:
    """Tell whether a way between the samples fits so well that nothing decides against it.

    With as many parameters, n ln(cost / least cost) is twice the difference of the log-likelihoods.
    """
    if best.found is None or other.found is None or not best.found.cost > 0.0:
        return False
    return best.found.residuals.size * math.log(other.found.cost / best.found.cost) < _TELLING


def undecided(tried: Sequence[Tried], estimates: Mapping[str, Estimate]) -> tuple[str, ...]:
    """Return a sentence on each way between the samples that fits about as well and leads elsewhere.

    Parameters
    ----------
    tried : sequence of Tried
        The best first.
    estimates : mapping of str to Estimate
        With the best way alone.
    """
    best, *others = tried
    said = []
    for one in others:
        if one.found is None or one.way is None or not as_likely(best, one):
            continue
        values = one.search.values(one.found.x)
        away = [name for name, own in estimates.items() if not _within(values[name], own)]
        if away:
            would = ", ".join(f"{name} = {values[name]:.4g} {estimates[name].unit}".rstrip() for name in away)
            said.append(
                f"inputs taken as {one.way} between their samples fit about as well as {best.way}, with {would}: the intervals "
                "reach over both, say in between_samples which they are"
            )
    return tuple(said)


def _within(value: float, own: Estimate) -> bool:
    lower, upper = own.lower95, own.upper95
    return (lower is None or value >= lower) and (upper is None or value <= upper)


def _explained(tests: ResidualTests, names: Sequence[str], output: str) -> str:
    """Say which input explains most."""
    lags = tests.cross_correlation.shape[1] // 2
    causal = np.abs(tests.cross_correlation[:, lags:])
    strongest = int(np.argmax(causal / tests.cross_correlation_bound[:, None]))
    source, lag = divmod(strongest, causal.shape[1])
    value, bound = causal[source, lag], tests.cross_correlation_bound[source]
    return (
        f"{names[source]} still explains a part of the residuals of {output} (correlation {value:.2g} at {lag} samples, which "
        f"chance keeps below {bound:.2g} in 99 of 100)"
    )
