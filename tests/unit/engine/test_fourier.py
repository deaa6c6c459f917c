"""Exact spectra of continuous responses: closed forms, Parseval, derivatives, steady harmonics, the waterfall of a delay."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from engine.analysis.evaluation import Evaluation
from engine.diagram.diagram import compile_system
from engine.exact.frequency.energy import band_energy
from engine.exact.frequency.fourier import transform
from engine.model.errors import SignalError, SpectrumError, UnresolvedError
from engine.model.tangent import INFINITESIMAL, slopes
from engine.recordings.spectra.simulated import response_spectrum, steady_harmonics, transient, waterfall
from engine.signals import changed, make
from tests.unit.engine.diagrams import block, document
from tests.unit.engine.test_curve import curve_of

W = np.array([0.0, 0.3, 1.0, 7.0, 50.0, 1000.0])


def lag(gain: float = 2.0, corner: float = 3.0, **extra):
    """Return u -> 2/(s/3 + 1), with the parameters ``gain`` and ``corner``."""
    blocks = {"u": block("input"), "lag": block("transfer_function", numerator=["=gain"], denominator=["=1/corner", 1])}
    return compile_system(document({**blocks, **extra}, ["u -> lag"], {"y": "lag"}, gain=gain, corner=corner))


def arm(frequency: float = 10.0, damping_ratio: float = 0.0):
    """Return a flexible arm: position of its tip for the position of its drive, and the tip's velocity."""
    numerator, denominator = [frequency**2], [1, 2 * damping_ratio * frequency, frequency**2]
    return compile_system(
        document(
            {
                "drive": block("input"),
                "tip": block("transfer_function", numerator=numerator, denominator=denominator),
                "speed": block("transfer_function", numerator=[*numerator, 0], denominator=denominator),
            },
            ["drive -> tip", "drive -> speed"],
            {"position": "tip", "velocity": "speed"},
        )
    )


def response(diagram, output: str = "y"):
    """Return the response of an output to a unit step as a curve."""
    (port,) = diagram.inputs
    return Evaluation(diagram).time_response({port: make("step")}, [output]).joint.output(0)


def test_transform_of_a_ramp_piece_is_its_closed_form() -> None:
    # ∫₀² t e^{-jωt} dt = (e^{-2jω}(1 + 2jω) - 1)/ω²; 2 at ω = 0
    found = transform(curve_of(lambda t, p: p * t, [0.0, 0.7, 2.0]), W).value
    w = W[1:]
    assert found[0] == pytest.approx(2.0, rel=1e-15)
    np.testing.assert_allclose(found[1:], (np.exp(-2j * w) * (1 + 2j * w) - 1) / w**2, rtol=1e-11, atol=1e-15)


def test_transform_of_a_step_response_is_the_path_times_that_of_the_step() -> None:
    # 2/(jω/3 + 1) · e^{-jω}/(jω)
    found = response_spectrum(lag(), {"u": make("step", {"start": 1.0})}, "y", W[1:])
    w = W[1:]
    np.testing.assert_allclose(found, 2 / (1j * w / 3 + 1) * np.exp(-1j * w) / (1j * w), rtol=1e-9)


def test_transform_carries_exact_derivatives_by_gain_and_corner() -> None:
    evaluation = Evaluation(lag(), gradient=["gain", "corner"])
    response = evaluation.time_response({"u": make("step")}, ["y"])
    w = W[1:4]
    found = transform(response.joint.output(0), w, final=response.finals["y"])
    by_parameter = found.slopes / np.array([[2.0], [3.0]])  # infinitesimals are relative to the values
    exact = 1 / (1j * w / 3 + 1) / (1j * w)
    np.testing.assert_allclose(by_parameter[0], exact, rtol=1e-9)
    np.testing.assert_allclose(by_parameter[1], 2 * (1j * w / 9) / (1j * w / 3 + 1) ** 2 / (1j * w), rtol=1e-8)


def test_transform_carries_the_movement_of_edges() -> None:
    # y = 1 for t < p = 2: Y = (1 - e^{-jωp})/(jω), dY/dp = e^{-jωp}
    curve = curve_of(lambda t, p: 1 + 0 * t, [0.0, 1.0, 2.0])
    edges = curve.edges.astype(complex)
    edges[-1] += 1j * INFINITESIMAL
    moved = type(curve)(edges=edges, values=curve.values)
    w = W[1:]
    np.testing.assert_allclose(transform(moved, w).slopes[0], np.exp(-2j * w), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (0.5, 7.0), (100.0, 300.0)])
def test_energy_of_an_exponential_in_a_band_is_its_closed_form(low: float, high: float) -> None:
    # y = e^{-3t}: |Y|² = 1/(9 + ω²), E = (atan(high/3) - atan(low/3))/(3π)
    diagram = compile_system(
        document(
            {"u": block("input"), "f": block("transfer_function", numerator=[1, 0], denominator=[1, 3])},
            ["u -> f"],
            {"y": "f"},
        )
    )
    curve = response(diagram)
    expected = (math.atan(high / 3) - math.atan(low / 3)) / (3 * math.pi)
    assert band_energy(curve, low, high)[0] == pytest.approx(expected, rel=1e-9)
    found = transient(diagram, {"u": make("step")}, "y")
    assert found.energy(low, high) == pytest.approx(expected, rel=1e-9)
    assert not found.stays_away


def test_energy_of_a_light_resonance_is_found_whatever_the_band() -> None:
    # velocity of the arm after a step, ω = 10, ζ = 0.02: all of the energy, ∫ v² dt = ω/(4ζ), is in the resonance
    curve = response(arm(10.0, 0.02), "velocity")
    whole = 10.0 / (4 * 0.02)
    assert curve.squared().integral()[0] == pytest.approx(whole, rel=1e-9)

    def density(w: float) -> float:
        return abs(100 / (100 - w**2 + 0.4j * w)) ** 2 / math.pi

    expected = quad(density, 9, 11, points=[10], epsabs=0, epsrel=1e-11, limit=200)[0]
    assert band_energy(curve, 9.0, 11.0)[0] == pytest.approx(expected, rel=1e-8)
    parts = sum(band_energy(curve, a, b)[0] for a, b in [(0.0, 5.0), (5.0, 9.99), (9.99, 60.0)])
    rest = quad(density, 60, math.inf, epsrel=1e-10)[0]
    assert parts + rest == pytest.approx(whole, rel=1e-8)


def test_energy_in_a_band_of_a_position_that_stays_away() -> None:
    # y = 2(1 - e^{-3t}): |Y|² = 36/(ω²(9 + ω²))
    evaluation = Evaluation(lag())
    found = evaluation.time_response({"u": make("step")}, ["y"])
    curve, final = found.joint.output(0), found.finals["y"]
    expected = quad(lambda w: 36 / (w**2 * (9 + w**2)) / math.pi, 0.5, 20, epsrel=1e-12)[0]
    assert band_energy(curve, 0.5, 20.0, final=final)[0] == pytest.approx(expected, rel=1e-9)
    spectrum = transient(lag(), {"u": make("step")}, "y")
    assert spectrum.energy(0.5, 20.0) == pytest.approx(expected, rel=1e-9)
    with pytest.raises(SpectrumError, match="band must begin above 0"):
        spectrum.energy(0.0, 1.0)


def test_energy_carries_exact_derivatives() -> None:
    # E = gain²·(...)
    evaluation = Evaluation(lag(), gradient=["gain"])
    response = evaluation.time_response({"u": make("step")}, ["y"])
    energy = band_energy(response.joint.output(0), 0.5, 20.0, final=response.finals["y"])
    assert slopes(energy)[0] == pytest.approx(2 * energy[0].real, rel=1e-12)


def test_energy_of_a_band_too_wide_for_the_length_is_refused() -> None:
    curve = curve_of(lambda t, p: np.sin(p * t), [0.0, 1000.0])
    with pytest.raises(UnresolvedError, match="at most 200000 frequencies"):
        band_energy(curve, 0.0, 1e4)


def test_harmonics_of_a_steady_response_are_gain_and_phase_of_the_path() -> None:
    excitation = make("multisine", {"amplitude": 0.5, "fundamental": 2.0, "harmonics": [1, 3]})
    found = steady_harmonics(lag(), {"u": excitation}, "y", fundamental=2.0, count=4)
    gains = 2 / (1j * 2.0 * np.array([1, 3]) / 3 + 1)
    np.testing.assert_allclose(found.amplitude[[0, 2]], 0.5 * np.abs(gains), rtol=1e-9)
    np.testing.assert_allclose(found.amplitude[[1, 3]], 0.0, atol=1e-10)
    # sines with phases 0 and -π(k² - k)/K at k = 2 of K = 2; a cosine is a quarter earlier
    expected = np.angle(gains * np.exp(1j * (np.array([0.0, -np.pi]) - np.pi / 2)))
    np.testing.assert_allclose(np.exp(1j * found.phase[[0, 2]]), np.exp(1j * expected), atol=1e-9)
    assert found.thd == pytest.approx(abs(gains[1]) / abs(gains[0]), rel=1e-9)


def test_waterfall_over_a_programmed_delay_is_the_unshaped_spectrum_times_its_cosine() -> None:
    w, delays = np.linspace(2, 40, 39), [0.0, 0.1, math.pi / 10, 0.5]
    command = make("programmed_delay", {"delay": 0.1, "command": {"kind": "step"}})
    found = waterfall(
        arm(10.0, 0.05), {"drive": command}, "velocity", w, port="drive", parameter="delay", values=delays
    )
    plain = np.abs(response_spectrum(arm(10.0, 0.05), {"drive": make("step")}, "velocity", w))
    exact = plain * np.abs(np.cos(np.multiply.outer(delays, w) / 2))
    np.testing.assert_allclose(found.magnitude, exact, atol=1e-9 * plain.max())
    # half a period of the resonance: nothing is left there
    assert found.magnitude[2, np.argmin(np.abs(w - 10))] < 1e-9 * plain.max()


def test_an_inner_command_may_be_varied() -> None:
    command = make("programmed_delay", {"delay": 0.1, "command": {"kind": "step"}})
    assert changed(command, "command.amplitude", 3.0).final() == 3.0
    with pytest.raises(SignalError, match="must be >= 0 s") as caught:
        changed(command, "command.start", -1.0)
    assert caught.value.at == ("command", "start")
    with pytest.raises(SignalError, match="delay must be a command inside programmed_delay \\(command\\)"):
        changed(command, "delay.start", 1.0)
    with pytest.raises(SignalError, match="parameter of step must be one of"):
        changed(make("step"), "height", 1.0)


def test_what_does_not_settle_has_no_spectrum() -> None:
    integrator = compile_system(document({"u": block("input"), "i": block("integrator")}, ["u -> i"], {"y": "i"}))
    with pytest.raises(SpectrumError, match="which is integrating"):
        response_spectrum(integrator, {"u": make("step")}, "y", W[1:])
    with pytest.raises(SpectrumError, match="goes on for ever"):
        response_spectrum(lag(), {"u": make("ramp")}, "y", W[1:])


@pytest.mark.parametrize(
    ("signal", "fundamental"),
    [(make("step"), 2.0), (make("sine", {"frequency": 3.0}), 2.0), (make("sine", {"frequency": 1.0}), 2.0)],
)
def test_harmonics_of_what_does_not_repeat_with_the_fundamental_are_refused(signal, fundamental) -> None:
    with pytest.raises(SpectrumError, match="fundamental must be that of the commands"):
        steady_harmonics(lag(), {"u": signal}, "y", fundamental=fundamental, count=3)


def test_harmonics_of_a_command_of_a_higher_order() -> None:
    found = steady_harmonics(lag(), {"u": make("sine", {"frequency": 6.0})}, "y", fundamental=2.0, count=3)
    np.testing.assert_allclose(found.amplitude, [0, 0, 2 / math.sqrt(1 + 4)], atol=1e-10)
    assert found.thd is None


@pytest.mark.parametrize(
    "signal",
    [
        make("step", {"start": 0.3}),
        make("trapezoid", {"max_velocity": 2.0, "max_acceleration": 9.0, "start": 0.1}),
        make("s_curve", {"max_velocity": 2.0, "max_acceleration": 9.0, "max_jerk": 80.0}),
        make("shaped", {"shaper": "ei", "frequency": 7.0, "command": {"kind": "step"}}),
        make("sampled", {"time": [0.0, 0.2, 1.0], "values": [1.0, -1.0, 0.0]}),
    ],
    ids=lambda signal: signal.kind,
)
def test_the_product_of_path_and_command_is_the_integral_of_the_response(signal) -> None:
    # two ways to the same spectrum: G(jω) U(jω), and the Fourier integral of the simulated response
    diagram, w = arm(10.0, 0.1), np.array([0.4, 3.0, 10.0, 33.0])
    found = Evaluation(diagram).time_response({"drive": signal}, ["position"])
    integral = transform(found.joint.output(0), w, final=found.finals["position"]).value
    product = response_spectrum(diagram, {"drive": signal}, "position", w)
    np.testing.assert_allclose(product, integral, rtol=1e-8, atol=1e-12)


def test_a_smooth_command_that_ends_is_analysed_by_its_response() -> None:
    # a chirp of constant frequency is a burst: U = ∫₀^T sin(w₀ t) e^{-jωt} dt
    burst, w0 = make("chirp", {"start_frequency": 6.0, "end_frequency": 6.0, "duration": 2.0}), 6.0
    w = np.array([1.0, 5.0, 20.0])
    ends = [(np.exp(1j * (s * w0 - w) * 2.0) - 1) / (1j * (s * w0 - w)) for s in (1, -1)]
    exact = (ends[0] - ends[1]) / 2j * 2 / (1j * w / 3 + 1)
    found = response_spectrum(lag(), {"u": burst}, "y", w)
    np.testing.assert_allclose(found, exact, rtol=1e-9)
