from __future__ import annotations

import numpy as np
import pytest

from engine.recordings.validation.comparison import Comparison
from engine.recordings.validation.prediction import one_step
from tests.unit.engine.validation.lags import H, chirp, lag


def test_a_prediction_scores_high_where_the_simulation_is_useless() -> None:
    y = lag(chirp())
    found = one_step(Comparison(name="y", measured=y, simulated=np.zeros(y.size), sample_time=H))
    assert found is not None
    assert found.model.fit_percent is not None
    assert found.model.fit_percent > 99
    # the last sample repeated misses a sine of angular frequency w by w h of its size: at most 2 π 8.5 Hz x 1 ms = 5 %
    assert found.last_sample.fit_percent is not None
    assert 95 < found.last_sample.fit_percent < 99


def test_white_residuals_cannot_be_foretold() -> None:
    y, noise = lag(chirp()), np.random.default_rng(3).normal(scale=0.1, size=4000)
    found = one_step(Comparison(name="y", measured=y + noise, simulated=y, sample_time=H))
    assert found is not None
    simulation = 100 * float(np.linalg.norm(noise) / np.linalg.norm(y + noise))
    assert found.model.relative_error_percent == pytest.approx(simulation, rel=0.01)


def test_an_autoregression_is_foretold_to_its_innovations() -> None:
    y, rng = lag(chirp(20_000)), np.random.default_rng(5)
    white = rng.normal(scale=0.01, size=y.size)
    coloured = np.zeros(y.size)
    for i in range(1, y.size):
        coloured[i] = 0.9 * coloured[i - 1] + white[i]
    found = one_step(Comparison(name="y", measured=y + coloured + 3.0, simulated=y, sample_time=H, constant=True))
    assert found is not None
    expected = 100 * float(np.linalg.norm(white) / np.linalg.norm(y + coloured + 3.0))
    assert found.model.relative_error_percent == pytest.approx(expected, rel=0.02)


def test_too_short_a_window_has_no_prediction() -> None:
    y = lag(chirp(30))
    assert one_step(Comparison(name="y", measured=y, simulated=y, sample_time=H)) is None
