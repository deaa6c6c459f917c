"""Problems whose goals are functions of the variables as they are written: gains of outputs behind a lag, read as peaks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.signals import make
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable

STEP = Experiment(name="step", signals={"u": make("step", {})})


def gains(functions: Mapping[str, str], ranges: Mapping[str, tuple[float, float]]) -> Diagram:
    """Return a system whose output ``name`` settles at the function of that name."""
    return compile_system(
        System(
            parameters={
                name: Parameter(value=0.9 * upper + 0.1 * lower, lower=lower, upper=upper)
                for name, (lower, upper) in ranges.items()
            },
            blocks={
                "u": Block(kind="input"),
                "lag": Block(kind="transfer_function", values={"numerator": [1.0], "denominator": [1.0, 1.0]}),
                **{name: Block(kind="gain", values={"gain": f"={text}"}) for name, text in functions.items()},
            },
            connections=(
                Connection(source="u", target="lag"),
                *(Connection(source="lag", target=name) for name in functions),
            ),
            outputs={name: name for name in functions},
        )
    )


def landscape(
    functions: Mapping[str, str],
    ranges: Mapping[str, tuple[float, float]],
    *,
    minimise: Sequence[str],
    limits: Mapping[str, float] | None = None,
    **variables: Any,
) -> Problem:
    """Return the problem of minimising some functions (> 0) while others stay below their limits."""
    goals = [Goal(metric="peak", experiment="step", output=name, sense=Sense.MINIMIZE) for name in minimise]
    goals += [
        Goal(metric="peak", experiment="step", output=name, upper=limit) for name, limit in (limits or {}).items()
    ]
    return Problem(
        diagram=gains(functions, ranges),
        variables=tuple(Variable(parameter=name, **variables.get(name, {})) for name in ranges),
        experiments=(STEP,),
        goals=tuple(goals),
    )
