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

from api.formats import (
    ANOTHER,
    MOST_CHANNELS,
    NO_VALUES,
    DamagedFileError,
    FormatError,
    Recording,
    Series,
    Values,
)
from api.formats.exactness import Rounded
from api.formats.text.cells import Marks
from api.formats.text.endings import Rows
from api.formats.text.side_by_side import Column, Seen, SideBySide
from api.formats.text.txt import lines_of

_CHUNK = 1 << 20
_END = "***End_of_Header***"
_LONGEST_HEADER = 1000
_LOOKED_AT = 64
_SEPARATORS = {"tab": "\t", "comma": ",", "semicolon": ";"}


@dataclass(slots=True, kw_only=True)
class _Table:
    """The header of one table, and how many rows followed it."""

    keys: dict[str, list[str]] = field(default_factory=dict)
    names: list[str] = field(default_factory=list)
    first_line: int = 0
    rows: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class _Layout:
    """Where the channels and their X_Values are: ``cells[i]`` and ``axes[i]`` in each row."""

    separator: str
    decimal: str
    cells: Sequence[int]
    axes: Sequence[int]

    def said(self, table: _Table, key: str) -> list[str]:
        """Return what a header says of each channel, "" where it says nothing."""
        values = table.keys.get(key, [])
        return [values[cell - 1].strip() if cell <= len(values) else "" for cell in self.cells]


def open_file(file: BinaryIO, *, allow_truncated: bool = False) -> Recording:
    """Return what a LabVIEW measurement file holds; tables that follow each other are joined.

    The instants are those of Delta_X where there is no X_Value, or where every X_Value is what Delta_X makes of it to its
    last printed digit; otherwise they are the X_Values.

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
    first = tables[0]
    layout = _layout(head, _channels(first))
    for table in tables[1:]:
        if (_channels(table), layout.said(table, "Delta_X")) != (len(layout.cells), layout.said(first, "Delta_X")):
            raise FormatError(
                f"the tables of a file must have the same channels and Delta_X, line {table.first_line} begins one that "
                "differs: save each table in a file of its own",
                line=table.first_line,
            )
    names = _distinct([first.names[cell] if cell < len(first.names) else "" for cell in layout.cells])
    stated = [int(text) if text.isdecimal() else 0 for text in layout.said(tables[-1], "Samples")]
    longest = max(range(len(stated)), key=lambda place: (stated[place], place))
    ending = Rows(
        last_column=layout.cells[longest],
        delimiter=layout.separator,
        marks=Marks(decimal=layout.decimal),
        header_lines=tables[-1].first_line - 1,
    )
    left_out, remarks = ending.ending(file).settle(allow_truncated=allow_truncated)
    tables[-1].rows -= left_out
    remarks += _missing(tables[-1], stated[longest], allow_truncated=allow_truncated)
    columns = SideBySide(
        rows=lambda: _rows(file, tables), delimiter=layout.separator, decimal_commas=layout.decimal == ","
    )
    instants = _Instants(layout, tables, columns)
    series, places = instants.series(names)
    if not series:
        raise FormatError(
            "a LabVIEW measurement file must hold samples, got none in its rows: does X_Columns fit them?"
        )
    if len(tables) > 1:
        begun = ", ".join(f"{_starts(table, layout)[0]}" for table in tables)
        remarks.append(f"{len(tables)} tables were joined as if they followed without a pause; they began at {begun}")

    rounded = Rounded()

    def read(wanted: Sequence[int]) -> Iterator[tuple[int, Values]]:
        yield from columns.read([places[place] for place in wanted])
        for place in wanted:
            rounded.at_least(series[place].name, columns.rounded.get(places[place].cell, 0))

    return Recording(
        series=series,
        read=read,
        refused=instants.refused,
        remarks=[*remarks, *instants.remarks],
        complete=not left_out and len(tables) == 1 and instants.begin_at_zero,
        rounded=rounded,
    )


def _layout(head: Mapping[str, Sequence[str]], count: int) -> _Layout:
    decimal = head.get("Decimal_Separator", ["."])[0] or "."
    if decimal not in {".", ","}:
        raise DamagedFileError(f'Decimal_Separator must be "." or ",", got {decimal[:40]!r}')
    kind = head.get("X_Columns", ["One"])[0]
    several = kind == "Multi"
    return _Layout(
        separator=_separator(head),
        decimal=decimal,
        # without a column of X its cell is there and empty, in front of every row
        cells=[2 * i + 1 if several else i + 1 for i in range(count)],
        axes=[] if kind == "No" else [2 * i if several else 0 for i in range(count)],
    )


class _Instants:
    """The times of the channels: of Delta_X, or those that the columns of X_Value hold."""

    def __init__(self, layout: _Layout, tables: Sequence[_Table], columns: SideBySide) -> None:
        self._layout, self._tables, self._columns = layout, tables, columns
        self.remarks: list[str] = []
        self.refused: dict[str, str] = {}

    def series(self, names: Sequence[str]) -> tuple[list[Series], list[Column]]:
        """Return the channels, columns of X_Value that are needed before those that need them, and where they are."""
        layout, table = self._layout, self._tables[0]
        axes: Sequence[int | None] = layout.axes or [None] * len(names)
        channels = [Column(cell=cell, axis=axis) for cell, axis in zip(layout.cells, axes, strict=True)]
        lengths = set(layout.said(self._tables[-1], "Samples"))
        total = sum(table.rows for table in self._tables)
        seen: Mapping[int, Seen] = {}
        if layout.axes or len(lengths) > 1:
            stamps = [Column(cell=cell, axis=cell) for cell in dict.fromkeys(layout.axes)]
            seen = self._columns.scan([*channels, *stamps])
        steps = [_number(text or "0", layout.decimal, "Delta_X") for text in layout.said(table, "Delta_X")]
        units, starts = layout.said(table, "Y_Unit_Label"), _starts(table, layout)
        kept = {cell for cell in dict.fromkeys(layout.axes) if not self._is_even(cell, steps)}
        if len(self._tables) > 1 and any(not self._rises(axis) for axis in kept):
            raise FormatError(
                "X_Value must rise through all tables of a file, it begins anew in one of them: save each table in a file of "
                "its own"
            )
        found: list[Series] = []
        places: list[Column] = []
        groups: dict[bytes, str] = {}
        for name, unit, start, step, column in zip(names, units, starts, steps, channels, strict=True):
            if seen and math.isnan(seen[column.cell].first):
                self.refused[name] = NO_VALUES
                continue
            axis = column.axis if column.axis in kept else None
            group = ""
            if axis is not None:
                group = groups.get(seen[axis].digest, "")
                if not group:
                    group = groups.setdefault(seen[axis].digest, name)
                    label = "X_Value" if len({*layout.axes}) == 1 else f"X_Value of {name}"
                    found.append(
                        Series(name=label, index=len(found), count=seen[axis].count, unit="s", role="time", group=group)
                    )
                    places.append(Column(cell=axis, axis=axis))
            found.append(
                Series(
                    name=name,
                    index=len(found),
                    count=seen[column.cell].count if seen else total,
                    unit=unit,
                    sample_rate=1.0 / step if step and axis is None else None,
                    start_time=start,
                    group=group,
                )
            )
            places.append(column)
        if layout.axes:
            self.remarks.append(_said(kept, layout.axes))
        return found, places

    @property
    def begin_at_zero(self) -> bool:
        """Whether no channel begins at an X0 of its own, which a rate does not tell."""
        starts = self._layout.said(self._tables[0], "X0")
        return not any(_number(text or "0", self._layout.decimal, "X0") for text in starts)

    def _rises(self, axis: int) -> bool:
        last = -math.inf
        for _, values in self._columns.read([Column(cell=axis, axis=axis)]):
            if values[0] <= last or (np.diff(values) <= 0).any():
                return False
            last = float(values[-1])
        return True

    def _is_even(self, axis: int, steps: Sequence[float]) -> bool:
        """Whether each X_Value is X0 + i Delta_X to its last printed digit."""
        layout = self._layout
        place = layout.axes.index(axis)
        if not steps[place] > 0.0:
            return False
        absolute, relative = self._printed(axis)
        begins = np.cumsum([0, *(table.rows for table in self._tables)])
        starts = np.array([_number(layout.said(one, "X0")[place] or "0", layout.decimal, "X0") for one in self._tables])
        passed = 0
        for _, values in self._columns.read([Column(cell=axis, axis=axis)]):
            row = np.arange(passed, passed + values.size)
            table = np.searchsorted(begins, row, side="right") - 1
            expected = starts[table] + steps[place] * (row - begins[table])
            if (np.abs(values - expected) > np.maximum(absolute, relative * np.abs(values))).any():
                return False
            passed += values.size
        return True

    def _printed(self, axis: int) -> tuple[float, float]:
        """Return how far a number of a column may be off for its printing: in absolute terms, and as a share."""
        digits, powers = 0, False
        for _, line in itertools.islice(self._columns.rows(), _LOOKED_AT):
            cells = line.split(self._layout.separator)
            mantissa, mark, _ = cells[axis].strip().lower().partition("e") if axis < len(cells) else ("", "", "")
            digits = max(digits, len(mantissa.partition(self._layout.decimal)[2]))
            powers = powers or bool(mark)
        half = 0.6 * 10.0**-digits
        return (1e-300, half) if powers else (half, 0.0)


def _said(kept: set[int | None] | set[int], axes: Sequence[int]) -> str:
    """Return the sentence on the columns of X_Value."""
    if not kept:
        return "X_Value and Delta_X say the same: the sample rate is that of Delta_X"
    some = "" if len(kept) == len({*axes}) else f" in {len(kept)} of {len({*axes})} columns"
    return f"X_Value is not what Delta_X says{some}: the instants are those of X_Value"


def _missing(table: _Table, stated: int, *, allow_truncated: bool) -> list[str]:
    """Say or refuse that a table has fewer rows than its header says; a file that goes on under one header has more."""
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
        raise FormatError(
            "a LabVIEW measurement file must begin with 'LabVIEW Measurement', got something else" + ANOTHER
        )
    head = _header(lines)
    separator = _separator(head)
    tables: list[_Table] = []
    table: _Table | None = None
    named = True
    for number, line in lines:
        key, *values = line.split(separator)
        if table is not None and not named:
            table.names, table.first_line, named = [cell.strip() for cell in (key, *values)], number + 1, True
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
        raise DamagedFileError("a LabVIEW measurement file must hold a table with rows, got none")
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
    raise DamagedFileError(f"the header must end with {_END} within {_LONGEST_HEADER} lines, got none")


def _separator(head: Mapping[str, Sequence[str]]) -> str:
    """Return what stands between cells, a tab unless the header names another."""
    named = next(iter(head.get("Separator", ())), "Tab").strip().lower()
    return _SEPARATORS.get(named, "\t")


def _channels(table: _Table) -> int:
    text = (table.keys.get("Channels") or [""])[0]
    if not text.isdecimal() or not 1 <= int(text) <= MOST_CHANNELS:
        raise DamagedFileError(f"Channels must be 1 ... {MOST_CHANNELS}, got {text[:40]!r}", line=table.first_line)
    return int(text)


def _number(text: str, decimal: str, what: str) -> float:
    try:
        value = float(text.replace(decimal, "."))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DamagedFileError(f"{what} must be a finite number, got {text[:40]!r}")
    return value


def _distinct(given: Sequence[str]) -> list[str]:
    names: list[str] = []
    for i, name in enumerate(given):
        plain = name or f"channel {i}"
        names.append(plain if plain not in names else f"{plain} (channel {i})")
    return names


def _starts(table: _Table, layout: _Layout) -> list[datetime | None]:
    """Return the local times at which channels began; the digits of a second beyond the sixth are dropped."""
    starts: list[datetime | None] = []
    for day, time in zip(layout.said(table, "Date"), layout.said(table, "Time"), strict=True):
        whole, _, fraction = time.replace(",", ".").partition(".")
        try:
            start = datetime.strptime(f"{day} {whole}", "%Y/%m/%d %H:%M:%S")  # noqa: DTZ007 - the file names no zone
            starts.append(start.replace(microsecond=int(fraction[:6].ljust(6, "0") or 0)))
        except ValueError:
            starts.append(None)
    return starts


def _rows(file: BinaryIO, tables: Sequence[_Table]) -> Iterator[tuple[int, str]]:
    """Yield the rows of all tables with the numbers of their lines."""
    file.seek(0)
    lines = enumerate(lines_of(iter(lambda: file.read(_CHUNK), b"")), start=1)
    for table in tables:
        left = table.rows
        if not left:
            continue
        for number, line in lines:
            if number >= table.first_line and line.strip():
                yield number, line
                left -= 1
                if not left:
                    break
