"""Final values far below the peak: the band that an output settles into is a small part of what it has been.

    G(s) = (s + ε)/((s + a)(s + b)) e^{-sτ}:   y(t + τ) = ε/(ab) + A e^-at + B e^-bt,   A = (ε - a)/(a (a - b)), B = (ε - b)/(b (b - a))

Expected values are the last solutions of |y - y∞| = 0.02 y∞, at 50 digits. The bounds of the derivative by ε say what was
measured to be kept, a few 1e-15/ε; they are not derived.
"""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from hypothesis import settings

from engine.analysis.measuring import MetricRequest, measure
from tests.reference.measuring import step
from tests.reference.systems import block, system

mp = mpmath.mp.clone()
mp.dps = 50

SYSTEMS = 50 if settings().max_examples > 1000 else 2


@pytest.mark.parametrize("delay", [0.0, 0.125])
@pytest.mark.parametrize(
    ("small", "close", "slope_close"), [(1e-3, 1e-11, 1e-10), (1e-6, 1e-10, 5e-9), (1e-8, 5e-9, 5e-7)]
)
def test_when_it_settles(small: float, close: float, slope_close: float, delay: float) -> None:
    generator = np.random.default_rng(7)
    for _ in range(SYSTEMS):
        slow, fast = np.sort(10 ** generator.uniform(-0.7, 1.0, 2))
        # binary fractions, so that the polynomial's coefficients are exact
        slow, fast = np.round(slow * 64) / 64, np.round(fast * 64) / 64 + 0.25
        ending = small * slow
        blocks = {
            "u": block("input"),
            "plant": block("transfer_function", numerator=[1.0, "=e"], denominator=[1.0, slow + fast, slow * fast]),
        }
        wires = ["u -> plant"]
        if delay:
            blocks["late"] = block("delay", time=delay)
            wires = ["u -> late", "late -> plant"]
        diagram = system(blocks, wires, {"y": "plant"}, {"e": ending})
        request = MetricRequest(metric="settling_time", signals={"u": step()}, output="y")
        ((measured, gradient),) = measure(diagram, [request], gradient=["e"])
        a, b, e = mp.mpf(slow), mp.mpf(fast), mp.mpf(ending)

        def settled(e: mpmath.mpf, a: mpmath.mpf = a, b: mpmath.mpf = b) -> mpmath.mpf:
            one, two = (e - a) / (a * (a - b)), (e - b) / (b * (b - a))
            band = mp.mpf("0.02") * e / (a * b)
            guess = mp.log(abs(one) / band) / a  # when only the slow exponential is left
            return mp.findroot(lambda t: abs(one) * mp.exp(-a * t) + mp.sign(one) * two * mp.exp(-b * t) - band, guess)

        assert measured.value == pytest.approx(float(settled(e) + delay), rel=close)
        assert gradient is not None
        h = e * mp.mpf(10) ** -15
        slope = (settled(e + h) - settled(e - h)) / (2 * h)
        assert gradient.values[0] == pytest.approx(float(slope), rel=slope_close)
