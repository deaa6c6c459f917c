"""Pulse, square wave, noise, straight lines and the constant source: responses of k/(T s + 1), by hand.

A step of height h at t0 gives h k (1 - e^(-(t - t0)/T)), a ramp of slope m  m k ((t - t0) - T (1 - e^(-(t - t0)/T))), a sine
k Im(e^(j(ωt + φ))/(1 + jωT)) minus what makes it begin at 0.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from engine.analysis.commanded import CommandParameter
from engine.analysis.influence import influence
from engine.analysis.measuring import MetricRequest
from engine.analysis.study import simulate
from engine.diagram.diagram import Diagram, compile_system
from engine.signals import Signal, make
from tests.unit.engine.diagrams import block, document

GAIN, LAG = 3.0, 0.5
DURATION = 3.0


def lag(*, delay: float = 0.0, limited: bool = False, offset: float | None = None) -> Diagram:
    """Return the lag; behind a delay, a saturation that is never reached, or a sum with a constant."""
    blocks = {"u": block("input"), "plant": block("transfer_function", numerator=[GAIN], denominator=[LAG, 1.0])}
    chain = ["u"]
    wires = []
    if delay:
        blocks["line"] = block("delay", time=delay)
        chain.append("line")
    if limited:
        blocks["limit"] = block("saturation", lower=-100.0, upper=100.0)
        chain.append("limit")
    if offset is not None:
        blocks |= {"weight": block("constant", value=offset), "total": block("sum", signs="++")}
        wires.append("weight -> total.in2")
        chain.append("total")
    chain.append("plant")
    wires += [f"{a} -> {b}{'.in1' if b == 'total' else ''}" for a, b in pairwise(chain)]
    return compile_system(document(blocks, wires, {"y": "plant"}))


def rise(t: np.ndarray) -> np.ndarray:
    return np.where(t > 0, GAIN * -np.expm1(-np.maximum(t, 0.0) / LAG), 0.0)


def climb(t: np.ndarray) -> np.ndarray:
    after = np.maximum(t, 0.0)
    return GAIN * (after + LAG * np.expm1(-after / LAG))


def pulse(t: np.ndarray) -> np.ndarray:
    return 2.0 * (rise(t - 0.4) - rise(t - 1.15))


def square(t: np.ndarray) -> np.ndarray:
    jumps = [(0.35 * k, 1.5 if k == 0 else 3.0 * (-1) ** k) for k in range(9)]
    return sum(height * rise(t - at) for at, height in jumps)


def lines(t: np.ndarray) -> np.ndarray:
    """0.5 at once, up by 2/s from 0.5 s to 1 s, down by 2 at 1.5 s."""
    return 0.5 * rise(t) + 2.0 * (climb(t - 0.5) - climb(t - 1.0)) - 2.0 * rise(t - 1.5)


LINES = {"time": [0.0, 0.5, 1.0, 1.5, 1.5, 2.0], "values": [0.5, 0.5, 1.5, 1.5, -0.5, -0.5]}
CASES = [
    (make("pulse", {"start": 0.4, "width": 0.75, "amplitude": 2.0}), pulse),
    (make("square", {"period": 0.7, "amplitude": 1.5}), square),
    (make("piecewise_linear", LINES), lines),
]


@pytest.mark.parametrize(("signal", "expected"), CASES, ids=lambda case: getattr(case, "kind", ""))
@pytest.mark.parametrize("delay", [0.0, 0.13])
@pytest.mark.parametrize("limited", [False, True])
def test_a_response_is_the_sum_of_steps_and_ramps(signal, expected, delay, limited):
    found = simulate(lag(delay=delay, limited=limited), signals={"u": signal}, duration=DURATION)
    np.testing.assert_allclose(found.curves["y"], expected(found.time - delay), rtol=0, atol=1e-10)


@pytest.mark.parametrize("limited", [False, True])
def test_noise_is_a_sum_of_sines(limited):
    signal = make("noise", {"band": [2.0, 30.0], "rms": 0.7, "seed": 5})
    found = simulate(lag(limited=limited), signals={"u": signal}, duration=DURATION)
    gain = GAIN / (1 + 1j * signal.frequencies * LAG)
    phase = 1j * (np.multiply.outer(found.time, signal.frequencies) + signal.phases)
    swing, begin = gain * np.exp(phase), gain * np.exp(1j * signal.phases)
    fade = np.exp(-found.time / LAG)[:, None]
    expected = 0.7 * np.sqrt(2 / 128) * (swing.imag - fade * begin.imag).sum(axis=1)
    np.testing.assert_allclose(found.curves["y"], expected, rtol=0, atol=1e-10)


def test_noise_has_its_strength_and_its_band():
    """Mean square over a long time, and nothing outside: by a window whose side lobes are below -90 dB."""
    signal = make("noise", {"band": [2.0, 30.0], "rms": 0.7, "seed": 5})
    time = np.arange(2**18) * 0.02
    u = signal.value(time)
    assert np.sqrt(np.mean(u**2)) == pytest.approx(0.7, rel=0.01)
    power = np.abs(np.fft.rfft(u * np.blackman(len(u)))) ** 2
    frequency = 2 * np.pi * np.fft.rfftfreq(len(u), 0.02)
    outside = (frequency < 1.99) | (frequency > 30.01)
    assert power[outside].sum() < 1e-6 * power.sum()


def test_noise_is_the_same_everywhere():
    """SplitMix64 from state 5, the numbers of its authors' program: 2^-53 of the upper 53 bits."""
    signal = make("noise", {"band": [0.0, 128.0], "seed": 1234567})
    first = [6457827717110365317, 3203168211198807973, 9817491932198370423]
    drawn = [(word >> 11) * 2.0**-53 for word in first]
    np.testing.assert_array_equal(signal.frequencies[:3], [drawn[0], 1 + drawn[1], 2 + drawn[2]])
    other = make("noise", {"band": [0.0, 128.0], "seed": 1234568})
    assert not np.any(other.phases == signal.phases)


@pytest.mark.parametrize("delay", [0.0, 0.13])
def test_a_constant_is_there_from_the_beginning(delay):
    found = simulate(lag(delay=delay, offset=-0.25), signals={"u": make("step", {"start": 1.0})}, duration=DURATION)
    expected = rise(found.time - 1.0 - delay) - 0.25 * rise(found.time)
    np.testing.assert_allclose(found.curves["y"], expected, rtol=0, atol=1e-10)


def peak(signal: Signal, diagram: Diagram) -> float:
    found = simulate(diagram, signals={"u": signal}, duration=DURATION, metrics=["peak"])
    value = found.metrics["y"]["peak"].value
    assert value is not None
    return value


@pytest.mark.parametrize(
    ("signal", "number"),
    [
        (CASES[0][0], "start"),
        (CASES[0][0], "width"),
        (CASES[0][0], "amplitude"),
        (CASES[1][0], "period"),
        (CASES[1][0], "amplitude"),
        (make("noise", {"band": [2.0, 30.0], "rms": 0.7, "seed": 5}), "rms"),
    ],
)
def test_derivatives_by_a_number_of_the_command(signal, number):
    """iae within the duration, against differences that converge (Richardson)."""
    diagram, command = lag(), CommandParameter(signal=signal, path=number)
    request = MetricRequest(metric="iae", signals={"u": signal}, output="y", duration=DURATION)
    found = influence(diagram, {"iae": request}, ["p"], commands={"p": command})
    base = getattr(signal, number)

    def area(value: float) -> float:
        own = make(signal.kind, {**{p.name: getattr(signal, p.name) for p in signal.parameters}, number: value})
        measured = simulate(diagram, signals={"u": own}, duration=DURATION, metrics=["iae"]).metrics["y"]["iae"].value
        assert measured is not None
        return measured

    def slope(step: float) -> float:
        return (area(base + step) - area(base - step)) / (2 * step)

    step = 1e-3 * base
    expected = (4 * slope(step / 2) - slope(step)) / 3 * base / area(base)
    assert found.elasticities["iae"]["p"].value == pytest.approx(expected, rel=1e-5, abs=1e-6)


def test_a_command_without_a_number_of_that_kind_says_so():
    with pytest.raises(Exception, match="seed must be a whole number"):
        CommandParameter(signal=make("noise", {"band": [1.0, 2.0]}), path="seed").perturbed()
