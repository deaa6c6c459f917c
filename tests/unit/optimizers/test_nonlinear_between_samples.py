"""Nonlinear models under held, linear and band-limited inputs, beside scipy's integration from sample to sample."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline

from engine.batch.nonlinear.march import Marcher
from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.model.between_samples import BetweenSamples
from engine.model.traced import UnsuitableError
from optimizers.identification import identify, search
from optimizers.identification.exact import ExactModel
from optimizers.identification.marched import MarchedModel, Structure
from optimizers.problem import Variable
from optimizers.recorded.recording import Identification, RecordedExperiment, Recording
from optimizers.search.result import Status, Unwatched

H, SAMPLES = 0.02, 120
U = np.random.default_rng(8).normal(size=SAMPLES)
T = H * np.arange(SAMPLES)


def motor(rate: float = 15.0) -> Diagram:
    """x' = rate (sat(u) - x), and beside x what the limit lets through at once."""
    return compile_system(
        System(
            name="limited",
            parameters={"rate": Parameter(value=rate, lower=0.0)},
            blocks={
                "u": Block(kind="input"),
                "limit": Block(kind="saturation", values={"lower": -0.8, "upper": 1.1}),
                "lag": Block(kind="transfer_function", values={"numerator": ["=rate"], "denominator": [1.0, "=rate"]}),
            },
            connections=(Connection(source="u", target="limit"), Connection(source="limit", target="lag")),
            outputs={"x": "lag", "f": "limit"},
        )
    )


def answered(way: BetweenSamples, *, rate: float = 15.0) -> np.ndarray:
    spline = make_interp_spline(T, U, k=5)
    of = {
        BetweenSamples.HOLD: lambda k: lambda t: U[k],
        BetweenSamples.LINEAR: lambda k: lambda t: U[k] + (U[k + 1] - U[k]) * (t - T[k]) / H,
        BetweenSamples.BAND_LIMITED: lambda k: spline,
    }[way]
    x = [float(np.clip(U[0], -0.8, 1.1))]
    for k in range(SAMPLES - 1):
        u = of(k)
        found = solve_ivp(
            lambda t, x, u=u: rate * (np.clip(u(t), -0.8, 1.1) - x), (T[k], T[k + 1]), [x[-1]],
            rtol=1e-10, atol=1e-12, max_step=H / 20,
        )  # fmt: skip
        x.append(found.y[0, -1])
    return np.array([x, np.clip(U, -0.8, 1.1)])


def experiment(way: BetweenSamples, **outputs: np.ndarray) -> RecordedExperiment:
    recording = Recording(
        inputs={"u": U}, outputs=outputs or {"x": 0 * U, "f": 0 * U}, sample_time=H, between_samples={"u": way}
    )
    return RecordedExperiment(recording=recording, split=1.0)


@pytest.mark.parametrize("way", BetweenSamples)
def test_the_exact_path_and_the_march_answer_as_scipy_does(way: BetweenSamples) -> None:
    expected, made, one = answered(way), motor(), experiment(way)
    exact = ExactModel(made, one, initial=False).shown({}, np.zeros(0)).values
    assert exact == pytest.approx(expected, abs=1e-8)
    marched = MarchedModel(Structure(made, [], [one]), one, initial=False).shown({}, np.zeros(0)).values
    assert marched == pytest.approx(expected, abs=3e-6)


def test_interpreted_and_generated_marches_see_the_same_jumps(monkeypatch: pytest.MonkeyPatch) -> None:
    made, one = motor(), experiment(BetweenSamples.HOLD)
    answers = []
    for generate in (True, False):
        structure = Structure(made, [], [one])
        structure.compiled = {
            outputs: (program, Marcher(program, generate=generate).prepared())
            for outputs, (program, _) in structure.compiled.items()
        }
        answers.append(MarchedModel(structure, one, initial=False).shown({}, np.zeros(0)).values)
    assert answers[0] == pytest.approx(answers[1], rel=1e-12, abs=1e-14)


def test_the_way_of_a_nonlinear_model_is_found() -> None:
    x = answered(BetweenSamples.HOLD)[0] + 0.01 * np.random.default_rng(3).normal(size=SAMPLES)
    recording = Recording(inputs={"u": U}, outputs={"x": x}, sample_time=H, undecided=("u",))
    problem = Identification(
        diagram=motor(10.0), experiments=(RecordedExperiment(recording=recording, split=1.0),),
        parameters=(Variable(parameter="rate"), Variable(parameter="limit.upper", start=0.9)),
    )  # fmt: skip
    found = identify(problem, rng=np.random.default_rng(0))
    assert found.between_samples is BetweenSamples.HOLD
    for name, truth in (("rate", 15.0), ("limit.upper", 1.1)):
        estimate = found.parameters[name]
        assert estimate.lower95 <= truth <= estimate.upper95


class Impatient(Unwatched):
    """Cancels after so many questions."""

    def __init__(self, patience: int) -> None:
        self.patience = patience

    def cancelled(self) -> bool:
        self.patience -= 1
        return self.patience < 0


def test_a_cancel_is_heard_within_one_response(monkeypatch: pytest.MonkeyPatch) -> None:
    """On the exact path, whose responses may take minutes; what was found before is shown in full."""

    def refused(*_: object) -> None:
        raise UnsuitableError

    monkeypatch.setattr(search, "Structure", refused)
    x = answered(BetweenSamples.HOLD)[0]
    recording = Recording(inputs={"u": U}, outputs={"x": x}, sample_time=H, between_samples={"u": BetweenSamples.HOLD})
    problem = Identification(
        diagram=motor(10.0), experiments=(RecordedExperiment(recording=recording, split=1.0),),
        parameters=(Variable(parameter="rate"),),
    )  # fmt: skip
    begun = identify(problem, rng=np.random.default_rng(0), monitor=Impatient(20))
    assert (begun.status, begun.evaluations) == (Status.CANCELLED, 1)
    later = identify(problem, rng=np.random.default_rng(0), monitor=Impatient(500))
    assert later.status is Status.CANCELLED
    assert 1 < later.evaluations < 100
    assert set(later.estimation) == {"x"}
