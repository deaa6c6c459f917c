"""Derivatives of metrics by numbers of commands: closed forms, and converged differences where there is none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from engine.analysis.commanded import CommandParameter
from engine.analysis.measuring import MetricRequest, measure
from engine.diagram.diagram import compile_system
from engine.model.errors import DiagramError, SignalError
from engine.signals import changed, make
from tests.unit.engine.diagrams import block, document

W, Z = 10.0, 0.1


def arm(delay: float | None = None):
    """Return a mode: position, velocity and acceleration; with a transport delay before it, if wanted."""
    denominator = [1, 2 * Z * W, W**2]
    blocks = {
        "u": block("input"),
        "x": block("transfer_function", numerator=[W**2], denominator=denominator),
        "v": block("transfer_function", numerator=[W**2, 0], denominator=denominator),
        "a": block("transfer_function", numerator=[W**2, 0, 0], denominator=denominator),
    }
    source = "u"
    if delay is not None:
        blocks["wait"], source = block("delay", time=delay), "wait"
    wires = [f"{source} -> {name}" for name in "xva"] + (["u -> wait"] if delay is not None else [])
    return compile_system(document(blocks, wires, {"position": "x", "velocity": "v", "acceleration": "a"}))


TRAPEZOID = {"kind": "trapezoid", "distance": 2.0, "max_velocity": 1.5, "max_acceleration": 6.0, "start": 0.2}
S_CURVE = {"kind": "s_curve", "distance": 2.0, "max_velocity": 1.5, "max_acceleration": 6.0, "max_jerk": 50.0}
SHAPED = {
    "kind": "shaped",
    "shaper": "zvd",
    "frequency": 9.0,
    "damping_ratio": 0.08,
    "command": {"kind": "step", "start": 0.1},
}
EI = {"kind": "shaped", "shaper": "ei", "frequency": 9.0, "damping_ratio": 0.08, "command": TRAPEZOID}
DELAYED = {
    "kind": "programmed_delay",
    "delay": 0.23,
    "share": 0.45,
    "command": {"kind": "step", "amplitude": 2.0, "start": 0.1},
}

CASES = [
    ({"kind": "step", "amplitude": 2.0, "start": 0.3}, ["amplitude", "start"]),
    (TRAPEZOID, ["distance", "max_velocity", "max_acceleration", "start"]),
    (S_CURVE, ["distance", "max_velocity", "max_acceleration", "max_jerk"]),
    (SHAPED, ["frequency", "damping_ratio", "command.amplitude", "command.start"]),
    (EI, ["frequency", "damping_ratio", "tolerance", "command.max_velocity"]),
    (DELAYED, ["delay", "share", "command.start"]),
    ({"kind": "programmed_delay", "delay": 0.23, "command": {"kind": "sampled", "time": [0, 0.1, 1], "values": [0, 1, 2]}},
     ["delay"]),
]  # fmt: skip
METRICS = [
    ("residual_vibration", "position", {}),
    ("residual_vibration", "velocity", {}),
    ("band_energy", "velocity", {"band": (8.0, 12.0)}),
    ("settling_time", "position", {}),
    ("peak_time", "position", {}),
    ("max_velocity", "velocity", {}),
    ("ise", "position", {}),
    ("itae", "position", {}),
    ("iae", "position", {"duration": 1.3}),
]


def made(document):
    return make(document["kind"], {key: value for key, value in document.items() if key != "kind"})


def metrics(diagram, signal, gradient=()):
    requests = [
        MetricRequest(metric=metric, signals={"u": signal}, output=output, **fields)
        for metric, output, fields in METRICS
    ]
    return measure(diagram, requests, gradient=gradient)


@pytest.mark.parametrize(
    ("command", "paths"), CASES, ids=lambda value: value.get("kind") if isinstance(value, dict) else ""
)
@pytest.mark.parametrize("delay", [None, 0.07])
def test_derivatives_are_those_of_converged_differences(command, paths, delay) -> None:
    diagram, signal = arm(delay), made(command)
    lanes = [CommandParameter(signal=signal, path=path) for path in paths]
    found = metrics(diagram, signal, lanes)
    for lane, parameter in enumerate(lanes):
        h = 1e-5 * parameter.scale
        above, below = (metrics(diagram, changed(signal, parameter.path, parameter.value + side)) for side in (h, -h))
        for row, (metric, output, _) in enumerate(METRICS):
            measured, gradient = found[row]
            if measured.value is None:
                assert gradient is None
                continue
            difference = (above[row][0].value - below[row][0].value) / (2 * h)
            # a central difference of a metric known to 1e-10 errs by about 1e-10/1e-5 of its size
            size = max(abs(measured.value) / parameter.scale, abs(difference))
            assert gradient.values[lane] == pytest.approx(difference, rel=2e-5, abs=2e-5 * size), (
                parameter.path, metric, output,
            )  # fmt: skip


def test_the_derivative_of_residual_vibration_by_the_delay_is_its_closed_form() -> None:
    # a mode without damping behind two half steps: what swings has the amplitude |cos(wτ/2)|; seen long after the end
    diagram = compile_system(
        document(
            {"u": block("input"), "x": block("transfer_function", numerator=[W**2], denominator=[1, 1e-3, W**2])},
            ["u -> x"],
            {"x": "x"},
        )
    )
    signal = make("programmed_delay", {"delay": 0.2, "command": {"kind": "step"}})
    request = MetricRequest(metric="residual_vibration", signals={"u": signal}, output="x")
    ((measured, gradient),) = measure(diagram, [request], gradient=[CommandParameter(signal=signal, path="delay")])
    assert measured.value == pytest.approx(math.cos(1.0), rel=1e-3)
    assert gradient.values[0] == pytest.approx(-W / 2 * math.sin(1.0), rel=1e-3)


def test_numbers_of_commands_and_of_the_system_stand_side_by_side() -> None:
    diagram = compile_system(
        document(
            {"u": block("input"), "lag": block("transfer_function", numerator=["=k"], denominator=[0.5, 1])},
            ["u -> lag"],
            {"y": "lag"},
            k=3.0,
        )
    )
    signal, other = make("step", {"amplitude": 2.0}), make("step", {"amplitude": 2.0})
    requests = [MetricRequest(metric="peak", signals={"u": each}, output="y") for each in (signal, other)]
    requests.append(MetricRequest(metric="bandwidth", source="u", target="y"))
    lanes = [CommandParameter(signal=signal, path="amplitude"), "k", CommandParameter(signal=other, path="amplitude")]
    found = measure(diagram, requests, gradient=lanes)
    # peak = k amplitude; equal commands of two experiments are two
    np.testing.assert_allclose(found[0][1].values, [3, 2, 0], atol=1e-12)
    np.testing.assert_allclose(found[1][1].values, [0, 2, 3], atol=1e-12)
    np.testing.assert_allclose(found[2][1].values, [0, 0, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("height", "must be one of delay, share"),
        ("delay.start", "delay must be a command"),
        ("command", "must be one of"),
    ],
)
def test_refuses_what_is_no_number(path, message) -> None:
    with pytest.raises(SignalError, match=message):
        CommandParameter(signal=made(DELAYED), path=path)


def test_knows_what_it_is() -> None:
    parameter = CommandParameter(signal=made(EI), path="command.max_velocity")
    assert (parameter.value, parameter.param.name, parameter.param.scale) == (1.5, "max_velocity", "log")


def test_a_nonlinear_system_has_no_such_derivative_yet() -> None:
    diagram = compile_system(
        document(
            {
                "u": block("input"),
                "limit": block("saturation", upper=1.0),
                "lag": block("transfer_function", numerator=[1], denominator=[1, 1]),
            },
            ["u -> limit", "limit -> lag"],
            {"y": "lag"},
        )
    )
    signal = make("step")
    request = MetricRequest(metric="peak", signals={"u": signal}, output="y")
    with pytest.raises(DiagramError, match="must be that of a linear system"):
        measure(diagram, [request], gradient=[CommandParameter(signal=signal, path="amplitude")])
