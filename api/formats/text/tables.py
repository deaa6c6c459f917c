"""Text tables (csv, txt): the layout is that of the import description, what it leaves open is found out."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from api.formats import TIME_OF_DAY, FormatError, Read, Recording, Series, SpectralFunction, Values
from api.formats.exactness import Reading, Rounded
from api.formats.spectral import Vector, over_frequency
from api.formats.spectral.cells import is_complex, number_of
from api.formats.text.cells import Marks, cut
from api.formats.text.clock import Clock, is_stamp
from api.formats.text.endings import Rows
from api.formats.text.guess import Guess, Known, guess
from api.formats.text.txt import Lines, TextLayout, lines_of, read

_HEAD = 1 << 18
_LOOKED_AT = 50
_CHUNK = 1 << 20
_SAMPLE, _STAMP = re.compile(r"sample|messpunkt", re.IGNORECASE), re.compile(r"time ?stamp|zeitstempel", re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True)
class TableOptions:
    """What is known of a table; None is to be found out."""

    known: Known = field(default_factory=Known)
    columns: Sequence[int] = ()
    missing: Sequence[str] | None = None
    time: int | None = None
    allow_truncated: bool = False
    over_time: bool = False
    """Whether it is known that the rows are samples in time."""


def open_file(file: BinaryIO, options: TableOptions) -> Recording:
    """Return what a text table holds; a column that is no number in every row is no channel, unless it is asked for.

    Raises
    ------
    FormatError
        When there are no rows of numbers, or the last one is cut.
    """
    head = file.read(_HEAD)
    pieces = Lines([head])
    lines = list(pieces)
    if not pieces.ended and len(lines) > 2:
        lines.pop()  # it may be cut
    found = guess(lines, options.known)
    series = _series(found, options, lines)
    missing = tuple(options.missing) if options.missing is not None else found.missing
    ending = Rows(
        last_column=max((one.index for one in series), default=0),
        delimiter=found.delimiter,
        marks=found.marks,
        missing=missing,
        header_lines=found.header_lines,
    ).ending(file)
    rounded = Rounded()
    left_out, said = ending.settle(allow_truncated=options.allow_truncated)

    def rows(wanted: Sequence[int]) -> Iterator[tuple[int, Values]]:
        if not wanted:
            return
        asked = [series[place] for place in wanted]
        stamped = [place for place, one in enumerate(asked) if _is_clock(one, found)]
        layout = TextLayout(
            columns=tuple(one.index for one in asked if not _is_clock(one, found)),
            delimiter=found.delimiter,
            marks=found.marks,
            comment=found.comment,
            header_lines=found.header_lines,
            missing=missing,
            stamps=(asked[stamped[0]].index, found.clock or Clock()) if stamped else None,
            usual=found.usual,
            ended_only=left_out,
        )
        order = [*stamped, *(place for place in range(len(asked)) if place not in stamped)]
        numbers = [one.name for one in asked if not _is_clock(one, found)]
        reading = Reading(rounded)
        file.seek(0)
        chunks = iter(lambda: file.read(_CHUNK), b"")
        for block in read(chunks, layout, lambda column, more: reading.count(numbers[column], more)):
            for place in range(len(asked)):
                yield place, np.ascontiguousarray(block[:, order.index(place)])

    layout = {
        "delimiter": found.delimiter,
        "decimal": found.marks.decimal,
        **({"thousands": found.marks.thousands} if found.marks.thousands else {}),
        **({"comment": found.comment} if found.comment else {}),
        "header_lines": found.header_lines,
        "missing": list(missing),
        **({"sample_rate": found.sample_rate} if found.sample_rate else {}),
        **({"allow_truncated": True} if options.allow_truncated else {}),
    }
    there = {one.index for one in series}
    functions, noted, used = _functions(file, found, options, series, rows)
    refused = {
        found.names.get(i, f"column {i}"): why for i, why in found.refused.items() if i not in there and i not in used
    }
    return Recording(
        series=[] if functions else series,
        functions=functions,
        read=rows,
        refused=refused,
        layout=layout,
        remarks=(*_maker(found), *found.remarks, *said, *noted),
        stated_count=found.count,
        untimed=found.untimed,
        complete=not left_out,
        rounded=rounded,
    )


def _functions(
    file: BinaryIO, found: Guess, options: TableOptions, series: Sequence[Series], rows: Read
) -> tuple[list[SpectralFunction], list[str], set[int]]:
    """Return the functions of frequency that a table holds, remarks, and the columns of complex numbers among them."""
    if options.over_time or options.columns or found.time is not None:
        return [], [], set()
    shown = [cut(line, found.delimiter) for line in _body(file, found, most=_LOOKED_AT)]
    texts = {
        i
        for i in found.refused
        if is_complex([row[i] for row in shown if i < len(row) and row[i]], found.marks.decimal)
    }
    columns = {
        one.index: Vector(name=one.name, unit=one.unit, is_complex=False, read=partial(_values, rows, place))
        for place, one in enumerate(series)
        if one.role == "channel"
    }
    for i in texts:
        columns[i] = Vector(
            name=found.names.get(i, f"column {i}"),
            unit=found.units.get(i, ""),
            is_complex=True,
            read=partial(_complex, file, found, i),
        )
    functions, remarks = over_frequency([columns[i] for i in sorted(columns)])
    return functions, remarks, texts if functions else set()


def _values(rows: Read, place: int) -> Values:
    return np.concatenate([*(values for _, values in rows([place])), np.empty(0)])


def _complex(file: BinaryIO, found: Guess, column: int) -> npt.NDArray[np.complex128]:
    rows = (cut(line, found.delimiter) for line in _body(file, found))
    return np.array([number_of(row[column] if column < len(row) else "", found.marks.decimal) for row in rows])


def _body(file: BinaryIO, found: Guess, *, most: int | None = None) -> Iterator[str]:
    """Yield the lines of the rows."""
    file.seek(0)
    lines = lines_of(iter(lambda: file.read(_CHUNK), b""))
    rows = (line for line in islice(lines, found.header_lines, None) if line.strip())
    return islice((line for line in rows if not (found.comment and line.lstrip().startswith(found.comment))), most)


def _series(found: Guess, options: TableOptions, lines: Sequence[str]) -> list[Series]:
    time = found.time if options.time is None else options.time
    columns = {*found.numbers, *options.columns, *(() if time is None else (time,))}
    start = found.start if time == found.time else None
    if found.clock is not None and time == found.time:
        row = next(line for line in lines[found.header_lines :] if line.strip())
        cells = cut(row, found.delimiter)
        assert time is not None
        if found.clock != Clock() and time < len(cells) and is_stamp(cells[time]):
            start = found.clock.instant(float(found.clock.seconds([cells[time]])[0]))
    names = _distinct({i: found.names.get(i, f"column {i}") for i in sorted(columns)})
    return [
        Series(
            name=names[i],
            index=i,
            unit="s" if i == found.time and found.clock else found.units.get(i, ""),
            quantity=TIME_OF_DAY if i == found.time and found.clock == Clock() else "",
            sample_rate=None,
            start_time=start,
            role="time" if i == time else "counter" if i == found.counter else "channel",
            doubt=found.clock.doubt if i == found.time and found.clock else "",
        )
        for i in sorted(columns)
    ]


def _maker(found: Guess) -> list[str]:
    """Return what is to be said of a table that is laid out as TIA Portal of Siemens exports a trace."""
    names = found.names
    if (
        {found.time, found.counter} != {0, 1}
        or found.header_lines != 1
        or not any("." in name for name in names.values())
    ):
        return []
    sample, stamp = names.get(found.counter or 0, ""), names.get(found.time or 0, "")
    if not (_SAMPLE.match(sample) and _STAMP.match(stamp)):
        return []
    return [
        "it is laid out as TIA Portal (Siemens) exports a trace: sample numbers and instants, then each signal by its tag"
    ]


def _distinct(names: dict[int, str]) -> dict[int, str]:
    """Give a second column of the same name its number."""
    seen: set[str] = set()
    distinct = {}
    for i, name in names.items():
        distinct[i] = name if name not in seen else f"{name} (column {i})"
        seen.add(distinct[i])
    return distinct


def _is_clock(series: Series, found: Guess) -> bool:
    return series.index == found.time and found.clock is not None


__all__ = ["FormatError", "Known", "Marks", "TableOptions", "open_file"]
