"""Integrals of the error to infinity where delays remember: a tail that is small beside the step and outlives it by decades.

An integral of k/s and ki/s² in a loop leaves e = (a e^-at - b e^-bt)/(a - b), b near ki/k; read behind a delay it is later.
With delays in the loop the moments of the error's transform at s = 0 are the integrals, less twice what has the other sign.
"""

from __future__ import annotations

from typing import Any

import mpmath
import pytest

from engine.analysis.measuring import MetricRequest, measure
from engine.diagram.diagram import Diagram
from engine.signals import make
from tests.reference.systems import block, system

mp = mpmath.mp.clone()
mp.dps = 60


def integrals(diagram: Diagram, start: float = 0.0) -> list[float | None]:
    command = make("step", {"amplitude": 1.0, "start": start})
    requests = [MetricRequest(metric=name, signals={"u": command}, output="y") for name in ("iae", "itae")]
    return [measured.value for measured, _ in measure(diagram, requests)]


@pytest.mark.parametrize("start", [0.0, 2.5])
@pytest.mark.parametrize(("ki", "close"), [(1e-3, 1e-12), (1e-5, 1e-10)])
def test_a_slow_tail_read_behind_a_delay(ki: float, close: float, start: float) -> None:
    blocks = {
        "u": block("input"),
        "s": block("sum", signs="+-"),
        "c": block("pi", kp=1.0, ki=ki),
        "g": block("integrator"),
        "late": block("delay", time=0.25),
    }
    diagram = system(blocks, ["u -> s.in1", "s -> c", "c -> g", "g -> s.in2", "g -> late"], {"y": "late"})
    root = mp.sqrt(1 - 4 * mp.mpf(ki))
    a, b, delay = (1 + root) / 2, mp.mpf(ki) * 2 / (1 + root), mp.mpf(0.25)
    turn = mp.log(a / b) / (a - b)

    def left(t: Any) -> tuple[Any, Any]:
        """Return ∫e and ∫te from t on."""
        fast, slow = mp.exp(-a * t) / (a - b), mp.exp(-b * t) / (a - b)
        return fast - slow, fast * (t + 1 / a) - slow * (t + 1 / b)

    iae, itae = (whole - 2 * tail for whole, tail in zip(left(mp.mpf(0)), left(turn), strict=True))
    expected = [float(delay + iae), float(delay**2 / 2 + itae + delay * iae)]
    assert integrals(diagram, start) == pytest.approx(expected, rel=close)


def test_a_slow_tail_of_a_loop_with_two_delays() -> None:
    """Its slow poles are real: e changes its sign once, when only two of their exponentials are left."""
    ki, kp, pole, there, back = 1e-4, 0.25, 4.0, 0.125, 0.0625
    blocks = {
        "u": block("input"),
        "s": block("sum", signs="+-"),
        "c": block("pi", kp=kp, ki=ki),
        "bus": block("delay", time=there),
        "g": block("transfer_function", numerator=[pole], denominator=[1.0, pole, 0.0]),
        "sensor": block("delay", time=back),
    }
    wires = ["u -> s.in1", "s -> c", "c -> bus", "bus -> g", "g -> sensor", "sensor -> s.in2"]
    diagram = system(blocks, wires, {"y": "g"})

    def terms(s: Any) -> tuple[Any, Any]:
        """Return the transform of e as (above, below)."""
        plant, forward = s * s * (s + pole), (mp.mpf(kp) * s + mp.mpf(ki)) * pole
        closed = plant + forward * mp.exp(-s * mp.mpf(there + back))
        return (closed - forward * mp.exp(-s * mp.mpf(there))) / s, closed

    def transform(s: Any) -> Any:
        above, below = terms(s)
        return above / below

    circle = [mp.mpf(ki) / kp / 10 * mp.expjpi(mp.mpf(k) / 32) for k in range(64)]  # Cauchy's integrals about s = 0
    around = [transform(s) for s in circle]
    whole = mp.re(sum(around) / 64), -mp.re(sum(e / s for e, s in zip(around, circle, strict=True)) / 64)
    slow = [mp.findroot(lambda s: terms(s)[1], guess) for guess in (-ki / kp, -0.283)]
    parts = [(s, terms(s)[0] / mp.diff(lambda z: terms(z)[1], s)) for s in slow]
    turn = mp.log(-parts[0][1] / parts[1][1]) / (parts[1][0] - parts[0][0])
    assert 3.4 * turn > 40  # the next pole, -3.4 rad/s, has left nothing by then
    area = -sum(c * mp.exp(s * turn) / s for s, c in parts)
    moment = -sum(c * mp.exp(s * turn) * (turn / s - 1 / s**2) for s, c in parts)
    expected = [float(whole[0] - 2 * area), float(whole[1] - 2 * moment)]
    assert integrals(diagram) == pytest.approx(expected, rel=1e-12)
