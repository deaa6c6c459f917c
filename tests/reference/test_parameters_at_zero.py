"""Loops with a gain at 0, which brings a state of its own as soon as it is not: the filter of a derivative, an integral.

L = (kp + ki/s + kd s/(1 + s/w)) K e^{-s τ} / (s (1 + 2 ζ s/v + s²/v²)),   margins and their derivatives at 40 digits
"""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from engine.analysis.measuring import MetricRequest, measure
from engine.batch.screening import Screening
from tests.reference.systems import block, system

mp = mpmath.mp.clone()
mp.dps = 40

GAIN, RATE, DAMPING, DELAY, FILTER = 4.0, 60.0, 0.15, 0.004, 300.0
LOOPS = {"kd beside an integral": ("kd", 3.0, 1.5, 0.0), "kd": ("kd", 3.0, 0.0, 0.0), "ki": ("ki", 3.0, 0.0, 0.02)}
METRICS = ("phase_margin", "gain_margin", "delay_margin")


def loop(kp, ki, kd, frequency):
    """Return L(jω) by its formula."""
    s = mp.mpc(0, frequency)
    law = kp + ki / s + kd * s / (1 + s / FILTER)
    return law * GAIN * mp.exp(-s * DELAY) / (s * (1 + 2 * DAMPING * s / RATE + s**2 / RATE**2))


def margins(kp, ki, kd):
    """Return phase (rad), gain and delay margin (s); each loop here has one crossing of either kind that counts."""
    crossover = mp.findroot(lambda w: abs(loop(kp, ki, kd, w)) - 1, (8, 20), solver="anderson")
    phase = mp.pi + mp.arg(loop(kp, ki, kd, crossover))
    turned = mp.findroot(lambda w: mp.im(loop(kp, ki, kd, w)), (45, 70), solver="anderson")
    return [phase, 1 / abs(loop(kp, ki, kd, turned)), phase / crossover]


def diagram(kp, ki, kd):
    """Return the same loop as blocks."""
    plant = block("transfer_function", numerator=[GAIN], denominator=[1 / RATE**2, 2 * DAMPING / RATE, 1.0, 0.0])
    return system(
        {
            "r": block("input"),
            "error": block("sum", signs="+-"),
            "law": block("pid", kp=kp, ki=ki, kd=kd, filter_frequency=FILTER),
            "late": block("delay", time=DELAY),
            "plant": plant,
        },
        ["r -> error.in1", "plant -> error.in2", "error -> law", "law -> late", "late -> plant"],
        {"y": "plant"},
    )


@pytest.mark.parametrize("case", LOOPS)
def test_margins_move_with_a_gain_at_zero_as_the_formula_does(case):
    name, *gains = LOOPS[case]
    at = ("kp", "ki", "kd").index(name)

    def moved(value):
        return margins(*(value if k == at else gain for k, gain in enumerate(gains)))

    requests = [MetricRequest(metric=metric, open_at="error") for metric in METRICS]
    found = measure(diagram(*gains), requests, gradient=[f"law.{name}"])
    step = mp.mpf(10) ** -12
    below, above = moved(-step), moved(step)
    assert [measured.value for measured, _ in found] == pytest.approx([float(v) for v in margins(*gains)], rel=1e-10)
    slopes = [gradient.values[0] for _, gradient in found if gradient is not None]
    assert slopes == pytest.approx([float((b - a) / (2 * step)) for a, b in zip(below, above, strict=True)], rel=1e-8)


def test_what_never_comes_to_rest_has_a_value_and_no_derivative():
    requests = [MetricRequest(metric="bandwidth", source="r", target="y")]
    ((measured, gradient),) = measure(diagram(3.0, 0.0, 0.02), requests, gradient=["law.ki"])
    ((alone, _),) = measure(diagram(3.0, 0.0, 0.02), requests)
    assert (measured.value, measured.verdict) == (alone.value, "ok")
    assert gradient is not None
    assert np.isnan(gradient.values).all()


def test_an_integral_that_hardly_acts_is_measured_or_doubted_and_never_called_unstable():
    small = np.array([1e-2, 1e-4, 1e-6, 1e-9])
    requests = [MetricRequest(metric=metric, open_at="error") for metric in METRICS]
    found = Screening(diagram(3.0, 0.0, 0.02), requests)({"law.ki": small})
    assert not (found.growth >= 0).any()
    expected = np.array([[float(value) for value in margins(3.0, ki, 0.02)] for ki in small])
    assert np.all(found.doubtful | np.isclose(found.values, expected, rtol=1e-7))
    assert not found.doubtful[0].any()


@pytest.mark.parametrize("delay", [0.0, 0.1])
@pytest.mark.parametrize("ki", [1e-2, 1e-4, 1e-7, 1e-10])
def test_a_crossing_far_below_every_corner_is_found(ki, delay):
    # |L| = |0.1 + ki/s| / |s² + 0.2 s + 1| is 1 only where the integral alone makes it so
    def loop(w):
        s = mp.mpc(0, w)
        return (mp.mpf("0.1") + ki / s) * mp.exp(-s * delay) / (s**2 + s / 5 + 1)

    crossover = mp.findroot(lambda scale: abs(loop(scale * ki)) - 1, (0.9, 1.1), solver="anderson") * ki
    blocks = {
        "r": block("input"),
        "error": block("sum", signs="+-"),
        "law": block("pi", kp=0.1, ki=ki),
        "late": block("delay", time=delay) if delay else block("gain", gain=1.0),
        "plant": block("transfer_function", numerator=[1.0], denominator=[1.0, 0.2, 1.0]),
    }
    wires = ["r -> error.in1", "plant -> error.in2", "error -> law", "law -> late", "late -> plant"]
    requests = [MetricRequest(metric=metric, open_at="error") for metric in ("phase_margin", "delay_margin")]
    drawn = system(blocks, wires, {"y": "plant"})
    phase = mp.pi + mp.arg(loop(crossover))
    expected = [float(phase), float(phase / crossover)]
    assert [measured.value for measured, _ in measure(drawn, requests)] == pytest.approx(expected, rel=1e-9)
    found = Screening(drawn, requests)({"law.ki": np.array([ki])})
    assert np.all(found.doubtful | np.isclose(found.values, expected, rtol=1e-7))
