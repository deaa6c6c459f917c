from __future__ import annotations

import numpy as np
import pytest

from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.exact.time.sampled import simulate_sampled
from optimizers.estimation.confidence import correlations, covariance
from optimizers.identification import identify
from optimizers.methods.least_squares import minimize_squares
from optimizers.problem import ProblemError, Variable
from optimizers.recorded.recording import Identification, RecordedExperiment, Recording
from optimizers.search.result import Status

H = 0.002
TIME = H * np.arange(2000)
SWEEP = np.sin(2 * np.pi * (0.5 * TIME + 1.5 * TIME**2))
TRUTH = {"gain": 20.0, "valve.time_constant": 0.01, "transport.time": 0.0123}


def drive(**blocks: Block) -> Diagram:
    """Position loop: error, gain, delay, valve lag, integrator; the parameter ``gain`` is also the loop's gain."""
    return compile_system(
        System(
            name="drive",
            parameters={"gain": Parameter(value=15.0, lower=1.0, upper=100.0), "twice": Parameter(value="=2*gain")},
            blocks={
                "reference": Block(kind="input"),
                "load": Block(kind="input", values={"role": "disturbance"}),
                "error": Block(kind="sum", values={"signs": "+-"}),
                "controller": Block(kind="gain", values={"gain": "=gain"}),
                "transport": Block(kind="delay", values={"time": 0.01}),
                "valve": Block(kind="proportional_valve", values={"flow_gain": 1.0, "time_constant": 0.02}),
                "disturbed": Block(kind="sum", values={"signs": "+-"}),
                "cylinder": Block(kind="integrator"),
                **blocks,
            },
            connections=tuple(
                Connection(source=source, target=target)
                for source, target in (
                    ("reference", "error.in1"),
                    ("cylinder", "error.in2"),
                    ("error", "controller"),
                    ("controller", "transport"),
                    ("transport", "valve"),
                    ("valve", "disturbed.in1"),
                    ("load", "disturbed.in2"),
                    ("disturbed", "cylinder"),
                )
            ),
            outputs={"position": "cylinder", "velocity": "disturbed"},
        )
    )


def measured(diagram: Diagram, truth: dict[str, float], u: np.ndarray = SWEEP, output: str = "position") -> np.ndarray:
    both = np.vstack([u, np.zeros(u.size)])
    return simulate_sampled(diagram.realize(truth), both, H)[diagram.outputs.index(output)]


def made(
    diagram: Diagram, recording: Recording, parameters, *, estimation=None, validation=None, split=0.5, **settings
):
    experiment = RecordedExperiment(recording=recording, estimation=estimation, validation=validation, split=split)
    return Identification(diagram=diagram, experiments=(experiment,), parameters=parameters, **settings)


def problem(y: np.ndarray, *parameters: Variable, diagram: Diagram | None = None, **settings) -> Identification:
    names = parameters or (
        Variable(parameter="gain"),
        Variable(parameter="valve.time_constant", lower=1e-4, upper=0.1),
        Variable(parameter="transport.time", lower=0.001, upper=0.1),
    )
    recording = Recording(inputs={"reference": SWEEP}, outputs={"position": y}, sample_time=H)
    return made(diagram or drive(), recording, names, **settings)


def values(result):
    return {name: estimate.value for name, estimate in result.parameters.items()}


def rng():
    return np.random.default_rng(0)


def test_parameters_and_offset_come_back_from_clean_data():
    result = identify(problem(measured(drive(), TRUTH) + 0.3, offsets=True), rng=rng())
    assert result.status is Status.CONVERGED
    assert values(result) == pytest.approx(TRUTH, rel=1e-6)
    assert result.offsets == {"position": pytest.approx(0.3, rel=1e-6)}
    assert result.estimation["position"].fit_percent == pytest.approx(100, abs=1e-4)
    assert result.validation["position"].fit_percent == pytest.approx(100, abs=1e-4)
    assert result.baselines["mean"]["position"].fit_percent == pytest.approx(0, abs=1e-9)
    assert result.baselines["input"]["position"].fit_percent < 50


def test_an_offset_that_is_not_asked_for_spoils_the_estimates():
    result = identify(problem(measured(drive(), TRUTH) + 0.3), rng=rng())
    assert result.offsets == {}
    assert result.validation["position"].fit_percent < 80


def test_noise_widens_the_intervals_and_they_hold_the_truth():
    clean = measured(drive(), TRUTH)
    inside = 0
    widths = []
    for seed in range(10):
        noise = np.random.default_rng(seed).normal(scale=0.02, size=clean.size)
        result = identify(problem(clean + noise, Variable(parameter="gain"), Variable(parameter="transport.time", lower=0.001, upper=0.1),
                                  diagram=drive(valve=Block(kind="proportional_valve", values={"flow_gain": 1.0, "time_constant": 0.01}))), rng=rng())  # fmt: skip
        for name, estimate in result.parameters.items():
            inside += estimate.lower95 <= TRUTH[name] <= estimate.upper95
        widths.append(result.parameters["gain"].upper95 - result.parameters["gain"].lower95)
    # 20 intervals of 95 %: fewer than 15 inside has a probability of 3e-4
    assert inside >= 15
    assert max(widths) < 0.5


def test_the_windows_say_where_the_errors_count():
    y = measured(drive(), TRUTH)
    y[1000:] += 0.5 * np.sin(40 * TIME[1000:])
    result = identify(problem(y, estimation=(0.0, 1.9), validation=(2.0, 3.998)), rng=rng())
    assert values(result) == pytest.approx(TRUTH, rel=1e-6)
    assert result.validation["position"].fit_percent < 50


def test_default_windows_split_the_recording():
    y = measured(drive(), TRUTH)
    assert problem(y).experiments[0].windows == (
        (0.0, pytest.approx(1.999)),
        (pytest.approx(1.999), pytest.approx(3.998)),
    )
    assert problem(y, split=1.0).experiments[0].windows[1] is None
    assert problem(y, estimation=(3.0, 3.9)).experiments[0].windows[1] == (0.0, 3.0)


def test_without_a_validation_part_the_baselines_belong_to_the_estimation():
    result = identify(problem(measured(drive(), TRUTH), split=1.0), rng=rng())
    assert result.validation == {}
    assert set(result.baselines) == {"mean", "input", "static_gain"}


def test_two_factors_of_one_product_are_said_to_be_indistinguishable():
    result = identify(
        problem(
            measured(drive(), TRUTH) + np.random.default_rng(1).normal(scale=0.01, size=TIME.size),
            Variable(parameter="gain"),
            Variable(parameter="valve.flow_gain", lower=0.1, upper=10.0),
        ),
        rng=rng(),
    )
    assert abs(result.correlations[0, 1]) > 0.999
    assert any("gain and valve.flow_gain act in the same way" in sentence for sentence in result.indistinguishable)
    gain = result.parameters["gain"]
    assert (gain.lower95, gain.upper95) == (1.0, 100.0)
    assert any(sentence.startswith("gain is not determined within its bounds") for sentence in result.indistinguishable)


def test_lag_and_delay_under_a_slow_input_are_known_by_their_sum():
    slow = np.sin(4 * TIME)
    y = measured(drive(), TRUTH, slow) + np.random.default_rng(1).normal(scale=0.002, size=TIME.size)
    recording = Recording(inputs={"reference": slow}, outputs={"position": y}, sample_time=H)
    unknown = (
        Variable(parameter="valve.time_constant", lower=1e-3, upper=0.1),
        Variable(parameter="transport.time", lower=0.001, upper=0.1),
    )
    known_gain = drive(controller=Block(kind="gain", values={"gain": 20.0}))
    result = identify(made(known_gain, recording, unknown, split=1.0), rng=rng())
    sentence = next(s for s in result.indistinguishable if "hard to tell apart" in s)
    assert "valve.time_constant and transport.time" in sentence
    # the truth: 0.0100 + 0.0123 s
    assert float(sentence.split("their sum ")[1].split()[0]) == pytest.approx(0.0223, rel=0.02)


def test_a_parameter_at_its_bound_is_said_to_want_more_room():
    variables = (
        Variable(parameter="gain", lower=1.0, upper=18.0, start=10.0),
        Variable(parameter="transport.time", lower=0.001, upper=0.1),
    )
    result = identify(problem(measured(drive(), TRUTH), *variables), rng=rng())
    assert result.parameters["gain"].value == 18.0
    assert "gain came to rest at its upper bound 18" in result.advice


def test_a_delay_that_is_not_there_is_found_to_be_none():
    instant = drive(transport=Block(kind="delay", values={"time": 0.0}))
    y = measured(instant, {"gain": 20.0, "valve.time_constant": 0.01})
    unknown = (
        Variable(parameter="gain"),
        Variable(parameter="valve.time_constant", lower=1e-4, upper=0.1),
        Variable(parameter="transport.time", lower=0.0, upper=0.1),
    )
    result = identify(problem(y, *unknown), rng=rng())
    assert values(result) == pytest.approx({"gain": 20.0, "valve.time_constant": 0.01, "transport.time": 0.0}, rel=1e-5)
    assert "transport.time came to rest at 0" in result.advice
    assert any("transport.time cannot be told from 0" in sentence for sentence in result.indistinguishable)


def test_a_logarithmic_search_keeps_its_interval_positive():
    noise = np.random.default_rng(1).normal(scale=0.5, size=TIME.size)
    variable = Variable(parameter="valve.time_constant", lower=1e-6, upper=10.0, scale="log")
    result = identify(problem(measured(drive(), TRUTH) + noise, variable), rng=rng())
    estimate = result.parameters["valve.time_constant"]
    assert 0 < estimate.lower95 < estimate.value < estimate.upper95
    assert estimate.value**2 == pytest.approx(estimate.lower95 * estimate.upper95, rel=1e-9)


def test_several_outputs_count_alike_whatever_their_units():
    diagram = drive()
    outputs = {name: measured(diagram, TRUTH, output=name) for name in ("position", "velocity")}
    recording = Recording(inputs={"reference": SWEEP}, outputs=outputs, sample_time=H)
    unknown = (
        Variable(parameter="gain"),
        Variable(parameter="valve.time_constant", lower=1e-4, upper=0.1),
        Variable(parameter="transport.time", lower=0.001, upper=0.1),
    )
    result = identify(made(diagram, recording, unknown), rng=rng())
    assert values(result) == pytest.approx(TRUTH, rel=1e-6)
    assert set(result.validation) == {"position", "velocity"}


def test_more_starts_find_a_better_minimum():
    # a sine of 2 Hz cannot tell a delay from one period more, but the settling at its start can
    tone = np.where(TIME > 0.1, np.sin(4 * np.pi * (TIME - 0.1)), 0.0)
    diagram = compile_system(
        System(
            name="delay",
            parameters={},
            blocks={"u": Block(kind="input"), "transport": Block(kind="delay", values={"time": 0.7})},
            connections=(Connection(source="u", target="transport"),),
            outputs={"position": "transport"},
        )
    )
    recording = Recording(
        inputs={"u": tone},
        outputs={"position": simulate_sampled(diagram.realize({"transport.time": 0.2}), tone[None], H)[0]},
        sample_time=H,
    )
    unknown = (Variable(parameter="transport.time", lower=0.01, upper=1.2),)
    one = identify(made(diagram, recording, unknown, split=1.0), rng=rng())
    many = identify(made(diagram, recording, unknown, split=1.0, starts=6), rng=rng())
    assert one.parameters["transport.time"].value == pytest.approx(0.7, abs=0.1)
    assert many.parameters["transport.time"].value == pytest.approx(0.2, rel=1e-6)
    assert many.evaluations > one.evaluations


def test_a_model_without_a_bounded_response_is_a_status_and_an_advice():
    stubborn = drive(transport=Block(kind="delay", values={"time": 0.5}))
    result = identify(
        problem(
            measured(drive(), TRUTH), Variable(parameter="gain", lower=50.0, upper=100.0, start=80.0), diagram=stubborn
        ),
        rng=rng(),
    )
    assert result.status is Status.STALLED
    assert "stable" in result.advice
    assert result.parameters["gain"].value == 80.0
    assert result.parameters["gain"].lower95 is None
    assert (result.estimation, result.residuals) == ({}, {})


def test_a_search_cut_short_says_so():
    result = identify(problem(measured(drive(), TRUTH), max_evaluations=2), rng=rng())
    assert result.status is Status.BUDGET
    assert "narrow the bounds" in result.advice


class Impatient:
    """A monitor that cancels after some evaluations and keeps what it is told."""

    def __init__(self, patience: int) -> None:
        self.patience = patience
        self.fractions: list[float] = []
        self.costs: list[float] = []

    def progress(self, fraction, message):
        self.fractions.append(fraction)

    def best(self, evaluation, objective, violation, variables):
        self.costs.append(objective)

    def cancelled(self):
        return len(self.fractions) >= self.patience


def test_a_cancelled_search_returns_the_best_so_far():
    monitor = Impatient(3)
    result = identify(problem(measured(drive(), TRUTH)), rng=rng(), monitor=monitor)
    assert result.status is Status.CANCELLED
    assert result.evaluations == 3
    assert monitor.fractions == sorted(monitor.fractions)
    assert monitor.costs == sorted(monitor.costs, reverse=True)
    assert result.estimation["position"].fit_percent is not None


def test_a_search_cancelled_before_its_first_evaluation_has_nothing_to_return():
    result = identify(problem(measured(drive(), TRUTH)), rng=rng(), monitor=Impatient(0))
    assert result.status is Status.CANCELLED
    assert values(result) == {"gain": 15.0, "valve.time_constant": 0.02, "transport.time": 0.01}


Y = measured(drive(), TRUTH)


@pytest.mark.parametrize(
    ("change", "at", "message"),
    [
        ({"parameters": ()}, ("parameters",), "at least one"),
        ({"parameters": (Variable(parameter="mass"),)}, ("parameters", 0, "parameter"), "got 'mass'"),
        ({"parameters": (Variable(parameter="twice"),)}, ("parameters", 0, "parameter"), "expression"),
        ({"parameters": (Variable(parameter="gain"),) * 2}, ("parameters", 1), "named once"),
        ({"parameters": (Variable(parameter="gain", lower=5.0, upper=5.0),)}, ("parameters", 0, "upper"), "> lower 5"),
        ({"parameters": (Variable(parameter="gain", start=200.0),)}, ("parameters", 0, "start"), "got 200"),
        ({"parameters": (Variable(parameter="gain", scale="cubic"),)}, ("parameters", 0, "scale"), "linear or log"),
        (
            {"parameters": (Variable(parameter="transport.time", upper=1.0, scale="log"),)},
            ("parameters", 0, "lower"),
            "> 0 s",
        ),
        ({"split": -0.1}, ("split",), ">= 0 and <= 1"),
        ({"starts": 0}, ("starts",), ">= 1"),
        ({"estimation": (2.0, 1.0)}, ("estimation",), "t0 < t1"),
        ({"validation": (0.0, 9.0)}, ("validation",), "<= 3.998 s"),
        ({"estimation": (0.0, 0.01)}, ("estimation",), "at least 20 samples, got 6"),
        (
            {"recording": Recording(inputs={"force": SWEEP}, outputs={"position": Y}, sample_time=H)},
            ("inputs", "force"),
            "reference, load",
        ),
        (
            {"recording": Recording(inputs={"reference": SWEEP}, outputs={"force": Y}, sample_time=H)},
            ("outputs", "force"),
            "position, velocity",
        ),
        ({"recording": Recording(inputs={}, outputs={"position": Y}, sample_time=H)}, ("inputs",), "at least one"),
        (
            {"recording": Recording(inputs={"reference": SWEEP[1:]}, outputs={"position": Y}, sample_time=H)},
            ("inputs", "reference"),
            "2000 samples",
        ),
        (
            {"recording": Recording(inputs={"reference": SWEEP}, outputs={"position": Y * np.nan}, sample_time=H)},
            ("outputs", "position"),
            "finite",
        ),
        (
            {"recording": Recording(inputs={"reference": SWEEP}, outputs={"position": 0 * Y}, sample_time=H)},
            ("outputs", "position"),
            "must vary",
        ),
        (
            {"recording": Recording(inputs={"reference": SWEEP}, outputs={"position": Y}, sample_time=0.0)},
            ("dataset",),
            "> 0 s",
        ),
    ],
)
def test_what_cannot_be_identified_is_refused_with_its_place(change, at, message):
    recording = Recording(inputs={"reference": SWEEP}, outputs={"position": Y}, sample_time=H)
    settings = {"diagram": drive(), "recording": recording, "parameters": (Variable(parameter="gain"),), **change}
    with pytest.raises(ProblemError) as caught:
        made(**settings)
    assert caught.value.at == at
    assert message in caught.value.message


def test_covariance_of_a_mean_in_coloured_noise_follows_theory():
    # AR(1) with φ = 0.9: var of the mean of n samples = σ²/n (1 + φ)/(1 - φ) = 19 times the white value, σ² = 1/(1 - φ²)
    phi, n = 0.9, 20_000
    found = []
    for seed in range(8):
        white = np.random.default_rng(seed).normal(size=n)
        noise = np.zeros(n)
        for t in range(1, n):
            noise[t] = phi * noise[t - 1] + white[t]
        found.append(float(covariance(np.ones((1, n, 1)), noise[None])[0, 0]))
    assert np.mean(found) == pytest.approx(1 / (1 - phi**2) / n * 19, rel=0.15)


def test_covariance_in_white_noise_is_the_textbook_one():
    rng = np.random.default_rng(5)
    jacobian = rng.normal(size=(1, 5000, 2)) @ np.array([[1.0, 0.8], [0.0, 0.6]])
    residuals = rng.normal(scale=3.0, size=(1, 5000))
    textbook = 9 * np.linalg.inv(jacobian[0].T @ jacobian[0])
    assert covariance(jacobian, residuals) == pytest.approx(textbook, rel=0.25)
    assert correlations(covariance(jacobian, residuals))[0, 1] == pytest.approx(-0.8, abs=0.05)


def test_a_direction_without_effect_has_an_enormous_variance():
    jacobian = np.ones((1, 100, 2))
    cov = covariance(jacobian, np.random.default_rng(6).normal(size=(1, 100)))
    assert cov[0, 0] > 1e6
    assert correlations(cov)[0, 1] == pytest.approx(-1)


def test_least_squares_finds_the_best_of_several_valleys_and_keeps_to_the_bounds():
    def valleys(x):
        return np.array([x[0] ** 2 - 4, 0.1 * (x[0] - 2)]), np.array([[2 * x[0]], [0.1]])

    bounds = {"lower": np.array([-5.0]), "upper": np.array([5.0])}
    left = minimize_squares(valleys, np.array([[-3.0]]), **bounds)
    best = minimize_squares(valleys, np.array([[-3.0], [1.0]]), **bounds)
    assert left.x[0] == pytest.approx(-2, abs=0.05)
    assert best.x[0] == pytest.approx(2, abs=1e-6)
    held = minimize_squares(valleys, np.array([[0.5]]), lower=np.array([0.0]), upper=np.array([1.0]))
    assert held.x[0] == 1.0


def test_least_squares_passes_over_starts_where_nothing_exists():
    def half(x):
        ok = x[0] > 0
        return np.array([np.log(x[0]) if ok else np.inf]), np.array([[1 / x[0] if ok else 0.0]])

    bounds = {"lower": np.array([-5.0]), "upper": np.array([5.0])}
    assert minimize_squares(half, np.array([[-1.0]]), **bounds) is None
    found = minimize_squares(half, np.array([[-1.0], [3.0]]), **bounds)
    assert found.x[0] == pytest.approx(1, abs=1e-6)
