"""Describing functions: closed forms against Fourier integrals of simulated laws, and limit cycles against known ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from engine.analysis.describing_function import cycles, fourier_gain
from engine.elements import catalogue

CASES = [
    ("saturation", {"lower": -1.0, "upper": 1.0}),
    ("saturation", {"lower": -0.4, "upper": 1.5}),
    ("dead_zone", {"lower": -1.0, "upper": 1.0}),
    ("dead_zone", {"lower": -0.2, "upper": 0.6}),
    ("relay", {"low": -2.0, "high": 3.0, "hysteresis": 0.0}),
    ("relay", {"low": -2.0, "high": 2.0, "hysteresis": 0.8}),
    ("quantizer", {"step": 0.3}),
    ("backlash", {"width": 0.5, "initial": 0.0}),
    ("friction", {"coulomb": 2.0, "viscous": 0.7}),
    ("friction", {"coulomb": 2.0, "viscous": 0.7, "static": 3.0, "stribeck_velocity": 0.4, "coulomb_negative": 1.0}),
    ("lookup_table", {"points": [-1.0, 0.0, 0.5], "values": [-2.0, 0.0, 0.25], "extrapolation": "hold"}),
    ("lookup_table", {"points": [-1.0, 0.0, 0.5], "values": [-2.0, 0.0, 0.25], "extrapolation": "linear"}),
]


def law(kind, given):
    element = catalogue()[kind]
    return element, {p.name: given.get(p.name, p.default) for p in element.parameters}


@pytest.mark.parametrize("amplitude", [0.9, 2.3])
@pytest.mark.parametrize(("kind", "given"), CASES)
def test_the_closed_form_is_the_fourier_integral(kind, given, amplitude):
    element, values = law(kind, given)
    closed = element.describing_function(np.array([amplitude]), values)[0]
    assert fourier_gain(element, values, amplitude) == pytest.approx(closed, rel=1e-9, abs=1e-10)


def test_published_values():
    """Slotine and Li, chapter 5: k = 1, amplitude twice the limit; a relay with x = h/(2 A) = 0.6; Gelb: backlash b/A = 1."""
    element, values = law("saturation", {})
    expected = 2 / math.pi * (math.asin(0.5) + 0.5 * math.sqrt(0.75))
    assert element.describing_function(np.array([2.0]), values)[0] == pytest.approx(expected, rel=1e-14)
    element, values = law("relay", {"hysteresis": 1.2})
    assert element.describing_function(np.array([1.0]), values)[0] == pytest.approx(
        4 / math.pi * (0.8 - 0.6j), rel=1e-14
    )
    element, values = law("backlash", {"width": 1.0})
    assert element.describing_function(np.array([1.0]), values)[0] == pytest.approx(0.5 - 1j / math.pi, rel=1e-14)
    assert element.describing_function(np.array([0.4]), values)[0] == 0.0


def test_stribeck_friction_against_quadrature():
    element, values = law("friction", {"coulomb": 1.0, "static": 1.8, "stribeck_velocity": 0.3})
    amplitude = 0.7

    def integrand(angle):
        v = amplitude * math.sin(angle)
        return (1.0 + 0.8 * math.exp(-((v / 0.3) ** 2))) * math.sin(angle)

    expected = 4 / (math.pi * amplitude) * quad(integrand, 0, math.pi / 2, epsabs=1e-13)[0]
    assert element.describing_function(np.array([amplitude]), values)[0] == pytest.approx(expected, rel=1e-10)


def test_many_edges_of_a_quantizer_are_a_gain_of_one():
    element, values = law("quantizer", {"step": 1.0})
    assert element.describing_function(np.array([0.3]), values)[0] == 0.0
    found = element.describing_function(np.array([900.3, 5e4]), values)
    assert found == pytest.approx(1.0, abs=1e-3)


def test_a_law_of_two_inputs_has_no_describing_function():
    element, values = law("multiplication", {})
    with pytest.raises(ValueError, match="one input and one output, got multiplication"):
        fourier_gain(element, values, 1.0)


def test_a_saturated_loop_of_three_lags():
    """G = -K/(s (s+1) (s+2)): phase -180° at sqrt 2, where |G| = K/6; N = 6/K. It is stable: growing, the gain falls."""
    element, values = law("saturation", {})
    k = 10.0
    w = np.logspace(-2, 2, 400)

    def loop(omega):
        s = 1j * omega
        return -k / (s * (s + 1) * (s + 2))

    (found,) = cycles(lambda a: element.describing_function(a, values), w, loop, 1.0)
    assert found.frequency == pytest.approx(math.sqrt(2), rel=1e-8)
    r = 1 / found.amplitude
    assert 2 / math.pi * (math.asin(r) + r * math.sqrt(1 - r * r)) == pytest.approx(0.6, rel=1e-8)
    assert found.stable


def test_a_dead_zone_in_a_loop_of_too_much_gain_has_an_unstable_cycle():
    """Smaller ones die in the dead zone, larger ones grow: N = 6/K again, N rising with A."""
    element, values = law("dead_zone", {})

    def loop(omega):
        s = 1j * omega
        return -10.0 / (s * (s + 1) * (s + 2))

    (found,) = cycles(lambda a: element.describing_function(a, values), np.logspace(-2, 2, 400), loop, 1.0)
    assert found.frequency == pytest.approx(math.sqrt(2), rel=1e-8)
    assert not found.stable


def test_a_relay_with_hysteresis_and_an_integrator_with_a_lag():
    """-1/N = -(π/(4 M)) (sqrt(A² - b²) + j b), b = h/2; G = 1/(s (s+1)): Im G = -1/(w (1 + w²)), Re G = -1/(1 + w²)."""
    element, values = law("relay", {"hysteresis": 0.2})

    def loop(omega):
        s = 1j * omega
        return -1.0 / (s * (s + 1))

    (found,) = cycles(lambda a: element.describing_function(a, values), np.logspace(-2, 3, 800), loop, 1.0)
    w, a = found.frequency, found.amplitude
    assert w * (1 + w * w) == pytest.approx(4 / (math.pi * 0.1), rel=1e-8)
    assert math.sqrt(a * a - 0.01) * math.pi / 4 == pytest.approx(1 / (1 + w * w), rel=1e-8)
    assert found.stable


def test_a_loop_of_too_little_gain_has_none():
    element, values = law("saturation", {})

    def loop(omega):
        s = 1j * omega
        return -5.0 / (s * (s + 1) * (s + 2))

    assert cycles(lambda a: element.describing_function(a, values), np.logspace(-2, 2, 400), loop, 1.0) == []
