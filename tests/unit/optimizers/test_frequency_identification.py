"""Parameters from measured frequency responses, and from these and recordings together, against closed forms and scipy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import cont2discrete, freqz, lfilter

from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.model.between_samples import BetweenSamples
from optimizers.identification import Identified, identify
from optimizers.problem import ProblemError, Variable
from optimizers.recorded.measured_response import FrequencyExperiment, MeasuredResponse
from optimizers.recorded.recording import Identification, RecordedExperiment, Recording
from optimizers.search.result import Status

TRUTH = {"k": 2.0, "w": 30.0, "d": 0.2, "tau": 0.012}
START = {"k": 1.5, "w": 24.0, "d": 0.4, "tau": 0.008}
OMEGA = np.linspace(2.0, 90.0, 120)
H = 0.002


def diagram(**values: Any) -> Diagram:
    return compile_system(
        System(
            name="late oscillator",
            parameters={
                name: Parameter(value=value, lower=0.0, upper=100.0) for name, value in (START | values).items()
            },
            blocks={
                "u": Block(kind="input"),
                "late": Block(kind="delay", values={"time": "=tau"}),
                "plant": Block(
                    kind="transfer_function", values={"numerator": ["=k*w**2"], "denominator": [1.0, "=2*d*w", "=w**2"]}
                ),
            },
            connections=(Connection(source="u", target="late"), Connection(source="late", target="plant")),
            outputs={"y": "plant"},
        )
    )


def closed_form(k: float, w: float, d: float, tau: float, omega: np.ndarray = OMEGA) -> np.ndarray:
    """Return k w² e^(-sτ) / (s² + 2 d w s + w²)."""
    s = 1j * omega
    return k * w**2 * np.exp(-s * tau) / (s * s + 2 * d * w * s + w * w)


def measured(seed: int, share: float = 0.03, **truth: float) -> MeasuredResponse:
    """Return a response with circular noise whose deviation is a share of each magnitude, larger at the higher lines."""
    rng = np.random.default_rng(seed)
    clean = closed_form(**(TRUTH | truth))
    deviation = share * np.abs(clean) * (1 + OMEGA / 30.0)
    noise = rng.normal(size=(2, OMEGA.size))
    return MeasuredResponse(
        frequency=OMEGA, value=clean + deviation * (noise[0] + 1j * noise[1]), deviation=deviation
    )  # fmt: skip


def experiment(response: MeasuredResponse, **settings: Any) -> FrequencyExperiment:
    return FrequencyExperiment(source="u", responses={"y": response}, sample_time=H, **settings)


def found_by(frequency: tuple[FrequencyExperiment, ...], recordings: tuple[RecordedExperiment, ...] = ()) -> Identified:
    problem = Identification(
        diagram=diagram(), experiments=recordings, frequency=frequency,
        parameters=tuple(Variable(parameter=name) for name in TRUTH),
    )  # fmt: skip
    return identify(problem, rng=np.random.default_rng(0))


def recorded(seed: int, size: float = 0.3) -> RecordedExperiment:
    """Return a recording with held input by scipy's zero-order hold of the plant, the delay being six samples."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-1.0, 1.0], size=60), 25)
    k, w, d = TRUTH["k"], TRUTH["w"], TRUTH["d"]
    numerator, denominator, _ = cont2discrete(([k * w * w], [1.0, 2 * d * w, w * w]), H, method="zoh")
    late = np.concatenate([np.full(6, u[0]), u[:-6]])
    y = lfilter(numerator[0], denominator, late - u[0]) + k * u[0]
    return RecordedExperiment(
        recording=Recording(
            inputs={"u": u}, outputs={"y": y + size * rng.normal(size=u.size)}, sample_time=H,
            between_samples={"u": BetweenSamples.HOLD},
        ),
        split=1.0,
    )  # fmt: skip


def test_estimates_are_those_of_scipy_on_the_same_weighted_errors():
    response = measured(0)

    def errors(p: np.ndarray) -> np.ndarray:
        error = (response.value - closed_form(*p)) / response.deviation
        return np.concatenate([error.real, error.imag])

    reference = least_squares(
        errors, list(START.values()), x_scale=list(START.values()), xtol=1e-14, ftol=1e-14, gtol=1e-14
    )
    found = found_by((experiment(response),))
    assert found.status is Status.CONVERGED
    covariance = np.linalg.inv(reference.jac.T @ reference.jac) * 2 * reference.cost / (2 * OMEGA.size - 4)
    for i, name in enumerate(TRUTH):
        assert found.parameters[name].value == pytest.approx(reference.x[i], rel=1e-6)
        half = 1.959963984540054 * np.sqrt(covariance[i, i])
        assert found.parameters[name].upper95 == pytest.approx(reference.x[i] + half, abs=1e-4 * half)
    (judged,) = found.responses
    error = response.value - closed_form(*reference.x)
    assert judged["y"].fit_percent == pytest.approx(
        100 * (1 - np.linalg.norm(error) / np.linalg.norm(response.value - response.value.mean())), abs=1e-4
    )
    assert judged["y"].lines == OMEGA.size
    assert judged["y"].band == (2.0, 90.0)
    assert found.warnings == ()


def test_both_at_once_tell_more_than_each_alone():
    # in 2 of 100 white errors a colour is seen by chance, as in those of seed 1 alone: then the parts do not add up
    response, recording = experiment(measured(2), name="sweep"), recorded(1)
    width = [
        {name: (e.upper95 or np.inf) - (e.lower95 or 0.0) for name, e in found_by(f, r).parameters.items()}
        for f, r in (((response,), ()), ((), (recording,)), ((response,), (recording,)))
    ]
    for name, value in TRUTH.items():
        assert width[2][name] < 0.97 * min(width[0][name], width[1][name])
        # independent measurements: the information of both, as the variances are estimated
        both = (width[0][name] ** -2 + width[1][name] ** -2) ** -0.5
        assert width[2][name] < 1.05 * both
        assert width[2][name] < 0.3 * value


def test_held_and_linear_inputs_are_compared_from_sample_to_sample():
    """Without a word every way is tried; the measurement is scipy's zero-order or first-order hold of the plant."""
    k, w, d = TRUTH["k"], TRUTH["w"], TRUTH["d"]
    for way, kind in ((BetweenSamples.HOLD, "zoh"), (BetweenSamples.LINEAR, "foh")):
        numerator, denominator, _ = cont2discrete(([k * w * w], [1.0, 2 * d * w, w * w]), H, method=kind)
        clean = freqz(numerator[0], denominator, worN=OMEGA * H)[1]
        noise = 1e-5 * np.random.default_rng(4).normal(size=(2, OMEGA.size)) * np.abs(clean)
        response = MeasuredResponse(
            frequency=OMEGA, value=clean + noise[0] + 1j * noise[1], deviation=1e-5 * np.abs(clean)
        )
        problem = Identification(
            diagram=diagram(tau=0.0), experiments=(), frequency=(experiment(response, between_samples=None),),
            parameters=tuple(Variable(parameter=name) for name in ("k", "w", "d")),
        )  # fmt: skip
        found = identify(problem, rng=np.random.default_rng(0))
        assert found.between_samples is way
        assert set(found.between_tried) == set(BetweenSamples)
        for name in ("k", "w", "d"):
            assert found.parameters[name].value == pytest.approx(TRUTH[name], rel=2e-5)


@pytest.mark.parametrize("factor", [0.5, 1.5, 2.0])
def test_a_resonance_is_found_from_starts_far_away_within_wide_bounds(factor):
    """Bounds of 0 and 100 beside a delay of 0.012 s: a start is not moved off a bound on which it is not."""
    truth = TRUTH | {"d": 0.02}
    response = measured(0, **truth)
    problem = Identification(
        diagram=diagram(**{name: factor * value for name, value in truth.items()}), experiments=(),
        frequency=(experiment(response),), parameters=tuple(Variable(parameter=name) for name in truth),
    )  # fmt: skip
    found = identify(problem, rng=np.random.default_rng(0))
    assert found.warnings == ()
    for name, value in truth.items():
        assert found.parameters[name].value == pytest.approx(value, rel=0.05)


def test_a_gain_of_zero_is_a_model_too():
    """Without a way from the input to the output there was an internal error."""
    zero = identify(
        Identification(
            diagram=diagram(k=0.0), experiments=(), frequency=(experiment(measured(0)),),
            parameters=tuple(Variable(parameter=name) for name in ("k", "w")),
        ),
        rng=np.random.default_rng(0),
    )  # fmt: skip
    assert np.isfinite(zero.parameters["k"].value)


def test_a_model_that_lacks_a_mode_is_seen():
    rest = closed_form(0.5, 70.0, 0.05, TRUTH["tau"])
    response = measured(2)
    wrong = MeasuredResponse(frequency=OMEGA, value=response.value + rest, deviation=response.deviation)
    found = found_by((experiment(wrong),))
    assert any("times as far from the model as its coherence explains" in sentence for sentence in found.warnings)
    assert any("not independent from line to line" in sentence for sentence in found.warnings)


def test_what_cannot_be_compared_is_refused_by_name():
    response = measured(0)
    few = MeasuredResponse(frequency=OMEGA[:8], value=response.value[:8], deviation=response.deviation[:8])
    for wrong, message in (
        (FrequencyExperiment(source="v", responses={"y": response}, sample_time=H), "inputs must be among u, got 'v'"),
        (FrequencyExperiment(source="u", responses={"z": response}, sample_time=H), "outputs must be among y, got 'z'"),
        (experiment(few), "band must hold at least 25 lines, got 8"),
        (experiment(response, values={"w": 3.0}), "either estimated or known"),
        (experiment(response, values={"q": 3.0}), "q"),
    ):
        with pytest.raises(ProblemError, match=message):
            found_by((wrong,))
    with pytest.raises(ProblemError, match="name must be different"):
        found_by((experiment(response, name="a"), experiment(response, name="a")))


def loop(*, sampled: bool) -> Diagram:
    """Return a P controller round a lag, sampled or with a limit beside which the loop is linear."""
    inner = Block(kind="zero_order_hold", values={"sample_time": 0.05}) if sampled else Block(
        kind="saturation", values={"lower": -10.0, "upper": 10.0}
    )  # fmt: skip
    return compile_system(
        System(
            name="loop",
            parameters={"kp": Parameter(value=2.0), "T": Parameter(value=0.3)},
            blocks={
                "r": Block(kind="input"), "e": Block(kind="sum", values={"signs": "+-"}), "inner": inner,
                "p": Block(kind="gain", values={"gain": "=kp"}),
                "plant": Block(kind="transfer_function", values={"numerator": [1.0], "denominator": ["=T", 1.0]}),
            },
            connections=tuple(
                Connection(source=a, target=b)
                for a, b in (("r", "e.in1"), ("plant", "e.in2"), ("e", "inner"), ("inner", "p"), ("p", "plant"))
            ),
            outputs={"y": "plant"},
        )
    )  # fmt: skip


@pytest.mark.parametrize("sampled", [True, False])
def test_loops_with_samplers_and_linear_parts_are_fitted(sampled):
    """Closed forms: K G(jω) (1 - e^(-jωh))/(jωh) / (1 + K G_zoh(e^(jωh))), and K/(1 + K + jωT)."""
    kp, constant, h = 4.0, 0.5, 0.05
    omega = np.linspace(0.5, 50.0, 40)
    s = 1j * omega
    if sampled:
        pole, z = np.exp(-h / constant), np.exp(s * h)
        held = (1 - np.exp(-s * h)) / (s * h)
        value = kp / (1 + kp * (1 - pole) / (z - pole)) * held / (constant * s + 1)
    else:
        value = kp / (1 + kp + constant * s)
    measured_loop = MeasuredResponse(frequency=omega, value=value, deviation=1e-4 * np.abs(value))
    one = FrequencyExperiment(source="r", responses={"y": measured_loop}, sample_time=0.001)
    problem = Identification(
        diagram=loop(sampled=sampled), experiments=(), frequency=(one,),
        parameters=(Variable(parameter="kp"), Variable(parameter="T")),
    )  # fmt: skip
    found = identify(problem, rng=np.random.default_rng(0))
    assert found.parameters["kp"].value == pytest.approx(kp, rel=1e-6)
    assert found.parameters["T"].value == pytest.approx(constant, rel=1e-6)


def test_lines_beyond_the_samplers_of_a_loop_are_refused():
    omega = np.linspace(0.5, 70.0, 40)
    measured_loop = MeasuredResponse(frequency=omega, value=np.ones(40, complex), deviation=np.ones(40))
    one = FrequencyExperiment(source="r", responses={"y": measured_loop}, sample_time=0.001)
    with pytest.raises(ProblemError, match=r"band must end below 62\.8319 rad/s"):
        Identification(
            diagram=loop(sampled=True), experiments=(), frequency=(one,), parameters=(Variable(parameter="kp"),)
        )
