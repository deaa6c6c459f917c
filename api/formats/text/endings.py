"""Whether a text table ends in the middle of a row.

A last line without a line end may be whole: some programs end no last line. It is cut where it has fewer cells than are
read, ends in something that is no number, is shorter than every row before it, or has fewer digits behind the decimal
mark than all of them, which have the same. Otherwise nobody can tell whether its last digits are missing.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import BinaryIO, Literal

from api.formats import FormatError
from api.formats.text.cells import Marks, cut
from api.formats.text.clock import is_stamp
from api.formats.text.txt import decode, encoding_of

_TAIL = 1 << 16
_ROWS = 200
_FEWEST = 8
"""Rows that must look alike before one that does not is called cut."""

State = Literal["ended", "whole", "doubtful", "cut"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ending:
    """The last line of a table, and what is known of it."""

    line: str
    state: State

    def settle(self, *, allow_truncated: bool) -> tuple[bool, list[str]]:
        """Return whether the last line is left out, with what must be said about it.

        Raises
        ------
        FormatError
            When it is cut and that is not allowed.
        """
        shown = self.line[-60:]
        if self.state in {"ended", "whole"}:
            return False, []
        if allow_truncated:
            return True, [f"the file ends without a line end: its last row ({shown!r}) is left out, it may be cut"]
        if self.state == "cut":
            raise FormatError(
                f"the file must end with a whole row, its last line is cut: {shown!r} "
                "(allow_truncated: true in import reads the rows before it)"
            )
        said = f"the file ends without a line end: nothing tells whether its last row ({shown!r}) is whole"
        return False, [f"{said}; allow_truncated: true in import leaves it out"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rows:
    """How the rows of a table are read.

    Parameters
    ----------
    last_column : int
        The last one that is read.
    delimiter : str
    marks : Marks
        How numbers are written.
    missing : sequence of str
        Cells that stand for a missing sample.
    header_lines : int
    """

    last_column: int
    delimiter: str
    marks: Marks
    missing: Sequence[str] = ()
    header_lines: int = 0

    def ending(self, file: BinaryIO) -> Ending:
        """Return how a table ends; ``file`` is left somewhere else."""
        file.seek(0)
        encoding = encoding_of(file.read(2))
        size = file.seek(0, 2)
        start = max(0, size - _TAIL) & ~1
        file.seek(start)
        text = decode(file.read(), encoding)
        lines = text.split("\n")[1 if start else self.header_lines :]
        if not lines or not lines[-1].strip():
            return Ending(line="", state="ended")
        before = [line for line in lines[-1 - _ROWS : -1] if line.strip()]
        return Ending(line=lines[-1], state=self._state(lines[-1], before))

    def _state(self, last: str, before: Sequence[str]) -> State:
        cells = cut(last, self.delimiter)
        if last.count('"') % 2 or len(cells) <= self.last_column:
            return "cut"
        if len(cells) > self.last_column + 1:
            return "whole"  # a separator follows the last cell that is read
        cell = cells[self.last_column]
        if self.marks.value(cell) is None and not is_stamp(cell):
            # a minus alone is the beginning of a number, and an empty cell has not begun
            return "doubtful" if cell in self.missing and len(cell) > 1 else "cut"
        return self._compared(last, cell, before)

    def _compared(self, last: str, cell: str, before: Sequence[str]) -> State:
        """Compare a last line, which ends in a number, with the rows before it."""
        rows = (cut(line, self.delimiter) for line in before)
        shapes = {_shape(cells[self.last_column], self.marks) for cells in rows if len(cells) > self.last_column}
        if len(before) < _FEWEST:
            return "doubtful"
        shape, usual = _shape(cell, self.marks), next(iter(shapes), "")
        fixed = len(shapes) == 1 and usual
        if fixed and shape == usual:
            return "whole"
        if len(last) < min(map(len, before)) or (fixed and usual.startswith(shape)):
            return "cut"
        return "doubtful"


def _shape(cell: str, marks: Marks) -> str:
    """Return the shape of what follows the decimal mark: 999e+99 for 1.234e-05, "" for a whole number."""
    return re.sub("[+-]", "+", re.sub(r"\d", "9", cell.partition(marks.decimal)[2]))
