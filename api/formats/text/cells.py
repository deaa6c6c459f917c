"""Cells of text tables: how a line is cut into them, and which number stands in one.

1.234,56  ->  1234.56   where "," marks decimals and "." thousands
"""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass, field

MISSING = ("", "NaN")
"""Cells that stand for a missing sample unless an import description says otherwise."""
SWITCHES = {"true": 1.0, "false": 0.0}
"""What states are written as, in any case of letters."""
_WORDS = {"", "nan", "n/a", "na", "#n/a", "null", "none", "--", "-"}

WHOLE = re.compile(r"([+-]?\d{1,308})(?:\.0*)?")  # with more digits it is no finite float64
_DECIMALS = {".": r"\.", ",": ","}
_THOUSANDS = {".": r"\.", ",": ",", "'": "['’]", " ": "[ \u00a0\u202f]"}
_REMOVED = str.maketrans("", "", "'’ \u00a0\u202f")


def cut(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line, without what surrounds them; a blank stands for any run of blanks and tabs."""
    if delimiter == " ":
        return [cell.strip('"') for cell in line.split()]
    if '"' in line and len(delimiter) == 1:
        try:
            cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
        except csv.Error:  # a cell of more than 128 kB
            cells = line.split(delimiter)
        return [cell.strip() for cell in cells]
    return [cell.strip().strip('"').strip() for cell in line.split(delimiter)]


def is_word_for_missing(cell: str) -> bool:
    """Say whether a cell is empty or one of the usual words for a missing sample."""
    return cell.lower() in _WORDS


@dataclass(frozen=True, slots=True, kw_only=True)
class Marks:
    """How numbers are written.

    Parameters
    ----------
    decimal : str
        "." or ",".
    thousands : str
        What may stand between groups of three digits: ".", ",", "'", a blank (also one that does not break), or "" for
        nothing. Groups must be of three digits and not begin with 0: 0.123 is none of 123.
    """

    decimal: str = "."
    thousands: str = ""
    _plain: re.Pattern[str] = field(init=False, repr=False, compare=False)
    _grouped: re.Pattern[str] | None = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        mark = _DECIMALS[self.decimal]
        group = _THOUSANDS.get(self.thousands)
        grouped = re.compile(rf"[+-]?[1-9]\d{{0,2}}(?:{group}\d{{3}})+(?:{mark}\d*)?") if group else None
        object.__setattr__(self, "_plain", re.compile(rf"[+-]?(?:\d+{mark}?\d*|{mark}\d+)(?:[eE][+-]?\d+)?"))
        object.__setattr__(self, "_grouped", grouped)

    def value(self, cell: str) -> float | None:
        """Return the number in a cell, None where it is no finite number."""
        if (state := SWITCHES.get(cell.lower())) is not None:
            return state
        text = self._written(cell)
        value = math.nan if text is None else float(text)
        return value if math.isfinite(value) else None

    def whole(self, cell: str) -> int | None:
        """Return the whole number that a cell writes out digit by digit, None where it holds anything else."""
        match = WHOLE.fullmatch(self._written(cell) or "")
        return int(match[1]) if match else None

    def _written(self, cell: str) -> str | None:
        """Return the number in a cell with a decimal point and without separated thousands, None where it is none."""
        text = cell.replace("\u2212", "-")
        if self._plain.fullmatch(text) is None:
            if self._grouped is None or self._grouped.fullmatch(text) is None:
                return None
            text = text.translate(_REMOVED) if self.thousands in "' " else text.replace(self.thousands, "")
        return text.replace(self.decimal, ".")


def all_marks(decimal: str) -> tuple[Marks, ...]:
    """Return all ways to write numbers with a decimal mark; the one without groups comes first."""
    return tuple(Marks(decimal=decimal, thousands=mark) for mark in ("", *_THOUSANDS) if mark != decimal)


def thousands_of(cell: str, decimal: str) -> str | None:
    """Return what separates thousands in a cell: "" where nothing does, None where the cell is no number."""
    return next((marks.thousands for marks in _ALL[decimal] if marks.value(cell) is not None), None)


_ALL = {decimal: all_marks(decimal) for decimal in _DECIMALS}
