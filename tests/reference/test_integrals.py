"""Integrals of the error and of the control beside closed forms: beyond the response's end, and of tails that outlive it."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from engine.analysis.measuring import MetricRequest, measure
from engine.diagram.diagram import Diagram
from engine.signals import make
from tests.reference.systems import block, system

STEP = make("step", {"amplitude": 1.0})


def _loop(controller: dict[str, object], plant: dict[str, object], parameters: dict[str, float]) -> Diagram:
    blocks = {"u": block("input"), "s": block("sum", signs="+-"), "c": controller, "g": plant}
    return system(blocks, ["u -> s.in1", "s -> c", "c -> g", "g -> s.in2"], {"y": "g", "u_c": "c"}, parameters)


@pytest.mark.parametrize("duration", [0.3, 6.0, 50.0, 2000.0])
def test_an_error_that_remains_is_counted_to_the_end_of_the_duration(duration: float) -> None:
    """With e = (1 + k e^-(1+k)t)/(1+k) the response ends after about 6 s, the duration does not."""
    diagram = _loop(
        block("gain", gain="=k"), block("transfer_function", numerator=[1.0], denominator=[1.0, 1.0]), {"k": 4.0}
    )

    def exact(k: mpmath.mpf) -> dict[str, mpmath.mpf]:
        t, rate = mpmath.mpf(duration), 1 + k
        faded, twice = mpmath.exp(-rate * t), mpmath.exp(-2 * rate * t)
        squared = (t + 2 * k * (1 - faded) / rate + k**2 * (1 - twice) / (2 * rate)) / rate**2
        return {
            "iae": (t + k * (1 - faded) / rate) / rate,
            "itae": (t**2 / 2 + k * (1 - faded * (1 + rate * t)) / rate**2) / rate,
            "ise": squared,
            "control_effort_rms": k * mpmath.sqrt(squared / t),
        }

    requests = [
        MetricRequest(
            metric=name, signals={"u": STEP}, output="u_c" if name == "control_effort_rms" else "y", duration=duration
        )
        for name in exact(mpmath.mpf(4))
    ]
    with mpmath.workdps(60):
        expected = exact(mpmath.mpf(4))
        step = mpmath.mpf(10) ** -20
        above, below = exact(4 + step), exact(4 - step)
        for request, (found, slopes) in zip(requests, measure(diagram, requests, gradient=["k"]), strict=True):
            name = request.metric
            assert found.value is not None
            assert slopes is not None
            assert found.value == pytest.approx(float(expected[name]), rel=1e-11)
            slope = float((above[name] - below[name]) / (2 * step))
            assert slopes.values[0] == pytest.approx(slope, rel=1e-9, abs=1e-11 * float(expected[name]))


@pytest.mark.parametrize("duration", [3.0, 700.0])
def test_a_command_that_goes_on_is_followed_to_the_end_of_the_duration(duration: float) -> None:
    """Of u = sin t a lag of 1 s makes y = (sin t - cos t + e^-t)/2."""
    lag = block("transfer_function", numerator=[1.0], denominator=[1.0, 1.0])
    diagram = system({"u": block("input"), "g": lag}, ["u -> g"], {"y": "g"}, {})
    sine = make("sine", {"amplitude": 1.0, "frequency": 1.0})
    request = MetricRequest(metric="control_effort_rms", signals={"u": sine}, output="y", duration=duration)
    ((found, _),) = measure(diagram, [request])
    t = duration
    squared = (t - np.sin(t) ** 2 - 2 * np.exp(-t) * np.sin(t) + (1 - np.exp(-2 * t)) / 2) / 4
    assert found.value == pytest.approx(np.sqrt(squared / t), rel=1e-10)


@pytest.mark.parametrize(("ki", "close"), [(1e-3, 1e-12), (1e-6, 1e-9), (1e-8, 1e-8)])
@pytest.mark.parametrize("start", [0.0, 2.5])
def test_a_slow_tail_keeps_its_digits(ki: float, close: float, start: float) -> None:
    """With k/s and ki/s² in a loop e = (a e^-at - b e^-bt)/(a - b), b near ki/k: a tail of b that lasts for 1/b."""
    diagram = _loop(block("pi", kp="=k", ki="=ki"), block("integrator"), {"k": 1.0, "ki": ki})
    command = make("step", {"amplitude": 1.0, "start": start})
    requests = [MetricRequest(metric=name, signals={"u": command}, output="y") for name in ("iae", "itae")]
    found = [measured.value for measured, _ in measure(diagram, requests)]
    with mpmath.workdps(60):
        root = mpmath.sqrt(1 - 4 * mpmath.mpf(ki))
        a, b = (1 + root) / 2, mpmath.mpf(ki) * 2 / (1 + root)
        turn = mpmath.log(a / b) / (a - b)

        def left(t: mpmath.mpf) -> tuple[mpmath.mpf, mpmath.mpf]:
            """Return ∫e and ∫te from t on."""
            fast, slow = mpmath.exp(-a * t) / (a - b), mpmath.exp(-b * t) / (a - b)
            return fast - slow, fast * (t + 1 / a) - slow * (t + 1 / b)

        expected = [float(whole - 2 * tail) for whole, tail in zip(left(mpmath.mpf(0)), left(turn), strict=True)]
    assert found == pytest.approx(expected, rel=close)
