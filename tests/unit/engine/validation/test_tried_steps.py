"""The steps of a diagnosis are simulated, whole ones before parts of them, as long as there is time."""

from __future__ import annotations

from itertools import count

import numpy as np
import pytest

from engine.diagram.diagram import Block, Connection, Parameter, System, compile_system
from engine.recordings.validation.diagnosis import diagnose
from engine.recordings.validation.response import respond, tangents
from engine.recordings.validation.steps import Movable
from engine.recordings.validation.validate import Compared, Validated, validate

H = 0.01
TIME = H * np.arange(400)
U = 3 * np.sin(2 * np.pi * 0.5 * TIME) + np.sin(2 * np.pi * 1.7 * TIME)

# a lag behind a limit
LIMITED = compile_system(
    System(
        name="limited",
        parameters={
            "k": Parameter(value=1.0, lower=0.1, upper=10.0),
            "limit": Parameter(value=2.0, lower=0.1, upper=10.0),
        },
        blocks={
            "u": Block(kind="input"),
            "gain": Block(kind="gain", values={"gain": "=k"}),
            "limit": Block(kind="saturation", values={"upper": "=limit", "lower": "=-limit"}),
            "lag": Block(kind="transfer_function", values={"numerator": [1.0], "denominator": [0.1, 1.0]}),
        },
        connections=tuple(
            Connection(source=a, target=b) for a, b in (("u", "gain"), ("gain", "limit"), ("limit", "lag"))
        ),
        outputs={"y": "lag"},
    )
)


def answer(values):
    return respond(LIMITED, {"u": U}, H, outputs=("y",), overrides=dict(values))


@pytest.fixture(scope="module")
def found() -> Validated:
    """A model whose limit is too low and whose gain is right."""
    compared = Compared(
        measured=answer({"limit": 2.6}), simulated=answer({}), theoretical=None, inputs={"u": U}, sample_time=H,
        offsets={"y": 0.0},
    )  # fmt: skip
    validated = validate(compared, limit_percent=1.0)
    by = tangents(LIMITED, {"u": U}, H, outputs=("y",), overrides={}, parameters=["k", "limit"])
    movable = [Movable(parameter=name, value=LIMITED.parameters[name].value, lower=0.1, upper=10.0, unit="") for name in by["y"]]  # fmt: skip
    return validated.diagnosed(diagnose(validated.comparisons(by), movable))


def test_steps_of_a_nonlinear_model_are_simulated(found) -> None:
    checked = found.checked(answer)
    assert set(checked.checks) == {"k", "limit", "together"}
    assert checked.note == ""
    limit = checked.checks["limit"]
    assert limit.values["limit"] == pytest.approx(2.6, abs=0.15)
    assert found.diagnosis is not None
    assert found.diagnosis.steps is not None
    present = found.diagnosis.steps.present_error_percent
    assert limit.relative_error_percent < 0.3 * present
    # what a simulation with that value has, computed here once more
    y, moved = found.outputs["y"].comparison.measured, answer(limit.values)["y"]
    assert limit.relative_error_percent == pytest.approx(100 * np.linalg.norm(y - moved) / np.linalg.norm(y))


def test_without_time_for_all_the_whole_steps_are_tried_first_and_the_reader_is_told(found) -> None:
    asked = count(1)
    checked = found.checked(answer, go_on=lambda: next(asked) <= 2)
    assert found.diagnosis is not None
    assert found.diagnosis.steps is not None
    alone = found.diagnosis.steps.alone
    assert list(checked.checks) == [step.parameter for step in alone[:2]]
    for step in alone[:2]:
        assert checked.checks[step.parameter].values == {step.parameter: pytest.approx(step.suggested)}
    assert "no time to try all steps" in checked.note
    never = found.checked(answer, go_on=lambda: False)
    assert never.checks == {}
    assert "no time" in never.note
