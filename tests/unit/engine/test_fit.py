from __future__ import annotations

import numpy as np
import pytest

from engine.recordings.fit import baselines, compare, examine_residuals, passes, worst_interval


def test_each_measure_follows_its_own_definition():
    # y = 3, 4, 5; error = 0, 1, 0: mean 4, ||y - mean|| = √2, ||y|| = √50, var e = 2/9, var y = 2/3, rms e = √(1/3)
    fit = compare(np.array([3.0, 4.0, 5.0]), np.array([3.0, 3.0, 5.0]))
    assert fit.fit_percent == pytest.approx(100 * (1 - 1 / np.sqrt(2)), rel=1e-14)
    assert fit.relative_error_percent == pytest.approx(100 / np.sqrt(50), rel=1e-14)
    assert fit.vaf_percent == pytest.approx(100 * (1 - 1 / 3), rel=1e-14)
    assert fit.nrmse_percent == pytest.approx(100 * np.sqrt(1 / 3) / 5, rel=1e-14)


def test_a_perfect_model_and_the_mean_are_the_ends_of_the_fit_scale():
    y = np.array([1.0, 2.0, 4.0])
    assert compare(y, y).fit_percent == 100
    assert compare(y, np.full(3, y.mean())).fit_percent == pytest.approx(0, abs=1e-12)


def test_measures_with_a_vanishing_denominator_do_not_exist():
    constant = compare(np.full(5, 0.1), np.zeros(5))
    assert (constant.fit_percent, constant.vaf_percent) == (None, None)
    assert constant.relative_error_percent == pytest.approx(100)
    silent = compare(np.zeros(5), np.ones(5))
    assert silent.relative_error_percent is None
    assert compare(-np.arange(1.0, 4.0), np.zeros(3)).nrmse_percent is None


@pytest.mark.parametrize(
    ("measured", "simulated"),
    [(np.zeros(3), np.zeros(4)), (np.zeros(0), np.zeros(0)), (np.zeros((2, 2)), np.zeros((2, 2)))],
)
def test_signals_that_cannot_be_compared_are_refused(measured, simulated):
    with pytest.raises(ValueError, match="equal length"):
        compare(measured, simulated)


def test_baselines_are_the_best_of_their_kind():
    u = np.array([[0.0, 1.0, 2.0, 3.0], [5.0, 5.0, 5.0, 9.0]])
    y = 2 * u[0] + 7
    without = baselines(y, u)
    assert without["mean"].fit_percent == pytest.approx(0, abs=1e-12)
    # the better copy is the second input: its error 2, 4, 6, 4 is smaller than the first one's 7, 8, 9, 10
    assert without["input"].relative_error_percent == pytest.approx(100 * np.sqrt(72 / float(y @ y)))
    offset = baselines(y, u[:1], constant=True)
    assert offset["static_gain"].fit_percent == pytest.approx(100)
    # u - mean u + mean y misses u - mean u once more: half the spread of y
    assert offset["input"].fit_percent == pytest.approx(50)


def test_the_worst_interval_is_where_the_error_is():
    error = np.zeros(1000)
    error[400:450] = 1.0
    assert worst_interval(error, np.zeros(1000), sample_time=0.01) == (4.0, pytest.approx(4.49))


def test_the_verdict_is_the_worst_output():
    y = np.array([3.0, 4.0])
    good, bad = compare(y, 1.05 * y), compare(y, 1.2 * y)
    assert passes({"a": good}, 10.0)
    assert not passes({"a": good, "b": bad}, 10.0)
    assert not passes({"a": compare(np.zeros(2), y)}, 10.0)


def test_white_residuals_pass_and_coloured_ones_do_not():
    rng = np.random.default_rng(1)
    white, u = rng.normal(size=4000), rng.normal(size=(1, 4000))
    assert examine_residuals(white, u).white
    coloured = np.convolve(white, [1, 0.9, 0.8, 0.7])[:4000]
    tests = examine_residuals(coloured, u)
    assert not tests.white
    assert tests.autocorrelation[0] == pytest.approx(1)
    # moving average 1, .9, .8, .7: ρ1 = (.9 + .72 + .56) / (1 + .81 + .64 + .49) = 2.18 / 2.94
    assert tests.autocorrelation[1] == pytest.approx(2.18 / 2.94, abs=0.03)
    assert tests.independent


def test_residuals_that_still_hold_the_input_are_told_apart():
    rng = np.random.default_rng(2)
    u = rng.normal(size=(2, 4000))
    tests = examine_residuals(
        rng.normal(size=4000) + 0.3 * np.roll(u[1], 3) + 0.3 * np.roll(u[1], 4) + 0.3 * np.roll(u[1], 5), u
    )
    assert not tests.independent
    assert np.argmax(np.abs(tests.cross_correlation[1])) - 25 in {3, 4, 5}
    assert np.abs(tests.cross_correlation[0]).max() < 3 * tests.cross_correlation_bound[0]


def test_degenerate_residuals_have_no_correlation_instead_of_an_error():
    tests = examine_residuals(np.zeros(10), np.zeros((1, 10)))
    assert tests.white
    assert tests.independent
    assert not tests.cross_correlation.any()
