"""What an output is compared with: told by what the inputs drive, said in the reply, refused where units differ."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from engine.analysis.measuring import MetricRequest, measure
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram, compile_system
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document

STEP = make("step", {})
ERRORS = ("iae", "ise", "itae", "ie", "steady_state_error")


def loop(*, limited: bool = False) -> Diagram:
    """Return 1/(s + 1) under 2 + 3/s: e = (s² + s)/(s² + 3 s + 3) r."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "c": block("pi", kp="=kp", ki=3.0),
        "p": block("transfer_function", numerator=[1.0], denominator=[1.0, 1.0]),
    }  # fmt: skip
    wires = ["r -> e.in1", "p -> e.in2", "e -> c", "c -> p"]
    if limited:  # never reached
        blocks["s"] = block("saturation", lower=-100.0, upper=100.0)
        wires = [*wires[:3], "c -> s", "s -> p"]
    return compile_system(document(blocks, wires, {"y": "p", "error": "e"}, kp=2.0))


def by_hand(weight) -> float:
    """Return ∫ weight(t, e) dt of the loop's error, from its differential equation."""

    def rates(_, state):
        integral, y = state
        return [3 * (1 - y), 2 * (1 - y) + integral - y]

    found = solve_ivp(rates, (0, 30), [0, 0], rtol=1e-11, atol=1e-13, dense_output=True)
    return quad(lambda t: weight(t, 1 - found.sol(t)[1]), 0, 30, limit=500, epsabs=1e-9)[0]


def ask(made: Diagram, metrics, output: str, duration: float | None = None, **signals):
    requests = [MetricRequest(metric=m, signals=signals, output=output, duration=duration) for m in metrics]
    return dict(zip(metrics, (found for found, _ in measure(made, requests)), strict=True))


@pytest.mark.parametrize("limited", [False, True])
def test_an_output_that_is_the_error_is_its_own_error(limited):
    """Its integrals are finite, and those of the output beside it; it had none, as its reference less itself stays."""
    made = loop(limited=limited)
    found, other = ask(made, ERRORS, "error", r=STEP), ask(made, ERRORS, "y", r=STEP)
    expected = {
        "iae": by_hand(lambda _, e: abs(e)), "ise": by_hand(lambda _, e: e * e), "itae": by_hand(lambda t, e: t * abs(e)),
        "ie": 1 / 3, "steady_state_error": 0.0,
    }  # fmt: skip
    for metric, value in expected.items():
        assert found[metric].value == pytest.approx(value, rel=1e-6, abs=1e-9), metric
        assert found[metric].value == pytest.approx(other[metric].value, rel=1e-8, abs=1e-9), metric
        assert (found[metric].reference, other[metric].reference) == ("itself", "r")


@pytest.mark.parametrize("limited", [False, True])
def test_what_ranks_candidates_means_the_same_error(limited):
    made = loop(limited=limited)
    for output in ("error", "y"):
        request = MetricRequest(metric="ise", signals={"r": STEP}, output=output, duration=20.0)
        screened = Screening(made, [request])({"kp": np.array([2.0])})
        ((exact, _),) = measure(made, [request])
        assert screened.doubtful[0, 0] or screened.values[0, 0] == pytest.approx(exact.value, rel=1e-4)


def drive(role: str | None = None) -> Diagram:
    """Return a speed loop of a DC motor with a load torque."""
    given = {} if role is None else {"role": role}
    blocks = {
        "r": block("input"), "load": block("input", **given), "half": block("gain", gain=0.5), "e": block("sum", signs="+-"),
        "c": block("pi", kp=1.0, ki=20.0),
        "motor": block("dc_motor", resistance=1.0, inductance=1e-3, torque_constant=0.1, back_emf_constant=0.1,
                       inertia=1e-3, viscous_friction=1e-4),
    }  # fmt: skip
    wires = [
        "r -> e.in1",
        "motor.speed -> e.in2",
        "e -> c",
        "c -> motor.voltage",
        "load -> half",
        "half -> motor.load_torque",
    ]
    return compile_system(
        document(blocks, wires, {"speed": "motor.speed", "angle": "motor.angle", "current": "motor.current"})
    )


def test_an_input_that_only_loads_is_a_disturbance():
    """A load of 1 N m: ∫e = 1/ki times what it takes of the voltage, R M/K + ..., not ∞ as against a speed of 1."""
    made = drive()
    assert dict(made.references.roles) == {"r": "reference", "load": "disturbance"}
    found = ask(made, ("ie", "steady_state_error"), "speed", load=STEP)
    # at rest ω = 0: u = R i, i = 0.5/K_t = 5 A, and ki ∫e = u = 5 V
    assert found["ie"].value == pytest.approx(5 / 20, rel=1e-9)
    assert found["steady_state_error"].value == pytest.approx(0.0, abs=1e-9)
    assert found["ie"].reference == "0"


def test_a_role_that_is_given_holds():
    made = drive("reference")
    assert made.references.roles["load"] == "reference"
    assert ask(made, ("ie",), "current", load=STEP)["ie"].reference == "load"


def test_unlike_units_are_not_compared():
    """The reference is added to a speed, so it is one: an angle (rad) and a current (A) are not compared with it."""
    made = drive()
    assert made.references.input_units["r"] == "rad/s"
    assert ask(made, ("itae",), "speed", r=STEP)["itae"].verdict is Verdict.OK
    for output, unit in (("angle", "rad"), ("current", "A")):
        for metric in ERRORS:
            found = ask(made, (metric,), output, 1.0, r=STEP)[metric]
            assert (found.value, found.verdict) == (None, Verdict.NOT_APPLICABLE)
            assert f"({unit})" in found.advice
            assert "(rad/s)" in found.advice


def test_a_flow_is_not_compared_with_a_velocity():
    made = compile_system(
        document({"u": block("input"), "motor": block("linear_pneumatic_motor", area=65e-4, volume=1e-3, pressure=5e5, mass=30.0)},
                 ["u -> motor.flow"], {"v": "motor.velocity"})
    )  # fmt: skip
    found = ask(made, ("iae",), "v", 1.0, u=STEP)["iae"]
    assert found.verdict is Verdict.NOT_APPLICABLE
    assert "m**3/s" in found.advice
    assert "m/s" in found.advice
