"""Curves against bounds: values by formulas, derivatives of those, and the batched form against the exact one."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

from engine.analysis.study import MetricRequest, measure
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram
from engine.model.errors import MaskError
from engine.model.masks import Corners, Envelope, FrequencyBounds, Polyline, Rational
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.optimizers.drive import pid_loop
from tests.unit.optimizers.oscillator import oscillator

STEP = {"force": make("step", {})}
Z = 0.5  # of the oscillator with m = c = k = 1
ROOT = math.sqrt(1 - Z * Z)
OVER = math.exp(-math.pi * Z / ROOT)


def value(diagram: Diagram, request: MetricRequest, parameter: str) -> tuple[float, float]:
    ((measured, gradient),) = measure(diagram, [request], gradient=[parameter])
    assert measured.value is not None, measured
    assert gradient is not None
    return measured.value, float(gradient.values[0])


def test_an_envelope_is_met_at_one() -> None:
    mask = Envelope(
        upper=Polyline(times=(0.0, 30.0), values=(1.1, 1.1)), lower=Polyline(times=(6, 30), values=(0.8, 0.9))
    )
    request = MetricRequest(metric="envelope", signals=STEP, output="x", mask=mask)
    found, slope = value(oscillator(), request, "c")
    assert found == pytest.approx(1 + (1 + OVER - 1.1) / 1.1, rel=1e-12)
    # d overshoot / d ζ = -π overshoot / (1 - ζ²)^1.5, and ζ = c / 2.
    assert slope == pytest.approx(-math.pi * OVER / ROOT**3 / 2 / 1.1, rel=1e-10)


def test_an_envelope_that_jumps_holds_from_both_sides() -> None:
    # At rest before the step at 2 s, and 0.2 above it up to 2.5 s: the line is not reached there.
    late = {"force": make("step", {"start": 2.0})}
    mask = Envelope(lower=Polyline(times=(0, 2, 2, 2.5), values=(-0.5, -0.5, -0.2, -0.2)))
    request = MetricRequest(metric="envelope", signals=late, output="x", mask=mask)
    assert value(oscillator(), request, "c")[0] == pytest.approx(1 + (-0.2 - 0.0) / 0.5, rel=1e-12)


def test_behind_its_end_a_response_stays_where_it_is() -> None:
    mask = Polyline(times=(0.0, 1e6), values=(1.0, 1.0))
    request = MetricRequest(metric="tracking_error", signals=STEP, output="x", mask=mask)
    # ∫ e² of the oscillator is ζ + 1/(4ζ), and its error is 0 from then on.
    assert value(oscillator(), request, "c")[0] == pytest.approx(math.sqrt((Z + 1 / (4 * Z)) / 1e6), rel=1e-10)


def test_a_gain_is_held_against_corners_on_both_sides() -> None:
    # |G| = 1/√((1-ω²)² + ω²) rises and is back at 1 at 1 rad/s: there it is nearest to the lower bound.
    flat = FrequencyBounds(lower=Corners(frequencies=(0.1, 1.0), magnitudes=(0.5, 0.5)))
    request = MetricRequest(metric="path_bound", source="force", target="x", mask=flat)
    found, _ = value(oscillator(), request, "c")
    assert found == pytest.approx(0.5, rel=1e-12)
    top = 1 / (2 * Z * ROOT)
    above = FrequencyBounds(upper=Corners(frequencies=(0.01, 100.0), magnitudes=(1.0, 1.0)))
    found, slope = value(oscillator(), MetricRequest(metric="path_bound", source="force", target="x", mask=above), "c")
    assert found == pytest.approx(top, rel=1e-12)
    assert slope == pytest.approx((2 * Z * Z - 1) / (2 * Z * Z * ROOT**3) / 2, rel=1e-8)  # d top / d ζ / 2


def test_an_error_is_held_against_a_weight_down_to_rest() -> None:
    # 1 - G = (s² + s) / (s² + s + 1) against |s + 1| / |s² + s + 1|: their ratio is |jω|, unbounded: refused with a word.
    weight = Rational(numerator=(1.0, 1.0), denominator=(1.0, 1.0, 1.0))
    request = MetricRequest(metric="error_bound", source="force", target="x", mask=FrequencyBounds(upper=weight))
    ((measured, _),) = measure(oscillator(), [request])
    assert measured.value is None
    assert measured.verdict is Verdict.DIVERGES
    # Against (s + 1) / (s + 2) · 2 it tends to 1/2 far out, and is highest where |jω (jω + 2) / (2 (s² + s + 1))| is.
    weight = Rational(numerator=(2.0, 2.0), denominator=(1.0, 2.0))
    request = MetricRequest(metric="error_bound", source="force", target="x", mask=FrequencyBounds(upper=weight))
    omega = np.linspace(0.5, 4.0, 2_000_001)
    s = 1j * omega
    expected = np.abs(s * (s + 2) / (2 * (s * s + s + 1))).max()
    assert value(oscillator(), request, "c")[0] == pytest.approx(expected, rel=1e-10)


REQUESTS: Mapping[str, MetricRequest] = {
    "envelope": MetricRequest(
        metric="envelope", signals={"reference": make("step", {})}, output="position",
        mask=Envelope(upper=Polyline(times=(0, 0.05, 0.05, 0.3), values=(1.3, 1.3, 1.02, 1.02))),
    ),
    "tracking_error": MetricRequest(
        metric="tracking_error", signals={"reference": make("step", {})}, output="position",
        mask=Polyline(times=(0, 0.02, 3.0), values=(0, 1, 1)),
    ),
    "path_bound": MetricRequest(
        metric="path_bound", source="reference", target="position",
        mask=FrequencyBounds(upper=Corners(frequencies=(1.0, 40.0, 400.0), magnitudes=(1.5, 1.2, 0.05))),
    ),
    "sensitivity_bound": MetricRequest(
        metric="sensitivity_bound", open_at="error",
        mask=FrequencyBounds(upper=Corners(frequencies=(1.0, 50.0, 5000.0), magnitudes=(0.02, 1.4, 1.4))),
    ),
    "complementary_bound": MetricRequest(
        metric="complementary_bound", open_at="error",
        mask=FrequencyBounds(upper=Corners(frequencies=(1.0, 1000.0), magnitudes=(1.4, 0.1))),
    ),
    "loop_bound": MetricRequest(
        metric="loop_bound", open_at="error",
        mask=FrequencyBounds(lower=Corners(frequencies=(0.5, 10.0), magnitudes=(100.0, 5.0))),
    ),
    "error_bound": MetricRequest(
        metric="error_bound", source="reference", target="position",
        mask=FrequencyBounds(upper=Rational(numerator=(1.5, 0.5), denominator=(1.0, 60.0))),
    ),
}  # fmt: skip


@pytest.mark.parametrize("delay", [0.0, 0.004])
def test_many_at_once_agree_with_one_by_one(delay) -> None:
    diagram, requests = pid_loop(delay=delay), list(REQUESTS.values())
    names = ["kp", "kd", "velocity_gain"]
    points = {
        "kp": np.array([0.6, 1.0, 1.4]),
        "kd": np.array([1e-3, 2e-3, 3e-3]),
        "velocity_gain": np.array([45.0, 50, 55]),
    }
    found = Screening(diagram, requests)(points)
    for b in range(3):
        here = {name: float(column[b]) for name, column in points.items()}
        lanes = {n: np.array([v * (1 + (1e-30j if n == name else 0)) for name in names]) for n, v in here.items()}
        slopes = Screening(diagram, requests)(lanes).values.imag / 1e-30
        for column, (measured, gradient) in enumerate(measure(diagram, requests, overrides=here, gradient=names)):
            assert measured.value is not None
            assert gradient is not None
            assert not found.doubtful[b, column]
            assert found.values[b, column] == pytest.approx(measured.value, rel=1e-8), requests[column].metric
            elasticities = gradient.values * np.array([here[n] for n in names])
            size = float(np.abs(elasticities).max())
            assert slopes[:, column] == pytest.approx(elasticities, abs=1e-5 * size + 1e-9), requests[column].metric


@pytest.mark.parametrize(
    ("make_it", "message"),
    [
        (lambda: Polyline(times=(0.0,), values=(1.0,)), "at least two"),
        (lambda: Polyline(times=(1.0, 0.5), values=(1.0, 1.0)), "must not fall"),
        (lambda: Polyline(times=(-1.0, 0.5), values=(1.0, 1.0)), ">= 0 s"),
        (lambda: Polyline(times=(1.0, 1.0), values=(1.0, 2.0)), "more than one instant"),
        (lambda: Polyline(times=(0.0, 1.0), values=(1.0, math.inf)), "finite"),
        (lambda: Corners(frequencies=(0.0, 1.0), magnitudes=(1.0, 1.0)), "> 0 rad/s"),
        (lambda: Corners(frequencies=(2.0, 1.0), magnitudes=(1.0, 1.0)), "must rise"),
        (lambda: Corners(frequencies=(1.0, 2.0), magnitudes=(1.0, 0.0)), "magnitudes must be > 0"),
        (lambda: Rational(numerator=(0.0,), denominator=(1.0,)), "not 0"),
        (Envelope, "neither"),
        (lambda: Envelope(upper=Polyline(times=(0, 1), values=(1, 1)), scale=0.0), "scale must be > 0"),
        (FrequencyBounds, "neither"),
        (
            lambda: Envelope(
                upper=Polyline(times=(0, 2), values=(1, 1)), lower=Polyline(times=(1, 3), values=(0.9, 1.3))
            ),
            "got 1 < 1.1 at 2 s",
        ),
    ],
)
def test_bounds_that_make_no_sense_are_refused(make_it, message) -> None:
    with pytest.raises(MaskError, match=message):
        make_it()


def test_without_bounds_a_metric_of_a_curve_says_what_it_needs() -> None:
    ((measured, _),) = measure(oscillator(), [MetricRequest(metric="envelope", signals=STEP, output="x")])
    assert measured.verdict is Verdict.NOT_APPLICABLE
    assert "bounds" in measured.advice
