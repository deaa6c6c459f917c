"""Mechanical elements: what the textbooks say of them, energy, how their ports go together, and what they refuse."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import scipy.linalg

from engine.diagram.diagram import Parameter, compile_system
from engine.model.errors import DiagramError
from tests.unit.engine import diagrams
from tests.unit.engine.diagrams import block, document
from tests.unit.engine.realizations import member, ports, realized, response

S = (0.4j, 9.0 + 2.0j, 150.0j)

CORRECTION = {"m2": 50.0, "m3": 20.0, "h1": 400.0, "h2": 300.0, "k1": 6e4, "k2": 2e4, "k3": 4e4, "k4": 1e4}


def correction_polynomials(
    *, m2: float, m3: float, h1: float, h2: float, k1: float, k2: float, k3: float, k4: float
) -> tuple[list[float], list[float]]:
    """Eq. (5) with the physical coefficients, as in the checked reading of the paper: (b2...b0), (a4...a0)."""
    return (
        [h1 * h2, h1 * k3 + h2 * k1, k1 * k3],
        [
            m2 * m3,
            m3 * h2 + m2 * h1 + m2 * h2,
            h1 * h2 + m2 * (k1 + k2 + k3) + m3 * (k3 + k4),
            h1 * (k3 + k4) + h2 * (k1 + k2 + k4),
            k1 * k3 + k1 * k4 + k2 * k3 + k2 * k4 + k3 * k4,
        ],
    )


def as_printed(denominator: list[float], *, h2: float, k2: float, k3: float) -> list[float]:
    """The paper prints h2 k3 in place of h2 k2 in a1, and k3² in place of k2 k3 in a0."""
    a4, a3, a2, a1, a0 = denominator
    return [a4, a3, a2, a1 - h2 * k2 + h2 * k3, a0 - k2 * k3 + k3 * k3]


@pytest.mark.parametrize("s", S)
def test_two_mass_correction_has_the_physical_coefficients(s):
    top, bottom = correction_polynomials(**CORRECTION)
    got = response(realized("two_mass_correction", **CORRECTION), s)[0, 0]
    assert got == pytest.approx(np.polyval(top, s) / np.polyval(bottom, s), rel=1e-12)


def test_the_printed_coefficients_differ():
    k2, k3, h2 = CORRECTION["k2"], CORRECTION["k3"], CORRECTION["h2"]
    top, bottom = correction_polynomials(**CORRECTION)
    printed = as_printed(bottom, h2=h2, k2=k2, k3=k3)
    r = realized("two_mass_correction", **CORRECTION)
    # The element's own characteristic polynomial, scaled to a4 = m2 m3, less the printed one.
    difference = np.poly(r.a) * bottom[0] - printed
    np.testing.assert_allclose(difference[3:], [h2 * (k2 - k3), k3 * (k2 - k3)], rtol=1e-9)
    # At rest it stands where the springs hold it, k1 k3 x1 / a0 (in 1e8 N²/m²: 24/44); with the printed a0, 24/52.
    assert response(r, 0)[0, 0].real == pytest.approx(24 / 44, rel=1e-13)
    assert top[2] / printed[4] == pytest.approx(24 / 52, rel=1e-13)


@pytest.mark.parametrize("s", S)
def test_the_printed_coefficients_are_right_where_k2_is_k3(s):
    given = {**CORRECTION, "k2": CORRECTION["k3"]}
    top, bottom = correction_polynomials(**given)
    printed = as_printed(bottom, h2=given["h2"], k2=given["k2"], k3=given["k3"])
    got = response(realized("two_mass_correction", **given), s)[0, 0]
    assert got == pytest.approx(np.polyval(top, s) / np.polyval(printed, s), rel=1e-12)


def test_a_jump_of_the_input_kicks_the_middle_mass_through_its_damper():
    # x1 jumps by 1: h1 gives m3 the velocity h1/m3 at once, so x2'' = h2/m2 · h1/m3 (initial value theorem: b2/a4).
    r = realized("two_mass_correction", **CORRECTION)
    assert (r.c @ r.a @ r.b)[0, 0] == pytest.approx(CORRECTION["h1"] * CORRECTION["h2"] / (50.0 * 20.0), rel=1e-13)


# One mass. Rao, chapter 3: with r = w/w_n and d = 2 ζ sqrt(k m) the displacement transmissibility is
# sqrt((1 + (2 ζ r)²)/((1 - r²)² + (2 ζ r)²)); it is 1 at r = sqrt(2) for every damping.
MASS = {"mass": 4.0, "stiffness": 900.0}


@pytest.mark.parametrize("base", ["displacement", "motion"])
@pytest.mark.parametrize("ratio", [0.2, 1.0, math.sqrt(2), 5.0])
@pytest.mark.parametrize("zeta", [0.05, 0.7])
def test_transmissibility(base, ratio, zeta):
    r = realized("mass_spring_damper", **MASS, damping=2 * zeta * 60.0, base=base)
    s = 1j * ratio * 15.0
    h = response(r, s)[0]
    moved = h[1] if base == "displacement" else h[1] + s * h[2]
    expected = math.sqrt((1 + (2 * zeta * ratio) ** 2) / ((1 - ratio**2) ** 2 + (2 * zeta * ratio) ** 2))
    assert abs(moved) == pytest.approx(expected, rel=1e-12)


def test_transmissibility_of_force_is_that_of_displacement():
    force = realized("mass_spring_damper", **MASS, damping=30.0)
    displacement = realized("mass_spring_damper", **MASS, damping=30.0, base="displacement")
    for s in S:
        assert response(force, s)[3, 0] == pytest.approx(response(displacement, s)[0, 1], rel=1e-12)


def test_a_mass_without_spring_and_damper_obeys_newton():
    h = response(realized("mass_spring_damper", mass=4.0, stiffness=0.0, damping=0.0), 2.0j)[:, 0]
    np.testing.assert_allclose(h, [-1 / 16, -1j / 8, 1 / 4, 0], rtol=1e-14)


# Flexible joint. Spong 1987: a free joint resonates at sqrt(k (1/J_m + 1/J_l)); where the load swings alone, at
# sqrt(k/J_l), the motor stands still. A gear divides what the motor sees by n².
JOINT = {"motor_inertia": 2e-3, "load_inertia": 0.5, "stiffness": 700.0}


@pytest.mark.parametrize("gear_ratio", [1.0, 8.0])
def test_resonance_and_antiresonance_of_a_joint(gear_ratio):
    r = realized("two_inertia", **JOINT, gear_ratio=gear_ratio)
    poles = np.linalg.eigvals(r.a)
    resonance = math.sqrt(700.0 * (1 / (2e-3 * gear_ratio**2) + 1 / 0.5))
    assert np.max(poles.imag) == pytest.approx(resonance, rel=1e-9)
    h = response(r, 1j * math.sqrt(700.0 / 0.5))
    assert abs(h[0, 0]) < 1e-12 * abs(h[3, 0])  # motor angle beside load angle


def test_a_joint_keeps_power():
    # Whatever frictionless shaft and gear take from the motor comes to the load: the sum of all torques moves the sum of all
    # inertias as seen from the load, n M - M_L = (n² J_m ω_m'/n + J_l ω_l').
    h = response(realized("two_inertia", **JOINT, damping=3.0, gear_ratio=8.0), 20.0j)
    momentum = 8.0 * 2e-3 * h[2] + 0.5 * h[5]
    np.testing.assert_allclose(momentum, [8.0, -1.0], rtol=1e-11)


def test_the_twist_of_a_joint_that_turns_for_long_keeps_its_digits():
    # 1 N m for 1e5 s: angles of 1e10 rad, and a twist of J_l/(J_m + J_l) M/k, which rests on digits that angles have not.
    h = response(realized("two_inertia", **JOINT), 1e-5j)
    assert h[6, 0].real == pytest.approx(0.5 / 0.502, rel=1e-8)


def test_ports_of_ideal_transmissions_pass_power():
    # Gear and screw give back as torque what they take from the motion: D is symmetric.
    for kind, given in (("gear", {"ratio": 7.0}), ("ball_screw", {"lead": 0.016})):
        d = realized(kind, **given).d
        np.testing.assert_array_equal(d, d.T)
        assert d[0, 1] == d[1, 0] == 0


def test_a_stiff_screw_moves_a_table_like_a_rigid_one():
    lead, mass = 0.02, 60.0
    elastic = document(
        {
            "u": block("input"),
            "motor": block("dc_motor"),
            "screw": block("ball_screw", lead=lead, stiffness=1e12, damping=1e6),
            "table": block("mass_spring_damper", mass=mass, stiffness=0, damping=0),
        },
        [
            "u -> motor.voltage", "motor.angle -> screw.angle", "motor.speed -> screw.speed",
            "table.position -> screw.position", "table.velocity -> screw.velocity", "screw.force -> table",
            "screw.torque -> motor.load_torque",
        ],
        {"velocity": "table.velocity"},
    )  # fmt: skip
    h = lead / (2 * math.pi)
    rigid = realized("dc_motor", inertia=2e-3 + mass * h**2)
    for s in (1.0j, 40.0j):
        got = diagrams.response(compile_system(elastic).realize(), s, "velocity", "u")
        assert got == pytest.approx(h * response(rigid, s)[1, 0], rel=1e-6)


# The arm of Fig. 1 as masses and springs: base 12 kg held by 3e5 N/m, link 5 kg, end-effector 2 kg. With M, K and modal
# damping, the modes are those of K v = w² M v, v' M v = 1 (Ewins, chapter 2).
MASSES = np.diag([12.0, 5.0, 2.0])
SPRINGS = np.array([[3e5 + 8e4, -8e4, 0.0], [-8e4, 8e4 + 5e4, -5e4], [0.0, -5e4, 5e4]])
RATIOS = np.array([0.02, 0.01, 0.03])


def chain() -> tuple[dict[str, list[float]], np.ndarray]:
    """Return the arm's parameters and the damping matrix M V diag(2 ζ w) V' M of the same chain."""
    squares, shapes = scipy.linalg.eigh(SPRINGS, MASSES)
    frequencies = np.sqrt(squares)
    arm = {
        "frequencies": frequencies.tolist(),
        "damping_ratios": RATIOS.tolist(),
        "base_shape": shapes[0].tolist(),
        "end_effector_shape": shapes[2].tolist(),
    }
    return arm, MASSES @ shapes @ np.diag(2 * RATIOS * frequencies) @ shapes.T @ MASSES


@pytest.mark.parametrize("s", [1.0j, 90.0j, 5.0 + 200.0j, 900.0j])
def test_compliant_arm_is_the_chain_that_its_modes_are_of(s):
    arm, damping = chain()
    compliance = np.linalg.inv(MASSES * s**2 + damping * s + SPRINGS)[np.ix_([0, 2], [0, 2])]
    h = response(realized("compliant_arm", **arm), s)
    np.testing.assert_allclose(h[np.ix_([0, 3], [0, 1])], compliance, rtol=1e-11)
    np.testing.assert_allclose(h[[1, 4]], s * h[[0, 3]], rtol=1e-11)
    np.testing.assert_allclose(h[[2, 5]], s**2 * h[[0, 3]], rtol=1e-10, atol=1e-15)
    # A force between the two is one of a kind on the base and its opposite on the end-effector.
    np.testing.assert_allclose(h[:, 2], h[:, 0] - h[:, 1], rtol=1e-11, atol=1e-15)
    np.testing.assert_allclose(h[6:], h[3:5] - h[:2], rtol=1e-11)


@pytest.mark.parametrize("s", S)
def test_compliant_arm_is_reciprocal(s):
    h = response(realized("compliant_arm", **chain()[0]), s)
    np.testing.assert_allclose(h[3, 0], h[0, 1], rtol=1e-13)  # x_ee/F_base = x_base/F_ee (Maxwell, Betti)
    np.testing.assert_allclose(h[6, 0], -h[0, 2], rtol=1e-12)  # and for the pair of forces: stroke/F_base


def test_static_compliance_of_the_arm():
    # At rest the springs carry F: end-effector 1/3e5 + 1/8e4 + 1/5e4, base 1/3e5.
    h = response(realized("compliant_arm", **chain()[0]), 0).real
    assert h[3, 1] == pytest.approx(1 / 3e5 + 1 / 8e4 + 1 / 5e4, rel=1e-12)
    assert h[0, 0] == pytest.approx(1 / 3e5, rel=1e-12)


def test_a_mode_of_frequency_0_is_a_rigid_body():
    # A free body of 19 kg: every shape 1/sqrt(19), a = F/19 everywhere.
    rigid = 19.0**-0.5
    arm = {"frequencies": [0.0], "damping_ratios": [0.0], "base_shape": [rigid], "end_effector_shape": [rigid]}
    h = response(realized("compliant_arm", **arm), 3.0j)
    np.testing.assert_allclose(h[[2, 5]], [[1 / 19, 1 / 19, 0]] * 2, rtol=1e-14, atol=1e-17)


@pytest.mark.parametrize("s", [40.0j, 5.0 + 200.0j])
def test_a_damper_between_base_and_end_effector(s):
    arm, damping = chain()
    system = document(
        {
            "force": block("input"),
            "arm": block("compliant_arm", **arm),
            "damper": block("viscous_damper", damping=350.0),
        },
        ["force -> arm.base_force", "arm.stroke_velocity -> damper", "damper -> arm.damper_force"],
        {"base": "arm.base_position", "end": "arm.end_effector_position"},
    )
    ends = np.array([-1.0, 0.0, 1.0])
    compliance = np.linalg.inv(MASSES * s**2 + (damping + 350.0 * np.outer(ends, ends)) * s + SPRINGS)
    realization = compile_system(system).realize()
    for name, row in (("base", 0), ("end", 2)):
        assert diagrams.response(realization, s, name, "force") == pytest.approx(compliance[row, 0], rel=1e-11)
    assert (
        np.linalg.eigvals(realization.a).real.max() < np.linalg.eigvals(realized("compliant_arm", **arm).a).real.max()
    )


def test_a_batch_of_modes():
    arm = chain()[0]
    first, second = arm["frequencies"][0], 1.3 * arm["frequencies"][0]
    batch = {**arm, "frequencies": [np.array([first, second]), *arm["frequencies"][1:]]}
    for number, frequency in enumerate((first, second)):
        single = realized("compliant_arm", **{**arm, "frequencies": [frequency, *arm["frequencies"][1:]]})
        got = member(realized("compliant_arm", **batch), number)
        np.testing.assert_allclose(response(got, 60.0j), response(single, 60.0j), rtol=1e-13)


FORCED = ("position", "velocity", "acceleration", "transmitted_force")


@pytest.mark.parametrize(
    ("kind", "given", "inputs", "outputs"),
    [
        ("viscous_damper", {}, ("velocity",), ("force",)),
        ("two_mass_correction", {}, ("x1",), ("x2",)),
        ("mass_spring_damper", {}, ("force",), FORCED),
        ("mass_spring_damper", {"base": "motion"}, ("force", "base_displacement", "base_velocity"), FORCED),
        ("mass_spring_damper", {"base": "displacement"}, ("force", "base_displacement"), FORCED[:2]),
        ("gear", {}, ("motion", "load_torque"), ("load_motion", "motor_torque")),
        ("ball_screw", {}, ("motion", "force"), ("travel", "torque")),
        ("ball_screw", {"stiffness": 1.0}, ("angle", "position"), ("force", "torque")),
        ("ball_screw", {"stiffness": 1.0, "damping": 0.0}, ("angle", "position", "speed", "velocity"),
         ("force", "torque")),
        ("two_inertia", {}, ("motor_torque", "load_torque"),
         ("motor_angle", "motor_speed", "motor_acceleration", "load_angle", "load_speed", "load_acceleration",
          "shaft_torque")),
        ("compliant_arm", {}, ("base_force", "end_effector_force", "damper_force"),
         ("base_position", "base_velocity", "base_acceleration", "end_effector_position", "end_effector_velocity",
          "end_effector_acceleration", "stroke", "stroke_velocity")),
    ],
)  # fmt: skip
def test_ports(kind, given, inputs, outputs):
    assert ports(kind, **given) == (inputs, outputs)


ARM: dict[str, Any] = {
    "frequencies": [40.0, 95.0],
    "damping_ratios": [0.02, 0.03],
    "base_shape": [0.05, 0.09],
    "end_effector_shape": [0.2, -0.12],
}


@pytest.mark.parametrize(
    ("kind", "given", "at", "message"),
    [
        ("mass_spring_damper", {"mass": 0, "stiffness": 1, "damping": 1}, ("mass",), "part.mass must be > 0 kg, got 0"),
        ("mass_spring_damper", {"mass": 1, "stiffness": -1, "damping": 1}, ("stiffness",), "must be >= 0 N/m, got -1"),
        ("mass_spring_damper", {"mass": 1, "stiffness": 1}, ("damping",), "part.damping must be given"),
        ("mass_spring_damper", {"mass": 1, "stiffness": 1, "damping": 1, "base": "free"}, ("base",), "must be one of"),
        ("two_mass_correction", {**CORRECTION, "m3": 0}, ("m3",), "must be > 0 kg, got 0"),
        ("two_mass_correction", {**CORRECTION, "h1": -1}, ("h1",), "must be >= 0 N\\*s/m, got -1"),
        ("two_inertia", {**JOINT, "gear_ratio": 0}, ("gear_ratio",), "must be > 0, got 0"),
        ("two_inertia", {"motor_inertia": 1, "stiffness": 1}, ("load_inertia",), "must be given"),
        ("gear", {"ratio": -2}, ("ratio",), "must be > 0, got -2"),
        ("ball_screw", {"lead": 0}, ("lead",), "must be > 0 m, got 0"),
        ("ball_screw", {"damping": 10.0}, ("damping",), "must be absent where there is no stiffness"),
        ("viscous_damper", {"damping": -1}, ("damping",), "must be >= 0 N\\*s/m, got -1"),
        ("compliant_arm", {**ARM, "frequencies": []}, ("frequencies",), "at least 1 mode, got none"),
        ("compliant_arm", {**ARM, "damping_ratios": [0.02]}, ("damping_ratios",), "each of the 2 frequencies, got 1"),
        ("compliant_arm", {**ARM, "base_shape": [1, 2, 3]}, ("base_shape",), "each of the 2 frequencies, got 3"),
        ("compliant_arm", {**ARM, "end_effector_shape": []}, ("end_effector_shape",), "2 frequencies, got 0"),
        ("compliant_arm", {**ARM, "end_effector_shape": 0.2}, ("end_effector_shape",), "must be a list"),
        ("compliant_arm", {**ARM, "frequencies": [40.0, -9.0]}, ("frequencies", 1),
         "part.frequencies\\[1\\] must be >= 0 rad/s, got -9"),
        ("compliant_arm", {**ARM, "damping_ratios": [-0.1, 0.1]}, ("damping_ratios", 0), "must be >= 0, got -0.1"),
    ],
)  # fmt: skip
def test_refuses(kind, given, at, message):
    with pytest.raises(DiagramError, match=message) as caught:
        compile_system(document({"part": block(kind, **given)}))
    assert caught.value.at == ("blocks", "part", *at)


def test_a_frequency_that_follows_a_parameter_keeps_its_bounds():
    system = document(
        {"force": block("input"), "arm": block("compliant_arm", **{**ARM, "frequencies": ["=w", "=2.4*w"]})},
        ["force -> arm.base_force"],
        {"end": "arm.end_effector_position"},
        w=Parameter(value=40.0),
    )
    diagram = compile_system(system)
    assert diagram.parameters["w"].unit == "rad/s"
    assert diagram.parameters["w"].lower == 0
    with pytest.raises(DiagramError, match="must be >= 0 rad/s, got -1"):
        diagram.realize({"w": -1.0})
