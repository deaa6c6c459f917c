"""Whole periods of samplers at once, against a recurrence of the test's own: matrix exponentials between the instants."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from engine.analysis.evaluation import Evaluation
from engine.diagram.diagram import Diagram, compile_system
from engine.exact.nonlinear.integrate import Integration
from engine.model.tangent import INFINITESIMAL
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document

H, KP, KI, KD, W = 1e-3, 0.4, 3.0, 0.004, 800.0
PLANT = np.array([[0.0, 1.0, 0.0], [0.0, -20.0, 900.0], [0.0, 0.0, -2000.0]])
"""A motor behind a lag: position, speed, current."""
DRIVEN = np.array([0.0, 0.0, 2000.0])
PART = 0.37  # where between two instants a response is looked at


def loop(delay: float, offset: float, h: float = H, **limits: Any) -> Diagram:
    blocks = {
        "r": block("input"), "v": block("input"), "e": block("sum", signs="++-"),
        "c": block("sampled_pid", kp="=kp", ki=KI, kd=KD, filter_frequency=W, sample_time="=h", delay=delay, offset=offset, **limits),
        "lag": block("transfer_function", numerator=[1.0], denominator=[1 / 2000.0, 1.0]),
        "motor": block("transfer_function", numerator=[900.0], denominator=[1.0, 20.0, 0.0]),
    }  # fmt: skip
    wires = ["r -> e.in1", "v -> e.in2", "motor -> e.in3", "e -> c", "c -> lag", "lag -> motor"]
    return compile_system(document(blocks, wires, {"y": "motor", "i": "lag", "u": "c"}, kp=KP, h=h))


def command(t: float) -> float:
    return 0.5 * max(t - 0.0213, 0.0) + (1.0 if t >= 0.0101 else 0.0)


def recurrence(
    end: float, delay: float, offset: float, *, kp: complex = KP, h: complex = H, limit: float = np.inf
) -> tuple[np.ndarray, np.ndarray]:
    """Return times, and positions and currents a while after each output; h may carry an infinitesimal."""
    x, u, integral, error, derivative = np.zeros(3, complex), 0.0 + 0j, 0j, 0j, 0j

    def on(width: complex) -> np.ndarray:
        joint = np.zeros((4, 4), complex)
        joint[:3, :3], joint[:3, 3] = PLANT * width, DRIVEN * u * width
        return (expm(joint) @ [*x, 1.0])[:3]

    times, found = [], []
    x = on(offset)
    for k in range(math.floor((end - offset) / h.real)):
        now = offset + k * h
        e = command(now.real) + 0.5j * now.imag * (now.real > 0.0213) - x[0]
        integral += KI * h * e
        derivative = (derivative + W * KD * (e - error)) / (1 + W * h)
        error, asked = e, kp * e + integral + derivative
        x = on(delay)
        u = asked if abs(asked.real) <= limit else np.copysign(limit, asked.real) + 0j
        rest = h - delay
        times.append((now + delay + PART * rest).real)
        # at a fixed instant: what the instant moves by is taken back
        middle = on(PART * rest)
        rate = PLANT @ middle + DRIVEN * u
        found.append((middle - 1j * (now + delay + PART * rest).imag * rate)[[0, 2]])
        x = on(rest)
    return np.array(times), np.array(found).T


@pytest.mark.parametrize(
    ("delay", "offset", "h"), [(0.0, 0.0, H), (3e-4, 0.0, H), (1e-3, 0.0, H), (2e-4, 4e-4, H), (1e-3, 0.0, 1.5e-2)]
)
def test_a_response_and_its_slopes_are_those_of_the_recurrence(
    delay: float, offset: float, h: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    single: list[float] = []
    step = Integration._step

    def counted(self: Integration, *rest: Any) -> None:
        single.append(self.now)
        step(self, *rest)

    monkeypatch.setattr(Integration, "_step", counted)
    evaluation = Evaluation(loop(delay, offset, h), gradient=["kp", "h"] if delay < h else ["kp"])
    signals = {"r": make("step", {"start": 0.0101}), "v": make("ramp", {"start": 0.0213, "slope": 0.5})}
    response = evaluation.simulated(signals, 0.8)
    times, expected = recurrence(0.8, delay, offset, h=h)
    for name, wanted in zip("yi", expected.real, strict=True):
        assert response.sample(name, times) == pytest.approx(wanted, rel=1e-11, abs=1e-11 * np.abs(wanted).max())
    assert len(single) < 200  # of 800 samples and as many updates
    by_kp = recurrence(0.8, delay, offset, kp=KP + 1j * INFINITESIMAL, h=h)[1].imag / INFINITESIMAL
    by_h = recurrence(0.8, delay, offset, h=h + 1j * INFINITESIMAL)[1].imag / INFINITESIMAL
    for signal, name in enumerate("yi"):
        curve = response.output(name)
        for k in range(len(times) % 9, len(times), len(times) // 9):
            moved = evaluation.derivatives(curve.read(times[k]))
            for found, wanted in zip(moved, (by_kp[signal], by_h[signal]), strict=False):
                assert found == pytest.approx(wanted[k], rel=1e-9, abs=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("limit", [0.02, 0.1])
def test_limits_are_left_to_single_samples(limit: float) -> None:
    made = loop(3e-4, 0.0, lower=-limit, upper=limit, anti_windup="none")
    evaluation = Evaluation(made, gradient=["kp"])
    signals = {"r": make("step", {"start": 0.0101}), "v": make("ramp", {"start": 0.0213, "slope": 0.5})}
    response = evaluation.simulated(signals, 0.6)
    times, expected = recurrence(0.6, 3e-4, 0.0, kp=KP + 1j * INFINITESIMAL, limit=limit)
    assert response.sample("y", times) == pytest.approx(expected[0].real, rel=1e-11, abs=1e-12)
    by_kp, curve = expected[0].imag / INFINITESIMAL, response.output("y")
    for k in range(len(times) % 9, len(times), len(times) // 9):
        assert evaluation.derivatives(curve.read(times[k]))[0] == pytest.approx(
            by_kp[k], rel=1e-9, abs=1e-9 * np.abs(by_kp).max()
        )
    effort = response.outcome.output(response.outputs.index("u")).values[:, :, 0].real
    assert np.abs(effort).max() == pytest.approx(limit)


def test_a_loop_that_diverges_is_called_unstable() -> None:
    response = Evaluation(loop(3e-4, 0.0), {"kp": 4000.0}).simulated({"r": make("step", {})}, 5.0)
    assert response.outcome.verdict is Verdict.UNSTABLE
    assert "grows beyond 1e+100" in response.outcome.advice
