"""What a text table is made of, told from its beginning: separator, decimal mark, header, names, units, time.

Every separator and decimal mark is tried; the best leaves the most cells of a row that are numbers, and the fewest that
are none. What is found is a proposal: it is shown before it is used, and any of it can be overruled.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from api.formats import FormatError
from api.formats.clock import Clock, Order, clock_for, is_stamp

DELIMITERS = ("\t", ";", ",", "|", " ")
_LOOK = 200
_NUMBER = {
    ".": re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?"),
    ",": re.compile(r"[+-]?(\d+,?\d*|,\d+)([eE][+-]?\d+)?"),
}
_MISSING = {"nan", "n/a", "na", "null", "none", "--", "-"}
_TIME_NAME = re.compile(r"(t|time|zeit|timestamp|x_value|abscissa|temps|tiempo|timp)\b", re.IGNORECASE)
_COUNTER_NAME = re.compile(r"(sample(\s*(number|no|nr|#))?|index|n|no|nr|row|record|#|lfd)\.?\s*", re.IGNORECASE)
_UNIT_OF_NAME = re.compile(r"(?P<name>.*?)\s*[\[(](?P<unit>[^\])]{0,30})[\])]\s*")
_RATE = re.compile(
    r"(?i)\b(sampl\w*[ _-]*(rate|freq\w*)|abtastrate)\W*?(?P<value>\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)\s*(?P<unit>[kM]?Hz)?"
)
_INTERVAL = re.compile(
    r"(?i)\b(sampl\w*[ _-]*(interval|period|time)|delta[ _]?[tx]|time[ _]?step)\W*?(?P<value>\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)"
    r"\s*(?P<unit>ms|us|µs|s)?"
)
_SCALE = {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6, "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6}


@dataclass(frozen=True, slots=True, kw_only=True)
class Guess:
    """The layout of a table.

    Parameters
    ----------
    numbers : tuple of int
        Columns of numbers, from 0.
    names, units : dict
        By column, where a header has them.
    time : int, optional
        Column of the instants; ``clock`` where they are times of day, otherwise they are numbers.
    counter : int, optional
        Column of sample numbers.
    sample_rate : float, optional
        Where the header states it.
    """

    delimiter: str
    decimal: str
    header_lines: int
    numbers: tuple[int, ...]
    names: dict[int, str]
    units: dict[int, str]
    time: int | None = None
    clock: Clock | None = None
    counter: int | None = None
    sample_rate: float | None = None
    missing: tuple[str, ...] = ()
    remarks: tuple[str, ...] = field(default=())


def guess(
    lines: Sequence[str],
    *,
    delimiter: str | None = None,
    decimal: str | None = None,
    header_lines: int | None = None,
    order: Order | None = None,
) -> Guess:
    """Return the layout of a table.

    Parameters
    ----------
    lines : sequence of str
        The beginning of the file, whole lines.
    delimiter, decimal, header_lines, order : optional
        What is known already.

    Raises
    ------
    FormatError
        When no line holds a number, however it is cut.
    """
    full = [line for line in lines if line.strip()]
    if not full:
        raise FormatError("file must hold rows of numbers, got none in its beginning")
    # the second half of a short file: its header may be longer than its rows are many
    sample = full[-min(_LOOK, max(len(full) // 2, 1)) :]
    best, cut = max(
        (
            (_score(sample, mark, point), (mark, point))
            for mark in ([delimiter] if delimiter else DELIMITERS)
            for point in ([decimal] if decimal else [".", ","])
            if mark != point
        ),
        key=lambda found: found[0],
        default=((0.0, 0.0), (",", ".")),
    )
    if best[0] <= 0.0:
        raise FormatError("file must hold rows of numbers, got none in its beginning: is this a text table?")
    mark, point = cut
    columns = _columns(sample, mark, point)
    begin = _first_row(lines, mark, point, columns) if header_lines is None else header_lines
    rows = [_cut(line, mark) for line in lines[begin:] if line.strip()]
    names, units = _names(lines[:begin], mark, 1 + max(columns, default=0))
    head = lines[:begin]
    time, clock, counter, remarks = _instants(rows, columns, names, point, order)
    missing = sorted({cell.strip() for row in rows for i, cell in enumerate(row) if i in columns and _is_missing(cell)})
    return Guess(
        delimiter=mark,
        decimal=point,
        header_lines=begin,
        numbers=tuple(columns),
        names=names,
        units=units,
        time=time,
        clock=clock,
        counter=counter,
        sample_rate=_stated_rate(head),
        missing=tuple(missing),
        remarks=tuple(remarks),
    )


def _cut(line: str, delimiter: str) -> list[str]:
    return line.split() if delimiter == " " else [cell.strip().strip('"').strip() for cell in line.split(delimiter)]


def _is_missing(cell: str) -> bool:
    return cell.strip().lower() in _MISSING


def _score(lines: Sequence[str], delimiter: str, decimal: str) -> tuple[float, float]:
    """Return how well a separator and decimal mark explain some rows: first the share of numbers, then their count."""
    number = _NUMBER[decimal]
    shares, counts = [], Counter[int]()
    for line in lines:
        cells = _cut(line, delimiter)
        while cells and not cells[-1]:
            cells.pop()
        found = sum(number.fullmatch(cell) is not None for cell in cells)
        known = found + sum(_is_missing(cell) or is_stamp(cell) for cell in cells)
        shares.append(known / max(len(cells), 1) if found else 0.0)
        counts[found] += 1
    del counts[0]  # lines of a header
    usual, times = counts.most_common(1)[0] if counts else (0, 0)
    return sum(shares) / len(shares) * times / len(lines) * usual**0.5, usual


def _columns(lines: Sequence[str], delimiter: str, decimal: str) -> list[int]:
    """Return the columns that are numbers in nearly every row."""
    number = _NUMBER[decimal]
    plain = Counter[int]()
    places: list[tuple[int, ...]] = []
    for line in lines:
        cells = list(enumerate(_cut(line, delimiter)))
        fitting = [i for i, cell in cells if number.fullmatch(cell) is not None]
        plain.update(fitting)
        places.append(tuple(sorted([*fitting, *(i for i, cell in cells if _is_missing(cell))])))
    # the lines of a header have their numbers elsewhere, if they have any
    usual = len(max((p for p in Counter(places).items() if p[0]), key=lambda p: p[1])[0])
    rows = [place for place in places if len(place) >= usual]
    hits = Counter(i for place in rows for i in place)
    return sorted(i for i, count in hits.items() if count >= 0.9 * len(rows) and plain[i])


def _first_row(lines: Sequence[str], delimiter: str, decimal: str, columns: Sequence[int]) -> int:
    number = _NUMBER[decimal]
    for i, line in enumerate(lines):
        cells = _cut(line, delimiter)
        if len(cells) > max(columns) and all(
            number.fullmatch(cells[column]) is not None or _is_missing(cells[column]) for column in columns
        ):
            return i
    return 0


def _names(head: Sequence[str], delimiter: str, width: int) -> tuple[dict[int, str], dict[int, str]]:
    """Return names and units by column from the last lines of the header that have as many cells as the rows."""
    fitting = [cells for line in head if len(cells := _cut(line, delimiter)) >= width and any(cells)]
    if not fitting:
        return {}, {}
    named, units = fitting[-1], dict[int, str]()
    if len(fitting) > 1 and all(re.fullmatch(r"[\[(].{0,30}[\])]|", cell) for cell in named):
        units = {i: cell.strip("[]()") for i, cell in enumerate(named)}
        named = fitting[-2]
    names = {}
    for i, cell in enumerate(named):
        match = _UNIT_OF_NAME.fullmatch(cell)
        names[i] = (match["name"] if match else cell)[:200]
        if match:
            units[i] = match["unit"].strip()
    return {i: name for i, name in names.items() if name}, {
        i: unit for i, unit in units.items() if unit not in {"", "-"}
    }


def _instants(
    rows: Sequence[Sequence[str]], columns: Sequence[int], names: dict[int, str], decimal: str, order: Order | None
) -> tuple[int | None, Clock | None, int | None, list[str]]:
    """Return the column of time, its clock where it is a time of day, the column of sample numbers, and remarks."""
    counter = next((i for i in columns if _is_counter(rows, i, names)), None)
    for i in range(min(map(len, rows), default=0)):
        if i not in columns and is_stamp(rows[0][i]):
            clock, remark = clock_for([row[i] for row in rows], order)
            return i, clock, counter, [remark] if remark else []
    rising = [i for i in columns if i != counter and _is_rising(rows, i, decimal)]
    named = [i for i in rising if _TIME_NAME.match(names.get(i, ""))]
    if named:
        return named[0], None, counter, []
    if rising[:1] == list(columns[:1]) and not names and len(columns) > 1:
        remark = f"column {rising[0]} rises from row to row: it is taken as the time in s (time.unit says otherwise)"
        return rising[0], None, counter, [remark]
    return None, None, counter, []


def _is_counter(rows: Sequence[Sequence[str]], column: int, names: dict[int, str]) -> bool:
    cells = [row[column] for row in rows if column < len(row)]
    if len(cells) < 2 or not all(cell.isdecimal() for cell in cells):
        return False
    steps = {int(b) - int(a) for a, b in pairwise(cells)}
    name = names.get(column, "")
    return steps == {1} and (_COUNTER_NAME.fullmatch(name) is not None or (column == 0 and not _TIME_NAME.match(name)))


def _is_rising(rows: Sequence[Sequence[str]], column: int, decimal: str) -> bool:
    try:
        values = [float(row[column].replace(decimal, ".")) for row in rows]
    except (ValueError, IndexError):
        return False
    return len(values) > 2 and all(b >= a for a, b in pairwise(values)) and values[-1] > values[0]


def _stated_rate(head: Sequence[str]) -> float | None:
    for line in head:
        if found := _RATE.search(line):
            return float(found["value"].replace(",", ".")) * _SCALE[found["unit"] or "Hz"] or None
    for line in head:
        if found := _INTERVAL.search(line):
            interval = float(found["value"].replace(",", ".")) * _SCALE[found["unit"] or "s"]
            return 1.0 / interval if interval else None
    return None
