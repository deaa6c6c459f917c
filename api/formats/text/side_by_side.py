"""Columns side by side in one text, each as long as it is and with its own instants: empty cells follow the shorter ones.

samples of a column = its cells in those rows in which the column of its instants has one
"""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from api.formats import PIECE, FormatError, Values
from api.formats.exactness import EXACT, inexact_whole
from api.formats.text.cells import WHOLE

_BLOCK = PIECE // 16
_WORDS = {"TRUE": 1.0, "FALSE": 0.0}

Row = tuple[int, str]
"""Number of a line in its file, and the line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """Where the samples of a channel are.

    Parameters
    ----------
    cell : int
        From 0 in each row.
    axis : int, optional
        Cell of its instants; where that is empty, the row is none of this column's.
    origin : int
        What is taken from whole numbers before they are rounded to float64: instants since 1601 have more digits.
    divisor : int
        What is left of them is divided by it.
    """

    cell: int
    axis: int | None = None
    origin: int = 0
    divisor: int = 1


@dataclass(slots=True, kw_only=True)
class Seen:
    """What a first reading of a column found: its samples, the first and the last one, and a mark of all of them."""

    count: int = 0
    first: float = math.nan
    last: float = math.nan
    digest: bytes = b""


@dataclass(frozen=True, slots=True, kw_only=True)
class SideBySide:
    """Rows whose columns have lengths of their own.

    Parameters
    ----------
    rows : callable
        Begins reading them.
    delimiter : str
    decimal_commas : bool
        Whether a comma marks decimals; a point does always.
    remedy : str
        What to do about a cell that is no number.
    rounded : dict
        By cell, how many whole numbers there float64 does not hold, as far as they have been read.
    """

    rows: Callable[[], Iterator[Row]]
    delimiter: str
    decimal_commas: bool
    remedy: str = ""
    rounded: dict[int, int] = field(default_factory=dict)
    _seen: dict[int, Seen] = field(default_factory=dict)

    def scan(self, columns: Sequence[Column]) -> Mapping[int, Seen]:
        """Read columns once; return what was found by cell. A column without instants ends with its last full cell."""
        digests = {one.cell: hashlib.sha256() for one in columns}
        passed = dict.fromkeys(digests, 0)
        for cell, values in self._pieces(columns):
            seen = self._seen.setdefault(cell, Seen())
            there = np.flatnonzero(~np.isnan(values))
            if there.size:
                seen.first = float(values[there[0]]) if math.isnan(seen.first) else seen.first
                seen.last = float(values[there[-1]])
                seen.count = passed[cell] + int(there[-1]) + 1
            passed[cell] += values.size
            digests[cell].update(values.tobytes())
        for one in columns:
            seen = self._seen.setdefault(one.cell, Seen())
            seen.digest = digests[one.cell].digest()
            if one.axis is not None:
                seen.count = passed[one.cell]
        return self._seen

    def read(self, columns: Sequence[Column]) -> Iterator[tuple[int, Values]]:
        """Yield the place of a column in what was asked for, and its next samples; empty cells are missing ones."""
        left = {one.cell: self._seen[one.cell].count for one in columns if one.cell in self._seen}
        places: dict[int, list[int]] = {}
        for place, one in enumerate(columns):
            places.setdefault(one.cell, []).append(place)
        for cell, values in self._pieces(columns):
            part = values[: left.get(cell, values.size)]
            if cell in left:
                left[cell] -= part.size
            if part.size:
                for place in places[cell]:
                    yield place, part

    def _pieces(self, columns: Sequence[Column]) -> Iterator[tuple[int, Values]]:
        once = {one.cell: one for one in columns}
        cells = sorted({*once, *(one.axis for one in columns if one.axis is not None)})
        whole = {cell: one for cell, one in once.items() if one.origin}
        rows, rounded = self.rows(), Counter[int]()
        while block := [row for _, row in zip(range(_BLOCK), rows, strict=False)]:
            grid = self._grid(block, cells, whole)
            for cell, one in once.items():
                values = grid[:, cells.index(cell)]
                rounded[cell] += self._rounded(block, cell, values) if cell not in whole else 0
                self.rounded[cell] = max(self.rounded.get(cell, 0), rounded[cell])
                if one.axis is not None:
                    values = values[~np.isnan(grid[:, cells.index(one.axis)])]
                yield cell, np.ascontiguousarray(values)

    def _rounded(self, block: Sequence[Row], cell: int, values: Values) -> int:
        """Return how many whole numbers of a column float64 does not hold."""
        texts = (block[row][1].split(self.delimiter)[cell] for row in np.flatnonzero(np.abs(values) >= EXACT).tolist())
        matches = (WHOLE.fullmatch(text.strip().replace(",", ".")) for text in texts)
        return inexact_whole(int(match[1]) if match else None for match in matches)

    def _grid(self, block: Sequence[Row], cells: Sequence[int], whole: Mapping[int, Column]) -> Values:
        """Return the wanted cells of some rows, NaN where one is empty."""
        lines = [line.replace(",", ".") if self.decimal_commas else line for _, line in block]
        if not whole:
            try:
                values = np.loadtxt(lines, delimiter=self.delimiter, usecols=cells, comments=None, ndmin=2)
                if len(values) == len(lines):
                    return values
            except ValueError:
                pass
        found = np.empty((len(lines), len(cells)))
        for i, line in enumerate(lines):
            there = line.split(self.delimiter)
            for j, cell in enumerate(cells):
                text = there[cell].strip() if cell < len(there) else ""
                found[i, j] = self._value(text, whole.get(cell), block[i][0], cell)
        return found

    def _value(self, text: str, whole: Column | None, line: int, cell: int) -> float:
        if not text:
            return math.nan
        try:
            if whole is not None:
                return (int(text) - whole.origin) / whole.divisor
            return _WORDS[text.upper()] if text.upper() in _WORDS else float(text.replace("_", "?"))
        except ValueError as error:
            raise FormatError(
                f"line {line}, column {cell} must be a number or empty, got {text[:40]!r}{self.remedy}",
                line=line,
                column=cell,
            ) from error
