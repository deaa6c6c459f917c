"""TwinCAT Scope exports (CSV) of Beckhoff: a header of keys for each channel, then columns of instants and of samples.

Name   ch1   Name   ch2   ch3        a cell that holds the key itself is the column of the instants behind which
Unit   V     Unit   mm    (None)     the channels stand; instants are ms from the start, or ticks of 100 ns since 1601
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any, BinaryIO

from api.formats import (
    MOST_CHANNELS,
    FormatError,
    Recording,
    Series,
    Values,
    text_reason,
)
from api.formats.exactness import Rounded
from api.formats.text.side_by_side import Column, Row, Seen, SideBySide
from api.formats.text.txt import lines_of

_CHUNK = 1 << 20
_START = re.compile(r"^\"?Starttime of export(?P<mark>\"? |[^\w\s]|\t)\s*(?P<ticks>\d{17,19})\b", re.MULTILINE)
_EPOCH = datetime(1601, 1, 1, tzinfo=UTC)
_TICKS = 10_000
"""Of 100 ns in a ms."""
_MOST_LINES = 100
_UNITS = re.compile(r"(?P<unit>.*?)\s*\((?P<quantity>[^()]*)\)")
_TEXTS = {"STRING", "WSTRING"}


@dataclass(slots=True, kw_only=True)
class _Head:
    """What stands before the rows."""

    mark: str
    start: int
    rows: dict[str, list[str]] = field(default_factory=dict)
    lines: int = 0

    def said(self, key: str, cell: int) -> str:
        """Return what a key says of the channel in a column, "" where it says nothing."""
        cells = self.rows.get(key, [])
        return cells[cell].strip() if cell < len(cells) else ""


def is_scope(text: str) -> bool:
    """Whether a text begins as TwinCAT Scope exports it."""
    return text.lstrip("\ufeff").startswith("Name") and _START.search(text) is not None


def open_file(file: BinaryIO) -> Recording:
    """Return the channels of an export, each with the instants before it; those of the same instants are one group.

    Raises
    ------
    FormatError
        For an export without columns of instants, or a row that does not fit.
    """
    head = _head(file)
    names = head.rows["Name"]
    # a decimal comma among commas shifts one of the lines: most of them decide
    axes = [
        cell
        for cell, name in enumerate(names)
        if name == "Name" and 2 * sum(head.said(key, cell) == key for key in head.rows) > len(head.rows)
    ]
    found = [
        (cell, max((axis for axis in axes if axis < cell), default=None))
        for cell in range(len(names))
        if cell not in axes
    ]
    channels = [Column(cell=cell, axis=axis) for cell, axis in found if names[cell].strip()]
    if not channels or any(one.axis is None for one in channels) or len(channels) > MOST_CHANNELS:
        raise FormatError(
            f"an export must have 1 ... {MOST_CHANNELS} channels, each behind a column of instants, got {len(channels)}: export it "
            "anew with Timelines: All or For each sampletime"
        )
    columns = SideBySide(
        rows=lambda: _rows(file, head),
        delimiter=head.mark,
        decimal_commas=head.mark != ",",
        remedy=": export it anew without trigger infos and markers",
    )
    return _recording(head, channels, columns)


def _recording(head: _Head, channels: Sequence[Column], columns: SideBySide) -> Recording:
    refused = {
        head.said("Name", one.cell): text_reason()
        for one in channels
        if head.said("Data-Type", one.cell).upper() in _TEXTS
    }
    channels = [one for one in channels if head.said("Name", one.cell) not in refused]
    ticks = _full(columns, [one.axis for one in channels if one.axis is not None])
    axes = {
        axis: Column(cell=axis, axis=axis, **({"origin": head.start, "divisor": _TICKS} if ticks else {}))
        for axis in dict.fromkeys(one.axis for one in channels if one.axis is not None)
    }
    seen = columns.scan([*axes.values(), *channels])
    groups = _groups(head, channels, seen)
    series: list[Series] = []
    places: list[Column] = []
    scaled: list[str] = []
    for one in channels:
        assert one.axis is not None
        group = groups[seen[one.axis].digest]
        shared: dict[str, Any] = {
            "count": seen[one.cell].count,
            "start_time": _instant(head, seen[one.axis]),
            "group": group,
        }
        if not any(other.group == group for other in series):
            series.append(Series(name=f"time of {group}", index=one.axis, unit="ms", role="time", **shared))
            places.append(axes[one.axis])
        name, (unit, quantity) = head.said("Name", one.cell), _unit(head.said("Unit", one.cell))
        series.append(Series(name=name, index=one.cell, unit=unit, quantity=quantity, **shared))
        places.append(one)
        if (head.said("Offset", one.cell) or "0", head.said("ScaleFactor", one.cell) or "1") != ("0", "1"):
            scaled.append(name)
    remarks = ["it is an export of TwinCAT Scope: names, units and instants are those of its header"]
    if scaled:
        remarks.append(
            f"Offset and ScaleFactor of {', '.join(scaled[:20])} are not applied: the file does not say whether its values are scaled"
        )

    rounded = Rounded()

    def read(wanted: Sequence[int]) -> Iterator[tuple[int, Values]]:
        yield from columns.read([places[place] for place in wanted])
        for place in wanted:
            rounded.at_least(series[place].name, columns.rounded.get(places[place].cell, 0))

    return Recording(
        series=series,
        read=read,
        refused=refused,
        remarks=remarks,
        complete=not scaled,
        rounded=rounded,
    )


def _head(file: BinaryIO) -> _Head:
    """Return the header; the lines before its second Name are those of the whole."""
    file.seek(0)
    lines = [line for _, line in zip(range(_MOST_LINES), lines_of(iter(lambda: file.read(_CHUNK), b"")), strict=False)]
    match = _START.search("\n".join(lines))
    assert match is not None
    if match["mark"].endswith(" "):
        raise FormatError(
            "an export of TwinCAT Scope with blanks between its columns cannot be cut where names have blanks: export it with "
            "tabs or semicolons"
        )
    head = _Head(mark=match["mark"], start=int(match["ticks"]))
    starts = [number for number, line in enumerate(lines) if line.split(head.mark)[0] == "Name"]
    if len(starts) < 2:
        raise FormatError(
            "an export of TwinCAT Scope must have a line of the names of its channels, got none: export it with its header"
        )
    for number, line in enumerate(lines[starts[1] :], start=starts[1] + 1):
        key, *_ = cells = line.split(head.mark)
        if not line.strip() or re.fullmatch(r"-?[\d.,]+", key):
            head.lines = number - 1
            break
        head.rows[key] = cells
    return head


def _rows(file: BinaryIO, head: _Head) -> Iterator[Row]:
    file.seek(0)
    for number, line in enumerate(lines_of(iter(lambda: file.read(_CHUNK), b"")), start=1):
        if line.strip() == "EOF":
            return
        if number > head.lines and line.strip(head.mark + " "):
            yield number, line


def _full(columns: SideBySide, axes: Sequence[int]) -> bool:
    """Whether instants are ticks since 1601 and not ms from the start."""
    _, first = next(iter(columns.rows()), (0, ""))
    cells = first.split(columns.delimiter)
    return any(re.fullmatch(r"\s*\d{17,19}\s*", cells[axis]) for axis in axes if axis < len(cells))


def _groups(head: _Head, channels: Sequence[Column], seen: Mapping[int, Seen]) -> dict[bytes, str]:
    """Return the name of each group by the mark of its instants: its sample time, with a number where several have that."""
    steps: dict[bytes, str] = {}
    for one in channels:
        assert one.axis is not None
        steps.setdefault(seen[one.axis].digest, head.said("SampleTime[ms]", one.cell))
    named: dict[bytes, str] = {}
    for number, (digest, step) in enumerate(steps.items(), start=1):
        alone = step and list(steps.values()).count(step) == 1
        named[digest] = f"{step} ms" if alone else f"timeline {number}"
    return named


def _unit(text: str) -> tuple[str, str]:
    """Return unit and quantity of "V (Voltage)"; "(None)" is none."""
    match = _UNITS.fullmatch(text)
    if match is None:
        return text, ""
    return match["unit"], match["quantity"].lower() if match["unit"] else ""


def _instant(head: _Head, axis: Seen) -> datetime:
    """Return when the first sample was taken."""
    first = 0.0 if math.isnan(axis.first) else axis.first
    return _EPOCH + timedelta(microseconds=(head.start + round(first * _TICKS)) // 10)
