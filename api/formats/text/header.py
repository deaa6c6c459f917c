"""What the lines above the rows of a text table say: names and units of its columns, a sample rate."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from api.formats.text.cells import cut
from api.units.conversion import UnitError, known

COMMENTS = ("#", "%", "//", "!")
"""What a line begins with that is none of the table."""

TIME_NAME = re.compile(r"(t|time|zeit|timestamp|x_value|abscissa|temps|tiempo|timp)\b", re.IGNORECASE)

_BRACKETS = re.compile(r"(?P<name>.*?)\s*[\[(](?P<unit>[^\])]{0,30})[\])]\s*")
_FRACTION = re.compile(r"(?P<name>[^/]+?)\s*/\s*(?P<unit>[^/\s]+(?:/[^/\s]+)?)")
_WORD = re.compile(r"(?P<name>.+?)\s+in\s+(?P<unit>\S+)")
_RATE = re.compile(
    r"(?i)\b(sampl\w*[ _-]*(rate|freq\w*)|abtastrate)\W*?(?P<value>\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)\s*(?P<unit>[kM]?Hz)?"
)
_INTERVAL = re.compile(
    r"(?i)\b(sampl\w*[ _-]*(interval|period|time)|delta[ _]?[tx]|time[ _]?step)\W*?(?P<value>\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)"
    r"\s*(?P<unit>ms|us|µs|s)?"
)
_COUNT = re.compile(
    r"(?i)\b(?:(?:sample|point|row|value)s?[ _-]*count|number of (?:samples|points|rows|values)|anzahl (?:der )?(?:werte|messwerte|punkte))"
    r"\W*(?P<value>\d{1,12})\W*"
)
_SCALE = {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6, "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6}
_NO_UNIT = {"", "-", "--", "1", "[]", "()", "[-]", "(-)"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """Names and units by column, where there are any, and sentences on where they were found."""

    names: Mapping[int, str] = field(default_factory=dict)
    units: Mapping[int, str] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()


def uncommented(line: str) -> str:
    """Return a line without the mark of a comment before it."""
    return line.lstrip().lstrip("#%!").removeprefix("//").strip(" ")


def header_of(lines: Sequence[str], delimiter: str, columns: Sequence[int]) -> Header:
    """Return the names and units of columns, from the last lines that have as many cells as the rows.

    Units stand in a line of their own below the names, in brackets or bare, or behind each name: ``F [N]``, ``F (N)``,
    ``F/N``, ``F in N``. The last two count only where all columns have them, and known ones.
    """
    width = 1 + max(columns, default=0)
    fitting = [
        (number, cells)
        for number, line in enumerate(lines, start=1)
        if len(cells := cut(uncommented(line), delimiter)) >= width and any(cells)
    ]
    if not fitting:
        return Header()
    for above, (number, cells) in zip(reversed(fitting[:-1]), reversed(fitting[1:]), strict=True):
        if _are_units_below([cells[i] for i in columns], [above[1][i] for i in columns]):
            units = {i: cell.strip("[]()").strip() for i, cell in enumerate(cells) if cell not in _NO_UNIT}
            said = delimiter.join(cells).strip()[:60]
            names = {i: _split(cell, _BRACKETS)[0] for i, cell in enumerate(above[1])}
            return Header(
                names={i: name for i, name in names.items() if name},
                units=units,
                remarks=(
                    f"line {number} ({said}) is taken as the units of the columns, line {above[0]} as their names",
                ),
            )
    cells = fitting[-1][1]
    split = {i: _split(cell, _BRACKETS) for i, cell in enumerate(cells)}
    if not any(unit for _, unit in split.values()):
        for form in (_FRACTION, _WORD):
            tried = {i: _split(cells[i], form) for i in columns}
            if all(name and _is_unit(unit) for name, unit in tried.values()):
                split |= tried
                break
    return Header(
        names={i: name for i, (name, _) in split.items() if name},
        units={i: unit for i, (_, unit) in split.items() if unit not in _NO_UNIT},
    )


def _split(cell: str, form: re.Pattern[str]) -> tuple[str, str]:
    match = form.fullmatch(cell)
    return (match["name"].strip()[:200], match["unit"].strip()) if match else (cell[:200], "")


def _is_unit(text: str) -> bool:
    if not text or (text[0].isdigit() and not text.startswith("1/")):
        return False
    for candidate in (text, text.lower()):
        try:
            known(candidate)
        except UnitError:
            continue
        return True
    return False


def _are_units(cells: Sequence[str]) -> bool:
    """Say whether some cells are units: all in brackets or empty, or all known and at least one not empty."""
    if all(re.fullmatch(r"[\[(].{0,30}[\])]|", cell) for cell in cells):
        return any(cells)
    return all(cell in _NO_UNIT or _is_unit(cell.strip("[]()")) for cell in cells) and any(
        cell not in _NO_UNIT for cell in cells
    )


def _are_units_below(cells: Sequence[str], above: Sequence[str]) -> bool:
    """Say whether some cells are units of the names above them.

    A name may look like a unit (t is a tonne, F a farad): one of time does where nothing above it is a time.
    """
    if not _are_units(cells) or not all(cell and not re.fullmatch(r"[+-]?[\d.,]+", cell) for cell in above):
        return False
    return any(map(TIME_NAME.match, above)) or not any(map(TIME_NAME.match, cells))


def stated_rate(lines: Sequence[str]) -> float | None:
    """Return the samples per second that a header states."""
    for line in lines:
        if found := _RATE.search(line):
            return float(found["value"].replace(",", ".")) * _SCALE[found["unit"] or "Hz"] or None
    for line in lines:
        if found := _INTERVAL.search(line):
            interval = float(found["value"].replace(",", ".")) * _SCALE[found["unit"] or "s"]
            return 1.0 / interval if interval else None
    return None


def stated_count(lines: Sequence[str]) -> int | None:
    """Return how many samples a header says that there are."""
    return next((int(found["value"]) for line in lines if (found := _COUNT.fullmatch(line.strip()))), None)
