"""Two answers to the same question, number by number.

    difference = |a - b| / max(|a|, |b|)        of a list of numbers: max |a_i - b_i| / max |a_i|

Numbers of the size of their neighbours' rounding are equal. Times, identifiers and versions are no results.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

IGNORED = frozenset(
    {
        "id", "identification", "dataset", "system", "created_at", "started_at", "finished_at", "seconds", "effort", "versions",
        "warnings", "request", "document",
    }
)  # fmt: skip
_WORDS = frozenset({"verdict", "status", "grade"})
_ROUNDING = 1e-13


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """One quantity of both answers; ``difference`` is infinite where one has no number, or another word."""

    path: str
    recorded: Any
    repeated: Any
    difference: float


def differences(recorded: Any, repeated: Any, path: str = "") -> Iterator[Difference]:
    """Give every quantity of the recorded answer beside the repeated one.

    >>> [d.difference for d in differences({"k": 2.0, "seconds": 1.0}, {"k": 2.0, "seconds": 9.0})]
    [0.0]
    """
    if isinstance(recorded, Mapping):
        yield from _members(recorded, repeated if isinstance(repeated, Mapping) else {}, path)
    elif isinstance(recorded, list):
        yield from _items(recorded, repeated, path)


def _members(recorded: Mapping[str, Any], repeated: Mapping[str, Any], path: str) -> Iterator[Difference]:
    scale = max((abs(value) for value in recorded.values() if _is_number(value)), default=0.0)
    for key, value in recorded.items():
        if key in IGNORED:
            continue
        here, other = f"{path}.{key}" if path else key, repeated.get(key)
        if _is_number(value):
            yield Difference(path=here, recorded=value, repeated=other, difference=_distance(value, other, scale))
        elif isinstance(value, str) and key in _WORDS:
            yield Difference(path=here, recorded=value, repeated=other, difference=0.0 if value == other else math.inf)
        elif isinstance(value, Mapping | list):
            yield from differences(value, other, here)


def _items(recorded: list[Any], repeated: Any, path: str) -> Iterator[Difference]:
    if not isinstance(repeated, list) or len(repeated) != len(recorded):
        other = f"{len(repeated)} items" if isinstance(repeated, list) else repeated
        yield Difference(path=path, recorded=f"{len(recorded)} items", repeated=other, difference=math.inf)
        return
    pairs = list(_leaves(recorded, repeated))
    if pairs and all(_is_number(a) or a is None for a, _ in pairs):
        yield _array(pairs, path)
        return
    for number, (mine, other) in enumerate(zip(recorded, repeated, strict=True)):
        yield from differences(mine, other, f"{path}[{number}]")


def _leaves(recorded: Sequence[Any], repeated: Any) -> Iterator[tuple[Any, Any]]:
    """Give the numbers of nested lists in pairs."""
    others = repeated if isinstance(repeated, list) and len(repeated) == len(recorded) else [None] * len(recorded)
    for mine, other in zip(recorded, others, strict=True):
        if isinstance(mine, list):
            yield from _leaves(mine, other)
        else:
            yield mine, other


def _array(pairs: Sequence[tuple[Any, Any]], path: str) -> Difference:
    scale = max((abs(a) for a, _ in pairs if a is not None), default=0.0)
    worst, at = -1.0, 0
    for number, (mine, other) in enumerate(pairs):
        if mine is None or not _is_number(other):
            distance = 0.0 if mine is None and other is None else math.inf
        else:
            distance = abs(mine - other) / scale if scale > 0.0 else float(mine != other)
        if distance > worst:
            worst, at = distance, number
    return Difference(path=f"{path}[{at}]", recorded=pairs[at][0], repeated=pairs[at][1], difference=worst)


def _distance(mine: float, other: Any, scale: float) -> float:
    if not _is_number(other):
        return math.inf
    distance = abs(mine - float(other))
    if distance <= _ROUNDING * scale:
        return 0.0
    return distance / max(abs(mine), abs(float(other)))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
