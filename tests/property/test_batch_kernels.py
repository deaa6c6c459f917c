"""Whatever the diagram, a screened number that is not flagged doubtful is that of the exact path."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from engine.analysis.study import MetricRequest
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram
from engine.model.metric_options import Options
from engine.signals import make
from tests.property.strategies import Plant, Servo, gains, plants, servos
from tests.reference.batch_agreement import compare
from tests.reference.systems import block, system, transfer_function

TIME = (
    "rise_time", "settling_time", "response_time", "overshoot", "undershoot", "peak", "peak_time", "max_velocity",
    "max_acceleration", "control_effort", "steady_state_error",
)  # fmt: skip
LOOP = ("gain_margin", "phase_margin", "delay_margin", "sensitivity_peak", "complementary_peak")
PATH = ("bandwidth", "compliance_peak", "control_sensitivity_peak")
CANDIDATES = 5


def requests(source: str, outputs: list[str], cut: str | None = None) -> list[MetricRequest]:
    step = {source: make("step", {})}
    made = [
        MetricRequest(metric=metric, signals=step, output=output, options=Options(derivative=0))
        for output in outputs
        for metric in TIME
    ]
    made += [MetricRequest(metric=metric, source=source, target=output) for output in outputs for metric in PATH]
    return made + ([MetricRequest(metric=metric, open_at=cut) for metric in LOOP] if cut else [])


def around(nominal: dict[str, float], spread: float, seed: int) -> dict[str, np.ndarray]:
    """Return candidates whose parameters are times exp(-spread) to exp(spread) of the document's."""
    rng = np.random.default_rng(seed)
    return {name: value * np.exp(rng.uniform(-spread, spread, CANDIDATES)) for name, value in nominal.items()}


def assert_exact(diagram: Diagram, wanted: list[MetricRequest], candidates: dict[str, np.ndarray]) -> None:
    screened = Screening(diagram, wanted)(candidates)
    assert screened.valid.all()
    found = compare(diagram, wanted, candidates, screened)
    assert not found.wrong, "\n".join(found.wrong)


@given(servos(), st.floats(0.05, 1.5), st.integers(0, 2**32))
def test_loops(servo: Servo, spread: float, seed: int) -> None:
    wanted = [r for r in requests("r", ["y", "control"], "error") if r.metric != "peak_time"]
    assert_exact(servo.diagram(), wanted, around(asdict(servo), spread, seed))


# the control is highest at its jump, with a slope of 0: rounding put the instant before it
@example(Servo(gain=0.2594633811966956, frequency=5.0, damping=0.15, lag=0.004), 0.05, 1409506162)
@given(servos(), st.floats(0.05, 1.5), st.integers(0, 2**32))
def test_peak_times_of_loops(servo: Servo, spread: float, seed: int) -> None:
    wanted = [r for r in requests("r", ["y", "control"]) if r.metric == "peak_time"]
    assert_exact(servo.diagram(), wanted, around(asdict(servo), spread, seed))


def scaled(plant: Plant) -> Diagram:
    """Return the plant with its gain and its scale of time as parameters."""
    numerator, denominator = plant.polynomials()
    orders = [[f"={c!r}*t**{len(row) - 1 - k}" for k, c in enumerate(row)] for row in (numerator, denominator)]
    return transfer_function([f"=k*({term[1:]})" for term in orders[0]], orders[1], k=1.0, t=1.0)


#: Its resonance is 1.4e-5 higher than its gain at rest, and slower than a thirtieth of its slowest pole.
FLAT = Plant(-1.0, (), (-0.59604645 + 1.03238273j, -0.59604645 - 1.03238273j, -0.14140625 + 0.14143646086118494j,
                        -0.14140625 - 0.14143646086118494j, -1.4901161193847656))  # fmt: skip


@example(FLAT, 2.0, 0)
@given(plants(), st.floats(0.05, 2.0), st.integers(0, 2**32))
def test_plants(plant: Plant, spread: float, seed: int) -> None:
    assert_exact(scaled(plant), requests("u", ["y"]), around({"k": 1.0, "t": 1.0}, spread, seed))


def regulated(plant: Plant) -> Diagram:
    """Return a PI controller round the plant, with a disturbance before it: stable or not, as it comes."""
    numerator, denominator = plant.polynomials()
    return system(
        {
            "r": block("input"),
            "d": block("input", role="disturbance"),
            "error": block("sum", signs="+-"),
            "controller": block("pi", kp="=kp", ki="=ki"),
            "junction": block("sum", signs="++"),
            "plant": block("transfer_function", numerator=numerator, denominator=denominator),
        },
        [
            "r -> error.in1", "plant -> error.in2", "error -> controller", "controller -> junction.in1",
            "d -> junction.in2", "junction -> plant",
        ],
        {"y": "plant", "u": "controller"},
        {"kp": 0.3 / plant.gain, "ki": 0.1 / plant.gain},
    )  # fmt: skip


@given(plants(), st.sampled_from(["r", "d"]), st.floats(0.05, 1.5), st.integers(0, 2**32))
def test_regulated_plants(plant: Plant, source: str, spread: float, seed: int) -> None:
    diagram = regulated(plant)
    nominal = {name: diagram.parameters[name].value for name in ("kp", "ki")}
    assert_exact(diagram, requests(source, ["y", "u"], "error"), around(nominal, spread, seed))


@given(servos(), gains())
def test_the_amplitude_scales_what_it_must(servo: Servo, amplitude: float) -> None:
    diagram, candidates = servo.diagram(), around(asdict(servo), 0.3, 1)
    metrics = ("rise_time", "overshoot", "peak", "steady_state_error")
    one, other = (
        Screening(
            diagram,
            [
                MetricRequest(
                    metric=m, signals={"r": make("step", {"amplitude": a})}, output="y", options=Options(derivative=0)
                )
                for m in metrics
            ],
        )(candidates)
        for a in (1.0, amplitude)
    )
    power = np.array([1.0, 1.0, abs(amplitude), amplitude])
    sure = ~(one.doubtful | other.doubtful)
    assert sure.mean() > 0.5
    difference = np.abs(other.values - one.values * power)[sure]
    assert (np.nan_to_num(difference) <= 1e-8 * np.broadcast_to(np.abs(power), one.values.shape)[sure]).all()
