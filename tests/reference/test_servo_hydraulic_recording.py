"""The recorded servo-hydraulic actuator of examples/data: what its model reaches, beside a published one.

Source of the recording and of the published model: examples/data/servo_hydraulic_actuator/SOURCE.md. The fits of the
published model were computed from the file before this code existed: 91.82 % on the raw recording, 95.00 % with the
means of the whole recording removed, 95.05 % low-passed at 50 Hz on the active part (95.50 % by the filters here); of the
refit with a delay of some 4 ms 95.95 %, of gain, lag and delay on the raw recording 92 %.
"""

from __future__ import annotations

import hashlib
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from api.formats.text.cells import Marks
from api.formats.text.txt import TextLayout, read
from engine.diagram.diagram import Block, Connection, Parameter, System, compile_system
from engine.exact.time.sampled import simulate_sampled
from engine.model.linear_system import LinearSystem
from engine.recordings.fit import baselines, compare
from engine.recordings.processing.zero_phase import ZeroPhaseFilter, filtered
from optimizers.identification import Identified, identify
from optimizers.problem import Variable
from optimizers.recorded.recording import Identification, RecordedExperiment, Recording
from optimizers.search.result import Status

FOLDER = Path(__file__).parents[2] / "examples" / "data" / "servo_hydraulic_actuator"
H = 0.001

# the active part: |command - mean| > 0.4 mm and 1 s around, cut into halves
LOW = (6.747, 33.336)
HIGH = (33.337, 59.925)


@cache
def recording() -> dict[str, np.ndarray]:
    """Return the channels in SI units, by the names of the import description."""
    description = json.loads((FOLDER / "import.json").read_text(encoding="utf-8"))
    layout = TextLayout(
        columns=tuple(column["index"] for column in description["columns"]),
        delimiter=description["delimiter"],
        marks=Marks(decimal=description["decimal"]),
        header_lines=description["header_lines"],
    )
    with (FOLDER / "0A.txt").open("rb") as file:
        rows = np.concatenate(list(read(iter(lambda: file.read(1 << 16), b""), layout)))
    si = {"mm": 1e-3, "N": 1.0}
    return {
        column["name"]: rows[:, k] * column["scale"] * si[column["unit"]]
        for k, column in enumerate(description["columns"])
    }


@cache
def identified(place: str, estimation: tuple[float, float], validation: tuple[float, float]) -> Identified:
    """Identify the position loop with its delay at the valve, or outside the loop."""
    wires = {
        "reference": "error.in1",
        "error": "controller",
        "valve": "cylinder.flow",
        "cylinder.position": "error.in2",
    }
    wires |= {"controller": "transport", "transport": "valve"} if place == "valve" else {"controller": "valve"}
    pairs = [*wires.items(), *([] if place == "valve" else [("cylinder.position", "transport")])]
    diagram = compile_system(
        System(
            name="test machine",
            parameters={},
            blocks={
                "reference": Block(kind="input"),
                "error": Block(kind="sum", values={"signs": "+-"}),
                "controller": Block(kind="p", values={"kp": 200.0}),
                "transport": Block(kind="delay", values={"time": 0.002}),
                "valve": Block(kind="proportional_valve", values={"flow_gain": 1e-4, "time_constant": 0.002}),
                "cylinder": Block(
                    kind="linear_hydraulic_motor",
                    # typical of a 25 kN class, resonance near 250 Hz: beyond what a chirp to 20 Hz can see
                    values={
                        "area": 1.26e-3,
                        "volume": 2.5e-4,
                        "bulk_modulus": 1e9,
                        "leakage": 2.3e-11,
                        "mass": 10.0,
                        "viscous_friction": 1000.0,
                    },
                ),
            },
            connections=tuple(Connection(source=source, target=target) for source, target in pairs),
            outputs={"measured": "cylinder.position" if place == "valve" else "transport"},
        )
    )
    return identify(
        Identification(
            diagram=diagram,
            experiments=(
                RecordedExperiment(
                    recording=Recording(
                        inputs={"reference": recording()["command"]},
                        outputs={"measured": recording()["position"]},
                        sample_time=H,
                    ),
                    estimation=estimation,
                    validation=validation,
                ),
            ),
            parameters=(
                Variable(parameter="valve.flow_gain", lower=2e-5, upper=1e-3),
                Variable(parameter="valve.time_constant", lower=1e-4, upper=0.02),
                Variable(parameter="transport.time", lower=0.0, upper=0.02),
            ),
            offsets=True,
        ),
        rng=np.random.default_rng(0),
    )


def velocity_gain(result: Identified) -> float:
    return 200.0 * result.parameters["valve.flow_gain"].value / 1.26e-3


def published() -> LinearSystem:
    """Return 9045.99157866 / ((s + 183.82897555)(s + 48.58160838))."""
    p, q = 183.82897555, 48.58160838
    return LinearSystem.delay_free(
        np.array([[0.0, 1.0], [-p * q, -(p + q)]]),
        np.array([[0.0], [9045.99157866]]),
        np.array([[1.0, 0.0]]),
        np.zeros((1, 1)),
    )


def test_the_recording_is_the_one_its_source_names():
    digest = hashlib.sha256((FOLDER / "0A.txt").read_bytes()).hexdigest()
    assert digest == "7ac3fd85ba301805323fc8f20a967ff3e989babcbcd9719b9bf5aa9d734168d1"
    assert digest in (FOLDER / "SOURCE.md").read_text(encoding="utf-8")
    assert "Permission is hereby granted" in (FOLDER / "LICENSE").read_text(encoding="utf-8")


def test_the_import_description_gives_the_channels_their_meaning():
    channels = recording()
    assert set(channels) == {"position", "force", "command"}
    assert all(channel.shape == (61_500,) for channel in channels.values())
    # first line of the file: -0.0209, -0.0166, -0.0169 in units of 10 mm, 9806.65 N, 10 mm
    assert [channels[name][0] for name in ("position", "force", "command")] == pytest.approx(
        [-0.209e-3, -162.79039, -0.169e-3]
    )


def test_the_active_part_is_where_the_halves_say():
    command = recording()["command"]
    active = np.flatnonzero(np.abs(command - command.mean()) > 0.4e-3)
    assert (active[0] * H - 1, active[-1] * H + 1) == pytest.approx((LOW[0], HIGH[1]))


def test_the_published_model_scores_what_was_computed_for_it():
    command, position = recording()["command"], recording()["position"]
    raw = simulate_sampled(published(), command[None], H)[0]
    # computed from zero then, from the first sample's equilibrium here: 0.013 more
    assert compare(position, raw).fit_percent == pytest.approx(91.82, abs=0.02)
    without_means = simulate_sampled(published(), command[None] - command.mean(), H)[0]
    assert compare(position - position.mean(), without_means).fit_percent == pytest.approx(95.00, abs=0.01)


def test_the_published_model_on_what_a_low_pass_leaves():
    """Both signals low-passed at 50 Hz (Butterworth of order 4, both ways), the active part, means removed: not below 95.05."""
    design = ZeroPhaseFilter(band="low_pass", frequency=2 * np.pi * 50, order=4)
    active = slice(round(LOW[0] / H), round(HIGH[1] / H) + 1)
    command, position = (filtered(recording()[name], 1 / H, design)[active] for name in ("command", "position"))
    model = simulate_sampled(published(), command[None] - command.mean(), H)[0]
    fit = compare(position - position.mean(), model).fit_percent
    assert fit is not None
    # the filter of that number is not known in full: one pass or two, on the recording or on its active part give 95.5
    assert 95.05 - 0.3 <= fit <= 95.05 + 0.5


def refitted(*, offsets: bool) -> Identified:
    """Return gain, lag and delay from the whole raw recording."""
    diagram = compile_system(
        System(
            name="lag and delay",
            parameters={"gain": Parameter(value=1.0), "lag": Parameter(value=0.02)},
            blocks={
                "command": Block(kind="input"),
                "lag": Block(kind="transfer_function", values={"numerator": ["=gain"], "denominator": ["=lag", 1.0]}),
                "transport": Block(kind="delay", values={"time": 0.003}),
            },
            connections=(
                Connection(source="command", target="lag"),
                Connection(source="lag", target="transport"),
            ),
            outputs={"measured": "transport"},
        )
    )
    whole = Recording(
        inputs={"command": recording()["command"]}, outputs={"measured": recording()["position"]}, sample_time=H
    )
    bounds = {"gain": (0.5, 2.0), "lag": (1e-3, 0.1), "transport.time": (0.0, 0.02)}
    return identify(
        Identification(
            diagram=diagram,
            experiments=(RecordedExperiment(recording=whole, split=1.0),),
            parameters=tuple(Variable(parameter=k, lower=low, upper=high) for k, (low, high) in bounds.items()),
            offsets=offsets,
        ),
        rng=np.random.default_rng(0),
    )


def test_the_zero_of_the_sensor_is_the_fourth_parameter():
    three, four = refitted(offsets=False), refitted(offsets=True)
    assert three.estimation["measured"].fit_percent == pytest.approx(92.0, abs=0.5)
    assert four.estimation["measured"].fit_percent >= 95.95 - 0.1
    # about 4 ms beside a lag; with the second lag of the published model it would be 4.4 to 4.9 ms of both
    assert 4.4e-3 <= four.parameters["transport.time"].value <= 4.9e-3


def test_the_trivial_model_scores_minus_18():
    window = Recording(inputs={}, outputs={"position": recording()["position"]}, sample_time=H).within(
        (LOW[0], HIGH[1])
    )
    fits = baselines(recording()["position"][window], recording()["command"][None, window], constant=True)
    assert fits["input"].fit_percent == pytest.approx(-18.7, abs=0.1)


@pytest.mark.parametrize("place", ["valve", "outside"])
def test_from_the_fast_half_to_the_slow_one(place):
    result = identified(place, HIGH, LOW)
    assert result.status is Status.CONVERGED
    assert result.validation["measured"].fit_percent >= 95.0
    assert result.validation["measured"].relative_error_percent <= 10.0
    assert result.validation["measured"].fit_percent > result.baselines["static_gain"]["measured"].fit_percent + 40


@pytest.mark.parametrize("place", ["valve", "outside"])
def test_from_the_slow_half_to_the_fast_one(place):
    result = identified(place, LOW, HIGH)
    assert result.status is Status.CONVERGED
    assert result.validation["measured"].fit_percent >= 91.0
    assert result.validation["measured"].fit_percent > result.baselines["static_gain"]["measured"].fit_percent + 90


@pytest.mark.parametrize("halves", [(HIGH, LOW), (LOW, HIGH)])
def test_lag_and_delay_cannot_be_told_apart_but_their_sum_can(halves):
    result = identified("valve", *halves)
    assert any(
        "valve.time_constant and transport.time are hard to tell apart" in sentence
        for sentence in result.indistinguishable
    )
    # of lag and delay together; each of them alone is uncertain by several tenths of a millisecond
    total = result.parameters["valve.time_constant"].value + result.parameters["transport.time"].value
    assert 3.8e-3 < total < 4.9e-3


def test_the_place_of_the_delay_is_no_question_that_the_recording_answers():
    for halves in ((HIGH, LOW), (LOW, HIGH)):
        inside, outside = (identified(place, *halves) for place in ("valve", "outside"))
        for part in ("estimation", "validation"):
            fits = [getattr(result, part)["measured"].fit_percent for result in (inside, outside)]
            assert fits[0] == pytest.approx(fits[1], abs=0.02)


def test_the_velocity_gain_agrees_between_the_halves_when_the_delay_is_in_the_loop():
    high, low = identified("valve", HIGH, LOW), identified("valve", LOW, HIGH)
    assert velocity_gain(high) == pytest.approx(38.6, abs=0.3)
    assert velocity_gain(low) == pytest.approx(velocity_gain(high), rel=0.02)
    # the sensor's zero drifted by 0.04 mm within the recording
    assert high.offsets["measured"] == pytest.approx(-0.0384e-3, abs=1e-6)
    assert low.offsets["measured"] == pytest.approx(-0.0786e-3, abs=1e-6)
