"""Systems at the edge of what can be asked: each answers soon, or says soon why it does not."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from scipy.special import gammainc

from engine.analysis.evaluation import Evaluation
from engine.analysis.study import MetricRequest, measure, simulate
from engine.diagram.diagram import Diagram
from engine.model.errors import DiagramError
from engine.model.verdicts import Verdict
from tests.reference.measuring import expect, step
from tests.reference.systems import block, system, transfer_function
from tests.reference.test_control_elements import CASES as CONTROL
from tests.reference.test_drive_elements import CASES as DRIVES
from tests.reference.test_drive_elements import CYLINDER, differential_cylinder, exact, mp


def row(count: int, kind: str, last: dict[str, Any], **values: Any) -> Diagram:
    """u -> count equal blocks -> plant -> y."""
    names = [f"b{i}" for i in range(count)]
    blocks = {"u": block("input"), **{name: block(kind, **values) for name in names}, "plant": block(**last)}
    chain = ["u", *names, "plant"]
    return system(blocks, [f"{a} -> {b}" for a, b in itertools.pairwise(chain)], {"y": "plant"})


def test_five_hundred_blocks() -> None:
    gain = 1.001
    diagram = row(498, "gain", {"kind": "transfer_function", "numerator": [1], "denominator": [1, 1]}, gain=gain)
    found = simulate(diagram, signals={"u": step()}, outputs=["y"]).metrics["y"]
    expect(found["settling_time"], math.log(50))
    expect(found["peak"], gain**498)


def test_eighty_lags_in_a_row() -> None:
    # mean and half the second moment of the gamma distribution with n = 80
    lag = {"numerator": [1], "denominator": [1, 1]}
    diagram = row(79, "transfer_function", {"kind": "transfer_function", **lag}, **lag)
    requests = [MetricRequest(metric=name, signals={"u": step()}, output="y") for name in ("iae", "itae", "overshoot")]
    (iae, _), (itae, _), (overshoot, _) = measure(diagram, requests)
    expect(iae, 80)
    expect(itae, 80 * 81 / 2)
    expect(overshoot, 0)


@pytest.mark.parametrize(
    ("numerator", "denominator", "rule"),
    [
        ([1, 0, 0], [1, 1], "numerator must be at most of the order"),
        ([1], [], "denominator must have a coefficient other than 0"),
        ([1], [0, 0], "denominator must have a coefficient other than 0"),
        ([math.nan], [1, 1], "must be finite"),
        ([1e99], [1e-250, 1], "finite coefficients, but they overflow|must be finite"),
        ([1e300], [1, 1], r"numerator\[0\] must be <= 1e\+100 in size, got 1e\+300"),
    ],
)
def test_polynomials_that_are_none(numerator: list[float], denominator: list[float], rule: str) -> None:
    with pytest.raises(DiagramError, match=rule):
        simulate(transfer_function(numerator, denominator), signals={"u": step()})


@pytest.mark.parametrize(
    ("values", "rule"),
    [
        ({"time": -1.0}, "time must be >= 0 s, got -1"),
        ({"time": math.inf}, "time must be finite, got inf"),
        ({"time": 1e308}, r"time must be <= 1e\+06 s in size, got 1e\+308"),
        ({"time": 1.0, "approximation": "taylor"}, "approximation must be one of exact, pade, got 'taylor'"),
        ({"time": 1.0, "approximation": "pade", "order": 0}, "order must be a whole number"),
    ],
)
def test_delays_that_are_none(values: dict[str, Any], rule: str) -> None:
    with pytest.raises(DiagramError, match=rule):
        system({"u": block("input"), "late": block("delay", **values)}, ["u -> late"], {"y": "late"})


def test_what_cannot_be_resolved_says_so() -> None:
    # a damping ratio of 1e-9 needs some 10^10 periods
    request = MetricRequest(metric="settling_time", signals={"u": step()}, output="y")
    ((measured, _),) = measure(transfer_function([1], [1, 2e-9, 1]), [request])
    assert (measured.value, measured.verdict) == (None, Verdict.DOUBTFUL)
    assert "too lightly damped" in measured.advice


def test_a_delay_of_a_quarter_of_an_hour_in_a_loop() -> None:
    # (1/2) e^{-1000 s}/(s + 1): the steps settle at 1/3 by halves; the first reaches 1/2 before any echo comes
    diagram = system(
        {
            "r": block("input"),
            "e": block("sum", signs="+-"),
            "late": block("delay", time=1000.0),
            "lag": block("transfer_function", numerator=[0.5], denominator=[1, 1]),
        },
        ["r -> e.in1", "lag -> e.in2", "e -> late", "late -> lag"],
        {"y": "lag"},
    )
    done = simulate(diagram, signals={"r": step()}, outputs=["y"], duration=4000.0, samples=9)
    assert not done.curves["y"][done.time < 1000].any()
    assert done.curves["y"][[3, 5, 7]] == pytest.approx([1 / 2, 1 / 4, 3 / 8], abs=1e-12)
    expect(done.metrics["y"]["overshoot"], 0.5)
    assert np.isfinite(done.curves["y"]).all()


def test_a_lag_of_a_second_in_a_loop_of_a_day() -> None:
    delay = 1e5
    # y = sum of -(-1/2)^k P(k, t - k T): each echo is one more lag, P the regularised incomplete gamma function
    diagram = system(
        {
            "r": block("input"),
            "e": block("sum", signs="+-"),
            "late": block("delay", time=delay),
            "lag": block("transfer_function", numerator=[0.5], denominator=[1, 1]),
        },
        ["r -> e.in1", "lag -> e.in2", "e -> late", "late -> lag"],
        {"y": "lag"},
    )
    response = Evaluation(diagram).time_response({"r": step()}, ["y"])
    assert response.joint is not None
    assert len(response.joint.y) < 2000  # pieces: the lag is short, and what follows it is wide
    echoes = np.arange(1, 50)
    after = np.linspace(0.0, 100.0, 201)
    time = (echoes[:, None] * delay + after).ravel()
    exact = sum(-((-0.5) ** k) * gammainc(k, np.maximum(time - k * delay, 0.0)) for k in echoes)
    assert np.abs(response.joint.output(0).sample(time) - exact).max() <= 1e-8


MOTOR = {"back_emf_constant": 0.21, "inertia": 2e-3, "viscous_friction": 3e-3, "resistance": 0.33}


def test_a_current_that_follows_at_once_still_turns_the_shaft() -> None:
    # ω/u = K/((R + L s)(J s + b) + K K_e); the angle integrates it however fast the current is
    for inductance in (1e-6, 1e-9, 1e-12):
        motor = block("dc_motor", **MOTOR, torque_constant=0.2, inductance=inductance)
        diagram = system({"u": block("input"), "m": motor}, ["u -> m.voltage"], {"angle": "m.angle"})
        slow = Evaluation(diagram).path("u", "angle").response(np.array([1e-6]))
        assert slow[0] == pytest.approx(0.2 / (0.33 * 3e-3 + 0.2 * 0.21) / 1e-6j, rel=1e-3)


def test_a_weak_torque_turns_as_far_as_it_must() -> None:
    # ω = K u/(R b + K K_e)
    motor = block("dc_motor", **MOTOR, torque_constant=1e-12, inductance=1.5e-3)
    diagram = system({"u": block("input"), "m": motor}, ["u -> m.voltage"], {"speed": "m.speed"})
    done = simulate(diagram, signals={"u": step()}, outputs=["speed"], metrics=["peak"])
    expect(done.metrics["speed"]["peak"], 1e-12 / (0.33 * 3e-3 + 1e-12 * 0.21))


@pytest.mark.parametrize("frequency", [1e6, 1e9, 1e12])
def test_a_fast_filter_leaves_the_integral_action(frequency: float) -> None:
    law = {"kp": 3.0, "ki": 2.0, "kd": 0.5, "filter_frequency": frequency}
    diagram = system({"e": block("input"), "law": block("pid", **law)}, ["e -> law"], {"u": "law"})
    path = Evaluation(diagram).path("e", "u")
    assert (path.static, path.verdict) == (None, Verdict.INTEGRATING)
    assert path.response(np.array([1e-6]))[0] == pytest.approx(2.0 / 1e-6j, rel=1e-5)


def test_a_cylinder_in_thick_grease_still_integrates_its_flow() -> None:
    law = {**CYLINDER, "rod_area": 42e-4, "viscous_friction": 1e12}
    blocks = {"q": block("input"), "c": block("linear_hydraulic_motor", **law)}
    path = Evaluation(system(blocks, ["q -> c.flow"], {"z": "c.position"})).path("q", "z")
    assert (path.static, path.verdict) == (None, Verdict.INTEGRATING)
    expected = complex(differential_cylinder(mp.mpc(0, 1e-6), exact(law))[0][0])
    assert path.response(np.array([1e-6]))[0] == pytest.approx(expected, rel=1e-9)


FAR_APART: list[tuple[str, dict[str, Any]]] = [
    ("pd2", {"kp": 2.0, "kd1": 0.1, "kd2": 0.001, "filter_frequency": 1e12, "filter_damping": 0.6}),
    ("feed_forward", {"kf": 0.5, "kv": 1.1, "ka": 0.02, "filter_frequency": 1e12, "filter_damping": 0.6}),
    ("lead_lag", {"gain": 2.0, "zero_frequency": 1e-12, "pole_frequency": 300.0}),
    ("derivative", {"gain": 3.0, "filter_frequency": 1e12}),
    ("pid", {"kp": 3.0, "ki": 2.0, "kd": 0.5, "filter_frequency": 1e12}),
    ("rc_network", {"network": "lead", "r1": 1e5, "c1": 1e-7, "r2": 1e-12}),
    ("accelerometer",
     {"sensitivity": 0.01, "natural_frequency": 5e3, "damping_ratio": 0.7, "high_pass_frequency": 3e12}),
    ("velocity_transducer",
     {"sensitivity": 28.0, "natural_frequency": 2.8e13, "damping_ratio": 0.56, "bandwidth": 800.0}),
    ("two_mass_correction",
     {"m2": 50.0, "m3": 20.0, "h1": 4e14, "h2": 300.0, "k1": 6e4, "k2": 2e4, "k3": 4e4, "k4": 1e4}),
    ("two_mass_correction",
     {"m2": 50.0, "m3": 2e-11, "h1": 400.0, "h2": 300.0, "k1": 6e4, "k2": 2e4, "k3": 4e16, "k4": 1e4}),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "given"), FAR_APART, ids=[f"{kind}-{n}" for n, (kind, _) in enumerate(FAR_APART)])
def test_what_a_fast_corner_leaves_keeps_its_digits(kind: str, given: dict[str, Any]) -> None:
    law = next(formula for name, _, formula in CONTROL + DRIVES if name == kind)
    numbers = exact(given)
    path = Evaluation(system({"u": block("input"), "it": block(kind, **given)}, ["u -> it"], {"y": "it"})).path(
        "u", "y"
    )
    frequencies = np.array([1e-3, 1.0, 30.0, 1e3])

    def expected(s: Any) -> Any:
        value = law(s, numbers)
        return value if kind != "two_mass_correction" else value[0][0]

    with mp.workdps(60):
        responses = [complex(expected(mp.mpc(0, w))) for w in frequencies]
        rest = float(mp.re(expected(mp.mpf("1e-40")))) if kind != "pid" else None
    assert path.response(frequencies) == pytest.approx(responses, rel=1e-9)
    assert (path.static is None) == (rest is None)
    if path.static is not None and rest is not None:
        assert path.static[0] == pytest.approx(rest, rel=1e-12, abs=1e-30)


def test_an_acceleration_at_rest_is_nothing_whatever_the_forces() -> None:
    motor = block("dc_motor", **{**MOTOR, "inertia": 2e-15}, torque_constant=0.2, inductance=1.5e-3)
    diagram = system({"u": block("input"), "m": motor}, ["u -> m.voltage"], {"a": "m.acceleration"})
    path = Evaluation(diagram).path("u", "a")
    assert path.static is not None
    assert path.static[0] == 0
    # a/u = s K/((R + L s)(J s + b) + K K_e): at 1 rad/s nothing but the slope
    s = mp.mpc(0, 1)
    ratio = (
        s
        * mp.mpf(0.2)
        / ((mp.mpf(0.33) + mp.mpf(1.5e-3) * s) * (mp.mpf(2e-15) * s + mp.mpf(3e-3)) + mp.mpf(0.2) * mp.mpf(0.21))
    )
    assert path.response(np.array([1.0]))[0] == pytest.approx(complex(ratio), rel=1e-12)


def test_what_rounding_leaves_of_an_integral_integrates() -> None:
    # without friction a torque accelerates both shafts for ever; a load that counts 1e-24 beside its motor left a pole of 4e-33
    joint = {"motor_inertia": 2e-3, "load_inertia": 0.9, "stiffness": 4e3, "damping": 1.5, "gear_ratio": 1e12}
    blocks = {"u": block("input"), "joint": block("two_inertia", **joint)}
    diagram = system(blocks, ["u -> joint.motor_torque"], {"speed": "joint.motor_speed"})
    evaluation = Evaluation(diagram)
    path = evaluation.path("u", "speed")
    assert (evaluation.poles.verdict, path.verdict, path.static) == (Verdict.INTEGRATING, Verdict.INTEGRATING, None)
    assert path.response(np.array([1e-3]))[0] == pytest.approx(1 / (1e-3j * joint["motor_inertia"]), rel=1e-6)
