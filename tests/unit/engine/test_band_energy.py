"""Energy in a band as a metric: its value, its exact derivative, and why it may not exist."""

from __future__ import annotations

import math

import pytest

from engine.analysis.measuring import MetricRequest, measure
from engine.diagram.diagram import compile_system
from engine.model.errors import DiagramError
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document


def mode():
    """Return a mode of frequency ``w`` and damping ratio ``z``: position and velocity."""
    denominator = [1, "=2*z*w", "=w**2"]
    return compile_system(
        document(
            {
                "u": block("input"),
                "mode": block("transfer_function", numerator=["=w**2"], denominator=denominator),
                "rate": block("transfer_function", numerator=["=w**2", 0], denominator=denominator),
                "sum": block("integrator"),
            },
            ["u -> mode", "u -> rate", "u -> sum"],
            {"position": "mode", "velocity": "rate", "way": "sum"},
            w=5.0,
            z=0.2,
        )
    )


def request(output: str = "velocity", signal=None, **fields):
    return MetricRequest(metric="band_energy", signals={"u": signal or make("step")}, output=output, **fields)


def test_over_a_wide_band_it_is_the_integral_of_the_square_with_its_derivatives() -> None:
    # velocity after a unit step: ∫ v² dt = w/(4 z); beyond 5e3 rad/s |V| < w²/ω² leaves w⁴/(3π ω³)
    ((measured, gradient),) = measure(mode(), [request(band=(0.0, 5e3))], gradient=["w", "z"])
    assert measured.value == pytest.approx(5 / (4 * 0.2), rel=1e-9)
    assert measured.verdict is Verdict.OK
    assert gradient is not None
    assert gradient.values == pytest.approx([1 / 0.8, -5 / (4 * 0.04)], rel=1e-8)


def test_a_band_of_a_programmed_delay_can_be_empty() -> None:
    # zeros of the command at (2k + 1) π / delay: the mode lies on the first one
    command = make("programmed_delay", {"delay": math.pi / 5, "command": {"kind": "step"}})
    shaped, plain = (
        measure(mode(), [request(signal=signal, band=(4.9, 5.1))])[0][0].value for signal in (command, make("step"))
    )
    # the mean of cos²(ωτ/2) over the band: (π Δ/(2·5))²/3 with Δ = 0.1, to its leading order
    assert shaped / plain == pytest.approx((math.pi * 0.1 / 10) ** 2 / 3, rel=0.02)


@pytest.mark.parametrize(
    ("fields", "verdict", "advice"),
    [
        ({}, Verdict.NOT_APPLICABLE, "it needs 'band'"),
        ({"band": (0.0, 1.0), "output": "position"}, Verdict.DIVERGES, "begin the band above 0"),
        ({"band": (1.0, 2.0), "output": "way"}, Verdict.INTEGRATING, "look at its velocity"),
        ({"band": (1.0, 2.0), "signal": make("sine", {"frequency": 1.0})}, Verdict.NOT_APPLICABLE, "infinite energy"),
        ({"band": (0.0, 1e9)}, Verdict.DOUBTFUL, "at most 200000 frequencies"),
    ],
)
def test_why_it_may_not_exist(fields, verdict, advice) -> None:
    measured, _ = measure(mode(), [request(**fields)])[0]
    assert (measured.value, measured.verdict) == (None, verdict)
    assert advice in measured.advice


def test_of_a_position_above_zero_frequency_it_exists() -> None:
    measured, _ = measure(mode(), [request("position", band=(0.5, 50.0))])[0]
    assert measured.verdict is Verdict.OK
    assert measured.value > 0


@pytest.mark.parametrize("band", [(-1.0, 1.0), (2.0, 2.0), (1.0, math.inf), (math.nan, 1.0)])
def test_a_band_that_is_none_is_refused(band) -> None:
    with pytest.raises(DiagramError, match="band must be"):
        request(band=band)
