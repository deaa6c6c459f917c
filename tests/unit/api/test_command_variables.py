"""Numbers of commands on the wire: variables of an optimisation, with their units and places of what is wrong."""

from __future__ import annotations

from typing import Any

import pytest

from api.convert.optimizations import problem_from_wire
from api.convert.systems import diagram_from_wire
from api.problems.documents import Problem
from api.schemas.optimizations import OptimizationRequest
from api.schemas.systems import SystemDocument
from optimizers.problem import Problem as Optimization
from optimizers.problem import ProblemError

SYSTEM = {
    "blocks": {"u": {"kind": "input"}, "lag": {"kind": "transfer_function", "numerator": [1], "denominator": [0.1, 1]}},
    "connections": [{"from": "u", "to": "lag"}],
    "outputs": {"y": "lag"},
}
COMMAND = {"kind": "programmed_delay", "delay": 0.1, "command": {"kind": "step"}}


def problem(**variable: Any) -> Optimization:
    request = OptimizationRequest.model_validate(
        {
            "system": SYSTEM,
            "variables": [variable],
            "experiments": [{"name": "move", "input": {"port": "u", "signal": COMMAND}}],
            "goals": [{"metric": "settling_time", "experiment": "move", "output": "y", "sense": "minimize"}],
            "method": {"kind": "grid"},
        }
    )

    def read_channel(*_: Any) -> Any:
        raise AssertionError("no command here is recorded")

    diagram = diagram_from_wire(SystemDocument.model_validate(SYSTEM))
    return problem_from_wire(request, diagram, read_channel=read_channel)


def test_bounds_are_read_in_the_unit_of_the_number() -> None:
    found = problem(
        parameter="signals.move.u.delay", lower={"value": 50, "unit": "ms"}, upper={"value": 0.2, "unit": "s"}
    )
    (axis,) = found.axes
    assert (axis.lower, axis.upper, axis.start, axis.unit) == (0.05, 0.2, 0.1, "s")
    assert found.before == {"signals.move.u.delay": 0.1}


def test_an_inner_command_has_numbers_too() -> None:
    (axis,) = problem(parameter="signals.move.u.command.amplitude", lower=0.5, upper=2).axes
    assert axis.start == 1.0


@pytest.mark.parametrize(
    ("variable", "at", "message"),
    [
        ({"parameter": "signals.move.u.delay", "lower": {"value": 1, "unit": "m"}}, ("variables", 0, "lower"), "s"),
        ({"parameter": "signals.move.u.height", "lower": 0, "upper": 1}, ("variables", 0, "parameter"), "must be one of"),
        ({"parameter": "signals.turn.u.delay", "lower": 0, "upper": 1}, ("variables", 0, "parameter"), "begin with one of"),
        ({"parameter": "signals.move.u.delay", "lower": -1, "upper": 1}, ("variables", 0, "lower"), "must be >= 0 s"),
    ],
)  # fmt: skip
def test_refuses_at_its_place(variable, at, message) -> None:
    with pytest.raises((Problem, ProblemError), match=message) as caught:
        problem(**variable)
    error = caught.value
    assert (error.at if isinstance(error, ProblemError) else error.faults[0].place) == at
