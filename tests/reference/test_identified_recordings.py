"""Recordings of drives and dampers, identified: what was computed from the files before this code existed is reached.

Recordings with a licence are part of the project; SERVOTUNE_RECORDINGS names the folder that holds the others. Numbers to
reach and their tolerances: refits not below the value minus one point, regressions to the printed digits.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.recordings.processing.zero_phase import ZeroPhaseFilter, filtered
from optimizers.black_box import black_box
from optimizers.estimation.inverse_dynamics import DriveRecording, Treatment, drive_parameters
from optimizers.estimation.static_curve import static_curve
from optimizers.identification import Identified, identify
from optimizers.problem import Variable
from optimizers.recorded.recording import Identification, RecordedExperiment, Recording
from optimizers.search.result import Status

DATA = Path(__file__).parents[2] / "examples" / "data"


def elsewhere(*parts: str) -> Path:
    """Return a recording that is not part of the project."""
    folder = os.environ.get("SERVOTUNE_RECORDINGS", "")
    path = Path(folder).joinpath(*parts)
    if not folder or not path.exists():
        pytest.skip(f"SERVOTUNE_RECORDINGS must name the folder with {'/'.join(parts)}, got '{folder}'")
    return path


def wired(
    name: str, parameters: dict[str, float], blocks: dict[str, Block], wires: str, outputs: dict[str, str]
) -> Diagram:
    pairs = (wire.split(" -> ") for wire in wires.split(", "))
    return compile_system(
        System(
            name=name,
            parameters={key: Parameter(value=value) for key, value in parameters.items()},
            blocks=blocks,
            connections=tuple(Connection(source=source, target=target) for source, target in pairs),
            outputs=outputs,
        )
    )


# --- the flexible robot arm ----------------------------------------------------------------------------------------


@cache
def arm(split: float) -> RecordedExperiment:
    data = np.loadtxt(DATA / "flexible_robot_arm" / "robot_arm.dat")
    recording = Recording(inputs={"torque": data[:, 0]}, outputs={"acceleration": data[:, 1]}, sample_time=0.01)
    return RecordedExperiment(recording=recording, split=split)


def test_a_subspace_model_of_the_arm():
    found = black_box(arm(1.0), method="subspace", orders=(4,))
    assert found.estimation["acceleration"].fit_percent == pytest.approx(96.41, abs=0.05)
    assert found.estimation["acceleration"].vaf_percent == pytest.approx(99.87, abs=0.01)


def test_an_output_error_model_of_the_arm():
    found = black_box(arm(1.0), method="transfer_function", orders=(4,))
    assert found.estimation["acceleration"].fit_percent == pytest.approx(96.6, abs=0.1)


def test_the_order_of_the_arm_is_chosen_on_the_other_half():
    found = black_box(arm(0.5), method="transfer_function", orders=(1, 2, 3, 4, 5))
    assert found.order == 4
    assert found.validation["acceleration"].fit_percent > 96
    assert found.one_step["acceleration"].fit_percent > found.validation["acceleration"].fit_percent + 1
    assert found.baselines["static_gain"]["acceleration"].fit_percent < 20


# --- the hydraulic bench -------------------------------------------------------------------------------------------


def test_the_static_curve_of_the_hydraulic_motor():
    data = np.loadtxt(DATA / "hydraulic_bench" / "MotorRotation.csv", delimiter=",")
    assert static_curve(data[:, 1], data[:, 2], degree=5).fit.fit_percent == pytest.approx(93.63, abs=0.01)


# --- dampers -------------------------------------------------------------------------------------------------------


def test_the_dahl_damper_is_refitted():
    data = loadmat(DATA / "mr_damper_dahl" / "data_simulation_4.1_MRdamper.mat")["x_F"]
    diagram = wired(
        "damper", {"kx": 768.2, "kw": 57.42, "rho": 2745.0},
        {"v": Block(kind="input"),
         "d": Block(kind="mr_damper_dahl", values={"damping": ["=kx"], "friction": ["=kw"], "rho": "=rho"})},
        "v -> d.velocity", {"force": "d"},
    )  # fmt: skip
    recording = Recording(inputs={"v": 1e-3 * data[:, 1]}, outputs={"force": data[:, 2]}, sample_time=0.01)
    found = identify(
        Identification(
            diagram=diagram, experiments=(RecordedExperiment(recording=recording, split=1.0),),
            parameters=tuple(Variable(parameter=name, lower=0.0) for name in ("kx", "kw", "rho")),
        ),
        rng=np.random.default_rng(0),
    )  # fmt: skip
    assert found.estimation["force"].fit_percent >= 82.46 - 0.01
    # the authors' parameters reach 81.04 on the same samples
    assert found.status is Status.CONVERGED


SPENCER = {
    "k0": 0.0, "k1": 0.0, "x0": 0.0, "a2": -17.1e3, "a1": 23.82e3, "a0": 5.73e3, "g": 0.68e6, "gr": -2.91,
    "c01": 12.34e3, "c00": 0.67e3, "c11": 86.19e3, "c10": 10.4e3,
}  # fmt: skip
"""The published start of the fit (mm, N, s, A there), in SI."""
PUBLISHED = {
    "k0": 0.150133, "k1": 1238.7977, "x0": 2.30914e-6, "a2": -38152.0043, "a1": 41508.4056, "a0": 15221.0961,
    "g": 1.89407553e6, "gr": -3.65610854, "c01": 7625.96402, "c00": 924.911328, "c11": 78336.6934, "c10": 9867.12839,
}  # fmt: skip
LOWER = dict.fromkeys(("k0", "k1", "a0", "g", "c00", "c10"), 0.0)
OWN = ("25mm0x5Hz0A", "25mm0x5Hz0x5A", "25mm0x5Hz1A")
ALL = tuple(
    f"{motion}{a}A" for motion in ("10mm1Hz", "25mm0x25Hz", "25mm0x5Hz") for a in ("0", "0x25", "0x5", "0x75", "1")
)


def damper(values: dict[str, float]) -> Diagram:
    given = {
        "alpha": ["=a0", "=a1", "=a2"], "c0": ["=c00", "=c01"], "c1": ["=c10", "=c11"], "k0": ["=k0"], "k1": "=k1",
        "x0": "=x0", "gamma": "=g", "gamma_rate": "=gr", "A": 300.0, "n": 2.0,
    }  # fmt: skip
    return wired(
        "damper", {**values, "current": 0.0},
        {"x": Block(kind="input"), "v": Block(kind="input"),
         "coil": Block(kind="passive_on", values={"current": "=current"}),
         "d": Block(kind="mr_damper_spencer", values=given)},
        "x -> d.displacement, v -> d.velocity, coil -> d.current", {"force": "d"},
    )  # fmt: skip


def sine(name: str, split: float) -> RecordedExperiment:
    """Return a test as an experiment, its current being known."""
    own = DATA / "mr_damper" / f"{name}.txt"
    path = own if own.exists() else elsewhere("mr_damper_mts", "sinusoidal_preprocessed", f"{name}.txt")
    data = np.loadtxt(path)
    recording = Recording(
        inputs={"x": 1e-3 * data[:, 1], "v": 1e-3 * data[:, 2]}, outputs={"force": data[:, 3]},
        sample_time=round(float(data[1, 0] - data[0, 0]), 6),
    )  # fmt: skip
    current = float(name.partition("Hz")[2][:-1].replace("x", "."))
    return RecordedExperiment(recording=recording, name=name.lower(), values={"current": current}, split=split)


def fitted(
    start: dict[str, float], experiments: tuple[RecordedExperiment, ...], free: tuple[str, ...], most: int = 60
) -> Identified:
    variables = tuple(Variable(parameter=name, lower=LOWER.get(name)) for name in free)
    problem = Identification(diagram=damper(start), experiments=experiments, parameters=variables, max_evaluations=most)
    return identify(problem, rng=np.random.default_rng(0))


SINGLE = SPENCER | {
    "a2": 0.0,
    "a1": 0.0,
    "a0": 15e3,
    "g": 3e5,
    "gr": 0.0,
    "c01": 0.0,
    "c00": 5e3,
    "c11": 0.0,
    "c10": 5e4,
    "k1": 1000.0,
}


@pytest.mark.parametrize(("name", "expected"), [("25mm0x5Hz1A", 91.5), ("10mm1Hz0x5A", 94.0), ("25mm0x25Hz0A", 89.0)])
def test_one_test_of_the_damper_is_refitted(name, expected):
    found = fitted(SINGLE, (sine(name, 1.0),), ("k0", "k1", "x0", "a0", "g", "c00", "c10"), most=35)
    assert found.estimation["force"].fit_percent >= expected - 0.05


def test_the_damper_is_estimated_on_the_first_cycles_and_validated_on_the_others():
    found = fitted(SPENCER, tuple(sine(name, 0.5) for name in OWN), tuple(SPENCER), most=20)
    assert found.estimation["force"].fit_percent > 90
    assert found.validation["force"].fit_percent > 89
    assert [one.name for one in found.experiments] == [name.lower() for name in OWN]


def objective(found: Identified) -> float:
    """Return the sum over the tests of the NRMSE, %: what the authors minimised, here over whole tests."""
    total = 0.0
    for one in found.experiments:
        nrmse = one.estimation["force"].nrmse_percent
        assert nrmse is not None
        total += nrmse
    return total


def test_all_fifteen_sines_from_the_published_start_are_not_worse_than_the_published_optimum():
    experiments = tuple(sine(name, 1.0) for name in ALL)
    published = fitted(PUBLISHED, experiments, tuple(SPENCER), most=1)
    # 129.7 % was computed for it from the files by the same sum
    assert objective(published) == pytest.approx(129.7, abs=0.5)
    found = fitted(SPENCER, experiments, tuple(SPENCER))
    assert objective(found) <= objective(published)
    assert found.estimation["force"].fit_percent > 90.5


def test_some_sines_estimate_and_the_others_validate():
    experiments = tuple(sine(name, 0.0 if "0x25A" in name or "0x75A" in name else 1.0) for name in ALL)
    found = fitted(SPENCER, experiments, tuple(SPENCER))
    assert found.estimation["force"].fit_percent > 90
    assert found.validation["force"].fit_percent > 89
    # the valley is flat: what these motions leave open is said, by name
    assert any("k0 has no influence" in sentence for sentence in found.indistinguishable)
    assert any("a0 and g are hard to tell apart" in sentence for sentence in found.indistinguishable)


# --- drives --------------------------------------------------------------------------------------------------------


def test_the_electric_drive_by_inverse_dynamics():
    data = loadmat(elsewhere("emps", "DATA_EMPS.mat"))
    found = drive_parameters(
        DriveRecording(force=data["gtau"].item() * data["vir"].ravel(), position=data["qm"].ravel(), sample_time=1e-3),
        Treatment(low_pass=2 * np.pi * 100, order=4, decimation=10, dropped=49),
    )
    printed = {"mass": 95.1089, "viscous": 203.5034, "coulomb": 20.3935, "offset": -3.1648}
    assert {name: term.value for name, term in found.terms.items()} == pytest.approx(printed, abs=5.1e-5)
    assert found.equation_error.relative_error_percent == pytest.approx(4.0834, abs=5.1e-5)


@cache
def axis() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return torque, position and velocity of the first axis, of its motor: N·m, rad, rad/s; 4 ms."""
    recorded = loadmat(elsewhere("kuka_kr300", "run_A.mat"), struct_as_record=False, squeeze_me=True)["rec"]
    return (
        np.array(recorded.act_torque_abs_nm[0], dtype=float),
        np.deg2rad(recorded.act_pos_mot_deg[0]),
        np.deg2rad(recorded.act_vel_mot_deg_per_s[0]),
    )


LISTED = {"mass": 7.89, "viscous": 6.50, "coulomb": 1.72, "offset": 0.46}
"""Computed from the file before this code existed, with FIT 75."""


def test_the_first_axis_of_an_industrial_robot():
    """Torque and position low-passed forward and backward at 40 Hz, 50 samples cut at each end, friction as a tanh."""
    design = ZeroPhaseFilter(band="low_pass", frequency=2 * np.pi * 40, order=4)
    force, position = (filtered(signal, 250.0, design)[50:-50] for signal in axis()[:2])
    found = drive_parameters(
        DriveRecording(force=force, position=position, sample_time=4e-3), Treatment(transition_velocity=0.01)
    )
    assert {name: term.value for name, term in found.terms.items()} == pytest.approx(LISTED, abs=0.01)
    assert found.equation_error.fit_percent == pytest.approx(75.0, abs=0.1)


def test_the_offset_of_the_axis_is_a_matter_of_how_it_stands():
    """The axis stands for a fifth of the time: what the sign of its noise says of friction there goes into the offset."""
    force, _, velocity = axis()
    assert np.mean(np.abs(velocity) < 1e-3) > 0.15
    found = drive_parameters(DriveRecording(force=force, velocity=velocity, sample_time=4e-3))
    assert found.equation_error.fit_percent == pytest.approx(75.0, abs=0.3)
    sure = {name: value for name, value in LISTED.items() if name != "offset"}
    assert {name: found.terms[name].value for name in sure} == pytest.approx(sure, rel=0.1)
    assert found.terms["offset"].value == pytest.approx(0.22, abs=0.02)


def test_the_friction_of_a_pneumatic_cylinder():
    half, level = [], []
    for bar in (1, 3, 5):
        data = np.loadtxt(elsewhere("pneumatic_friction_tudelft", f"O-ring257_{bar}bar.csv"))
        time = 1e-3 * data[:, 0]
        grid = np.arange(time[0], time[-1], 0.01)
        position, force = (np.interp(grid, time, scale * data[:, k]) for k, scale in ((4, 1e-3), (6, 1.0)))
        # the strokes are steady in their middle: near their ends the friction turns
        lowest, stroke = position.min(), np.ptp(position)
        middle = (position > lowest + 0.2 * stroke) & (position < lowest + 0.8 * stroke)
        velocity = np.gradient(position, 0.01)
        recording = DriveRecording(force=force[middle], velocity=velocity[middle], sample_time=0.01)
        found = drive_parameters(recording, Treatment(least_velocity=1e-6), inertia=False, viscous=False)
        half.append(found.terms["coulomb"].value)
        level.append(found.terms["offset"].value)
    assert half == pytest.approx([6.98, 8.47, 9.92], rel=0.005)
    # over the stated pressures; over the means of the measured ones it is 521 mm²
    assert np.polyfit([1e5, 3e5, 5e5], level, 1)[0] == pytest.approx(517.8e-6, rel=0.005)
