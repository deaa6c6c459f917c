"""Candidates of the benchmark's loop, found among a million, of whose margins the frequency table alone shows nothing.

A margin's crossings lie between two samples, a summit of |1/(1 + L)| between two that are equal to 1e-5, or it is far narrower
than their distance: each is as the exact path says, or in doubt.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import settings

from bench import inner_velocity_loop as inner
from engine.batch.kernels import batch
from engine.batch.screening import Screening
from tests.reference.batch_agreement import compare

CASES = {
    "|L| rises to 1 and falls again": (22.0113, 0.0115466, 0.000161803, 0.00331781, 0.607619),
    "Im L touches 0 where the samples still rise": (13.4449, 0.00842748, 0.000423023, 0.0079215, 0.267392),
    "Im L touches 0 where the samples hardly rise": (18.8669, 0.0236776, 0.00030675, 0.00106728, 0.33559),
    "two low summits with a trough between two samples": (26.752, 0.00885846, 0.000516776, 0.00202256, 0.189373),
    "a summit of 37,554": (17.6535, 0.0306853, 0.000785475, 0.0131457, 0.728792),
}


@pytest.mark.parametrize("case", CASES)
def test_what_happens_between_samples_is_not_missed(case):
    # with neighbours, so that some lie before and some behind where nothing is crossed any more
    factors = 1.0 + np.array([-1e-5, 0.0, 1e-5])
    candidates = {name: value * np.ones(3) for name, value in zip(inner.PARAMETERS, CASES[case], strict=True)}
    candidates["kp"] = candidates["kp"] * factors
    requests = [request for request in inner.requests() if not request.signals]
    screened = Screening(inner.diagram(), requests)(candidates)
    found = compare(inner.diagram(), requests, candidates, screened)
    assert not found.wrong, "\n".join(found.wrong)
    assert found.compared >= 10


@pytest.mark.parametrize("sample", [inner.sample, inner.wide])
def test_a_table_five_times_as_dense_shows_nothing_more(sample, monkeypatch):
    candidates = sample(262_144 if settings().max_examples > 1000 else 4096, seed=11)
    requests = [request for request in inner.requests() if not request.signals]
    usual = Screening(inner.diagram(), requests)(candidates)
    monkeypatch.setattr(batch, "_PER_DECADE", 5 * batch._PER_DECADE)
    dense = Screening(inner.diagram(), requests)(candidates)
    sure = ~(usual.doubtful | dense.doubtful)
    assert sure.mean() > 0.99
    np.testing.assert_allclose(usual.values[sure], dense.values[sure], rtol=1e-7)
