"""Drives and axes of the Control Tutorials for MATLAB and Simulink (B. Messner, D. Tilbury), each beside python-control.

Plants have the tutorials' numbers; controllers are theirs or near them. The same loop is written twice, as a diagram and for
python-control: margins and poles agree, and the metrics of the step with those of a grid of 100,000 points.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import control
import numpy as np
import pytest

from engine.analysis.evaluation import Evaluation
from engine.analysis.measuring import MetricRequest, measure
from engine.analysis.study import simulate
from engine.diagram.diagram import Block, Diagram
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.reference.systems import block, system

_STEP = make("step", {})
_TIME = ("rise_time", "settling_time", "overshoot", "peak_time", "steady_state_error", "iae")
_LOOP = ("gain_margin_up", "phase_margin", "critical_frequency", "sensitivity_peak")


@dataclass(frozen=True, kw_only=True)
class Tutorial:
    """A plant, and a loop around each of its controllers."""

    plant: tuple[list[float], list[float]]
    controllers: Mapping[str, Block]
    poles: tuple[complex, ...] = ()
    """Where state feedback puts the poles."""


def _pid(kp: float, ki: float, kd: float, w: float) -> Block:
    return block("pid", kp=kp, ki=ki, kd=kd, filter_frequency=w)


def _motor(j: float, b: float, k: float, r: float, inductance: float) -> tuple[list[float], list[float]]:
    return [k], [j * inductance, j * r + b * inductance, b * r + k * k]


def _suspension() -> tuple[list[float], list[float]]:
    """Return from the actuator's force to the stroke of the suspension of a bus."""
    body, wheel, k1, k2, b1, b2 = 2500.0, 320.0, 80000.0, 500000.0, 350.0, 15020.0
    s = control.tf("s")
    a = body * s**2 + b1 * s + k1
    d = wheel * s**2 + (b1 + b2) * s + (k1 + k2)
    delta = a * d - (b1 * s + k1) ** 2
    found = ((body + wheel) * s**2 + b2 * s + k2) / delta
    return list(found.num[0][0]), list(found.den[0][0])


def _pendulum() -> tuple[list[float], list[float]]:
    """Return from the force on the cart to the angle of the inverted pendulum."""
    cart, m, b, inertia, g, length = 0.5, 0.2, 0.1, 0.006, 9.8, 0.3
    q = (cart + m) * (inertia + m * length**2) - (m * length) ** 2
    denominator = [
        1.0, b * (inertia + m * length**2) / q, -(cart + m) * m * g * length / q, -b * m * g * length / q,
    ]  # fmt: skip
    return [m * length / q, 0.0], denominator


def _train() -> tuple[list[float], list[float]]:
    """Return from the force on the engine to its speed; the car hangs on a spring, and rolling resistance grows with speed."""
    engine, car, k, mu, g = 1.0, 0.5, 1.0, 0.02, 9.8
    s = control.tf("s")
    first, second = engine * s**2 + mu * engine * g * s + k, car * s**2 + mu * car * g * s + k
    # both positions share a pole at 0, which the speed cancels
    denominator = (first * second - k**2).num[0][0][:-1]
    return list(second.num[0][0]), list(denominator)


_POSITION = _motor(3.2284e-6, 3.5077e-6, 0.0274, 4.0, 2.75e-6)
_BALL = 0.111 * 9.8 * 0.03 / (1.0 * (9.99e-6 / 0.015**2 + 0.111))

TUTORIALS = {
    "motor speed": Tutorial(
        plant=_motor(0.01, 0.1, 0.01, 1.0, 0.5),
        controllers={
            "pid": _pid(100.0, 200.0, 10.0, 1e4),
            "lag": block("transfer_function", numerator=[45.0, 45.0], denominator=[1.0, 0.01]),
        },
        poles=(-5 + 1j, -5 - 1j),
    ),
    "motor position": Tutorial(
        plant=(_POSITION[0], [*_POSITION[1], 0.0]),
        controllers={
            "pid": _pid(21.0, 500.0, 0.15, 1e5),
            "lead": block("transfer_function", numerator=[0.2, 12.0], denominator=[1e-3, 1.0]),
        },
        poles=(-100 + 100j, -100 - 100j, -1.5e6),
    ),
    "cruise": Tutorial(
        plant=([1.0], [1000.0, 50.0]),
        controllers={
            "pid": _pid(800.0, 40.0, 5.0, 1e3),
            "lag": block("transfer_function", numerator=[1300.0, 390.0], denominator=[1.0, 0.03]),
        },
        poles=(-0.8,),
    ),
    "suspension": Tutorial(
        plant=_suspension(),
        controllers={
            "pid": _pid(832100.0, 624075.0, 208025.0, 1e4),
            "lead": block("transfer_function", numerator=[1e5, 4e5], denominator=[1.0, 60.0]),
        },
        poles=(-23.7 + 35j, -23.7 - 35j, -5 + 5j, -5 - 5j),
    ),
    "pitch": Tutorial(
        plant=([1.151, 0.1774], [1.0, 0.739, 0.921, 0.0]),
        controllers={
            "pid": _pid(2.0, 0.4, 3.0, 1e3),
            "lead": block("transfer_function", numerator=[200.0, 180.0], denominator=[1.0, 20.0]),
        },
        poles=(-1 + 1j, -1 - 1j, -5),
    ),
    "pendulum": Tutorial(
        plant=_pendulum(),
        controllers={
            "pid": _pid(100.0, 1.0, 20.0, 1e4),
            "lead-lag": block("transfer_function", numerator=[2000.0, 12000.0, 10000.0], denominator=[1.0, 100.0, 0.0]),
        },
        poles=(-4 + 2j, -4 - 2j, -9),
    ),
    "ball and beam": Tutorial(
        plant=([_BALL], [1.0, 0.0, 0.0]),
        controllers={
            "pid": _pid(15.0, 0.5, 40.0, 1e3),
            "lead": block("transfer_function", numerator=[37.0, 0.37], denominator=[1.0, 5.0]),
        },
        poles=(-2 + 2j, -2 - 2j),
    ),
    "mass on a spring": Tutorial(
        plant=([1.0], [1.0, 10.0, 20.0]),
        controllers={
            "pid": _pid(350.0, 300.0, 50.0, 1e3),
            "lead-lag": block("transfer_function", numerator=[400.0, 4400.0, 4000.0], denominator=[1.0, 50.05, 2.5]),
        },
        poles=(-8 + 6j, -8 - 6j),
    ),
    "train": Tutorial(
        plant=_train(),
        controllers={
            "pid": _pid(4.0, 0.5, 1.0, 1e3),
            "lag": block("transfer_function", numerator=[3.0, 0.6], denominator=[1.0, 0.01]),
        },
        poles=(-0.8 + 0.6j, -0.8 - 0.6j, -2),
    ),
    "first order of the frequency response": Tutorial(
        plant=([10.0], [1.25, 1.0]),
        controllers={
            "pid": _pid(5.0, 3.75, 0.02, 1e3),
            "lag": block("transfer_function", numerator=[2.0, 2.0], denominator=[1.0, 0.02]),
        },
        poles=(-6,),
    ),
}  # fmt: skip
LOOPS = [(name, controller) for name, tutorial in TUTORIALS.items() for controller in tutorial.controllers]


def _transfer(law: Block) -> control.TransferFunction:
    v = law.values
    if law.kind == "transfer_function":
        return control.tf(v["numerator"], v["denominator"])
    s, w = control.tf("s"), v["filter_frequency"]
    return v["kp"] + v["ki"] / s + v["kd"] * w * s / (s + w)


def _loop(tutorial: Tutorial, law: Block) -> Diagram:
    numerator, denominator = tutorial.plant
    blocks = {
        "r": block("input"), "error": block("sum", signs="+-"), "law": law,
        "plant": block("transfer_function", numerator=numerator, denominator=denominator),
    }  # fmt: skip
    return system(blocks, ["r -> error.in1", "plant -> error.in2", "error -> law", "law -> plant"], {"y": "plant"})


def _stepped(closed: control.StateSpace, t: np.ndarray) -> np.ndarray:
    """Return the step response at any instants, from the eigenvalues: y = D + C V (e^(λ t) - 1)/λ V⁻¹ B."""
    values, vectors = np.linalg.eig(closed.A)
    left, right = (closed.C @ vectors)[0], np.linalg.solve(vectors, closed.B[:, 0] + 0j)
    return closed.D[0, 0] + np.real((np.expm1(np.multiply.outer(t, values)) / values) @ (left * right))


def _crossed(t: np.ndarray, y: np.ndarray, level: float, *, last: bool = False) -> float:
    """Return where a curve crosses a level, for the first or the last time."""
    at = np.flatnonzero(np.diff(np.sign(y - level)))
    k = at[-1] if last else at[0]
    return float(t[k] + (t[k + 1] - t[k]) * (level - y[k]) / (y[k + 1] - y[k]))


def _check_step(diagram: Diagram, closed: control.StateSpace) -> None:
    """Compare curve and metrics of the step with python-control's, on a fine grid that is finer at the start."""
    found = simulate(diagram, signals={"r": _STEP}, outputs=["y"], metrics=list(_TIME))
    curve = _stepped(closed, found.time)
    np.testing.assert_allclose(found.curves["y"], curve, atol=1e-9 * np.abs(curve).max())
    metrics, final = found.metrics["y"], float(np.real(closed.dcgain()))
    if abs(final) < 1e-9:  # of a pendulum that is held upright: there is no rise to 0
        assert metrics["rise_time"].verdict is Verdict.ZERO_STATIC_GAIN
        return
    end = 40 / np.abs(closed.poles().real).min()
    t = np.unique(np.concatenate([np.geomspace(1e-10 * end, end, 200_001), np.linspace(0.0, end, 100_001)]))
    y = _stepped(closed, t) / final
    far = np.abs(y - 1) - 0.02
    assert metrics["settling_time"].value == pytest.approx(_crossed(t, far, 0.0, last=True), rel=1e-6)
    rise = _crossed(t, y, 0.9) - _crossed(t, y, 0.1)
    assert metrics["rise_time"].value == pytest.approx(rise, rel=1e-6)
    assert metrics["overshoot"].value == pytest.approx(max(y.max() - 1, 0.0), rel=1e-6, abs=1e-9)
    assert metrics["steady_state_error"].value == pytest.approx(1 - final, abs=1e-9)
    absolute = np.trapezoid(np.abs(y * final - 1), t) if abs(1 - final) < 1e-9 else None
    if absolute is None:
        assert metrics["iae"].verdict is Verdict.DIVERGES
    else:
        assert metrics["iae"].value == pytest.approx(absolute, rel=1e-6)


@pytest.mark.parametrize(("name", "controller"), LOOPS)
def test_a_loop_has_the_margins_poles_and_step_of_python_control(name: str, controller: str) -> None:
    tutorial = TUTORIALS[name]
    law = tutorial.controllers[controller]
    diagram, loop = _loop(tutorial, law), _transfer(law) * control.tf(*tutorial.plant)
    closed = control.feedback(control.ss(control.tf(*tutorial.plant)) * control.ss(_transfer(law)), 1)
    if name == "pendulum":  # the controller's integral cancels the plant's zero at 0, whose pole is not seen
        parts = [np.trim_zeros(part[0][0], "b") for part in (loop.num, loop.den)]
        closed = control.ss(control.feedback(control.tf(*parts), 1))
    requests = [MetricRequest(metric=metric, open_at="error") for metric in _LOOP]
    found = {r.metric: m for r, (m, _) in zip(requests, measure(diagram, requests), strict=True)}
    stable = closed.poles().real.max() < 0
    assert stable == all(m.verdict is not Verdict.UNSTABLE for m in found.values())
    if not stable:
        return
    with np.errstate(all="ignore"):
        gains, phases, *_ = control.stability_margins(loop, returnall=True)
    up = gains[(gains > 1) & np.isfinite(gains)]
    if found["gain_margin_up"].verdict is Verdict.OK:
        assert found["gain_margin_up"].value == pytest.approx(up.min(), rel=1e-7)
    else:
        assert len(up) == 0
    nearest = int(np.argmin(np.abs(np.where(phases > 180, phases - 360, phases))))
    phase = phases[nearest] - 360 if phases[nearest] > 180 else phases[nearest]
    assert found["phase_margin"].value == pytest.approx(np.radians(phase), rel=1e-7)
    _check_step(diagram, closed)


@pytest.mark.parametrize("name", TUTORIALS)
def test_state_feedback_has_the_step_of_python_control(name: str) -> None:
    tutorial = TUTORIALS[name]
    plant = control.ss(control.tf(*tutorial.plant))
    gains = np.asarray(control.place(plant.A, plant.B, tutorial.poles))
    closed = control.ss(plant.A - plant.B @ gains, plant.B, plant.C - plant.D @ gains, plant.D)
    order = plant.nstates
    c = np.vstack([plant.C, np.eye(order)])
    d = np.vstack([plant.D, np.zeros((order, 1))])
    states = [f"x{k + 1}" for k in range(order)]
    blocks = {
        "r": block("input"), "force": block("sum", signs="+" + "-" * order),
        "plant": block(
            "state_space", A=plant.A.tolist(), B=plant.B.tolist(), C=c.tolist(), D=d.tolist(), inputs=["u"], outputs=["y", *states]
        ),
        **{f"k{k + 1}": block("gain", gain=float(gains[0, k])) for k in range(order)},
    }  # fmt: skip
    wires = ["r -> force.in1", "force -> plant.u"]
    for k in range(order):
        wires += [f"plant.x{k + 1} -> k{k + 1}", f"k{k + 1} -> force.in{k + 2}"]
    diagram = system(blocks, wires, {"y": "plant.y"})
    ((damping, _),) = measure(diagram, [MetricRequest(metric="spectral_abscissa")])
    assert damping.value == pytest.approx(max(p.real for p in tutorial.poles), rel=1e-6)
    _check_step(diagram, closed)


@pytest.mark.parametrize("name", TUTORIALS)
def test_digital_state_feedback_puts_the_poles_where_python_control_does(name: str) -> None:
    """u = r - K x, held from sample to sample, with the gains that place e^{λ T}."""
    tutorial = TUTORIALS[name]
    slow = [p for p in tutorial.poles if abs(p) < 1e4]
    step = 0.05 / max(abs(p) for p in slow)
    plant = control.ss(control.tf(*tutorial.plant))
    sampled = control.c2d(plant, step, "zoh")
    gains = np.asarray(control.place(sampled.A, sampled.B, np.exp(np.array(tutorial.poles) * step)))
    order = plant.nstates
    blocks = {
        "r": block("input"), "law": block("sum", signs="+" + "-" * order), "hold": block("zero_order_hold", sample_time=step),
        "plant": block(
            "state_space", A=plant.A.tolist(), B=plant.B.tolist(), C=np.vstack([plant.C, np.eye(order)]).tolist(),
            D=np.vstack([plant.D, np.zeros((order, 1))]).tolist(), inputs=["u"], outputs=["y", *(f"x{k + 1}" for k in range(order))],
        ),
        **{f"k{k + 1}": block("gain", gain=float(gains[0, k])) for k in range(order)},
    }  # fmt: skip
    wires = ["r -> law.in1", "law -> hold", "hold -> plant.u"]
    for k in range(order):
        wires += [f"plant.x{k + 1} -> k{k + 1}", f"k{k + 1} -> law.in{k + 2}"]
    diagram = system(blocks, wires, {"y": "plant.y"})
    found = Evaluation(diagram).poles.values
    for pole in slow:
        assert np.abs(found - pole).min() < 1e-6 * abs(pole)
    closed = control.ss(sampled.A - sampled.B @ gains, sampled.B, sampled.C - sampled.D @ gains, sampled.D, step)
    expected = control.step_response(closed, np.arange(61) * step).outputs
    run = simulate(diagram, signals={"r": _STEP}, outputs=["y"], duration=60 * step, samples=61, metrics=[])
    np.testing.assert_allclose(run.curves["y"], expected, atol=1e-8 * np.abs(expected).max())


# sample time, kp, ki, kd of the digital version: computed from the samples of the error, held in between. The pendulum is not
# among them: its angle needs an integral, which then hides behind the zero of the plant at 0; its state feedback is digital above.
DIGITAL = {
    "motor speed": (0.05, 60.0, 120.0, 2.0),
    "motor position": (0.001, 5.0, 50.0, 0.05),
    "cruise": (0.02, 600.0, 30.0, 0.0),
    "suspension": (0.0005, 100000.0, 50000.0, 2000.0),
    "pitch": (0.01, 2.0, 0.4, 3.0),
    "ball and beam": (0.02, 8.0, 0.2, 20.0),
    "mass on a spring": (0.005, 100.0, 80.0, 5.0),
    "train": (0.05, 2.0, 0.3, 0.5),
    "first order of the frequency response": (0.02, 1.0, 0.8, 0.0),
}
FILTER = 50.0


def _digital(name: str) -> tuple[Diagram, np.ndarray, np.ndarray, np.ndarray]:
    """Return the loop, and A, B, C of the open one from sample to sample by python-control."""
    step, kp, ki, kd = DIGITAL[name]
    tutorial = TUTORIALS[name]
    law = block("sampled_pid", kp=kp, ki=ki, kd=kd, filter_frequency=FILTER, sample_time=step)
    plant = control.c2d(control.ss(control.tf(*tutorial.plant)), step, "zoh")
    n = plant.nstates
    # integral, last error, derivative: I += ki T e,  D = (D + w kd (e - last))/(1 + w T)
    share = 1 / (1 + FILTER * step)
    a = np.zeros((n + 3, n + 3))
    b = np.zeros((n + 3, 1))
    a[:n, :n] = plant.A
    law_a = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, -FILTER * kd * share, share]])
    law_b = np.array([[ki * step], [1.0], [FILTER * kd * share]])
    law_c, law_d = np.array([[1.0, 0.0, 1.0]]) @ law_a, kp + law_b[0, 0] + law_b[2, 0]
    a[n:, n:] = law_a
    a[:n, n:] = plant.B @ law_c
    b[:n], b[n:] = plant.B * law_d, law_b
    return _loop(tutorial, law), a, b, np.hstack([plant.C, np.zeros((1, 3))])


@pytest.mark.parametrize("name", DIGITAL)
def test_a_digital_loop_has_the_margins_and_the_step_of_its_samples(name: str) -> None:
    diagram, a, b, c = _digital(name)

    def radius(gain: complex) -> float:
        """Return how far the farthest eigenvalue that moves with the gain is from 0."""
        moving = np.linalg.eigvals(a - gain * b @ c)
        fixed = np.abs(moving - 1) < 1e-9  # the law's integral, where its gain is 0
        return float(np.abs(moving[~fixed]).max())

    assert radius(1.0) < 1
    requests = [MetricRequest(metric=metric, open_at="error") for metric in ("gain_margin_up", "phase_margin")]
    (gain, _), (phase, _) = measure(diagram, requests)
    assert (gain.verdict, phase.verdict) == (Verdict.OK, Verdict.OK)
    for sign in (-1, 1):
        assert (radius(gain.value * (1 + sign * 1e-7)) > 1) is (sign > 0)
        assert (radius(np.exp(-1j * phase.value * (1 + sign * 1e-7))) > 1) is (sign > 0)
    step, count = DIGITAL[name][0], 40
    found = simulate(diagram, signals={"r": _STEP}, outputs=["y"], duration=count * step, samples=count + 1, metrics=[])
    state, expected = np.zeros((len(a), 1)), []
    for _ in range(count + 1):
        y = float((c @ state)[0, 0])
        expected.append(y)
        state = a @ state + b * (1.0 - y)
    np.testing.assert_allclose(found.curves["y"], expected, atol=1e-9 * np.abs(expected).max())
