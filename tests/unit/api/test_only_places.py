"""Goals that name no experiment, input or output: the only one there is, and a refusal with the names where there are several."""

from __future__ import annotations

from typing import Any

import pytest

from api.convert.optimizations import problem_from_wire
from api.convert.systems import diagram_from_wire
from api.schemas.optimizations import OptimizationRequest
from api.schemas.systems import SystemDocument
from optimizers.problem import Problem, ProblemError

SYSTEM: dict[str, Any] = {
    "parameters": {"k": {"value": 2, "lower": 1, "upper": 3}},
    "blocks": {
        "u": {"kind": "input"},
        "plant": {"kind": "mass_spring_damper", "mass": 1, "stiffness": "=k", "damping": 1},
    },
    "connections": [{"from": "u", "to": "plant"}],
    "outputs": {"y": "plant.position"},
}
STEP = {"name": "step", "input": {"port": "u", "signal": {"kind": "step"}}}


def problem(goal: dict[str, Any], *, experiments: tuple[str, ...] = ("step",), **system: Any) -> Problem:
    document = SYSTEM | system
    request = OptimizationRequest.model_validate(
        {
            "system": document,
            "variables": [{"parameter": "k"}],
            "experiments": [STEP | {"name": name} for name in experiments],
            "goals": [goal],
            "method": {"kind": "grid"},
        }
    )
    diagram = diagram_from_wire(SystemDocument.model_validate(document))
    return problem_from_wire(request, diagram, read_channel=lambda *_: pytest.fail("nothing here is recorded"))


def test_a_time_metric_is_of_the_only_experiment_and_output() -> None:
    (goal,) = problem({"metric": "rise_time", "sense": "minimize"}).goals
    assert (goal.experiment, goal.output, goal.source) == ("step", "y", None)


def test_its_bounds_have_the_unit_of_that_output() -> None:
    (goal,) = problem({"metric": "peak", "sense": "minimize", "upper": {"value": 5, "unit": "mm"}}).goals
    assert goal.upper == pytest.approx(5e-3)


def test_a_path_is_from_the_only_input_to_the_only_output() -> None:
    (goal,) = problem({"metric": "bandwidth", "sense": "maximize"}, experiments=()).goals
    assert (goal.experiment, goal.source, goal.target, goal.output) == (None, "u", "y", None)


def test_what_is_named_stays() -> None:
    outputs = {"y": "plant.position", "v": "plant.velocity"}
    (goal,) = problem({"metric": "bandwidth", "sense": "maximize", "to": "v"}, outputs=outputs).goals
    assert (goal.source, goal.target) == ("u", "v")


def test_the_poles_need_no_place() -> None:
    (goal,) = problem({"metric": "damping_ratio", "sense": "maximize"}).goals
    assert (goal.experiment, goal.output, goal.source, goal.target) == (None,) * 4


@pytest.mark.parametrize(
    ("goal", "more", "key", "message"),
    [
        ("rise_time", {"experiments": ("a", "b")}, "experiment", "experiment must be given for rise_time, one of a, b"),
        ("rise_time", {"experiments": ()}, "experiment", "experiment must be given for rise_time, one of (none)"),
        ("rise_time", {"outputs": {"y": "plant.position", "v": "plant.velocity"}}, "output", "one of y, v"),
        ("bandwidth", {"outputs": {"y": "plant.position", "v": "plant.velocity"}}, "to", "one of y, v"),
        ("gain_margin", {}, "open_at", "open_at must be given for gain_margin, got nothing"),
    ],
)
def test_where_there_are_several_it_must_say_which(goal, more, key, message) -> None:
    with pytest.raises(ProblemError) as caught:
        problem({"metric": goal, "sense": "minimize"}, **more)
    assert caught.value.at == ("goals", 0, key)
    assert message in caught.value.message
