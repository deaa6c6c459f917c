"""Several experiments, initial states, what nobody can tell: identification beyond one clean recording."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from optimizers.identification import identify
from optimizers.identification.exact import ExactModel
from optimizers.identification.marched import MarchedModel, Structure
from optimizers.problem import ProblemError, Variable
from optimizers.recorded.recording import Identification, RecordedExperiment, Recording
from optimizers.search.result import Status

H = 0.01
TIME = H * np.arange(600)
STEPS = np.repeat(np.random.default_rng(1).choice([-1.0, 1.0], size=30), 20)


def diagram(blocks: dict[str, Block], wires: str, parameters: dict[str, float]) -> Diagram:
    pairs = (wire.split(" -> ") for wire in wires.split(", "))
    return compile_system(
        System(
            name="model",
            parameters={name: Parameter(value=value) for name, value in parameters.items()},
            blocks={"u": Block(kind="input"), **blocks},
            connections=tuple(Connection(source=source, target=target) for source, target in pairs),
            outputs={"y": "plant"},
        )
    )


def oscillator(**parameters: float) -> Diagram:
    values = {"w": 8.0, "d": 0.3, "k": 1.0} | parameters
    plant = Block(kind="transfer_function", values={"numerator": ["=k*w**2"], "denominator": [1.0, "=2*d*w", "=w**2"]})
    return diagram({"plant": plant}, "u -> plant", values)


def swung(w: float, d: float, y0: float, v0: float) -> np.ndarray:
    """Return the free motion of an oscillator: e^(-dwt) (y0 cos rt + (v0 + d w y0)/r sin rt), r = w sqrt(1 - d²)."""
    r = w * np.sqrt(1 - d**2)
    return np.exp(-d * w * TIME) * (y0 * np.cos(r * TIME) + (v0 + d * w * y0) / r * np.sin(r * TIME))


def recorded(y: np.ndarray, u: np.ndarray | None = None) -> Recording:
    return Recording(inputs={"u": np.zeros_like(y) if u is None else u}, outputs={"y": y}, sample_time=H)


def identified(made: Diagram, *experiments: RecordedExperiment, names: tuple[str, ...], **settings):
    variables = tuple(Variable(parameter=name, lower=1e-3, upper=100.0) for name in names)
    problem = Identification(diagram=made, experiments=experiments, parameters=variables, **settings)
    return identify(problem, rng=np.random.default_rng(0))


def test_free_motion_alone_tells_frequency_and_damping():
    y = swung(9.0, 0.1, 0.5, 2.0)
    experiment = RecordedExperiment(recording=recorded(y), split=1.0)
    found = identified(oscillator(), experiment, names=("w", "d"), initial_states=True)
    assert found.status is Status.CONVERGED
    assert found.parameters["w"].value == pytest.approx(9.0, rel=1e-7)
    assert found.parameters["d"].value == pytest.approx(0.1, rel=1e-6)
    assert found.estimation["y"].fit_percent == pytest.approx(100, abs=1e-4)
    assert found.experiments[0].initial_state.shape == (2,)


def test_without_its_initial_state_a_constant_input_is_refused():
    with pytest.raises(ProblemError, match="inputs must vary"):
        identified(oscillator(), RecordedExperiment(recording=recorded(swung(9.0, 0.1, 0.5, 2.0))), names=("w",))


def test_a_delay_does_not_disturb_the_free_motion():
    transport = Block(kind="delay", values={"time": 0.05})
    plant = Block(kind="transfer_function", values={"numerator": [1.0], "denominator": ["=tau", 1.0]})
    made = diagram({"transport": transport, "plant": plant}, "u -> transport, transport -> plant", {"tau": 0.5})
    y = 2.0 * np.exp(-TIME / 0.3)
    experiment = RecordedExperiment(recording=recorded(y), split=1.0)
    found = identified(made, experiment, names=("tau",), initial_states=True)
    assert found.parameters["tau"].value == pytest.approx(0.3, rel=1e-6)


def test_experiments_share_parameters_and_keep_what_is_theirs():
    # gain 2 and 5 are known, each recording has a zero of its own; from rest, u begins at STEPS[0]
    experiments = []
    for number, (gain, zero) in enumerate(((2.0, 0.3), (5.0, -0.2))):
        sol = solve_ivp(
            lambda t, s, k=gain: [s[1], 81 * (k * np.interp(t, TIME, STEPS) - s[0]) - 3.6 * s[1]],
            (0, TIME[-1]), [gain * STEPS[0], 0.0], t_eval=TIME, rtol=1e-9, atol=1e-11, max_step=H / 2,
        )  # fmt: skip
        recording = recorded(sol.y[0] + zero, STEPS)
        experiments.append(
            RecordedExperiment(recording=recording, name=f"run{number}", values={"k": gain}, split=1.0 - number)
        )
    found = identified(oscillator(), *experiments, names=("w", "d"), offsets=True)
    assert found.parameters["w"].value == pytest.approx(9.0, rel=1e-4)
    assert found.parameters["d"].value == pytest.approx(0.2, rel=1e-3)
    assert [one.offsets["y"] for one in found.experiments] == pytest.approx([0.3, -0.2], abs=1e-4)
    assert [bool(one.estimation) for one in found.experiments] == [True, False]
    assert found.validation["y"].fit_percent > 99.99


def test_what_has_no_influence_is_named_and_left_where_it_was():
    unused = Block(kind="gain", values={"gain": "=other"})
    plant = Block(kind="transfer_function", values={"numerator": [1.0], "denominator": ["=tau", 1.0]})
    made = diagram({"plant": plant, "aside": unused}, "u -> plant, u -> aside", {"tau": 0.5, "other": 2.0})
    y = np.interp(TIME, TIME, STEPS) + np.random.default_rng(0).normal(size=TIME.size)
    found = identified(made, RecordedExperiment(recording=recorded(y, STEPS)), names=("tau", "other"))
    assert "other has no influence on what was measured: keep it at a known value" in found.indistinguishable
    assert found.parameters["other"].value == 2.0
    assert found.parameters["other"].lower95 is None


def test_three_factors_of_one_gain_are_said_to_act_alike():
    plant = Block(kind="transfer_function", values={"numerator": ["=a*b*c"], "denominator": [0.1, 1.0]})
    made = diagram({"plant": plant}, "u -> plant", {"a": 1.0, "b": 1.1, "c": 1.2})
    y = STEPS + np.random.default_rng(0).normal(size=TIME.size)
    found = identified(made, RecordedExperiment(recording=recorded(y, STEPS)), names=("a", "b", "c"))
    assert any("a, b and c act in the same way" in sentence for sentence in found.indistinguishable)


def saturated() -> Diagram:
    """τ y' + y = sat(g u), the limit 1: marched with formulas of the instant."""
    limit = Block(kind="saturation", values={"lower": -1.0, "upper": 1.0})
    plant = Block(kind="transfer_function", values={"numerator": [1.0], "denominator": ["=tau", 1.0]})
    gain = Block(kind="gain", values={"gain": "=g"})
    return diagram(
        {"gain": gain, "limit": limit, "plant": plant},
        "u -> gain, gain -> limit, limit -> plant",
        {"tau": 0.3, "g": 1.0},
    )


WAVE = np.sin(5 * TIME)


def test_a_marched_answer_and_its_slopes_are_those_of_the_exact_path():
    made = saturated()
    experiment = RecordedExperiment(recording=recorded(WAVE, WAVE), split=1.0)
    variables = (Variable(parameter="tau", lower=0.01), Variable(parameter="g", lower=0.1))
    problem = Identification(diagram=made, experiments=(experiment,), parameters=variables, initial_states=True)
    structure = Structure(made, problem.unknowns, problem.experiments)
    marched = MarchedModel(structure, experiment, initial=True)
    exact = ExactModel(made, experiment, initial=True)
    values, deviation = {"tau": 0.2, "g": 1.7}, np.array([0.4])
    ours, theirs = marched.answer(values, deviation), exact.answer(values, deviation)
    np.testing.assert_allclose(ours.values, theirs.values, atol=1e-4)
    np.testing.assert_allclose(marched.shown(values, deviation).values, theirs.values, atol=2e-6)
    np.testing.assert_allclose(ours.slopes, theirs.slopes, atol=2e-3 * np.abs(theirs.slopes).max())


def test_a_nonlinear_model_finds_its_initial_state():
    tau, g, y0 = 0.2, 1.7, -0.6
    sol = solve_ivp(
        lambda t, y: (np.clip(g * np.sin(5 * t), -1, 1) - y) / tau, (0, TIME[-1]), [y0], t_eval=TIME,
        rtol=1e-9, atol=1e-11, max_step=H,
    )  # fmt: skip
    experiment = RecordedExperiment(recording=recorded(sol.y[0], WAVE), split=1.0)
    found = identified(saturated(), experiment, names=("tau", "g"), initial_states=True)
    # the recorded sine runs in straight lines between its samples here: 3e-4 of its size
    assert found.parameters["tau"].value == pytest.approx(tau, rel=2e-3)
    assert found.parameters["g"].value == pytest.approx(g, rel=2e-3)
    assert found.estimation["y"].fit_percent > 99.9


def test_a_stiff_model_is_marched_with_shorter_steps_or_not_at_all():
    """A lag of 20 µs behind samples 10 ms apart: steps of one sample would explode, as explicit steps do beyond 2.8 lags."""
    limit = Block(kind="saturation", values={"lower": -1.0, "upper": 1.0})
    fast = Block(kind="transfer_function", values={"numerator": [1.0], "denominator": ["=fast", 1.0]})
    plant = Block(kind="transfer_function", values={"numerator": ["=k"], "denominator": [0.2, 1.0]})
    made = diagram(
        {"limit": limit, "quick": fast, "plant": plant},
        "u -> limit, limit -> quick, quick -> plant",
        {"fast": 2e-5, "k": 1.0},
    )
    sol = solve_ivp(
        lambda t, y: (3 * np.sin(5 * t) - y) / 0.2, (0, TIME[-1]), [0.0], t_eval=TIME, rtol=1e-9, max_step=H
    )
    experiment = RecordedExperiment(recording=recorded(sol.y[0], WAVE), split=1.0)
    found = identified(made, experiment, names=("k",))
    assert found.parameters["k"].value == pytest.approx(3.0, rel=2e-3)
    assert found.estimation["y"].fit_percent > 99.8


def test_an_unstable_start_is_said():
    gain = Block(kind="gain", values={"gain": "=k"})
    loop = Block(kind="sum", values={"signs": "++"})
    made = diagram(
        {"gain": gain, "loop": loop, "plant": Block(kind="integrator")},
        "u -> loop.in1, plant -> gain, gain -> loop.in2, loop -> plant", {"k": 50.0},
    )  # fmt: skip
    found = identified(made, RecordedExperiment(recording=recorded(STEPS, STEPS)), names=("k",))
    assert found.status is Status.STALLED
    assert "stable" in found.advice


@pytest.mark.parametrize(
    ("change", "at", "message"),
    [
        ({"values": {"mass": 1.0}}, ("experiments", 0, "parameters", "mass"), "one of the system's"),
        ({"values": {"w": 1.0}}, ("experiments", 0, "parameters", "w"), "either estimated or known"),
        ({"split": 1.5}, ("experiments", 0, "split"), "<= 1"),
        ({"estimation": (5.0, 1.0)}, ("experiments", 0, "estimation"), "t0 < t1"),
    ],
)
def test_what_is_wrong_with_an_experiment_is_said_at_its_place(change, at, message):
    settings = {"recording": recorded(STEPS, STEPS), "at": ("experiments", 0), **change}
    with pytest.raises(ProblemError) as caught:
        identified(oscillator(), RecordedExperiment(**settings), names=("w",))
    assert caught.value.at == at
    assert message in caught.value.message


def test_names_are_told_apart_and_something_must_estimate():
    one = RecordedExperiment(recording=recorded(STEPS, STEPS), name="a")
    with pytest.raises(ProblemError, match="different for each experiment"):
        identified(oscillator(), one, one, names=("w",))
    idle = RecordedExperiment(recording=recorded(STEPS, STEPS), split=0.0)
    with pytest.raises(ProblemError, match="must have an estimation window"):
        identified(oscillator(), idle, names=("w",))
