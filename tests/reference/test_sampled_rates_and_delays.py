"""A loop of two rates with a pure delay through which its signal flows on, against a boundary value problem of the test's own.

All instants are multiples of h = 0.05 ms: over each of the q = 20 parts of the common period the states of all parts flow at once,
x_i' = A x_i + B (u_i - g C x_(i-n)), where what lies k periods back is z^-k of the same. The loop has a pole at z where the
equations of the states at the begin of each part, the torques and the integrals have a solution: nothing is discretised.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import minimize_scalar

from engine.analysis.evaluation import Evaluation
from engine.analysis.measuring import MetricRequest, measure
from engine.diagram.diagram import Diagram, compile_system
from engine.model.verdicts import Verdict
from tests.reference.test_sampled_flowing_delays import newton
from tests.unit.engine.diagrams import block, document

H, Q, N = 5e-5, 20, 26
KV, KP, KI, G = 60.0, 0.6, 20.0, 0.01
MOTOR, LOAD, STIFFNESS, DAMPING = 2e-3, 3e-3, 2000.0, 0.05
A = np.array(
    [
        [0, 1, 0, 0],
        [-STIFFNESS / MOTOR, -DAMPING / MOTOR, STIFFNESS / MOTOR, DAMPING / MOTOR],
        [0, 0, 0, 1],
        [STIFFNESS / LOAD, DAMPING / LOAD, -STIFFNESS / LOAD, -DAMPING / LOAD],
    ]
)
B, C = np.array([0, 1 / MOTOR, 0, 0]), np.array([0, 1.0, 0, 0])


def axis() -> Diagram:
    """Return a two-inertia axis, position at 1 ms and speed at 0.25 ms, with damping that arrives 1.3 ms late."""
    inertias = {"motor_inertia": MOTOR, "load_inertia": LOAD, "stiffness": STIFFNESS, "damping": DAMPING}
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "f": block("sum", signs="+-"), "s": block("sum", signs="+-"),
        "position": block("sampled_pid", kp=KV, sample_time=Q * H, delay=6 * H),
        "speed": block("sampled_pid", kp=KP, ki=KI, sample_time=5 * H, delay=2 * H),
        "late": block("delay", time=N * H), "g": block("gain", gain=G), "axis": block("two_inertia", **inertias),
    }  # fmt: skip
    wires = [
        "r -> e.in1", "axis.load_angle -> e.in2", "e -> position", "position -> f.in1", "axis.motor_speed -> f.in2", "f -> speed",
        "speed -> s.in1", "axis.motor_speed -> late", "late -> g", "g -> s.in2", "s -> axis.motor_torque",
    ]  # fmt: skip
    return compile_system(document(blocks, wires, {"y": "axis.load_angle"}))


def equations(z: complex, *, e: complex = 1.0, f: complex = 1.0, s: complex = 1.0) -> np.ndarray:
    """The equations of a mode with factors at three places: 4 states of 20 parts, 4 torques, 4 integrals, the speed command."""
    flow = np.zeros((5 * Q, 5 * Q), complex)
    for i in range(Q):
        turns, j = divmod(i - N, Q)
        own, late = slice(4 * i, 4 * i + 4), slice(4 * j, 4 * j + 4)
        flow[own, own] += A
        flow[own, late] += -s * G * np.outer(B, C) * z**turns
        flow[own, 4 * Q + i] = s * B
    over = expm(flow * H)
    torque, integral, command = 4 * Q, 4 * Q + 4, 4 * Q + 8
    found = np.zeros((command + 1, command + 1), complex)
    for i in range(Q):
        rows, j = slice(4 * i, 4 * i + 4), (i + 1) % Q
        found[rows, : 4 * Q] = over[rows, : 4 * Q]
        found[rows, 4 * j : 4 * j + 4] -= (z if j == 0 else 1) * np.eye(4)
        for part in range(Q):  # a torque acts from 2 parts behind its sample on
            turns, sample = divmod((part - 2) // 5, 4)
            found[rows, torque + sample] += over[rows, 4 * Q + part] * z**turns
    for k in range(4):
        error = np.zeros(command + 1, complex)
        error[20 * k + 1], error[command] = -f, f if k > 1 else f / z
        found[integral + k] = KI * 5 * H * error
        found[integral + k, integral + k] -= 1
        found[integral + k, integral + (k - 1) % 4] += 1 if k else 1 / z
        found[torque + k] = KP * error
        found[torque + k, integral + k] += 1
        found[torque + k, torque + k] -= 1
    found[command, command], found[command, 2] = -1, -KV * e
    return found


def singular(z: complex, **factors: complex) -> complex:
    return complex(np.linalg.det(equations(z, **factors)))


@pytest.mark.parametrize("place", ["e", "f", "s"])
def test_margins_are_where_the_loop_has_a_mode_on_the_unit_circle(place):
    asked = [MetricRequest(metric=m, open_at=place) for m in ("gain_margin_up", "phase_margin")]
    (up, _), (phase, _) = measure(axis(), asked)
    found = newton([up.at, up.value], lambda x: singular(np.exp(1j * x[0] * Q * H), **{place: x[1]}))
    assert up.value == pytest.approx(found[1], rel=1e-9)
    found = newton(
        [phase.at, phase.value], lambda x: singular(np.exp(1j * x[0] * Q * H), **{place: np.exp(-1j * x[1])})
    )
    assert phase.value == pytest.approx(found[1], rel=1e-9)


def test_poles_are_the_modes_and_verdicts_follow_the_margin():
    made = axis()
    values = Evaluation(made).poles.values
    for s in values[(values.imag >= 0) & (values.real > -5e3)]:
        z = exact = np.exp(s * Q * H)
        for _ in range(5):
            step = 1e-6 * abs(exact)
            exact -= singular(exact) * 2 * step / (singular(exact + step) - singular(exact - step))
        assert z == pytest.approx(exact, rel=1e-9)
    up = measure(made, [MetricRequest(metric="gain_margin_up", open_at="position")])[0][0].value
    for part, verdict in ((0.99, Verdict.OK), (1.01, Verdict.UNSTABLE)):
        assert Evaluation(made, {"position.kp": part * up * KV}).poles.verdict is verdict


def test_peaks_are_those_of_the_determinants():
    """At the place that the slower rate reads the determinant is linear in the gain: S = det(0)/det(1), T = 1 - S."""
    asked = [MetricRequest(metric=m, open_at="e") for m in ("sensitivity_peak", "complementary_peak")]
    found = [value for value, _ in measure(axis(), asked)]

    def sensitivity(w: float) -> complex:
        z = np.exp(1j * w * Q * H)
        return singular(z, e=0.0) / singular(z)

    grid = np.geomspace(10.0, 0.999 * np.pi / (Q * H), 60)
    response = np.array([sensitivity(w) for w in grid])
    for value, size in zip(found, (abs, lambda s: abs(1 - s)), strict=True):
        k = int(np.clip(np.argmax([size(s) for s in response]), 1, len(grid) - 2))
        best = minimize_scalar(
            lambda w, size=size: -size(sensitivity(w)), bounds=(grid[k - 1], grid[k + 1]), options={"xatol": 1e-6}, method="bounded"
        )  # fmt: skip
        assert value.value == pytest.approx(-best.fun, rel=1e-9)
        assert value.at == pytest.approx(best.x, rel=1e-4)
