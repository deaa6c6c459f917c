"""Text tables (csv, txt): the layout is that of the import description, what it leaves open is found out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import BinaryIO

import numpy as np

from api.formats import TIME_OF_DAY, FormatError, Recording, Series, Values
from api.formats.text.cells import Marks, cut
from api.formats.text.clock import Clock, is_stamp
from api.formats.text.endings import Rows
from api.formats.text.guess import Guess, Known, guess
from api.formats.text.txt import Lines, TextLayout, read

_HEAD = 1 << 18
_CHUNK = 1 << 20


@dataclass(frozen=True, slots=True, kw_only=True)
class TableOptions:
    """What is known of a table; None is to be found out."""

    known: Known = field(default_factory=Known)
    columns: Sequence[int] = ()
    missing: Sequence[str] | None = None
    time: int | None = None
    allow_truncated: bool = False


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
    left_out, said = ending.settle(allow_truncated=options.allow_truncated)

    def rows(wanted: Sequence[int]) -> Iterator[tuple[int, Values]]:
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
        file.seek(0)
        for block in read(iter(lambda: file.read(_CHUNK), b""), layout):
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
    refused = {found.names.get(i, f"column {i}"): why for i, why in found.refused.items() if i not in there}
    return Recording(
        series=series,
        read=rows,
        refused=refused,
        layout=layout,
        remarks=(*found.remarks, *said),
        stated_count=found.count,
    )


def _series(found: Guess, options: TableOptions, lines: Sequence[str]) -> list[Series]:
    time = found.time if options.time is None else options.time
    columns = {*found.numbers, *options.columns, *(() if time is None else (time,))}
    start = None
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
