"""Screening agrees with the exact path, value and derivative, and says so where it cannot vouch for a number."""

from __future__ import annotations

import numpy as np
import pytest

from engine.analysis.study import MetricRequest, measure
from engine.batch.frequency.batch import FrequencyBatch
from engine.batch.kernels.readings import TIME_READINGS
from engine.batch.screening import Screening
from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.model.metric_options import Options
from engine.signals import make
from tests.unit.engine.diagrams import block, document

STEP = {"u": make("step", {})}
LOOP = ("sensitivity_peak", "complementary_peak", "gain_margin", "phase_margin", "delay_margin")


def lag_loop(*, delay: float | None = 0.004, second: float | None = None) -> Diagram:
    """Velocity-gain plant with a valve lag and, if wanted, transport delays, under a proportional law with lead."""
    blocks = {
        "u": Block(kind="input"),
        "error": Block(kind="sum", values={"signs": "+-"}),
        "controller": Block(kind="pd", values={"kp": "=kp", "kd": "=kd", "filter_frequency": 2000.0}),
        "valve": Block(kind="transfer_function", values={"numerator": [50.0], "denominator": ["=lag", 1.0]}),
        "cylinder": Block(kind="integrator"),
    }
    route = ["u", "error.in1"], ["error", "controller"], ["controller", "valve"], ["valve", "cylinder"]
    last = "cylinder"
    connections = list(route)
    for name, time in (("first", delay), ("second", second)):
        if time is not None:
            blocks[name] = Block(kind="delay", values={"time": f"={name}_delay"})
            connections.append([last, name])
            last = name
    connections.append([last, "error.in2"])
    parameters = {
        "kp": Parameter(value=1.5), "kd": Parameter(value=0.002), "lag": Parameter(value=8e-4),
        **({"first_delay": Parameter(value=delay)} if delay is not None else {}),
        **({"second_delay": Parameter(value=second)} if second is not None else {}),
    }  # fmt: skip
    return compile_system(
        System(
            parameters=parameters,
            blocks=blocks,
            connections=tuple(Connection(source=a, target=b) for a, b in connections),
            outputs={"y": "cylinder", "v": "valve", "c": "controller"},
        )
    )


def oscillator(natural: float, damping: float, *, gain: float = 1.0) -> Diagram:
    """gain ω² / (s² + 2ζω s + ω²)."""
    return compile_system(
        System(
            parameters={"w": Parameter(value=natural), "z": Parameter(value=damping), "k": Parameter(value=gain)},
            blocks={
                "u": Block(kind="input"),
                "g": Block(
                    kind="transfer_function", values={"numerator": ["=k*w*w"], "denominator": [1.0, "=2*z*w", "=w*w"]}
                ),
            },
            connections=(Connection(source="u", target="g"),),
            outputs={"y": "g"},
        )
    )


def time_requests(*metrics: str, output: str = "y") -> list[MetricRequest]:
    return [
        MetricRequest(metric=metric, signals=STEP, output=output, options=Options(derivative=0))
        if metric == "max_velocity"
        else MetricRequest(metric=metric, signals=STEP, output=output)
        for metric in metrics
    ]


@pytest.mark.parametrize("delay", [None, 0.004])
def test_every_metric_agrees_with_the_exact_path(delay) -> None:
    diagram = lag_loop(delay=delay)
    metrics = [
        *TIME_READINGS.keys() - {"peak_time", "max_velocity", "max_acceleration", "control_effort"},
        "iae",
        "ise",
        "itae",
    ]
    requests = [
        *time_requests(*metrics),
        *time_requests("max_velocity", output="v"),
        *time_requests("control_effort", output="c"),
        *(MetricRequest(metric=metric, open_at="error") for metric in LOOP),
        MetricRequest(metric="bandwidth", source="u", target="y"),
        MetricRequest(metric="control_sensitivity_peak", source="u", target="c"),
    ]
    kp, kd = np.array([1.0, 1.6, 2.4]), np.array([0.001, 0.004, 0.002])
    screened = Screening(diagram, requests)({"kp": kp, "kd": kd})
    assert not screened.doubtful.any()
    assert (screened.growth < 0).all()
    for row in range(3):
        exact = measure(diagram, requests, overrides={"kp": float(kp[row]), "kd": float(kd[row])})
        for column, (measured, _) in enumerate(exact):
            value = screened.values[row, column]
            if measured.value is None:
                assert not np.isfinite(value)
            else:
                assert value == pytest.approx(measured.value, rel=1e-6, abs=1e-9), requests[column].metric


def test_derivatives_ride_along() -> None:
    diagram = lag_loop()
    requests = [
        *time_requests("rise_time", "response_time", "overshoot", "peak_time", "iae", "ise", "itae"),
        *time_requests("max_velocity", output="v"),
        *(MetricRequest(metric=metric, open_at="error") for metric in LOOP),
        MetricRequest(metric="bandwidth", source="u", target="y"),
    ]
    names = ["kp", "kd", "lag", "first_delay"]
    point = np.array([2.4, 0.002, 8e-4, 0.004])
    lanes = point + 1e-30j * np.diag(point)
    screened = Screening(diagram, requests)({name: lanes[:, i] for i, name in enumerate(names)})
    exact = measure(diagram, requests, overrides=dict(zip(names, point.tolist(), strict=True)), gradient=names)
    for column, (measured, gradient) in enumerate(exact):
        assert measured.value is not None
        assert gradient is not None
        elasticities = screened.values[:, column].imag / 1e-30 / measured.value
        assert elasticities == pytest.approx(gradient.values * point / measured.value, rel=1e-5, abs=1e-6), requests[
            column
        ].metric


def test_closed_form_of_an_oscillator() -> None:
    # 1/(s²+s+1): overshoot exp(-πζ/√(1-ζ²)), peak time π/(ω√(1-ζ²)); ISE of the step = (ζ + 1/(4ζ))/ω.
    zeta = 0.5
    screened = Screening(oscillator(1.0, zeta), time_requests("overshoot", "peak_time", "ise"))(
        {"w": np.array([1.0, 7.0])}
    )
    root = np.sqrt(1 - zeta**2)
    for row, natural in enumerate((1.0, 7.0)):
        expected = [np.exp(-np.pi * zeta / root), np.pi / (natural * root), (zeta + 1 / (4 * zeta)) / natural]
        assert screened.values[row] == pytest.approx(expected, rel=1e-8)


def test_a_lightly_damped_mode_is_refined_until_it_is_resolved() -> None:
    zeta = 0.01
    screened = Screening(oscillator(100.0, zeta), time_requests("overshoot", "settling_time"))({"k": np.array([1.0])})
    assert not screened.doubtful[0, 0]
    assert screened.values[0, 0] == pytest.approx(np.exp(-np.pi * zeta / np.sqrt(1 - zeta**2)), rel=1e-6)


def test_unstable_and_stable_candidates_do_not_disturb_each_other() -> None:
    diagram, requests = lag_loop(), time_requests("rise_time", "overshoot")
    screening = Screening(diagram, requests)
    alone = screening({"kp": np.array([1.5])})
    mixed = screening({"kp": np.array([40.0, 1.5, 1e3])})
    assert mixed.values[1] == pytest.approx(alone.values[0], rel=1e-12)
    assert np.isnan(mixed.values[[0, 2]]).all()
    assert (mixed.growth[[0, 2]] > 0).all()
    assert mixed.growth[2] > mixed.growth[0]  # the further beyond the edge, the faster it diverges


def test_violent_divergence_is_quiet() -> None:
    screened = Screening(lag_loop(), time_requests("overshoot"))({"kp": np.array([1e9, 1.5])})
    assert screened.growth[0] > 0 > screened.growth[1]
    assert np.isnan(screened.values[0, 0])


def test_the_edge_of_stability_is_found() -> None:
    # ∫ with delay τ: 1 + k e^(-sτ)/s loses stability at k τ = π/2.
    diagram = compile_system(
        System(
            parameters={"k": Parameter(value=1.0)},
            blocks={
                "u": Block(kind="input"), "error": Block(kind="sum", values={"signs": "+-"}),
                "k": Block(kind="gain", values={"gain": "=k"}), "i": Block(kind="integrator"), "d": Block(kind="delay", values={"time": 1.0}),
            },
            connections=tuple(
                Connection(source=a, target=b)
                for a, b in (("u", "error.in1"), ("d", "error.in2"), ("error", "k"), ("k", "i"), ("i", "d"))
            ),
            outputs={"y": "i"},
        )
    )  # fmt: skip
    screened = Screening(diagram, time_requests("overshoot"))({"k": np.pi / 2 * np.array([0.99, 1.01])})
    assert screened.growth[0] < 0 < screened.growth[1]


def test_what_a_frequency_response_does_not_tell_is_said_in_advance() -> None:
    requests = [
        MetricRequest(metric="phase_margin", open_at="error"),
        MetricRequest(metric="rise_time", signals=STEP, output="y"),
        MetricRequest(metric="damping_ratio"),
    ]
    scan = FrequencyBatch(lag_loop(), requests)
    assert scan.measured == (True, False, False)
    assert scan({"kp": np.array([1.5])}).doubtful[0].tolist() == [False, True, True]


def test_what_is_not_followed_is_left_to_the_exact_path() -> None:
    requests = [*time_requests("rise_time"), MetricRequest(metric="damping_ratio")]
    screened = Screening(lag_loop(), requests)({"kp": np.array([1.5])})
    assert screened.doubtful[0].tolist() == [False, True]
    assert np.isnan(screened.values[0, 1])


def test_delays_of_different_length_are_followed() -> None:
    diagram, requests = lag_loop(second=0.001), time_requests("rise_time", "overshoot", "iae")
    screened = Screening(diagram, requests)({"kp": np.array([1.5])})
    exact = measure(diagram, requests, overrides={"kp": 1.5})
    assert not screened.doubtful.any()
    assert screened.values[0] == pytest.approx([measured.value for measured, _ in exact], rel=1e-9)


def test_a_member_that_does_not_exist_is_invalid() -> None:
    screened = Screening(lag_loop(), time_requests("rise_time"))({"lag": np.array([8e-4, np.inf])})
    assert screened.valid.tolist() == [True, False]


@pytest.mark.parametrize(
    ("resonance", "gain", "damping", "delay", "seen"), [(1e3, 0.05, 0.01, 1.0, False), (1e3, 0.05, 0.001, 0.5, True)]
)
def test_an_unstable_resonance_behind_a_delay_is_doubted(
    resonance: float, gain: float, damping: float, delay: float, seen: bool
) -> None:
    # tests/reference/test_delay_poles.py counts its unstable poles: hundreds of turns of the delay lie within the resonance
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "late": block("delay", time=delay),
        "plant": block(
            "transfer_function", numerator=["=gain"], denominator=[1 / resonance**2, 2 * damping / resonance, 1.0]
        ),
    }  # fmt: skip
    wires = ["r -> e.in1", "plant -> e.in2", "e -> late", "late -> plant"]
    diagram = compile_system(document(blocks, wires, {"y": "plant"}, gain=gain))
    requests = [MetricRequest(metric=name, open_at="e") for name in ("gain_margin", "phase_margin", "delay_margin")]
    # at 1e-6 the loop is stable; its margin is that of the resonance, which may lie between the places that are looked at
    found = Screening(diagram, requests)({"gain": np.array([gain, 1e-6])})
    assert found.doubtful.tolist() == [[True] * 3, [not seen, False, False]]
    omega = resonance * (1 + np.linspace(-5, 5, 10**6) * damping)
    opened = 1e-6 / (1 - (omega / resonance) ** 2 + 2j * damping * omega / resonance) * np.exp(-1j * omega * delay)
    crossing = np.flatnonzero((opened.imag[:-1] * opened.imag[1:] < 0) & (opened.real[:-1] < 0))
    margin = measure(diagram, requests[:1], overrides={"gain": 1e-6})[0][0].value
    assert margin == pytest.approx(1 / np.abs(opened[crossing]).max(), rel=1e-4)
    if seen:
        assert found.values[1, 0] == pytest.approx(margin, rel=1e-9)


@pytest.mark.parametrize("limited", [False, True])
def test_margins_do_not_ask_for_what_no_loop_sees(limited) -> None:
    # The angle of the shaft is read by nobody: its pole at 0 is none of the loop's.
    blocks = {
        "u": block("input"), "error": block("sum", signs="+-"), "law": block("pi", kp="=kp", ki=2.0),
        "limit": block("saturation", lower=-48.0, upper=48.0) if limited else block("gain", gain=1.0),
        "motor": block(
            "dc_motor", resistance=0.5, inductance=1e-3, torque_constant=0.2, back_emf_constant=0.2, inertia=2e-3,
            viscous_friction=1e-3,
        ),
        "seen": block("low_pass", frequency=2000.0, order=1),
    }  # fmt: skip
    wires = [("u", "error.in1"), ("error", "law"), ("law", "limit"), ("limit", "motor.voltage")]
    wires += [("motor.speed", "seen"), ("seen", "error.in2")]
    diagram = compile_system(
        System(
            parameters={"kp": Parameter(value=0.2)}, blocks=blocks, outputs={"speed": "motor.speed"},
            connections=tuple(Connection(source=a, target=b) for a, b in wires),
        )
    )  # fmt: skip
    requests = [
        *(MetricRequest(metric=metric, open_at="error") for metric in LOOP),
        MetricRequest(metric="resonance_peak", source="u", target="speed"),
    ]
    gains = np.array([0.05, 0.3, 2.0, 5.0, 300.0])
    screened = FrequencyBatch(diagram, requests)({"kp": gains})
    assert not screened.doubtful.any()
    assert (screened.growth < 0).tolist() == [True] * 4 + [False]
    moved = FrequencyBatch(diagram, requests)({"kp": gains * (1 + 1e-30j)})
    for k, gain in enumerate(gains[:4]):
        exact = measure(diagram, requests, overrides={"kp": gain}, gradient=["kp"])
        values = [measured.value for measured, _ in exact]
        finite = np.isfinite(values)
        assert screened.values[k] == pytest.approx(values, rel=1e-9)
        slopes = np.array([slopes.values[0] for _, slopes in exact])
        assert (moved.values[k].imag / 1e-30)[finite] == pytest.approx(slopes[finite] * gain, rel=1e-6, abs=1e-9)
    assert measure(diagram, requests, overrides={"kp": 300.0})[0][0].value is None


@pytest.mark.parametrize("closed", [False, True])
def test_a_path_of_delays_alone_is_left_to_the_exact_path(closed) -> None:
    wires = ["u -> error.in1", "error -> k", "k -> d", "d -> lag", *(["d -> error.in2"] if closed else [])]
    diagram = compile_system(
        document(
            blocks={
                "u": block("input"), "error": block("sum", signs="+-" if closed else "+"), "k": block("gain", gain="=k"),
                "d": block("delay", time=0.1), "lag": block("low_pass", frequency=5.0, order=1),
            },
            wires=wires, outputs={"y": "d", "z": "lag"}, k=0.5,
        )
    )  # fmt: skip
    requests = [MetricRequest(metric="resonance_peak", source="u", target=output) for output in ("y", "z")]
    requests += [MetricRequest(metric="gain_margin", open_at="error")] if closed else []
    screened = FrequencyBatch(diagram, requests)({"k": np.array([0.5, 0.8])})
    assert screened.doubtful[:, 0].all()
    assert not screened.doubtful[:, 1].any()
    for row, gain in zip(screened.values, (0.5, 0.8), strict=True):
        exact = [measured.value for measured, _ in measure(diagram, requests, overrides={"k": gain})]
        known = ~np.isnan(row)
        assert row[known] == pytest.approx(np.array(exact, dtype=float)[known], rel=1e-9)
