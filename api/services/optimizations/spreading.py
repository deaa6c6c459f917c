"""Optimisations on all workers: a large grid and a large yield are cut into parts, and put together from what these found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from api.convert.optima import yield_to_wire
from optimizers.problem import Problem
from optimizers.search.result import Monitor
from optimizers.solving import sharding
from optimizers.solving.expectation import Draws, together
from storage.jobs.compute import Parts

#: Under which number a job finds what it knew when it was cut.
_KNOWN = -1


def cut_grid(kind: str, problem: Problem, options: Mapping[str, Any]) -> Parts | None:
    """Return the parts of a grid, None where it is not worth cutting."""
    stretches = sharding.cut_grid(kind, problem, options)
    return Parts(documents=[{"grid": list(stretch)} for stretch in stretches]) if stretches else None


def cut_yield(stretches: Sequence[sharding.Stretch], best: Mapping[str, float], *, wire: Mapping[str, Any]) -> Parts:
    """Return the parts of a yield; ``wire`` is the result that it belongs to."""
    documents = [{"yield": list(stretch), "best": dict(best)} for stretch in stretches]
    return Parts(documents=documents, known={"result": wire})


def compute_part(
    part: Mapping[str, Any], problem: Problem, options: Mapping[str, Any], *, samples: int, monitor: Monitor
) -> dict[str, Any]:
    """Return what is found in one part."""
    if "grid" in part:
        first, last = part["grid"]
        return sharding.look_at(problem, options, (first, last), monitor=monitor)
    first, last = part["yield"]
    draws = sharding.draw(problem, part["best"], options, (first, last), samples=samples, monitor=monitor)
    return {**asdict(draws), "failures": {str(goal): count for goal, count in draws.failures.items()}}


def grid_state(parts: Mapping[int, Mapping[str, Any]]) -> dict[str, Any] | None:
    """Return the state from which a search goes on when the parts of its grid are there, None where there are none."""
    if not parts or _KNOWN in parts:
        return None
    return sharding.looked_at([parts[number] for number in sorted(parts)])


def with_yield(parts: Mapping[int, Mapping[str, Any]]) -> dict[str, Any] | None:
    """Return the finished result when the parts of its yield are there, None where there are none."""
    if _KNOWN not in parts:
        return None
    draws = [
        Draws(
            done=part["done"],
            good=part["good"],
            unstable=part["unstable"],
            failures={int(goal): count for goal, count in part["failures"].items()},
        )
        for number, part in parts.items()
        if number != _KNOWN
    ]
    return {**parts[_KNOWN]["result"], "yield": yield_to_wire(together(draws))}
