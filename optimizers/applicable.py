"""Whether scenarios and metrics exist at all, asked before anything is computed."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

from engine.diagram import Block, Connection, Diagram, System, compile_system
from engine.errors import EngineError, IllPosedError, Path
from engine.metrics import catalogue as metric_catalogue
from engine.study import measure
from engine.verdicts import Verdict
from optimizers.problem import Problem, ProblemError


def check_applicable(problem: Problem) -> None:
    """Refuse scenarios that the system refuses, and goals whose metric does not exist under their experiment.

    Raises
    ------
    ProblemError
        With the scenario or range and what is wrong with it, or the goal and what it needs.
    """
    start = {path: v for path, v in problem.values(problem.start()).items() if path not in problem.commands}
    for index, scenario in enumerate(problem.scenarios):
        _check_exists(problem, {**start, **scenario}, ("scenarios", index))
    for index, axis in enumerate(problem.ranges):
        for key, end in (("lower", axis.lower), ("upper", axis.upper)):
            _check_exists(problem, {**start, axis.parameter: end}, ("uncertain", index, key))
    catalogue = metric_catalogue()
    for g, goal in enumerate(problem.goals):
        request = problem.requests[g]
        if catalogue[goal.metric].domain != "time":
            continue
        ((one, _),) = measure(_lag(problem.diagram, request.signals), [replace(request, output="y")])
        if one.verdict is Verdict.NOT_APPLICABLE:
            raise ProblemError(
                f"metric must be one that exists under experiment {goal.experiment!r}, got {goal.metric}: {one.advice}",
                at=("goals", g, "metric"),
            )


def _lag(diagram: Diagram, ports: Collection[str]) -> Diagram:
    """Return a lag behind the ports of a command: whether a metric exists there depends on nothing but the command."""
    inputs = {port: Block(kind="input", values={"role": diagram.input_roles[port]}) for port in ports}
    blocks = {
        **inputs,
        "all_of_them": Block(kind="sum", values={"signs": "+" * len(inputs)}),
        "lag_behind": Block(kind="transfer_function", values={"numerator": [1.0], "denominator": [1.0, 1.0]}),
    }
    wires = [(port, f"all_of_them.in{number}") for number, port in enumerate(ports, start=1)]
    connections = (*wires, ("all_of_them", "lag_behind"))
    return compile_system(
        System(
            blocks=blocks,
            connections=tuple(Connection(source=source, target=target) for source, target in connections),
            outputs={"y": "lag_behind"},
        )
    )


def _check_exists(problem: Problem, overrides: Mapping[str, float], at: Path) -> None:
    try:
        problem.diagram.realize(overrides)
    except IllPosedError:  # at the start only, maybe
        return
    except EngineError as error:
        raise ProblemError(error.message, at=at) from error
