"""Numbers by two names as tables that are no wider than a page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from api.services.reports.language import say
from api.services.reports.model import MOST_ROWS, Part, Sentence, table
from api.services.reports.quantities import plain

_ACROSS = 6
"""Columns of one table,"""
_MOST = 24
"""and of all of them."""
_ROUNDING = 1e-9
"""Elasticities of this size are rounding, not influence: sizes of 1 are what such a table is about."""


def matrix(rows: Mapping[str, Mapping[str, float | None]], corner: str) -> Iterator[Part]:
    """Yield tables of row -> column -> number, the column with the largest number first."""
    largest: dict[str, float] = {}
    for row in rows.values():
        for name, value in row.items():
            largest[name] = max(largest.get(name, 0.0), abs(value or 0.0))
    names = sorted(largest, key=lambda name: -largest[name])
    for start in range(0, min(len(names), _MOST), _ACROSS):
        part = names[start : start + _ACROSS]
        lines = ((label, *(shown(row.get(name)) for name in part)) for label, row in list(rows.items())[:MOST_ROWS])
        yield table((corner, *part), lines, numeric=range(1, len(part) + 1), total=len(rows))
    if len(names) > _MOST:
        yield Sentence(
            say(
                "The {most} strongest of {count} parameters; the result holds all of them.",
                most=_MOST,
                count=len(names),
            )
        )


def shown(value: float | None) -> str:
    """Return a number of such a table; what lies below rounding is 0."""
    return plain(0.0 if value is not None and abs(value) < _ROUNDING else value, 3)
