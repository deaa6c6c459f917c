"""Delimited text as data acquisition programs write it, read as a stream: memory is bounded by one block of rows.

    line -> cells between delimiters -> the float64 of each wanted column

Which lines are header, what separates cells and marks decimals, and which columns hold the channels is said by an
import description; everything else in a line (sample numbers, clock times, event marks) is left unread. The values
are those of the file: scale and offset belong to the channel and are applied when it is read.
"""

from __future__ import annotations

import codecs
import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from api.formats import FormatError

BLOCK_ROWS = 8192
MAX_LINE_CHARACTERS = 1 << 20
"""A longer line is no text table: reading on would hold a binary file in memory."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_UTF16_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


@dataclass(frozen=True, slots=True, kw_only=True)
class TextLayout:
    """Where the numbers of a text file are.

    Parameters
    ----------
    columns : tuple of int
        Columns to read, from 0, in the order in which they come out.
    delimiter : str
        What stands between two cells. A blank stands for any run of blanks and tabs.
    decimal : str
        "." or ",".
    header_lines : int
        Lines before the first row of numbers.

    Raises
    ------
    FormatError
        For a layout that no file can have.
    """

    columns: tuple[int, ...]
    delimiter: str = ","
    decimal: str = "."
    header_lines: int = 0

    def __post_init__(self) -> None:
        if not self.columns:
            raise FormatError("columns must name at least one column, got none")
        if min(self.columns) < 0:
            raise FormatError(f"column index must be at least 0, got {min(self.columns)}")
        if self.decimal not in (".", ","):
            raise FormatError(f'decimal must be "." or ",", got {self.decimal!r}')
        if not self.delimiter or "\n" in self.delimiter or "\r" in self.delimiter:
            raise FormatError(f"delimiter must be text within a line, got {self.delimiter!r}")
        if self.delimiter == self.decimal:
            raise FormatError(f"delimiter must differ from decimal, got {self.delimiter!r} for both")
        if self.header_lines < 0:
            raise FormatError(f"header_lines must be at least 0, got {self.header_lines}")


def read(chunks: Iterable[bytes], layout: TextLayout) -> Iterator[npt.NDArray[np.float64]]:
    r"""Yield the wanted columns of a text file in blocks of rows.

    Parameters
    ----------
    chunks : iterable of bytes
        The file, cut anywhere. UTF-8 (with or without byte order mark), UTF-16 with byte order mark, or any
        superset of ASCII; LF, CRLF or CR line ends.
    layout : TextLayout
        Where the numbers are.

    Yields
    ------
    ndarray of float64, shape (rows <= 8192, len(layout.columns))
        Values as recorded, in the order of ``layout.columns``.

    Raises
    ------
    FormatError
        For a cell that is no finite number, a row with too few cells, a blank line between rows, a line of more than
        a million characters, or a file without a row. A recording with a hole is refused: filled or skipped samples
        would shift or bend what is computed from it.

    Examples
    --------
    >>> layout = TextLayout(columns=(1,), header_lines=1)
    >>> [block.tolist() for block in read([b"n, x\n1, 0.", b"5\n2, 0.25, stop\n"], layout)]
    [[[0.5], [0.25]]]
    """
    rows: list[list[float]] = []
    blank = 0
    found = False
    for number, line in enumerate(_lines(chunks), start=1):
        if number <= layout.header_lines:
            continue
        if not line.strip():
            blank = blank or number
            continue
        if blank:
            raise FormatError(f"line {blank} must hold a row of numbers, got a blank line", line=blank)
        rows.append(_row(line, number, layout))
        found = True
        if len(rows) == BLOCK_ROWS:
            yield np.array(rows)
            rows.clear()
    if rows:
        yield np.array(rows)
    if not found:
        raise FormatError(f"file must hold at least one row after {layout.header_lines} header lines, got none")


def _row(line: str, number: int, layout: TextLayout) -> list[float]:
    cells = line.split() if layout.delimiter == " " else line.split(layout.delimiter)
    values = []
    for column in layout.columns:
        if column >= len(cells):
            raise FormatError(
                f"line {number} must have a column {column} (counted from 0), got {len(cells)} columns",
                line=number,
                column=column,
            )
        values.append(_value(cells[column], number, column, layout.decimal))
    return values


def _value(cell: str, line: int, column: int, decimal: str) -> float:
    text = cell.strip()
    if text.startswith('"'):
        text = text.strip('"').strip()
    if decimal == ",":
        text = text.replace(".", "?").replace(",", ".")  # a point is no decimal mark here and must not pass as one
    if _NUMBER.fullmatch(text) is not None:
        value = float(text)
        if math.isfinite(value):
            return value
    raise FormatError(
        f"line {line}, column {column} must be a finite number, got {cell.strip()[:40]!r}", line=line, column=column
    )


def _lines(chunks: Iterable[bytes]) -> Iterator[str]:
    """Yield the lines of the file without their ends."""
    pending = ""
    for text in _decoded(chunks):
        lines = (pending + text).split("\n")
        pending = lines.pop()
        if len(pending) > MAX_LINE_CHARACTERS:
            raise FormatError(
                f"line must have at most {MAX_LINE_CHARACTERS} characters, got more: is this a text file?"
            )
        yield from lines
    if pending:
        yield pending


def _decoded(chunks: Iterable[bytes]) -> Iterator[str]:
    """Yield the file as text with LF line ends; only ASCII matters, so that a header in a local code page passes."""
    decoder: codecs.IncrementalDecoder | None = None
    head = b""
    carriage_return = False
    for chunk in chunks:
        head += chunk
        if decoder is None:
            if len(head) < 2:
                continue
            name = "utf-16" if head.startswith(_UTF16_MARKS) else "utf-8-sig"
            decoder = codecs.getincrementaldecoder(name)(errors="replace")
        text = decoder.decode(head)
        head = b""
        if carriage_return:
            text = "\r" + text
        # a CR at the end of a chunk may be half of a CRLF
        carriage_return = text.endswith("\r")
        if carriage_return:
            text = text[:-1]
        yield text.replace("\r\n", "\n").replace("\r", "\n")
    rest = head.decode("utf-8", errors="replace") if decoder is None else decoder.decode(b"", final=True)
    yield rest + ("\n" if carriage_return else "")
