"""Systems whose answer is a word: what does not exist has a verdict, what exists beside it keeps its value.

Closed forms stand in each test; none of these may raise, and none may give a plausible number.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from engine.analysis.study import MetricRequest, frequency_response, measure, simulate
from engine.model.errors import DiagramError, IllPosedError
from engine.model.verdicts import Verdict
from tests.reference.measuring import TIME_METRICS, expect, loop_metrics, step, time_metrics
from tests.reference.systems import MOTOR, block, system, transfer_function, unity_loop

LARGEST = ("peak", "peak_time", "max_velocity", "max_acceleration", "control_effort")
RELATIVE = ("rise_time", "settling_time", "response_time", "overshoot", "undershoot")


def test_unstable_path_keeps_its_curve() -> None:
    # 1/(s - 1): y = exp(t) - 1
    done = simulate(transfer_function([1], [1, -1]), signals={"u": step()}, duration=5.0, samples=51)
    assert done.curves["y"] == pytest.approx(np.expm1(done.time), rel=1e-11, abs=1e-14)
    assert done.verdict is Verdict.UNSTABLE
    for metric in (*TIME_METRICS, "iae", "ise", "itae"):
        got = done.metrics["y"][metric]
        if metric in {"iae", "ise", "itae", *LARGEST}:  # over a finite duration they exist, whatever the system does
            assert got.value is not None, metric
        else:
            assert (got.value, got.verdict) == (None, Verdict.UNSTABLE), metric
            assert got.advice, metric


def test_an_unstable_loop_has_no_margins_that_please() -> None:
    # L = 10/(s(s+1)^2): Hurwitz needs K < 2, so the gain may have to fall by the factor 5
    study = loop_metrics(unity_loop([10], [1, 2, 1, 0]))
    assert study.verdict is Verdict.UNSTABLE
    assert sum(p.real > 0 for p in study.poles) == 2
    assert study.margins is not None
    assert [value for _, value in study.margins.gain] == pytest.approx([0.2], rel=1e-9)
    for peak in ("sensitivity_peak", "complementary_peak"):
        assert (study.metrics[peak].value, study.metrics[peak].verdict) == (None, Verdict.UNSTABLE)


def test_a_position_integrates_while_its_velocity_settles() -> None:
    lpm = system(
        {"flow": block("input"), "motor": block("linear_pneumatic_motor", **MOTOR)},
        ["flow -> motor.flow"],
        {"position": "motor.position", "velocity": "motor.velocity"},
    )
    done = simulate(lpm, signals={"flow": step(1e-4)}, duration=3.0, samples=31)
    assert done.verdict is Verdict.INTEGRATING
    for metric in RELATIVE:
        assert (done.metrics["position"][metric].value, done.metrics["position"][metric].verdict) == (
            None,
            Verdict.INTEGRATING,
        )
    # Overshoot of a second-order system, exp(-pi zeta/sqrt(1 - zeta^2)), eq. (1)-(2)
    capacitance = MOTOR["volume"] / (MOTOR["adiabatic_index"] * MOTOR["pressure"])
    stiff = MOTOR["area"] ** 2 + MOTOR["leakage"] * MOTOR["viscous_friction"]
    damping = (capacitance * MOTOR["viscous_friction"] + MOTOR["mass"] * MOTOR["leakage"]) / (
        2 * math.sqrt(stiff * capacitance * MOTOR["mass"])
    )
    assert damping == pytest.approx(0.175, abs=5e-4)
    expect(done.metrics["velocity"]["overshoot"], math.exp(-math.pi * damping / math.sqrt(1 - damping**2)))
    assert done.metrics["velocity"]["settling_time"].verdict is Verdict.OK


def test_zero_static_gain() -> None:
    # s/(s+1)^2: y = t exp(-t), back to 0; its peak 1/e at 1 s exists
    got = time_metrics(transfer_function([1, 0], [1, 2, 1]), "u", "y", TIME_METRICS)
    for metric in RELATIVE:
        assert (got[metric].value, got[metric].verdict) == (None, Verdict.ZERO_STATIC_GAIN), metric
    expect(got["peak"], math.exp(-1))
    expect(got["peak_time"], 1.0, relative=1e-7)
    expect(got["steady_state_error"], 1.0)


def test_a_high_pass_has_no_bandwidth() -> None:
    study = frequency_response(transfer_function([1, 0], [1, 1]), source="u", target="y")
    assert study.metrics["bandwidth"].value is None
    assert study.metrics["bandwidth"].verdict in {Verdict.ZERO_STATIC_GAIN, Verdict.NEVER_CROSSES}


def test_never_crosses() -> None:
    # 1/(s+1) in a loop: the phase never reaches -180 degrees, the magnitude never exceeds 1
    study = loop_metrics(unity_loop([1], [1, 1]))
    for metric in ("gain_margin", "phase_margin", "delay_margin"):
        assert (study.metrics[metric].value, study.metrics[metric].verdict) == (None, Verdict.NEVER_CROSSES), metric


def test_not_oscillatory() -> None:
    study = frequency_response(transfer_function([1], [1, 3, 2]), source="u", target="y")
    got = study.metrics["critical_frequency"]
    assert (got.value, got.verdict) == (None, Verdict.NOT_OSCILLATORY)


@pytest.mark.parametrize(
    ("numerator", "denominator", "damping"),
    [
        ([1], [1, 3, 2], 1.0),  # -1, -2
        ([1], [1, 1, -2], -1.0),  # 1, -2
        ([1], [1, 2, 1], 1.0),  # -1 twice
        ([1], [1, 2, 5, 0], 1 / math.sqrt(5)),  # -1 ± 2j, and 0, which has none
        ([1], [1, 0, -1, 0, 0], -1.0),  # 1, -1, and 0 twice
        ([1], [1, -2, 5], -1 / math.sqrt(5)),
    ],
)
def test_damping_of_real_and_complex_poles(numerator: list[float], denominator: list[float], damping: float) -> None:
    study = frequency_response(transfer_function(numerator, denominator), source="u", target="y")
    expect(study.metrics["damping_ratio"], damping)


@pytest.mark.parametrize("denominator", [[1, 0], [1, 0, 0], [2]])
def test_without_a_pole_beside_0_the_damping_is_infinite(denominator: list[float]) -> None:
    got = frequency_response(transfer_function([1], denominator), source="u", target="y").metrics["damping_ratio"]
    assert (got.value, got.verdict) == (None, Verdict.NOT_OSCILLATORY)
    assert "infinite" in got.advice


def test_a_short_duration_shortens_the_curve_and_no_metric() -> None:
    # 1/(s+1) looked at for 0.1 s: settling time ln 50, rise time ln 9
    done = simulate(transfer_function([1], [1, 1]), signals={"u": step()}, duration=0.1, samples=11)
    assert done.time[-1] == 0.1
    expect(done.metrics["y"]["settling_time"], math.log(50))
    expect(done.metrics["y"]["rise_time"], math.log(9))
    expect(done.metrics["y"]["iae"], -math.expm1(-0.1))


def test_a_lasting_error_has_no_integral_over_all_time() -> None:
    # 2/(s+1): e tends to -1
    done = simulate(transfer_function([2], [1, 1]), signals={"u": step()})
    for metric in ("iae", "ise", "itae"):
        assert (done.metrics["y"][metric].value, done.metrics["y"][metric].verdict) == (None, Verdict.DIVERGES), metric


def test_hidden_instability_is_the_systems_verdict_not_the_paths() -> None:
    # u -> 1/(s+1) -> y beside v -> 1/(s-1) -> z: the path u -> y settles, the system does not
    both = system(
        {
            "u": block("input"),
            "v": block("input"),
            "calm": block("transfer_function", numerator=[1], denominator=[1, 1]),
            "wild": block("transfer_function", numerator=[1], denominator=[1, -1]),
        },
        ["u -> calm", "v -> wild"],
        {"y": "calm", "z": "wild"},
    )
    done = simulate(both, signals={"u": step()}, duration=5.0)
    assert done.verdict is Verdict.UNSTABLE
    expect(done.metrics["y"]["rise_time"], math.log(9))


def test_improper_transfer_function_is_refused_with_its_place() -> None:
    with pytest.raises(DiagramError) as caught:
        transfer_function([1, 0, 0], [1, 1])
    assert caught.value.at[:2] == ("blocks", "plant")


@pytest.mark.parametrize("gain", [1.0, 1.0 + 1e-16])
def test_ill_posed_loop_names_its_ports(gain: float) -> None:
    # y = gain (r + y) with gain 1: 0 = r
    with pytest.raises(IllPosedError) as caught:
        system(
            {"r": block("input"), "sum": block("sum", signs="++"), "one": block("gain", gain=gain)},
            ["r -> sum.in1", "one -> sum.in2", "sum -> one"],
            {"y": "one"},
        ).realize()
    assert {port.split(".")[0] for port in caught.value.ports} == {"sum", "one"}


def test_a_loop_that_is_ill_posed_at_other_values_only() -> None:
    loop = system(
        {"r": block("input"), "sum": block("sum", signs="++"), "one": block("gain", gain="=k")},
        ["r -> sum.in1", "one -> sum.in2", "sum -> one"],
        {"y": "one"},
        {"k": 0.5},
    )
    with pytest.raises(IllPosedError):
        simulate(loop, signals={"r": step()}, overrides={"k": 1.0}, duration=1.0)
    request = MetricRequest(metric="peak", signals={"r": step()}, output="y")
    ((peak, _),) = measure(loop, [request], overrides={"k": 1.0})
    assert (peak.value, peak.verdict) == (None, Verdict.ILL_POSED)
    assert simulate(loop, signals={"r": step()}, duration=1.0, samples=3).curves["y"] == pytest.approx([1.0] * 3)
