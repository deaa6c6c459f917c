"""Intervals of 95 % from measured frequency responses hold the truth as often as they say, with few averages and many.

Each line is measured by n averages of its own: X_i and N_i circular normal, Y_i = G X_i + N_i, H1 = Σ Y X* / Σ |X|²; coherence
and deviation by Bendat and Piersol. G is a closed form with a delay. `make proof` measures 100 responses, a few are measured
everywhere; bounds as in `test_confidence`.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import settings
from scipy.stats import binom

from engine.recordings.spectra.frf import Frf
from optimizers.identification import identify
from optimizers.problem import Variable
from optimizers.recorded.measured_response import MeasuredResponse, measured_response
from optimizers.recorded.recording import Identification
from tests.unit.optimizers.test_frequency_identification import OMEGA, TRUTH, closed_form, diagram, experiment

RESPONSES = 100 if settings().max_examples >= 1000 else 12
"""The profile of `make proof` has thousands of examples."""


def estimated(averages: int, seed: int) -> MeasuredResponse:
    rng = np.random.default_rng(seed)
    x, noise = (a + 1j * b for a, b in rng.normal(size=(2, 2, averages, OMEGA.size)))
    y = closed_form(**TRUTH) * x + 0.3 * (1 + OMEGA / 60.0) * noise
    xx, yy, xy = (np.sum(a * np.conj(b), axis=0) for a, b in ((x, x), (y, y), (y, x)))
    coherence = np.abs(xy) ** 2 / (xx.real * yy.real)
    freedom = 2.0 * (averages - 1)
    error = np.sqrt((1 - coherence) / (freedom * coherence))
    frf = Frf(
        frequency=OMEGA, value=xy / xx, coherence=coherence, magnitude_error=error, phase_error=error, freedom=freedom,
        averages=averages, effective_averages=float(averages),
    )  # fmt: skip
    return measured_response(frf, least_coherence=0.0, weighted=True)


@pytest.mark.parametrize("averages", [8, 30])
def test_the_truth_is_within_the_intervals_as_often_as_they_say(averages: int) -> None:
    inside, doubted = dict.fromkeys(TRUTH, 0), 0
    for seed in range(RESPONSES):
        problem = Identification(
            diagram=diagram(), experiments=(), frequency=(experiment(estimated(averages, seed)),),
            parameters=tuple(Variable(parameter=name) for name in TRUTH),
        )  # fmt: skip
        found = identify(problem, rng=np.random.default_rng(0))
        for name, value in TRUTH.items():
            estimate = found.parameters[name]
            assert estimate.lower95 is not None
            assert estimate.upper95 is not None
            inside[name] += estimate.lower95 <= value <= estimate.upper95
        doubted += any("as its coherence explains" in sentence for sentence in found.warnings)
    least = binom.ppf(1e-4, RESPONSES, 0.95)
    for name, count in inside.items():
        assert count >= least, f"{name}: {count} of {RESPONSES}"
    assert doubted <= binom.ppf(1 - 1e-4, RESPONSES, 0.02)
