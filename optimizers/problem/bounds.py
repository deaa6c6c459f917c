"""Bounds that no value of their metric can reach or break, and the units that were meant.

A hard bound that no value reaches is refused. One that every value keeps says nothing, and one in the wrong unit asks for something
else: of these the reply warns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Final

from engine.metrics import catalogue
from engine.model.document import Remark
from optimizers.problem.errors import ProblemError

if TYPE_CHECKING:
    from engine.metrics import Metric
    from engine.model.errors import Path
    from optimizers.problem.goals import Goal

_SI: Final[Mapping[str, Callable[[float], float]]] = {
    "deg": math.radians,
    "%": lambda x: x / 100,
    "dB": lambda x: 10 ** min(x / 20, 300.0),
}
_WRITTEN: Final[Mapping[str, Callable[[float], float]]] = {
    "deg": math.degrees,
    "%": lambda x: 100 * x,
    "dB": lambda x: 20 * math.log10(x),
}


def check_reachable(goal: Goal, at: Path) -> None:
    """Refuse a hard bound that no value of the metric keeps.

    Raises
    ------
    ProblemError
        With the metric, where its values lie, and the unit that was probably meant.
    """
    for key, sentence in _unreachable(goal):
        if goal.hard:
            raise ProblemError(sentence, at=(*at, key))


def doubts(goals: Sequence[Goal]) -> tuple[Remark, ...]:
    """Return what is allowed and probably not meant: bounds that say nothing, and those in another unit."""
    found = []
    for index, goal in enumerate(goals):
        told = [] if goal.hard else [*_unreachable(goal)]
        if goal.aim is None:
            told += [*_idle(goal), *_odd(goal)]
        found += [Remark(at=("goals", index, key), detail=sentence) for key, sentence in told]
    return tuple(found)


def _unreachable(goal: Goal) -> Iterator[tuple[str, str]]:
    """Return the bounds that no value keeps."""
    metric = catalogue()[goal.metric]
    low, high = metric.range
    for key, bound, limit, sign in (("lower", goal.lower, high, "<="), ("upper", goal.upper, low, ">=")):
        if bound is not None and (bound > limit if key == "lower" else bound < limit):
            named, got = (key, bound) if goal.aim is None else ("target", goal.aim)
            rule = f"{named} of {_compared(metric)} must be {sign} {_amount(limit, metric)}"
            yield named, f"{rule}, got {_amount(got, metric)}{_meant(got, metric)}"


def _idle(goal: Goal) -> Iterator[tuple[str, str]]:
    """Return the bounds that every value keeps."""
    metric = catalogue()[goal.metric]
    low, high = metric.range
    every = f"every value of {_compared(metric)} is"
    if goal.lower is not None and goal.lower <= low:
        yield "lower", f"{every} >= {_amount(low, metric)}: this bound says nothing"
    if goal.upper is not None and goal.upper >= high:
        yield "upper", f"{every} <= {_amount(high, metric)}: this bound says nothing"


def _odd(goal: Goal) -> Iterator[tuple[str, str]]:
    """Return the bounds that were hardly meant in SI."""
    metric = catalogue()[goal.metric]
    for key, bound in (("lower", goal.lower), ("upper", goal.upper)):
        if bound is not None and bound > metric.seldom_beyond:
            unit = metric.usual_unit
            written = f"{_WRITTEN[unit](bound):.4g} {unit}"
            yield key, f"{key} {bound:g} of {goal.metric} is a ratio, that is {written}{_meant(bound, metric)}"


def _meant(value: float, metric: type[Metric]) -> str:
    """Return a question for the usual unit of a metric, where the value would make sense in it."""
    if not metric.usual_unit:
        return ""
    low, high = metric.range
    meant = _SI[metric.usual_unit](value)
    sensible = low <= meant <= min(high, metric.seldom_beyond)
    return f": did you mean {value:g} {metric.usual_unit}?" if sensible else ""


def _compared(metric: type[Metric]) -> str:
    return f"{metric.kind} (goals compare {metric.compares})" if metric.compares else metric.kind


def _amount(value: float, metric: type[Metric]) -> str:
    number = "pi" if value == math.pi else f"{value:g}"
    return number if metric.unit == "1" or "output" in metric.unit else f"{number} {metric.unit}"
