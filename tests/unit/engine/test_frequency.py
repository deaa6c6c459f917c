"""Frequency responses, crossings and peaks against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from engine.analysis.evaluation import Evaluation
from engine.diagram.diagram import compile_system
from engine.exact.frequency.response import FrequencyResponse
from engine.exact.frequency.shapes import imaginary_part, squared_magnitude, squared_sensitivity
from engine.metrics._loop import delay_margins
from engine.model.linear_system import LaneSystem
from engine.model.tangent import INFINITESIMAL, slopes
from tests.unit.engine.diagrams import block, document
from tests.unit.engine.test_poles import companion, lanes
from tests.unit.engine.test_trajectory import integrator_with_delay


def second_order(damping: complex) -> LaneSystem:
    system = companion([1, 2 * damping.real, 1], [1])
    if damping.imag:
        a = system.a.astype(complex)
        a[0, 1, 1] = -2 * damping
        system = LaneSystem(**{**vars(system), "a": a})
    return system


@pytest.mark.parametrize("damping", [0.5, 0.1, 1e-4, 1e-7])
def test_resonance_peak_however_sharp(damping: float) -> None:
    # max |1/(1 - ω² + 2jζω)| = 1 / (2 ζ sqrt(1 - ζ²)) at ω² = 1 - 2ζ²
    value, at = FrequencyResponse(second_order(complex(damping))).peak(squared_magnitude)
    assert np.sqrt(value[0]) == pytest.approx(1 / (2 * damping * np.sqrt(1 - damping**2)), rel=1e-8)
    assert at == pytest.approx(np.sqrt(1 - 2 * damping**2), rel=1e-7)


def test_peak_carries_its_derivative() -> None:
    damping = 0.3
    value, _ = FrequencyResponse(second_order(damping + 1j * INFINITESIMAL)).peak(squared_magnitude)
    # d/dζ of 1 / (4 ζ² (1 - ζ²))
    exact = -(2 * damping - 4 * damping**3) / (4 * damping**4 * (1 - damping**2) ** 2)
    assert slopes(value)[0] == pytest.approx(exact, rel=1e-10)


def test_a_crossing_carries_its_derivative() -> None:
    # |K e^-sτ / s| = 1 at ω = K: dω/dK = 1
    loop = lanes(integrator_with_delay(2.0 + 1j * INFINITESIMAL, 0.1))
    opened = LaneSystem(**{**vars(loop), "c2": 0 * loop.c2})
    (crossing,) = FrequencyResponse(opened).crossings(squared_magnitude, 1.0)
    assert crossing[0].real == pytest.approx(2.0, rel=1e-14)
    assert slopes(crossing)[0] == pytest.approx(1.0, rel=1e-12)


def test_phase_crossings_of_a_delay_down_to_the_smallest_gain() -> None:
    # Im(e^-0.1jω / jω) = 0 at ω = (k + 1/2) π / 0.1; as many as have |L| = 1/ω >= 1e-2
    loop = lanes(integrator_with_delay(1.0, 0.1))
    opened = LaneSystem(**{**vars(loop), "c2": 0 * loop.c2})
    found = [float(w[0]) for w in FrequencyResponse(opened).crossings(imaginary_part, 0.0, floor=1e-2) if w[0] < 100]
    assert found == pytest.approx([5 * np.pi, 15 * np.pi, 25 * np.pi], rel=1e-13)


def test_sensitivity_of_an_integrator_with_delay() -> None:
    # L = e^-s / s: the sharpest point from a dense scan of the closed form
    loop = lanes(integrator_with_delay(1.0, 1.0))
    opened = LaneSystem(**{**vars(loop), "c2": 0 * loop.c2})
    value, at = FrequencyResponse(opened).peak(squared_sensitivity)
    w = np.linspace(at * 0.99, at * 1.01, 200_001)
    dense = (1 / np.abs(1 + np.exp(-1j * w) / (1j * w))).max()
    assert np.sqrt(value[0]) == pytest.approx(dense, rel=1e-9)
    coarse = np.geomspace(1e-3, 1e3, 300_000)
    assert np.sqrt(value[0]) >= (1 / np.abs(1 + np.exp(-1j * coarse) / (1j * coarse))).max() * (1 - 1e-12)


def test_on_the_stability_limit_no_delay_is_borne() -> None:
    # 60 / ((s + 1)(s + 2)(s + 3)): closed poles -6, ±j√11 (control literature, case 11)
    response = FrequencyResponse(companion([1, 6, 11, 6], [60]))
    ((frequency, margin),) = delay_margins(response)
    assert frequency[0] == pytest.approx(np.sqrt(11), rel=1e-12)
    assert margin[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("late", [0.0, 0.01])
def test_a_faint_response_keeps_its_digits_and_takes_few_frequencies(late: float) -> None:
    # a position loop reads the rate of its error; far beyond its bandwidth what it lets through lies 15 powers of ten below that
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "late": block("delay", time=late),
        "c": block("pid", kp=0.05, ki=0.05, kd=0.001, filter_frequency=500.0),
        "motor": block("transfer_function", numerator=[100.0], denominator=[0.001, 0.05, 1.0, 0.0]),
        "load": block("transfer_function", numerator=[1.0], denominator=[0.002, 1.0]),
    }  # fmt: skip
    wires = ["r -> e.in1", "load -> e.in2", "e -> c", "c -> late", "late -> motor", "motor -> load"]
    response = Evaluation(compile_system(document(blocks, wires, {"y": "load"}))).path("r", "y").response
    w = np.geomspace(1e-2, 1e6, 200)
    s = 1j * w
    plant = 100 * np.exp(-late * s) / (s * (0.001 * s**2 + 0.05 * s + 1) * (0.002 * s + 1))
    loop = (0.05 + 0.05 / s + 0.001 * s * 500 / (s + 500)) * plant
    assert response(w) == pytest.approx(loop / (1 + loop), rel=1e-11, abs=0)
    assert len(response.scan[0]) < 1000
