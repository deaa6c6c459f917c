"""What a text table is made of, told from its beginning: separator, decimal mark, header, names, units, time.

Every separator and decimal mark is tried; the best leaves the most cells of a row that are numbers, and the fewest that
are none. What is found is a proposal: it is shown before it is used, and any of it can be overruled.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from itertools import pairwise

from api.formats import (
    FormatError,
    text_reason,
)
from api.formats.spectral.names import frequency_scale
from api.formats.text.cells import MISSING, Marks, cut, is_word_for_missing, thousands_of
from api.formats.text.clock import Clock, Order, clock_for, is_stamp
from api.formats.text.epochs import epoch_of
from api.formats.text.header import COMMENTS, TIME_NAME, Header, header_of, stated_count, stated_rate
from api.formats.text.named_time import is_called_time, why_no_time

DELIMITERS = ("\t", ";", ",", "|", " ")
_LOOK = 200
_LONGEST_COUNT = 20
"""Digits that no counter has: Python reads no whole number of more than 4300."""
_COUNTER_NAME = re.compile(r"(sample(\s*(number|no|nr|#))?|index|n|no|nr|row|record|#|lfd)\.?\s*", re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Guess:
    """The layout of a table.

    Parameters
    ----------
    marks : Marks
        How its numbers are written.
    comment : str
        What lines begin with that are none of its rows, "" where there are none.
    numbers : tuple of int
        Columns of numbers, from 0.
    refused : dict
        What other columns hold, by column.
    names, units : dict
        By column, where a header has them.
    time : int, optional
        Column of the instants; ``clock`` where they are times of day, otherwise they are numbers.
    start : datetime, optional
        Of the first row, where instants that are numbers count from 1970.
    counter : int, optional
        Column of sample numbers.
    sample_rate, count : optional
        Samples per second, and of each channel, where the header states them.
    missing : tuple of str
        Cells that stand for a missing sample.
    usual : int
        Cells of most rows.
    untimed : str
        Why a column that is called a time has no instants, "" where one has them or none is called so.
    """

    delimiter: str
    marks: Marks
    header_lines: int
    numbers: tuple[int, ...]
    names: Mapping[int, str]
    units: Mapping[int, str]
    comment: str = ""
    refused: Mapping[int, str] = field(default_factory=dict)
    time: int | None = None
    clock: Clock | None = None
    start: datetime | None = None
    counter: int | None = None
    sample_rate: float | None = None
    count: int | None = None
    missing: tuple[str, ...] = MISSING
    usual: int = 0
    untimed: str = ""
    remarks: tuple[str, ...] = field(default=())


@dataclass(frozen=True, slots=True, kw_only=True)
class Known:
    """What is known of a table before it is looked at; None is to be found out."""

    delimiter: str | None = None
    decimal: str | None = None
    thousands: str | None = None
    comment: str | None = None
    header_lines: int | None = None
    order: Order | None = None


def guess(lines: Sequence[str], given: Known) -> Guess:
    """Return the layout of a table.

    Parameters
    ----------
    lines : sequence of str
        The beginning of the file, whole lines.
    given : Known
        What is known already.

    Raises
    ------
    FormatError
        When no line holds a number, however it is cut.
    """
    full = [line for line in lines if line.strip()]
    if not full:
        raise FormatError("file must hold rows of numbers, got none in its beginning: is it empty, or another format?")
    # the second half of a short file: its header may be longer than its rows are many
    sample = full[-min(_LOOK, max(len(full) // 2, 1)) :]
    mark, decimal = _separators(sample, given, first=lines[0])
    columns = _columns(sample, mark, decimal)
    begin = _first_row(lines, mark, decimal, columns) if given.header_lines is None else given.header_lines
    comment = _comment(lines[begin:]) if given.comment is None else given.comment
    rows = [cut(line, mark) for line in lines[begin:] if line.strip() and not (comment and _is_comment(line, comment))]
    thousands = _thousands(rows, columns, decimal) if given.thousands is None else given.thousands
    marks = Marks(decimal=decimal, thousands=thousands)
    header = header_of(lines[:begin], mark, columns)
    crowded = _crowded(lines[:begin], rows, columns, mark) if given.delimiter is None else []
    time, clock, counter, remarks = _instants(rows, columns, header, marks, given.order)
    units, start, dated = _dated(rows, time if clock is None else None, header, marks)
    missing = {cell for row in rows for i in columns if i < len(row) and is_word_for_missing(cell := row[i])}
    return Guess(
        delimiter=mark,
        marks=marks,
        comment=comment,
        header_lines=begin,
        numbers=tuple(columns),
        refused=_others(rows, {*columns, time}),
        names=header.names,
        units=units,
        time=time,
        clock=clock,
        start=start,
        counter=counter,
        sample_rate=stated_rate(lines[:begin]),
        count=stated_count(lines[:begin]),
        missing=tuple(sorted({*MISSING, *missing})),
        usual=Counter(map(len, rows)).most_common(1)[0][0] if rows and given.delimiter is None else 0,
        untimed=why_no_time(rows, columns, header, marks) if time is None else "",
        remarks=(*header.remarks, *crowded, *_doubtful(rows, columns, marks, given), *remarks, *dated),
    )


def _separators(sample: Sequence[str], given: Known, *, first: str) -> tuple[str, str]:
    """Return what stands between cells and what marks decimals."""
    said = re.fullmatch(r"sep=(.)", first.strip(), re.IGNORECASE)  # the first line of Excel's own tables
    asked = given.delimiter or (said and said[1])
    quoted = any('"' in line for line in sample)
    # a line of tabs has blanks within its cells only
    marks = [mark for mark in DELIMITERS if mark != " " or not all("\t" in line for line in sample)]
    tried = [
        (_score(sample, mark, point, 0.85 if mark == point else 1.0), (mark, point))
        for mark in ([asked] if asked else marks)
        for point in ([given.decimal] if given.decimal else [".", ","])
        if mark != point or quoted  # "1,5","2,5": quotes keep a decimal comma from being a separator
    ]
    best, found = max(tried, key=lambda one: one[0], default=((0.0, 0.0), (",", ".")))
    if best[0] <= 0.0:
        raise FormatError(
            f"file must hold rows of numbers, got none in its beginning ({first.strip()[:60]!r} ...): was nothing recorded, or is this no text table?"
        )
    return found


def _score(lines: Sequence[str], delimiter: str, decimal: str, weight: float) -> tuple[float, float]:
    """Return how well a separator and decimal mark explain some rows: first the share of numbers, then their count.

    A comma within quotes between commas is rather one of thousands, where it may be: the weight of a decimal one is less.

    A number with separated thousands counts a little less, so that 1,234 is the simpler of its two readings.
    """
    shares, counts = [], Counter[int]()
    for line in lines:
        cells = cut(line, delimiter)
        full = [cell for cell in cells if cell]
        written = [thousands_of(cell, decimal) for cell in full]
        found = sum(1.0 if separator == "" else 0.9 for separator in written if separator is not None)
        words = sum(is_word_for_missing(cell) or is_stamp(cell) for cell in full)
        shares.append((found + words) / len(full) if found else 0.0)
        counts[len(written) - written.count(None) + sum(is_word_for_missing(cell) for cell in cells)] += bool(found)
    usual, times = counts.most_common(1)[0] if counts else (0, 0)
    return weight * sum(shares) / len(shares) * times / len(lines) * usual**0.5, usual


def _is_number(cell: str, decimal: str) -> bool:
    return thousands_of(cell, decimal) is not None


def _columns(lines: Sequence[str], delimiter: str, decimal: str) -> list[int]:
    """Return the columns that are numbers, or nothing, in nearly every row."""
    plain = Counter[int]()
    places: list[tuple[int, ...]] = []
    for line in lines:
        cells = list(enumerate(cut(line, delimiter)))
        fitting = [i for i, cell in cells if _is_number(cell, decimal)]
        plain.update(fitting)
        places.append(tuple(sorted([*fitting, *(i for i, cell in cells if is_word_for_missing(cell))])))
    # the lines of a header have their numbers elsewhere, if they have any
    usual = len(max((p for p in Counter(places).items() if p[0]), key=lambda p: p[1])[0])
    rows = [place for place in places if len(place) >= usual]
    hits = Counter(i for place in rows for i in place)
    return sorted(i for i, count in hits.items() if count >= 0.9 * len(rows) and plain[i])


def _first_row(lines: Sequence[str], delimiter: str, decimal: str, columns: Sequence[int]) -> int:
    """Return the number of lines before the first row, which may have cells without a number."""

    def cells_of(line: str) -> list[str]:
        cells = cut(line, delimiter)
        return [cells[column] for column in columns] if len(cells) > max(columns) else []

    def fits(line: str, share: float) -> bool:
        cells = cells_of(line)
        numbers = sum(_is_number(cell, decimal) for cell in cells)
        return numbers > share * len(columns) and all(
            _is_number(cell, decimal) or is_word_for_missing(cell) for cell in cells
        )

    first = next((i for i, line in enumerate(lines) if fits(line, 0.5)), 0)
    while (
        first
        and fits(lines[first - 1], 0.0)
        and len(cut(lines[first - 1], delimiter)) == len(cut(lines[first], delimiter))
    ):
        first -= 1
    return first


def _is_comment(line: str, mark: str) -> bool:
    return line.lstrip(' \t"').startswith(mark)


def _comment(lines: Sequence[str]) -> str:
    """Return what lines between the rows begin with that are none, "" where there are none."""
    return next((mark for mark in COMMENTS for line in lines if _is_comment(line, mark)), "")


def _thousands(rows: Sequence[Sequence[str]], columns: Sequence[int], decimal: str) -> str:
    found = {thousands_of(row[i], decimal) or "" for row in rows for i in columns if i < len(row)} - {""}
    if len(found) > 1:
        raise FormatError(
            f"thousands must be separated in one way, got {' and '.join(map(repr, sorted(found)))}: say thousands in import"
        )
    return next(iter(found), "")


def _doubtful(rows: Sequence[Sequence[str]], columns: Sequence[int], marks: Marks, given: Known) -> list[str]:
    """Return a remark where all decimal marks may as well be those of thousands: 1.234 alone tells neither."""
    if given.decimal is not None or given.thousands is not None or marks.thousands not in {"", ".", ","}:
        return []
    mark = marks.thousands or marks.decimal
    cells = [row[i] for row in rows for i in columns if i < len(row)]
    marked = [cell for cell in cells if mark in cell]
    if not marked or not all(re.fullmatch(r"[+-]?[1-9]\d{0,2}[.,]\d{3}", cell) for cell in marked):
        return []
    if marks.thousands and any(marks.decimal in cell for cell in cells):
        return []
    read, other = (
        ("separating thousands", "marks decimals")
        if marks.thousands
        else ("as the decimal mark", "separates thousands")
    )
    return [f"{marked[0]} is read with {mark!r} {read}; where it {other}, say decimal and thousands in import"]


def _crowded(head: Sequence[str], rows: Sequence[Sequence[str]], columns: Sequence[int], mark: str) -> list[str]:
    """Return a remark where rows have more cells than the line above them has names.

    Raises
    ------
    FormatError
        Where commas separate cells and stand in the numbers, too: nobody can tell 1,234 from two cells.
    """
    named = [cell for cell in cut(head[-1], mark) if cell] if head else []
    width = len(columns)
    if (
        mark == " "
        or len(named) < 2
        or width <= len(named)
        or any(thousands_of(cell, ".") is not None for cell in named)
    ):
        return []
    said = f"line {len(head)} names {len(named)} columns, the rows have {width} of numbers"
    cells = [[row[i] for row in rows if i < len(row)] for i in columns]
    whole = all(cell.lstrip("+-").isdecimal() or not cell for column in cells for cell in column)
    grouped = any(
        all(
            re.fullmatch(r"\d{3}(?:\.\d*)?", b) and re.fullmatch(r"[+-]?[1-9]\d{0,2}", a)
            for a, b in zip(*two, strict=False)
        )
        for two in pairwise(cells)
    )
    if mark == "," and (grouped or (whole and width == 2 * len(named))):
        raise FormatError(
            f"{said}: commas stand in the numbers and between them; save it with another separator, or with quotes around "
            "the cells (where it is right, say delimiter in import)"
        )
    return [f"{said}: is {mark!r} what separates them?"]


def _others(rows: Sequence[Sequence[str]], taken: set[int | None]) -> dict[int, str]:
    """Return why further columns are no channels."""
    others = {}
    for i in range(min(max(map(len, rows), default=0), 10_000)):
        cells = [row[i] for row in rows if i < len(row) and row[i]]
        if i not in taken and cells:
            others[i] = text_reason(cells[0]) + " (cells that stand for a missing sample are named in missing)"
    return others


def _instants(
    rows: Sequence[Sequence[str]],
    columns: Sequence[int],
    header: Header,
    marks: Marks,
    order: Order | None,
) -> tuple[int | None, Clock | None, int | None, list[str]]:
    """Return the column of time, its clock where it is a time of day, the column of sample numbers, and remarks."""
    names, units = header.names, header.units
    counter = next((i for i in columns if _is_counter(rows, i, names, units)), None)
    for i in range(min(map(len, rows), default=0)):
        if i not in columns and is_stamp(rows[0][i]):
            return i, clock_for([row[i] for row in rows], order), counter, []
    rising = [i for i in columns if i != counter and _is_rising(rows, i, marks)]
    named = [i for i in rising if is_called_time(i, header)]
    if named:
        return named[0], None, counter, []
    rising = rising if len(rows) > 2 else []
    if rising[:1] == list(columns[:1]) and not names and len(columns) > 1:
        remark = f"column {rising[0]} rises from row to row: it is taken as the time in s (time.unit says otherwise)"
        return rising[0], None, counter, [remark]
    return None, None, counter, []


def _dated(
    rows: Sequence[Sequence[str]], time: int | None, header: Header, marks: Marks
) -> tuple[Mapping[int, str], datetime | None, list[str]]:
    """Return the units, the date of the first row and a remark where instants that are numbers count from 1970."""
    cell = "" if time is None else next((row[time] for row in rows if time < len(row)), "")
    first = marks.value(cell)
    found = None if time is None or first is None else epoch_of(first, header.units.get(time, ""))
    if time is None or found is None:
        return header.units, None, []
    unit, start = found
    said = f"instants such as {cell} are taken as {unit} since 1970 (UTC): the first is {start.isoformat()}"
    return {**header.units, time: unit}, start, [said]


def _is_counter(rows: Sequence[Sequence[str]], column: int, names: Mapping[int, str], units: Mapping[int, str]) -> bool:
    cells = [row[column] for row in rows if column < len(row)]
    if len(cells) < 2 or not all(cell.isdecimal() and len(cell) < _LONGEST_COUNT for cell in cells):
        return False
    steps = {int(b) - int(a) for a, b in pairwise(cells)}
    name, unit = names.get(column, ""), units.get(column, "")
    # 1, 2, 3 ... Hz are lines
    is_plain = column == 0 and not unit and not TIME_NAME.match(name) and frequency_scale(name, unit) is None
    return steps == {1} and (_COUNTER_NAME.fullmatch(name) is not None or is_plain)


def _is_rising(rows: Sequence[Sequence[str]], column: int, marks: Marks) -> bool:
    values = [marks.value(row[column]) for row in rows if column < len(row)]
    known = [value for value in values if value is not None]
    return (
        len(values) == len(rows) and len(known) == len(values) > 1 and known[-1] > known[0] and sorted(known) == known
    )
