"""LabVIEW measurement files (.lvm): a header of keywords, then one or several tables with headers of their own.

t_i = X0 + i Delta_X   for each channel of a table
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import BinaryIO

import numpy as np

from api.formats import MOST_CHANNELS, PIECE, FormatError, Recording, Series, Values
from api.formats.text.cells import Marks
from api.formats.text.endings import Rows
from api.formats.text.txt import lines_of

_CHUNK = 1 << 20
_END = "***End_of_Header***"
_LONGEST_HEADER = 1000
_SEPARATORS = {"tab": "\t", "comma": ",", "semicolon": ";"}


@dataclass(slots=True, kw_only=True)
class _Table:
    """The header of one table, and how many rows followed it."""

    keys: dict[str, list[str]] = field(default_factory=dict)
    names: list[str] = field(default_factory=list)
    first_line: int = 0
    rows: int = 0

    def row(self, key: str, count: int) -> list[str]:
        """Return what the header says of each channel, "" where it says nothing."""
        return [*self.keys.get(key, []), *[""] * count][:count]


def open_file(file: BinaryIO, *, allow_truncated: bool = False) -> Recording:
    """Return what a LabVIEW measurement file holds; tables that follow each other are joined.

    Parameters
    ----------
    file : binary file
    allow_truncated : bool
        Whether a last row that is or may be cut is left out.

    Raises
    ------
    FormatError
        For another file, tables with different channels, a row that does not fit its table, or one that is cut.
    """
    head, tables = _scan(file)
    decimal = head.get("Decimal_Separator", ["."])[0] or "."
    if decimal not in {".", ","}:
        raise FormatError(f'Decimal_Separator must be "." or ",", got {decimal[:40]!r}')
    first = tables[0]
    count = _channels(first)
    for table in tables[1:]:
        if (_channels(table), table.row("Delta_X", count)) != (count, first.row("Delta_X", count)):
            raise FormatError(
                f"the tables of a file must have the same channels and Delta_X, "
                f"line {table.first_line} begins one that differs",
                line=table.first_line,
            )
    steps = [_number(text, decimal, "Delta_X") for text in first.row("Delta_X", count)]
    units, starts = first.row("Y_Unit_Label", count), _starts(first, count)
    names = _distinct(first, count)
    separator = _separator(head)
    rows = Rows(
        last_column=count,
        delimiter=separator,
        marks=Marks(decimal=decimal),
        header_lines=tables[-1].first_line - 1,
    )
    left_out, remarks = rows.ending(file).settle(allow_truncated=allow_truncated)
    tables[-1].rows -= left_out
    remarks += _missing(tables[-1], count, allow_truncated=allow_truncated)
    total = sum(table.rows for table in tables)
    series = [
        Series(
            name=names[i],
            index=i,
            count=total,
            unit=units[i].strip(),
            sample_rate=1.0 / steps[i] if steps[i] else None,
            start_time=starts[i],
        )
        for i in range(count)
    ]
    if len(tables) > 1:
        begun = ", ".join(f"{_starts(table, 1)[0]}" for table in tables)
        remarks.append(f"{len(tables)} tables were joined as if they followed without a pause; they began at {begun}")
    has_time = head.get("X_Columns", ["No"])[0] != "No"
    if head.get("X_Columns", ["No"])[0] == "Multi":
        raise FormatError("X_Columns must be No or One, got Multi: save the channels with one time column")

    def read(wanted: Sequence[int]) -> Iterator[tuple[int, Values]]:
        # without a column of X its cell is there and empty, in front of every row
        cells = [place + 1 for place in wanted]
        for block in _rows(file, tables, cells, separator, decimal):
            for place in range(len(wanted)):
                yield place, np.ascontiguousarray(block[:, place])

    if has_time:
        remarks.append("the column X_Value is not used: the sample rate is that of Delta_X")
    return Recording(series=series, read=read, remarks=remarks)


def _missing(table: _Table, count: int, *, allow_truncated: bool) -> list[str]:
    """Say or refuse that a table has fewer rows than its header says; a file that goes on under one header has more."""
    stated = max((int(text) for text in table.row("Samples", count) if text.isdecimal()), default=0)
    if table.rows >= stated:
        return []
    if allow_truncated:
        return [f"the file is cut off: {table.rows} of the last table's {stated} samples are there"]
    raise FormatError(
        f"the last table must have the {stated} samples that its header says, got {table.rows}: the file is cut off. "
        "Set allow_truncated: true to take what is there"
    )


def _scan(file: BinaryIO) -> tuple[dict[str, list[str]], list[_Table]]:
    """Return the keys of the file's header, and its tables with their rows counted."""
    file.seek(0)
    lines = enumerate(lines_of(iter(lambda: file.read(_CHUNK), b"")), start=1)
    if not next(lines, (0, ""))[1].startswith("LabVIEW Measurement"):
        raise FormatError("a LabVIEW measurement file must begin with 'LabVIEW Measurement', got something else")
    head = _header(lines)
    separator = _separator(head)
    tables: list[_Table] = []
    table: _Table | None = None
    named = True
    for number, line in lines:
        key, *values = line.split(separator)
        if table is not None and not named:
            table.names, table.first_line, named = [value.strip() for value in values], number + 1, True
            tables.append(table)
            table = None
        elif key.strip() == "Channels":
            table = _Table(keys={"Channels": [value.strip() for value in values]})
        elif table is not None:
            named = not key.startswith(_END)
            table.keys[key.strip()] = [value.strip() for value in values]
        elif tables and line.strip():
            tables[-1].rows += 1
    if not any(table.rows for table in tables):
        raise FormatError("a LabVIEW measurement file must hold a table with rows, got none")
    return head, tables


def _header(lines: Iterator[tuple[int, str]]) -> dict[str, list[str]]:
    """Read the keys up to the end of the file's own header."""
    head: dict[str, list[str]] = {}
    separator = "\t"
    for number, line in lines:
        if line.startswith("Separator"):
            separator = _separator({"Separator": re.split(r"[\t,;]", line)[1:2]})
        key, *values = line.split(separator)
        if key.startswith(_END):
            return head
        if number > _LONGEST_HEADER:
            break
        head[key.strip()] = [value.strip() for value in values] or [""]
    raise FormatError(f"the header must end with {_END} within {_LONGEST_HEADER} lines, got none")


def _separator(head: Mapping[str, Sequence[str]]) -> str:
    """Return what stands between cells, a tab unless the header names another."""
    named = next(iter(head.get("Separator", ())), "Tab").strip().lower()
    return _SEPARATORS.get(named, "\t")


def _channels(table: _Table) -> int:
    text = (table.keys.get("Channels") or [""])[0]
    if not text.isdecimal() or not 1 <= int(text) <= MOST_CHANNELS:
        raise FormatError(f"Channels must be 1 ... {MOST_CHANNELS}, got {text[:40]!r}", line=table.first_line)
    return int(text)


def _number(text: str, decimal: str, what: str) -> float:
    try:
        value = float(text.replace(decimal, "."))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FormatError(f"{what} must be a finite number, got {text[:40]!r}")
    return value


def _distinct(table: _Table, count: int) -> list[str]:
    # the last name is that of the comments
    names: list[str] = []
    for i, name in enumerate([*table.names, *[""] * count][:count]):
        plain = name or f"channel {i}"
        names.append(plain if plain not in names else f"{plain} (channel {i})")
    return names


def _starts(table: _Table, count: int) -> list[datetime | None]:
    """Return the local times at which channels began; the digits of a second beyond the sixth are dropped."""
    starts: list[datetime | None] = []
    for day, time in zip(table.row("Date", count), table.row("Time", count), strict=True):
        whole, _, fraction = time.replace(",", ".").partition(".")
        try:
            start = datetime.strptime(f"{day} {whole}", "%Y/%m/%d %H:%M:%S")  # noqa: DTZ007 - the file names no zone
            starts.append(start.replace(microsecond=int(fraction[:6].ljust(6, "0") or 0)))
        except ValueError:
            starts.append(None)
    return starts


def _rows(
    file: BinaryIO, tables: Sequence[_Table], cells: Sequence[int], separator: str, decimal: str
) -> Iterator[Values]:
    """Yield the wanted cells of all rows of all tables in blocks."""
    file.seek(0)
    lines = lines_of(iter(lambda: file.read(_CHUNK), b""))
    number = 0
    for table in tables:
        skipped = table.first_line - 1 - number
        number += sum(1 for _ in itertools.islice(lines, skipped))
        left = table.rows
        while left:
            block: list[str] = []
            begin = number + 1
            while len(block) < min(left, PIECE // 16):
                line = next(lines)
                number += 1
                if line.strip():
                    block.append(line)
            left -= len(block)
            yield _values(block, begin, cells, separator, decimal)


def _values(block: list[str], begin: int, cells: Sequence[int], separator: str, decimal: str) -> Values:
    plain = block if decimal == "." else [line.replace(decimal, ".") for line in block]
    try:
        values = np.loadtxt(plain, delimiter=separator, usecols=cells, comments=None, ndmin=2)
    except ValueError as error:
        last = begin + len(block) - 1
        raise FormatError(
            f"lines {begin} ... {last} must hold a number for every channel ({error})", line=begin
        ) from error
    return values
