"""Models with samplers under recorded inputs: as fast as held inputs, and as the path of nonlinear systems answers."""

from __future__ import annotations

import numpy as np
import pytest

from engine.diagram.diagram import Diagram, compile_system
from engine.exact.nonlinear.recorded import simulate_recorded
from engine.exact.sampled_data import recorded
from engine.model.between_samples import BetweenSamples
from engine.model.tangent import INFINITESIMAL
from engine.recordings.validation.response import respond, tangents
from optimizers.identification.exact import ExactModel
from optimizers.identification.linear import LinearModel
from optimizers.recorded.recording import RecordedExperiment, Recording
from tests.unit.engine.diagrams import block, document

H = 0.02
U = np.random.default_rng(5).normal(size=14)
OUTPUTS = ("y", "e", "c")


def experiment(way: BetweenSamples, values: np.ndarray = U, outputs: tuple[str, ...] = OUTPUTS) -> RecordedExperiment:
    given = dict.fromkeys(outputs, 0 * values)
    return RecordedExperiment(
        recording=Recording(inputs={"u": values}, outputs=given, sample_time=H, between_samples={"u": way}), split=1.0
    )


def looped(**sampling: float) -> Diagram:
    blocks = {
        "u": block("input"), "e": block("sum", signs="+-"), "c": block("sampled_pid", kp=1.5, ki=2.0, **sampling),
        "p": block("transfer_function", numerator=["=w"], denominator=[1.0, "=w"]),
    }  # fmt: skip
    return compile_system(
        document(blocks, ["u -> e.in1", "p -> e.in2", "e -> c", "c -> p"], {"y": "p", "e": "e", "c": "c"}, w=8.0)
    )


def test_a_hold_in_the_model_is_a_held_input() -> None:
    def motor(*, hold: bool) -> Diagram:
        blocks = {"u": block("input"), "p": block("transfer_function", numerator=["=w*w"], denominator=[1.0, "=0.6*w", "=w*w"])}  # fmt: skip
        wires = ["u -> p"]
        if hold:
            blocks["h"], wires = block("zero_order_hold", sample_time=H), ["u -> h", "h -> p"]
        return compile_system(document(blocks, wires, {"y": "p"}, w=12.0))

    values = np.random.default_rng(1).normal(size=4000)
    given = experiment(BetweenSamples.HOLD, values, ("y",))
    expected = LinearModel(motor(hold=False), given, initial=False).answer({"w": 12.0}, np.zeros(0))
    for way in (BetweenSamples.HOLD, BetweenSamples.LINEAR):
        found = ExactModel(motor(hold=True), experiment(way, values, ("y",)), initial=False)
        answer = found.answer({"w": 12.0}, np.zeros(0))
        assert answer.values == pytest.approx(expected.values, abs=1e-10)
        assert answer.slopes == pytest.approx(expected.slopes, abs=1e-10)


@pytest.mark.parametrize("way", BetweenSamples)
@pytest.mark.parametrize(
    "sampling",
    [
        {"sample_time": 0.05}, {"sample_time": 0.05, "delay": 0.013}, {"sample_time": 0.03, "offset": 0.01},
        {"sample_time": 0.03, "offset": 0.011, "delay": 0.025},
    ],
)  # fmt: skip
def test_the_answer_is_that_of_event_by_event(way: BetweenSamples, sampling: dict[str, float]) -> None:
    made, values = looped(**sampling), {"w": 8.0, "c.kp": 1.5}
    laws = made.laws(values, dict.fromkeys(values, INFINITESIMAL))
    expected, slopes = simulate_recorded(laws, U[None], H, outputs=OUTPUTS, between=way)
    found = recorded.simulate_recorded(laws, U[None], H, outputs=OUTPUTS, deviation=None, between=way)
    assert found is not None
    assert found[0] == pytest.approx(expected, abs=1e-12)
    assert found[1] == pytest.approx(slopes, abs=1e-11)


def test_a_state_at_the_beginning_counts() -> None:
    made = looped(sample_time=0.05, delay=0.013)
    laws = made.laws()
    deviation = np.random.default_rng(2).normal(size=(1, laws.states))
    ways = {"outputs": OUTPUTS, "deviation": deviation, "between": BetweenSamples.HOLD}
    expected, _ = simulate_recorded(laws, U[None], H, **ways)
    found = recorded.simulate_recorded(laws, U[None], H, **ways)
    assert found is not None
    assert found[0] == pytest.approx(expected, abs=1e-12)


def test_slopes_by_a_sample_time_are_those_of_a_smooth_input() -> None:
    """Samplers at 50 ms beside records of 20 ms: every second sample falls on a record."""
    made, given = looped(sample_time=0.05), experiment(BetweenSamples.BAND_LIMITED)
    model, step = ExactModel(made, given, initial=False), 1e-7
    slopes = model.answer({"c.sample_time": 0.05}, np.zeros(0)).slopes[0]
    sides = [model.shown({"c.sample_time": 0.05 + sign * step}, np.zeros(0)).values for sign in (1, -1)]
    differences = (sides[0] - sides[1]) / (2 * step)
    apart = np.arange(len(U)) % 5 > 0  # where both fall together the outputs jump or bend with the sign of the step
    assert slopes[:, apart] == pytest.approx(differences[:, apart], rel=1e-5, abs=1e-4)


def test_a_validation_answers_as_the_identification_does() -> None:
    made, way = looped(sample_time=0.05, delay=0.013), BetweenSamples.HOLD
    asked = {"outputs": OUTPUTS, "overrides": {"w": 8.0}, "between": way}
    expected = ExactModel(made, experiment(way), initial=False).answer({"w": 8.0}, np.zeros(0))
    values = respond(made, {"u": U}, H, **asked)
    slopes = tangents(made, {"u": U}, H, parameters=["w"], **asked)
    for row, name in enumerate(OUTPUTS):
        assert values[name] == pytest.approx(expected.values[row], abs=1e-13)
        assert slopes[name]["w"] == pytest.approx(expected.slopes[0, row], abs=1e-13)
