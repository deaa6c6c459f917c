"""Columns that are called a time: which of them has the instants of the samples, and why one cannot."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from api.formats.text.cells import Marks
from api.formats.text.header import TIME_NAME, Header

_UNITS = {"s", "ms", "us", "µs", "ns", "min", "h"}
_WRITTEN = _UNITS | {"", "sec", "second", "seconds"}
"""What may stand behind the name of a time: a T in degC is none."""


def is_called_time(column: int, header: Header) -> bool:
    """Say whether a column is called a time, or is the first one and in a unit of time."""
    unit = header.units.get(column, "")
    return TIME_NAME.match(header.names.get(column, "")) is not None or (column == 0 and unit in _UNITS)


def why_no_time(rows: Sequence[Sequence[str]], columns: Sequence[int], header: Header, marks: Marks) -> str:
    """Return why the first column that is called a time cannot have the instants of the samples, "" where none is called so.

    Parameters
    ----------
    rows : sequence of sequence of str
        The cells of the first rows.
    columns : sequence of int
        Those of numbers.
    header : Header
    marks : Marks
        How numbers are written.
    """
    called = (
        i
        for i in range(min(map(len, rows), default=0))
        if is_called_time(i, header) and header.units.get(i, "").lower() in _WRITTEN
    )
    for column in called:
        name = f"column {header.names.get(column, column)}"
        if column not in columns:
            return f"{name} must hold numbers or dates to be the time, got {rows[0][column][:40]!r}: write them so"
        reason = _reason([marks.value(row[column]) for row in rows], header.units.get(column, ""))
        return f"{name} cannot be the time: {reason}" if reason else ""
    return ""


def _reason(values: Sequence[float | None], unit: str) -> str:
    """Return what is wrong with some instants, in the words with which an import refuses them."""
    if None in values:
        return f"it must be given for every sample, got none at sample {values.index(None)}: complete the rows"
    known = [value for value in values if value is not None]
    if len(known) < 2:
        return f"it must have at least 2 instants, got {len(known)}: record more"
    for sample, (before, after) in enumerate(pairwise(known), start=1):
        if after < before:
            step = f"{after - before:.6g} {unit}".strip()
            return f"it must not run backwards, got a step of {step} at sample {sample}: sort its rows"
    if known[0] == known[-1]:
        return f"it must rise, got {len(known)} equal instants: write the instant of each sample"
    return ""
