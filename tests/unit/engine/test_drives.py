"""Drives: what the textbooks say of them, how their ports go together, and what they refuse."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from engine.diagram.diagram import System, compile_system
from engine.elements import Realization
from engine.model.errors import DiagramError
from tests.unit.engine import diagrams
from tests.unit.engine.diagrams import block, document
from tests.unit.engine.realizations import member, ports, realized, response

S = (0.2j, 11.0 + 3.0j, 400.0j)


def vibrating(r: Realization) -> tuple[float, float]:
    """Return undamped frequency and damping ratio of the only complex pair of poles."""
    pair = [pole for pole in np.linalg.eigvals(r.a) if pole.imag > 0]
    assert len(pair) == 1
    return abs(pair[0]), -pair[0].real / abs(pair[0])


# Direct-current motor. Franklin, Powell and Emami-Naeini, chapter 2: without friction
# ω/u = (1/K_e) / (T_m T_e s² + T_m s + 1) with T_e = L/R and T_m = R J/(K_t K_e).
R, L, KT, KE, J = 0.5, 1e-3, 0.2, 0.2, 2e-3
ELECTRICAL, MECHANICAL = L / R, R * J / (KT * KE)


@pytest.mark.parametrize("s", S)
def test_dc_motor_by_its_time_constants(s):
    h = response(realized("dc_motor", viscous_friction=0.0), s)
    speed = (1 / KE) / (MECHANICAL * ELECTRICAL * s**2 + MECHANICAL * s + 1)
    np.testing.assert_allclose(h[1, 0], speed, rtol=1e-12)
    # The current drives the inertia alone: K_t i = J ω'.
    np.testing.assert_allclose(h[3, 0], J * s * speed / KT, rtol=1e-12)


def test_dc_motor_defaults_have_these_time_constants():
    # T_e = 2 ms, T_m = 25 ms: T_m > 4 T_e, so both poles are real.
    poles = np.sort(np.linalg.eigvals(realized("dc_motor", viscous_friction=0.0).a).real)
    root = math.sqrt(1 - 4 * ELECTRICAL / MECHANICAL)
    expected = [-(1 + root) / (2 * ELECTRICAL), -(1 - root) / (2 * ELECTRICAL), 0.0]
    np.testing.assert_allclose(poles, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("resistance", [0.33, 0.5, 0.8])
def test_dc_motor_at_rest_and_at_constant_speed(resistance):
    # The paper's comparison of armature resistances. Stalled i = u/R; at constant speed ω = K_t u/(R b + K_t K_e), and a load
    # takes R/(R b + K_t K_e) of it for each N m.
    friction = 1e-3
    r = realized("dc_motor", resistance=resistance)
    steady = response(Realization(a=r.a[1:, 1:], b=r.b[1:], c=r.c[1:, 1:], d=r.d[1:]), 0)
    expected = np.array([KT, -resistance]) / (resistance * friction + KT * KE)
    np.testing.assert_allclose(steady[0], expected, rtol=1e-13)
    stalled = response(realized("dc_motor", resistance=resistance, inertia=1e30), 1e-9)
    np.testing.assert_allclose(stalled[2:, 0], [0.0, 1 / resistance, KT / resistance], rtol=1e-8, atol=1e-20)


def test_without_inductance_the_current_follows_at_once():
    r = realized("dc_motor", inductance=0.0)
    assert len(r.a) == 2
    np.testing.assert_array_equal(r.d[3], [1 / R, 0.0])
    # The limit of a small inductance: L/R = 2e-9 s changes nothing to 9 digits below 1 rad/s.
    for s in (0.3j, 1.0j):
        np.testing.assert_allclose(response(r, s), response(realized("dc_motor", inductance=1e-9), s), rtol=1e-8)


def test_a_batch_with_and_without_inductance():
    r = realized("dc_motor", inductance=np.array([0.0, 1e-3, 0.0]))
    for number, inductance in enumerate((0.0, 1e-3, 0.0)):
        one = member(r, number)
        poles = np.linalg.eigvals(one.a)
        assert np.sort(poles.real)[:2].max() < 0  # only the angle integrates: an unneeded state decays unseen
        for s in S:
            np.testing.assert_allclose(
                response(one, s), response(realized("dc_motor", inductance=inductance), s), rtol=1e-12
            )


def test_an_infinitesimal_on_an_inductance_of_0_is_dropped():
    r = realized("dc_motor", inductance=1e-30j)
    assert len(r.a) == 2
    assert np.isrealobj(r.a)


@pytest.mark.parametrize("s", S)
def test_gear_and_load_torque_go_together(s):
    """A load inertia behind a gear, whose torque comes back to the motor, is J_l/n² at the motor."""
    load_inertia, ratio = 0.3, 12.0
    system = document(
        {
            "u": block("input"),
            "motor": block("dc_motor"),
            "gear": block("gear", ratio=ratio),
            "load": block("gain", gain=load_inertia),
        },
        [
            "u -> motor.voltage", "motor.acceleration -> gear.motion", "gear.load_motion -> load",
            "load -> gear.load_torque", "gear.motor_torque -> motor.load_torque",
        ],
        {"speed": "motor.speed", "current": "motor.current"},
    )  # fmt: skip
    rigid = response(realized("dc_motor", inertia=J + load_inertia / ratio**2), s)
    realized_system = compile_system(system).realize()
    got = [diagrams.response(realized_system, s, name, "u") for name in ("speed", "current")]
    np.testing.assert_allclose(got, rigid[[1, 3], 0], rtol=1e-11)


@pytest.mark.parametrize("s", S)
def test_ball_screw_and_load_torque_go_together(s):
    """A table on a ball screw is m (lead/2π)² at the motor."""
    mass, lead = 80.0, 0.02
    system = document(
        {
            "i": block("input"),
            "axis": block("ac_servo_axis"),
            "screw": block("ball_screw", lead=lead),
            "table": block("gain", gain=mass),
        },
        [
            "i -> axis.command", "axis.acceleration -> screw.motion", "screw.travel -> table", "table -> screw.force",
            "screw.torque -> axis.load_torque",
        ],
        {"speed": "axis.speed"},
    )  # fmt: skip
    rigid = response(realized("ac_servo_axis", inertia=1e-3 + mass * (lead / (2 * math.pi)) ** 2), s)
    got = diagrams.response(compile_system(system).realize(), s, "speed", "i")
    assert got == pytest.approx(rigid[1, 0], rel=1e-11)


def test_current_loop_bandwidth_is_its_3_db_frequency():
    h = response(realized("ac_servo_axis", current_bandwidth=2500.0), 2500.0j)
    assert abs(h[3, 0]) == pytest.approx(2**-0.5, rel=1e-14)


# Hydraulic motors. Merritt, chapter 6: w_h = sqrt(4 β A²/(V m)) without leakage and friction; for a cylinder of two rooms
# the oil columns are springs side by side, k = β (A1²/V1 + A2²/V2).
AREA, VOLUME, BULK, MASS = 65e-4, 1e-3, 1.4e9, 300.0
LOSSLESS = {"leakage": 0.0, "viscous_friction": 0.0}


def test_hydraulic_frequency():
    frequency, damping = vibrating(realized("linear_hydraulic_motor", **LOSSLESS))
    assert frequency == pytest.approx(math.sqrt(4 * BULK * AREA**2 / (VOLUME * MASS)), rel=1e-12)
    assert damping == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("rod", "share"), [(40e-4, None), (40e-4, 0.7), (AREA, 0.2), (None, 0.2)])
def test_oil_springs_of_a_differential_cylinder(rod, share):
    given = {name: value for name, value in (("rod_area", rod), ("piston_volume_share", share)) if value is not None}
    frequency, _ = vibrating(realized("linear_hydraulic_motor", **LOSSLESS, **given))
    second = AREA if rod is None else rod
    part = AREA / (AREA + second) if share is None else share
    stiffness = BULK * (AREA**2 / (part * VOLUME) + second**2 / ((1 - part) * VOLUME))
    assert frequency == pytest.approx(math.sqrt(stiffness / MASS), rel=1e-12)


@pytest.mark.parametrize("s", S)
@pytest.mark.parametrize("external", [0.0, 5e-11])
def test_a_differential_cylinder_of_equal_areas_is_the_symmetric_one(s, external):
    one = response(realized("linear_hydraulic_motor", external_leakage=external), s)
    two = response(realized("linear_hydraulic_motor", external_leakage=external, rod_area=AREA), s)
    np.testing.assert_allclose(two[:4], one, rtol=1e-10)
    # Equal rooms share the pressure difference.
    np.testing.assert_allclose(two[4:], [one[3] / 2, -one[3] / 2], rtol=1e-10)


def test_at_constant_speed_the_flow_is_area_times_velocity():
    # No force, no friction: both pressures stay 0, whatever the areas.
    r = realized("linear_hydraulic_motor", rod_area=40e-4, viscous_friction=0.0)
    steady = response(Realization(a=r.a[1:, 1:], b=r.b[1:], c=r.c[1:, 1:], d=r.d[1:]), 0)[:, 0]
    np.testing.assert_allclose(steady, [1 / AREA, 0, 0, 0, 0], rtol=1e-12, atol=1e-3)


@pytest.mark.parametrize(
    ("given", "states"),
    [
        ({}, 4),
        ({"leakage": 0.0}, 3),
        ({"leakage": 0.0, "external_leakage": 1e-12}, 4),
        ({"rod_area": AREA}, 3),
        ({"rod_area": AREA, "external_leakage": 1e-12}, 4),
        ({"leakage": 1e-30j}, 3),
    ],
)
def test_oil_that_nothing_moves_has_no_state(given, states):
    r = realized("linear_hydraulic_motor", **({"rod_area": 40e-4} | given))
    assert len(r.a) == states
    # Only the position integrates: no pole at 0 that no input reaches.
    assert np.sum(abs(np.linalg.eigvals(r.a.real)) < 1e-6) == 1


def test_a_batch_where_only_some_members_leak():
    leakage = np.array([0.0, 27e-11])
    r = realized("linear_hydraulic_motor", rod_area=40e-4, leakage=leakage)
    for number in (0, 1):
        one = member(r, number)
        assert np.sum(abs(np.linalg.eigvals(one.a)) < 1e-6) == 1
        single = realized("linear_hydraulic_motor", rod_area=40e-4, leakage=leakage[number].item())
        for s in S[1:]:  # far below, an acceleration is a small rest of what the force gives at once
            np.testing.assert_allclose(response(one, s), response(single, s), rtol=1e-9)


@pytest.mark.parametrize("leakage", [9.1e-11, 18e-11, 27e-11])
def test_leakage_damps_the_hydraulic_motor(leakage):
    # The paper's Fig. 8, a_m from 9.1 cm⁵/(daN s) on. From s² C m + s (C b + m a) + A² + a b, C = V/(4 β).
    capacity, friction = VOLUME / (4 * BULK), 1200.0
    expected = (capacity * friction + MASS * leakage) / 2
    expected /= math.sqrt(capacity * MASS * (AREA**2 + leakage * friction))
    assert vibrating(realized("linear_hydraulic_motor", leakage=leakage))[1] == pytest.approx(expected, rel=1e-12)


def test_with_the_largest_leakage_nothing_vibrates():
    # 45 cm⁵/(daN s): d = a_m/A sqrt(β m/V) = 1.42 by leakage alone.
    assert np.all(np.linalg.eigvals(realized("linear_hydraulic_motor", leakage=45e-11).a).imag == 0)


def test_rotary_hydraulic_frequency():
    frequency, _ = vibrating(realized("rotary_hydraulic_motor", leakage=0.0, viscous_friction=0.0))
    assert frequency == pytest.approx(math.sqrt(4 * 1.4e9 * 8e-6**2 / (2e-4 * 0.05)), rel=1e-12)


@pytest.mark.parametrize(
    ("valve", "command"),
    [
        (block("proportional_valve", flow_gain=1e-4, time_constant=0.0, flow_pressure_coefficient=6e-11), "command"),
        (block("servo_valve", natural_frequency=1e7, flow_pressure_coefficient=6e-11), "current"),
    ],
)
def test_a_flow_pressure_coefficient_acts_as_leakage(valve, command):
    system = document(
        {"u": block("input"), "load": block("input"), "valve": valve, "motor": block("linear_hydraulic_motor")},
        [
            f"u -> valve.{command}", "load -> motor.force", "valve.flow -> motor.flow",
            "motor.pressure_difference -> valve.load_pressure",
        ],
        {"position": "motor.position"},
    )  # fmt: skip
    leaking = realized("linear_hydraulic_motor", leakage=27e-11 + 6e-11)
    for s in S:
        compliance = diagrams.response(compile_system(system).realize(), s, "position", "load")
        assert compliance == pytest.approx(response(leaking, s)[0, 1], rel=1e-10)


def test_servo_valve_by_its_data_sheet():
    # Full opening at the rated current; at three times the rated drop the flow is sqrt(3) times the rated one.
    flow, opening = response(realized("servo_valve"), 0)[:, 0] * 0.04
    assert flow == pytest.approx(6.5e-4 * math.sqrt(3), rel=1e-14)
    assert opening == pytest.approx(1.0, rel=1e-14)
    # A phase of -90 degrees at the natural frequency.
    assert np.angle(response(realized("servo_valve"), 600.0j)[0, 0]) == pytest.approx(-math.pi / 2, rel=1e-14)


@pytest.mark.parametrize(
    ("kind", "given", "inputs", "outputs"),
    [
        ("proportional_valve", {}, ("command",), ("flow",)),
        ("proportional_valve", {"flow_pressure_coefficient": 0.0}, ("command", "load_pressure"), ("flow",)),
        ("servo_valve", {}, ("current",), ("flow", "opening")),
        ("servo_valve", {"flow_pressure_coefficient": 1e-12}, ("current", "load_pressure"), ("flow", "opening")),
        ("power_amplifier", {}, ("command",), ("voltage",)),
        ("power_amplifier", {"output": "current"}, ("command",), ("current",)),
        ("linear_hydraulic_motor", {}, ("flow", "force"),
         ("position", "velocity", "acceleration", "pressure_difference")),
        ("linear_hydraulic_motor", {"rod_area": 1e-3}, ("flow", "force"),
         ("position", "velocity", "acceleration", "pressure_difference", "piston_pressure", "rod_pressure")),
        ("dc_motor", {}, ("voltage", "load_torque"), ("angle", "speed", "acceleration", "current", "torque")),
        ("ac_servo_axis", {}, ("command", "load_torque"), ("angle", "speed", "acceleration", "current", "torque")),
        ("rotary_hydraulic_motor", {}, ("flow", "load_torque"),
         ("angle", "speed", "acceleration", "pressure_difference")),
    ],
)  # fmt: skip
def test_ports(kind, given, inputs, outputs):
    assert ports(kind, **given) == (inputs, outputs)


def alone(kind: str, **values: Any) -> System:
    return document({"drive": block(kind, **values)})


@pytest.mark.parametrize(
    ("kind", "given", "at", "message"),
    [
        ("dc_motor", {"resistance": 0.0}, "resistance", "drive.resistance must be > 0 ohm, got 0"),
        ("dc_motor", {"inductance": -1e-3}, "inductance", "drive.inductance must be >= 0 H, got -0.001"),
        ("dc_motor", {"inertia": 0}, "inertia", "must be > 0 kg\\*m\\*\\*2, got 0"),
        ("ac_servo_axis", {"current_bandwidth": 0}, "current_bandwidth", "must be > 0 rad/s, got 0"),
        ("ac_servo_axis", {"viscous_friction": -1}, "viscous_friction", "must be >= 0 N\\*m\\*s/rad, got -1"),
        ("power_amplifier", {}, "gain", "drive.gain must be given"),
        ("power_amplifier", {"gain": 1, "output": "power"}, "output", "one of voltage, current, got 'power'"),
        ("power_amplifier", {"gain": 1, "bandwidth": -5}, "bandwidth", "must be > 0 rad/s, got -5"),
        ("servo_valve", {"rated_current": 0}, "rated_current", "must be > 0 A, got 0"),
        ("servo_valve", {"flow_pressure_coefficient": -1}, "flow_pressure_coefficient", "must be >= 0 m"),
        ("servo_valve", {"flow_gain": 1}, "flow_gain", "must be one of rated_flow"),
        ("rotary_hydraulic_motor", {"displacement": 0}, "displacement", "must be > 0 m\\*\\*3/rad, got 0"),
        ("linear_hydraulic_motor", {"rod_area": 0}, "rod_area", "must be > 0 m\\*\\*2, got 0"),
        ("linear_hydraulic_motor", {"external_leakage": -1}, "external_leakage", "must be >= 0 m"),
        ("linear_hydraulic_motor", {"piston_volume_share": 1.0}, "piston_volume_share", "and <= 0.99, got 1"),
        ("linear_pneumatic_motor", {"pressure": 0}, "pressure", "must be > 0 Pa, got 0"),
        ("dc_motor", {"torque_constant": [0.2]}, "torque_constant", "must be a number"),
    ],
)
def test_refuses(kind, given, at, message):
    with pytest.raises(DiagramError, match=message) as caught:
        compile_system(alone(kind, **given))
    assert caught.value.at == ("blocks", "drive", at)
