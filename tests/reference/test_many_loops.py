"""The example with six nested loops against python-control, to 1e-9: poles, responses in time and frequency, every loop.

The axis is built a second time below, block by block from the equations that the elements are documented with and from the
numbers of the document, but with pressures in 10 MPa and spool displacements in mm; python-control appends the blocks and
closes all loops at once. Crossings of each opened loop are found on python-control's frequency response.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path

import control
import numpy as np
import numpy.typing as npt
import pytest
from scipy.linalg import matrix_balance
from scipy.optimize import brentq, minimize_scalar

from api.convert.systems import diagram_from_wire
from api.schemas.systems import SystemDocument
from engine.analysis.evaluation import Evaluation
from engine.analysis.study import MetricRequest, frequency_response, measure, simulate
from engine.diagram.diagram import Diagram
from engine.model.verdicts import Verdict
from engine.signals import make

DOCUMENT = Path(__file__).parents[2] / "examples" / "systems" / "many_loops.json"

VELOCITY = "velocity_loop"
ACCELERATION = f"{VELOCITY}.acceleration_loop"
PRESSURE = f"{ACCELERATION}.pressure_loop"
SPOOL = f"{PRESSURE}.spool_loop"
CURRENT = f"{SPOOL}.current_loop"

LOOPS = {
    "position_law": "error",
    "velocity_law": f"{VELOCITY}.error",
    "acceleration_law": f"{ACCELERATION}.error",
    "pressure_law": f"{PRESSURE}.error",
    "spool_law": f"{SPOOL}.error",
    "current_law": f"{CURRENT}.error",
}
"""Where each loop is cut: the law whose input is replaced here, and the endpoint in the document."""

Polynomial = Sequence[float]


def lag(rate: float) -> tuple[Polynomial, Polynomial]:
    return [rate], [1.0, rate]


def swing(frequency: float, damping: float) -> tuple[Polynomial, Polynomial]:
    return [frequency**2], [1.0, 2 * damping * frequency, frequency**2]


PASCAL, METRE = 1e-7, 1e3  # in units of pressure and of the spool
FLOW_GAIN = 1.0 / METRE
AREA = 20e-4


def band_stop(frequency: float) -> tuple[Polynomial, Polynomial]:
    """Depth 0.04, width 1."""
    return [1.0, 0.04 * frequency, frequency**2], [1.0, frequency, frequency**2]


# Numerator and denominator, highest power of s first. pi: (kp s + ki)/s; pid: kp + ki/s + kd s/(1 + s/w).
QUOTIENTS: Mapping[str, tuple[Polynomial, Polynomial]] = {
    "smoothing": swing(30.0, 0.9),
    "ahead": (  # (kv s + ka s²)/(1 + 2 d s/w + s²/w²), d = 1/√2
        [28e-3 * 300.0**2, 300.0**2, 0.0],
        [1.0, 2**0.5 * 300.0, 300.0**2],
    ),
    "position_law": ([12.0], [1.0]),
    "velocity_law": ([35.0, 100.0], [1.0, 0.0]),
    "lead": ([600.0 / 120.0, 600.0], [1.0, 600.0]),
    "acceleration_law": ([5e4 * PASCAL, 3e7 * PASCAL], [1.0, 0.0]),
    "notch": band_stop(700.0),
    "pressure_law": ([6e-11 * METRE / PASCAL, 2e-9 * METRE / PASCAL], [1.0, 0.0]),
    # (1 + r1 c1 s)/((r1 + r2)/r2 + r1 c1 s) with r1 = r2, r1 c1 = 1 ms, and the amplifier of 2 behind it
    "network": ([2e-3, 2.0], [1e-3, 2.0]),
    "compensation": ([0.9 * AREA / FLOW_GAIN], [1.0]),
    "spool_law": (
        [(1.7 * 16e3 + 1400.0) / METRE, (1400.0 * 16e3 + 7e5) / METRE, 7e5 * 16e3 / METRE],
        [1.0, 16e3, 0.0],
    ),
    "current_law": ([75.0, 1e5], [1.0, 0.0]),
    "amplifier": lag(2e4),
    "coil": ([1.0], [0.015, 20.0]),
    "spool": ([640.0 * METRE], [1.0, 800.0, 640e3]),
    "lvdt": swing(16e3, 0.5**0.5),
    "pressure_sensor": lag(1e4),
    "bracket": swing(700.0, 0.02),
    "accelerometer": swing(5000.0, 0.7),
    "tachometer": lag(2000.0),
}

# Q = A z' + a_m p + (V/(4 β)) p',  m z'' + b z' + F = A p, with the states z, z', p.
MASS, FRICTION = 500.0, 600.0
FORCE, LEAKAGE, CAPACITANCE = AREA / PASCAL, 1e-12 / PASCAL, 1e-3 / (4 * 1.4e9) / PASCAL
MOTOR_A = [
    [0.0, 1.0, 0.0],
    [0.0, -FRICTION / MASS, FORCE / MASS],
    [0.0, -AREA / CAPACITANCE, -LEAKAGE / CAPACITANCE],
]
MOTOR_B = [[0.0, 0.0], [0.0, -1.0 / MASS], [FLOW_GAIN / CAPACITANCE, 0.0]]
MOTOR_C = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], MOTOR_A[1], [0.0, 0.0, 1.0]]
MOTOR_D = [[0.0, 0.0], [0.0, 0.0], MOTOR_B[1], [0.0, 0.0]]

# Who drives whom.
WIRES: Mapping[str, str] = {
    "smoothing": "+reference",
    "ahead": "+smoothing",
    "position_law": "+smoothing -position",
    "velocity_law": "+position_law +ahead -tachometer",
    "lead": "+velocity_law",
    "acceleration_law": "+lead -accelerometer",
    "notch": "+acceleration_law",
    "pressure_law": "+notch -pressure_sensor",
    "network": "+pressure_law",
    "compensation": "+velocity",
    "spool_law": "+network +compensation -lvdt",
    "current_law": "+spool_law -coil",
    "amplifier": "+current_law",
    "coil": "+amplifier",
    "spool": "+coil",
    "lvdt": "+spool",
    "valve": "+spool",
    "force": "+load",
    "pressure_sensor": "+pressure",
    "bracket": "+acceleration",
    "accelerometer": "+bracket",
    "tachometer": "+velocity",
}
OUTPUTS = [*QUOTIENTS, "position", "velocity", "acceleration", "pressure"]
INPUTS = [*QUOTIENTS, "valve", "force"]
EXTERNAL = ["reference", "load", "cut"]
SEEN = {
    "position": "+position", "velocity": "+velocity", "acceleration": "+acceleration", "pressure": "+pressure",
    "spool": "+spool", "voltage": "+amplifier", "following_error": WIRES["position_law"],
}  # fmt: skip
SI = {"pressure": 1 / PASCAL, "spool": 1 / METRE}


def row(terms: str, names: Sequence[str]) -> npt.NDArray[np.float64]:
    """Return the signs of ``names`` in a text such as "+smoothing -position"."""
    signs = {term[1:]: 1.0 if term[0] == "+" else -1.0 for term in terms.split()}
    return np.array([signs.get(name, 0.0) for name in names])


@cache
def axis(opened: str | None = None, notch: float = 700.0) -> control.StateSpace:
    """Return the axis from (reference, load, cut) to `SEEN`, or with the input of a law cut: its error is the last output."""
    quotients = {**QUOTIENTS, "notch": band_stop(notch)}
    blocks = [control.ss(control.tf(*quotient)) for quotient in quotients.values()]
    everything = control.append(*blocks, control.ss(MOTOR_A, MOTOR_B, MOTOR_C, MOTOR_D))
    wires = WIRES if opened is None else {**WIRES, opened: "+cut"}
    back = np.array([row(wires[name], OUTPUTS) for name in INPUTS])
    enter = np.array([row(wires[name], EXTERNAL) for name in INPUTS])
    read = np.array([row(terms, OUTPUTS) for terms in (*SEEN.values(), WIRES[opened or "position_law"])])
    read *= np.array([SI.get(name, 1.0) for name in (*SEEN, "error")])[:, None]
    closed = control.feedback(everything, static(back), sign=1)
    return static(read) * closed * static(enter)


def static(gains: npt.NDArray[np.float64]) -> control.StateSpace:
    return control.ss([], [], [], gains)


def loop(law: str, frequencies: npt.ArrayLike, *, notch: float = 700.0) -> npt.NDArray[np.complex128]:
    """L(jω) of python-control's opened axis: 1 + L = 0 is the characteristic equation."""
    response = axis(law, notch)(1j * np.atleast_1d(frequencies), squeeze=False)
    return np.asarray(-response[-1, EXTERNAL.index("cut")])


@pytest.fixture(scope="module")
def diagram() -> Diagram:
    return diagram_from_wire(SystemDocument.model_validate(json.loads(DOCUMENT.read_text())))


def test_it_is_one_diagram_with_six_loops_inside_each_other(diagram: Diagram) -> None:
    assert diagram.realize().states == 29
    assert diagram.warnings == ()
    assert CURRENT.count(".") == 4


def test_poles(diagram: Diagram) -> None:
    linear = diagram.realize()
    ours = np.sort_complex(np.linalg.eigvals(linear.a))
    theirs = np.sort_complex(control.poles(axis()))
    np.testing.assert_allclose(ours, theirs, rtol=1e-9)
    assert ours.real.max() < 0
    study = frequency_response(diagram, source="reference", target="position", frequencies=np.array([1.0]))
    np.testing.assert_allclose(np.sort_complex(study.poles), theirs, rtol=1e-9)


@pytest.mark.parametrize("source", ["reference", "load"])
@pytest.mark.parametrize("target", ["position", "acceleration", "spool", "following_error"])
def test_frequency_responses(diagram: Diagram, source: str, target: str) -> None:
    frequencies = np.geomspace(0.1, 1e5, 60)
    study = frequency_response(diagram, source=source, target=target, frequencies=frequencies, metrics=[])
    theirs = axis()(1j * frequencies)[list(SEEN).index(target), EXTERNAL.index(source)]
    np.testing.assert_allclose(study.response, theirs, rtol=1e-9, atol=1e-11 * abs(theirs).max())


@pytest.mark.parametrize("source", ["reference", "load"])
def test_step_responses(diagram: Diagram, source: str) -> None:
    done = simulate(diagram, signals={source: make("step", {})}, duration=0.5, samples=501, metrics=[])
    inputs = np.zeros((len(EXTERNAL), len(done.time)))
    inputs[EXTERNAL.index(source)] = 1.0
    # Balanced, as the exponential of the axis in its own units is good for 1e-8 only (measured against 40 digits).
    _, transform = matrix_balance(axis().A, permute=False)
    balanced = control.similarity_transform(axis(), np.linalg.inv(transform))
    theirs = control.forced_response(balanced, done.time, inputs).outputs
    for target, curve in zip(SEEN, theirs[:-1], strict=True):
        np.testing.assert_allclose(done.curves[target], curve, rtol=0, atol=1e-9 * abs(curve).max(), err_msg=target)


def roots(of: Callable[[npt.ArrayLike], npt.NDArray[np.float64]]) -> list[float]:
    grid = np.geomspace(0.1, 1e6, 2000)
    change = np.flatnonzero(np.diff(np.sign(of(grid))))
    return [float(brentq(lambda w: of(w)[0], grid[k], grid[k + 1], xtol=1e-12, rtol=1e-14)) for k in change]


@pytest.mark.parametrize(("law", "endpoint"), LOOPS.items())
def test_margins_of_every_loop(diagram: Diagram, law: str, endpoint: str) -> None:
    study = frequency_response(diagram, open_at=endpoint)
    assert study.margins is not None
    passes = roots(lambda w: abs(loop(law, w)) - 1.0)
    phases = [(w, float(np.angle(-loop(law, w)[0]))) for w in passes]
    np.testing.assert_allclose(study.margins.phase, phases, rtol=1e-9)
    turns = [(w, loop(law, w)[0].real) for w in roots(lambda w: loop(law, w).imag)]
    gains = [(w, -1 / value) for w, value in turns if value <= -1e-3]
    np.testing.assert_allclose(study.margins.gain, gains, rtol=1e-9)
    nearest = min(phases, key=lambda crossing: abs(crossing[1]))[1]
    assert study.metrics["phase_margin"].value == pytest.approx(nearest, rel=1e-9)
    nearest = min(gains, key=lambda crossing: abs(np.log(crossing[1])))[1]
    assert study.metrics["gain_margin"].value == pytest.approx(nearest, rel=1e-9)
    grid = np.geomspace(0.1, 1e6, 2000)
    k = int(np.argmin(abs(1 + loop(law, grid))))
    found = minimize_scalar(
        lambda w: abs(1 + loop(law, w)[0]), bounds=(grid[k - 1], grid[k + 1]), method="bounded", options={"xatol": 1e-6}
    )
    assert study.metrics["sensitivity_peak"].value == pytest.approx(1 / found.fun, rel=1e-9)


def test_the_elasticity_of_a_margin_in_a_parameter_three_loops_down(diagram: Diagram) -> None:
    # d ln(phase margin of the velocity loop)/d ln(notch frequency), against Richardson's extrapolation of differences
    # of python-control's phase margin.
    path = f"{ACCELERATION}.notch.frequency"
    request = MetricRequest(metric="phase_margin", open_at=LOOPS["velocity_law"])
    ((measured, gradient),) = measure(diagram, [request], gradient=[path])
    assert gradient is not None

    def phase_margin(notch: float) -> float:
        w = brentq(lambda w: abs(loop("velocity_law", w, notch=notch)[0]) - 1, 20.0, 60.0, xtol=1e-13, rtol=1e-14)
        return float(np.angle(-loop("velocity_law", w, notch=notch)[0]))

    coarse, fine = ((phase_margin(700.0 + h) - phase_margin(700.0 - h)) / (2 * h) for h in (14.0, 7.0))
    assert measured.value == pytest.approx(phase_margin(700.0), rel=1e-9)
    assert gradient.values[0] == pytest.approx((4 * fine - coarse) / 3, rel=1e-5)


def test_every_loop_is_well_damped(diagram: Diagram) -> None:
    # What the design promises: 45 degrees, a factor of 2 either way, and no disturbance amplified by more than 1.7.
    crossover = []
    for endpoint in LOOPS.values():
        study = frequency_response(diagram, open_at=endpoint)
        assert study.metrics["phase_margin"].value > np.radians(45)
        assert abs(np.log(study.metrics["gain_margin"].value)) > np.log(2)
        assert study.metrics["sensitivity_peak"].value < 1.7
        assert study.margins is not None
        crossover.append(study.margins.phase[-1][0])
    ratios = np.array(crossover[1:]) / np.array(crossover[:-1])
    assert ratios.min() > 2


CORRECTIONS = {
    "notch": (f"{ACCELERATION}.notch.depth", 1.0),
    "compensation": (f"{PRESSURE}.compensation_share", 0.0),
    "lead": (f"{VELOCITY}.lead.pole_frequency", 120.0),
    "network": (f"{PRESSURE}.network.c1", 1e-12),
}
"""How each correction is taken out: a notch that lets all through, a lead with its pole on its zero, the capacitor
of a wire."""


def margin(diagram: Diagram, endpoint: str, without: str | None) -> float:
    overrides = dict([CORRECTIONS[without]]) if without else {}
    study = frequency_response(diagram, open_at=endpoint, overrides=overrides, metrics=["phase_margin"])
    assert study.verdict is Verdict.OK
    return float(study.metrics["phase_margin"].value)


def test_without_the_notch_the_bracket_swings_up(diagram: Diagram) -> None:
    study = frequency_response(diagram, open_at=LOOPS["acceleration_law"], overrides=dict([CORRECTIONS["notch"]]))
    assert study.verdict is Verdict.UNSTABLE
    growing = study.poles[study.poles.real > 0]
    assert np.abs(growing) == pytest.approx([700.0, 700.0], rel=0.05)


@pytest.mark.parametrize(
    ("law", "correction", "degrees"), [("velocity_law", "lead", 10), ("pressure_law", "network", 5)]
)
def test_a_lead_gives_phase(diagram: Diagram, law: str, correction: str, degrees: float) -> None:
    endpoint = LOOPS[law]
    assert margin(diagram, endpoint, None) - margin(diagram, endpoint, correction) > np.radians(degrees)


def test_the_compensation_of_the_pistons_flow_makes_the_acceleration_loop_faster(diagram: Diagram) -> None:
    with_it, without = (
        frequency_response(diagram, open_at=LOOPS["acceleration_law"], overrides=overrides, metrics=[]).margins
        for overrides in ({}, dict([CORRECTIONS["compensation"]]))
    )
    assert with_it is not None
    assert without is not None
    assert with_it.phase[-1][0] > 2 * without.phase[-1][0]


def test_the_feed_forward_takes_the_following_error_away(diagram: Diagram) -> None:
    # Without it the error at 0.1 m/s ends at v/kp = 0.1/12 m, as a velocity loop without steady error demands.
    command = {"reference": make("ramp", {"slope": 0.1})}
    off = {"velocity_feed_forward": 0.0, "acceleration_feed_forward": 0.0}
    without = simulate(diagram, signals=command, overrides=off, outputs=["following_error"], duration=30.0)
    assert without.curves["following_error"][-1] == pytest.approx(0.1 / 12, rel=1e-9)
    with_it = simulate(diagram, signals=command, outputs=["following_error"], duration=30.0)
    assert abs(with_it.curves["following_error"][-1]) < 1e-10
    assert with_it.metrics["following_error"]["peak"].value < 0.1 * without.metrics["following_error"]["peak"].value


@pytest.mark.parametrize(("command", "output"), [("step", "position"), ("step", "voltage"), ("ramp", "voltage")])
def test_fast_loops_that_have_died_away_do_not_cut_the_response(diagram: Diagram, command: str, output: str) -> None:
    # poles from 2.8 to 1.7e4 rad/s: the fast ones shorten the first pieces only
    signals = {"reference": make(command, {})}
    joint = Evaluation(diagram).time_response(signals, [output]).joint
    assert joint is not None
    assert len(joint.y) < 2000
