"""A problem turned round: its variables held where they were chosen, its uncertain parameters free.

What an adversary searches and what a sample of the ranges shows are then evaluations like any others.
"""

from __future__ import annotations

from collections.abc import Mapping

from optimizers.problem import Problem, Variable


def turned(problem: Problem, best: Mapping[str, float]) -> Problem:
    """Return the problem whose variables are the uncertain parameters of ``problem``, at values (SI) of its own variables."""
    ranges = {axis.parameter: axis for axis in problem.ranges}
    following = {name: tie for name, tie in problem.ties.items() if set(tie.expression.names) & set(ranges)}
    held = {path: best[path] for path in best if path not in problem.commands and path not in following}
    free = [
        Variable(parameter=name, lower=axis.lower, upper=axis.upper, scale="log" if axis.log else "linear")
        for name, axis in ranges.items()
    ]
    tied = [
        Variable(parameter=name, expression=f"={tie.expression.text.lstrip('=')}") for name, tie in following.items()
    ]
    return Problem(
        diagram=problem.diagram,
        variables=(*free, *tied),
        experiments=problem.experiments_at(best),
        goals=problem.goals,
        scenarios=tuple({**scenario, **held} for scenario in problem.scenarios),
    )
