"""The paper's pneumatic motor under PID: every metric and elasticity against 40 digits, to 1e-9.

Motor of the seed paper, section 3, eq. (1)-(2), mid-range values; PID with N = 100 rad/s. The expected digits below were
computed by partial fractions at 40 digits, and `mpmath_oracle` computes them anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from engine.analysis.study import MetricRequest
from tests.reference import mpmath_oracle as oracle
from tests.reference.measuring import TIME_METRICS, elasticities, expect, loop_metrics, step, time_metrics
from tests.reference.systems import pneumatic_loop

mp = oracle.mp

EXACT = {
    (100.0, 20.0, 5.0): {
        "rise_time": "1.12926550584625",
        "settling_time": "10.2149965109608",
        "overshoot": "0.0873231787804261",
        "peak_time": "3.0654123189545",
        "gain_margin": "2.93536534998578",
        "phase_margin": "1.47325789684602",
        "bandwidth": "1.70918875182118",
    },
    (80.0, 10.0, 2.0): {
        "rise_time": "1.30187079",
        "settling_time": "14.22076876",
        "overshoot": "0.0710599124",
        "gain_margin": "3.45934648",
        "bandwidth": "1.37652969",
    },
}


def loop(gains: Mapping[str, Any]) -> oracle.Rational:
    """L(s) = C(s) H(s) in the paper's units, which cancel."""
    area, volume, chi, pressure = mp.mpf(65), mp.mpf(750), mp.mpf("1.4"), mp.mpf(5)
    mass, friction, leakage, n = mp.mpf("0.3"), mp.mpf("1.2"), mp.mpf("0.4"), mp.mpf(100)
    compliance = volume / (chi * pressure)
    bracket = [compliance * mass, compliance * friction + mass * leakage, area**2 + leakage * friction, mp.mpf(0)]
    kp, ki, kd = gains["kp"], gains["ki"], gains["kd"]
    pid = [kp + kd * n, kp * n + ki, ki * n]
    return oracle.Rational(oracle.multiply([area], pid), oracle.multiply([mp.mpf(1), n, mp.mpf(0)], bracket))


def gains(kp: float, ki: float, kd: float) -> dict[str, Any]:
    return {"kp": mp.mpf(kp), "ki": mp.mpf(ki), "kd": mp.mpf(kd)}


@pytest.mark.parametrize("values", EXACT)
def test_the_oracle_confirms_the_published_digits(values: tuple[float, float, float]) -> None:
    here = loop(gains(*values))
    known = {
        **oracle.step_metrics(here.closed()),
        **oracle.loop_metrics(here),
        "bandwidth": oracle.bandwidth(here.closed()),
    }
    for metric, digits in EXACT[values].items():
        places = len(digits.replace(".", "").lstrip("0"))
        assert abs(known[metric] / mp.mpf(digits) - 1) < mp.mpf(10) ** (1 - places), metric


@pytest.mark.parametrize("values", EXACT)
def test_time_metrics(values: tuple[float, float, float]) -> None:
    exact = oracle.step_metrics(loop(gains(*values)).closed())
    got = time_metrics(pneumatic_loop(*values), "reference", "position", TIME_METRICS)
    for metric in TIME_METRICS:
        # A static gain of 1 is a sum of five modes in the engine: the error of rest is its rounding.
        expect(got[metric], exact[metric], relative=1e-9, absolute=1e-12)


def test_the_digits_of_the_issue() -> None:
    got = time_metrics(pneumatic_loop(), "reference", "position", TIME_METRICS)
    study = loop_metrics(pneumatic_loop())
    for metric, digits in EXACT[100.0, 20.0, 5.0].items():
        if metric in got:
            expect(got[metric], digits)
        elif metric in study.metrics:
            expect(study.metrics[metric], digits)


@pytest.mark.parametrize("values", EXACT)
def test_error_integrals_over_all_time(values: tuple[float, float, float]) -> None:
    exact = oracle.error_integrals(loop(gains(*values)).closed())
    got = time_metrics(pneumatic_loop(*values), "reference", "position", ("iae", "ise", "itae"), duration=None)
    for metric, value in exact.items():
        expect(got[metric], value)


@pytest.mark.parametrize("values", EXACT)
def test_loop_metrics(values: tuple[float, float, float]) -> None:
    exact = oracle.loop_metrics(loop(gains(*values)))
    study = loop_metrics(pneumatic_loop(*values))
    for metric in ("gain_margin", "phase_margin", "delay_margin", "sensitivity_peak", "complementary_peak"):
        expect(study.metrics[metric], exact[metric])


ELASTICITIES = [
    # metric, output, four digits of the published table (kp, ki, kd)
    ("rise_time", (-0.2384, -0.0985, 0.0120)),
    ("settling_time", (-0.0204, -0.4910, 0.0075)),
    ("overshoot", (-1.2047, 0.7901, -0.0309)),
    ("gain_margin", (-1.1109, -0.0052, 0.1161)),
    ("bandwidth", (0.8730, 0.1083, -0.0778)),
]


@pytest.mark.parametrize(("metric", "published"), ELASTICITIES)
def test_elasticities(metric: str, published: tuple[float, ...]) -> None:
    def exact(at: Mapping[str, Any]) -> Any:
        here = loop(at)
        if metric == "bandwidth":
            return oracle.bandwidth(here.closed())
        return (
            oracle.loop_metrics(here)[metric] if metric == "gain_margin" else oracle.step_metrics(here.closed())[metric]
        )

    time_domain = metric in TIME_METRICS
    request = MetricRequest(
        metric=metric,
        signals={"reference": step()} if time_domain else {},
        output="position" if time_domain else None,
        open_at="error" if metric == "gain_margin" else None,
        source="reference" if metric == "bandwidth" else None,
        target="position" if metric == "bandwidth" else None,
    )
    _, got = elasticities(pneumatic_loop(), request, ("kp", "ki", "kd"))
    assert got == pytest.approx(published, abs=5.1e-5)
    at = gains(100, 20, 5)
    for parameter, value in zip(("kp", "ki", "kd"), got, strict=True):
        assert value == pytest.approx(float(oracle.elasticity(exact, at, parameter)), rel=1e-7)
