"""Loops whose integrators wind up behind a limit: what stands still for a while is not at rest, by the equations written by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from engine.analysis.evaluation import Evaluation
from engine.analysis.measuring import MetricRequest, measure
from engine.analysis.study import simulate
from engine.batch.nonlinear.readings import METRICS
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram, compile_system
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document


def position_loop(outputs: dict[str, str]) -> Diagram:
    """Return P(5) on the position, PI(0.5, 0.5) on the velocity, ±10, 1/(0.1 s + 1), 1/s."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "p": block("p", kp="=kp"), "ev": block("sum", signs="+-"),
        "pi": block("pi", kp=0.5, ki=0.5), "s": block("saturation", lower=-10.0, upper=10.0),
        "m": block("transfer_function", numerator=[1.0], denominator=[0.1, 1.0]), "x": block("integrator"),
    }  # fmt: skip
    wires = [
        "r -> e.in1",
        "x -> e.in2",
        "e -> p",
        "p -> ev.in1",
        "m -> ev.in2",
        "ev -> pi",
        "pi -> s",
        "s -> m",
        "m -> x",
    ]
    return compile_system(document(blocks, wires, outputs, kp=5.0))


def position_by_hand(instants: np.ndarray) -> np.ndarray:
    """Return the position (m) at instants (s) after a step of 1000 m."""

    def rates(_, state):
        integral, velocity, position = state
        error = 5.0 * (1000.0 - position) - velocity
        drive = np.clip(0.5 * error + 0.5 * integral, -10.0, 10.0)
        return [error, (drive - velocity) / 0.1, velocity]

    found = solve_ivp(
        rates, (0, instants[-1]), np.zeros(3), method="LSODA", t_eval=instants, rtol=1e-10, atol=1e-10, max_step=0.5
    )
    return found.y[2]


def test_a_saturated_position_loop_goes_on_while_its_integrator_winds():
    """It is at 334 of 1000 m after 33.5 s, turns at 1987 m, and swings on: its velocity of 10 m/s is no end."""
    instants = np.linspace(0.0, 600.0, 6001)
    expected = position_by_hand(instants)
    signals = {"r": make("step", {"amplitude": 1000.0})}
    for outputs in ({"x": "x"}, {"v": "m"}, {"u": "s"}, {"v": "m", "x": "x"}):
        made = position_loop(outputs)
        found = simulate(made, signals=signals, metrics=["settling_time", "peak"])
        assert found.verdict is Verdict.NOT_SETTLED
        for name in outputs:
            assert found.metrics[name]["settling_time"].verdict is Verdict.NOT_SETTLED
    response = Evaluation(made).simulated(signals, None)
    assert response.outcome.end > 600.0
    np.testing.assert_allclose(response.output("x").sample(instants), expected, atol=1e-3)
    assert expected.max() == pytest.approx(1987.36, abs=0.2)
    assert found.metrics["x"]["peak"].value == pytest.approx(1987.358, abs=1e-3)
    short = simulate(made, signals=signals, duration=33.5, metrics=["settling_time"])
    assert short.metrics["v"]["settling_time"].verdict is Verdict.NOT_SETTLED


@pytest.mark.parametrize("unsettled", [True, False])
@pytest.mark.parametrize("kp", [4.0, 5.0])
def test_what_only_ranks_candidates_does_not_call_it_settled_either(kp, unsettled):
    """What has stopped for a while has the value that the exact path tells, or is left to it; one that must settle has none."""
    made = position_loop({"v": "m", "x": "x"})
    signals = {"r": make("step", {"amplitude": 1000.0})}
    known = 0
    for output in made.outputs:
        for metric in METRICS:
            request = MetricRequest(
                metric=metric, signals=signals, output=output, duration=33.5, unsettled=unsettled
            )  # fmt: skip
            found = Screening(made, [request])({"kp": np.array([kp])})
            if found.doubtful[0, 0]:
                continue
            exact = measure(made, [request], overrides={"kp": kp})[0][0].value
            known += 1
            assert found.values[0, 0] == pytest.approx(np.nan if exact is None else exact, rel=1e-6, nan_ok=True), (
                metric
            )
    assert known >= (12 if unsettled else 7)
    request = MetricRequest(metric="settling_time", signals=signals, output="v")
    assert Screening(made, [request])({"kp": np.array([kp])}).doubtful.all()


KT, INERTIA, FRICTION, RESISTANCE, INDUCTANCE = 0.1, 1e-3, 1e-4, 1.0, 2e-3


def cascade() -> Diagram:
    """Return a DC motor of 24 V with position (P), speed (PI, ±5 A) and current (PI, ±24 V) loops, none of which stops winding up."""
    blocks = {
        "r": block("input"), "ep": block("sum", signs="+-"), "position": block("p", kp=20.0), "ev": block("sum", signs="+-"),
        "speed": block("pi", kp=0.05, ki=0.5), "amps": block("saturation", lower=-5.0, upper=5.0),
        "ei": block("sum", signs="+-"), "current": block("pi", kp=2.0, ki=500.0),
        "volts": block("saturation", lower=-24.0, upper=24.0),
        "motor": block("dc_motor", resistance=RESISTANCE, inductance=INDUCTANCE, torque_constant=KT, back_emf_constant=KT,
                       inertia=INERTIA, viscous_friction=FRICTION),
    }  # fmt: skip
    wires = [
        "r -> ep.in1", "motor.angle -> ep.in2", "ep -> position", "position -> ev.in1", "motor.speed -> ev.in2",
        "ev -> speed", "speed -> amps", "amps -> ei.in1", "motor.current -> ei.in2", "ei -> current", "current -> volts",
        "volts -> motor.voltage",
    ]  # fmt: skip
    return compile_system(document(blocks, wires, {"angle": "motor.angle", "speed": "motor.speed"}))


def speed_by_hand(amplitude: float, instants: np.ndarray) -> np.ndarray:
    """Return the motor's speed (rad/s) at instants (s) after a step of its position."""

    def rates(_, state):
        wound_speed, wound_current, current, speed, angle = state
        error = 20.0 * (amplitude - angle) - speed
        wanted = np.clip(0.05 * error + 0.5 * wound_speed, -5.0, 5.0) - current
        volts = np.clip(2.0 * wanted + 500.0 * wound_current, -24.0, 24.0)
        torque = KT * current - FRICTION * speed
        return [error, wanted, (volts - RESISTANCE * current - KT * speed) / INDUCTANCE, torque / INERTIA, speed]

    found = solve_ivp(
        rates, (0, instants[-1]), np.zeros(5), method="LSODA", t_eval=instants, rtol=1e-10, atol=1e-10, max_step=2e-3
    )
    return found.y[3]


def test_a_drive_at_its_voltage_limit_is_not_at_rest_just_before_it_reverses():
    """Its speed is steady to 1e-6 at ±237.6 rad/s = 24 V / (k + R b / k), and reverses all the same, further each time."""
    made = cascade()
    signals = {"r": make("step", {"amplitude": 10.0})}
    instants = np.linspace(0.0, 8.0, 401)
    expected = speed_by_hand(10.0, instants)
    limit = 24.0 / (KT + RESISTANCE * FRICTION / KT)
    response = Evaluation(made).simulated(signals, 8.0)
    np.testing.assert_allclose(response.output("speed").sample(instants), expected, atol=1e-3)
    end = instants[np.flatnonzero(np.abs(expected + limit) < 1e-6 * limit)[-1]]
    assert expected[-1] > 0.0
    found = Evaluation(made).simulated(signals, float(end))
    assert dict(found.verdicts) == {"angle": Verdict.NOT_SETTLED, "speed": Verdict.NOT_SETTLED}
    found = simulate(made, signals=signals)
    assert found.verdict is Verdict.NOT_SETTLED
    assert found.metrics["speed"]["settling_time"].value is None
