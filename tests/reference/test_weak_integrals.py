"""A controller whose integral hardly acts, round a double integrator: three poles at rest, told apart far below every other.

    L(s) = (kp + ki/s + kd s / (1 + s/N)) / (s² (1 + T s))

Near the frequencies where the integral begins to act the phase passes -180° far below every other pole, and once more between
the lag and the filter. Expected values are roots and differences of this formula at 50 digits.
"""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest

from engine.analysis.measuring import MetricRequest, measure
from engine.analysis.study import frequency_response
from engine.diagram.diagram import Diagram
from tests.reference.systems import block, system

mp = mpmath.mp.clone()
mp.dps = 50

CONTROLLER = {"kp": 30.0, "kd": 8.0, "filter": 2000.0, "lag": 0.05}


def loop(s: Any, ki: Any) -> Any:
    kp, kd, n, lag = (mp.mpf(value) for value in CONTROLLER.values())
    return (kp + ki / s + kd * s / (1 + s / n)) / (s**2 * (1 + lag * s))


def diagram(ki: float) -> Diagram:
    blocks = {
        "r": block("input"),
        "error": block("sum", signs="+-"),
        "controller": block("pid", kp=30.0, ki="=ki", kd=8.0, filter_frequency=2000.0),
        "force": block("transfer_function", numerator=[1.0], denominator=["=lag", 1.0]),
        "speed": block("integrator"),
        "position": block("integrator"),
    }
    wires = ["r -> error.in1", "position -> error.in2", "error -> controller", "controller -> force", "force -> speed"]
    return system(blocks, [*wires, "speed -> position"], {"y": "position"}, {"ki": ki, "lag": CONTROLLER["lag"]})


def axis_crossing(near: Any, ki: Any) -> Any:
    """The frequency near ``near`` at which L is real."""
    return mp.findroot(lambda w: mp.im(loop(mp.mpc(0, w), ki)) * w**3, near)


def margin(near: Any, ki: Any) -> Any:
    return -1 / mp.re(loop(mp.mpc(0, axis_crossing(near, ki)), ki))


@pytest.mark.parametrize("ki", [2e-3, 1e-6])
def test_a_weak_integral_keeps_the_loop_integrating_three_times(ki: float) -> None:
    study = frequency_response(diagram(ki), open_at="error")
    assert study.nyquist is not None
    assert study.nyquist.open_loop == study.nyquist.closed_loop == 0
    weak, exact = mp.mpf(ki), [float(w) for w in (1e-5, 1e-3, 1.0, 100.0)]
    again = frequency_response(diagram(ki), open_at="error", frequencies=np.array(exact))
    for w, value in zip(exact, again.response, strict=True):
        assert complex(value) == pytest.approx(complex(loop(mp.mpc(0, w), weak)), rel=1e-9)
    # behind the lag and the filter the phase falls to -180 degrees again
    fast = axis_crossing(160, weak)
    assert study.margins is not None
    frequency, found = study.margins.gain[-1]
    assert frequency == pytest.approx(float(fast), rel=1e-9)
    assert found == pytest.approx(float(margin(fast, weak)), rel=1e-9)


@pytest.mark.parametrize("ki", [2e-3, 1e-6])
def test_margins_hardly_move_with_a_weak_integral(ki: float) -> None:
    request = MetricRequest(metric="gain_margin", open_at="error")
    ((measured, gradient),) = measure(diagram(ki), [request], gradient=["ki"])
    weak, h = mp.mpf(ki), mp.mpf(ki) * mp.mpf(10) ** -12
    slope = (margin(160, weak + h) - margin(160, weak - h)) / (2 * h)
    assert measured.value == pytest.approx(float(margin(160, weak)), rel=1e-9)
    assert gradient is not None
    assert gradient.values[0] == pytest.approx(float(slope), rel=1e-6)
