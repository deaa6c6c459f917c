"""Delimited text as data acquisition programs write it, read as a stream: memory is bounded by one block of rows.

    line -> cells between delimiters -> the float64 of each wanted column

Which lines are header, what separates cells and marks decimals, and which columns hold the channels is said by an
import description; everything else in a line (sample numbers, event marks) is left unread. The values are those of the
file: scale and offset belong to the channel and are applied when it is read.

A block of rows goes through numpy's parser; where that has anything to complain about, the rows are read again one by
one, which is slow and names what is wrong.
"""

from __future__ import annotations

import codecs
import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from api.formats import FormatError
from api.formats.exactness import EXACT, inexact_whole
from api.formats.text.cells import SWITCHES, Marks, cut
from api.formats.text.clock import Clock

BLOCK_ROWS = 8192
MAX_LINE_CHARACTERS = 1 << 20
"""A longer line is no text table: reading on would hold a binary file in memory."""

_HEAD_OF_GROUPS, _GROUP = re.compile(r"[+-]?[1-9]\d{0,2}"), re.compile(r"\d{3}(?:\.\d*)?")
_FEW = 32
"""Rows that are read one by one where they cannot be read together."""
_SWITCH = re.compile(rf"(?<![\w.+-])({'|'.join(SWITCHES)})(?![\w.+-])", re.IGNORECASE)
_UTF16_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def _latin(error: UnicodeError) -> tuple[str, int]:
    """Read bytes that are not UTF-8 as Windows and western Europe write them: a degree, a micro, an umlaut."""
    if not isinstance(error, UnicodeDecodeError):
        raise error
    return error.object[error.start : error.end].decode("cp1252", errors="replace"), error.end


codecs.register_error("servotune.latin", _latin)


@dataclass(frozen=True, slots=True, kw_only=True)
class TextLayout:
    """Where the numbers of a text file are.

    Parameters
    ----------
    columns : tuple of int
        Columns to read, from 0, in the order in which they come out.
    delimiter : str
        What stands between two cells. A blank stands for any run of blanks and tabs.
    marks : Marks
        How numbers are written.
    comment : str
        Lines that begin with it are no rows; "" for none.
    header_lines : int
        Lines before the first row of numbers.
    missing : tuple of str
        Cells that stand for a missing sample and become NaN; without them such a cell is an error.
    stamps : tuple of (int, Clock), optional
        A column with the time of day, which comes out first, in s.
    usual : int
        Cells of nearly all rows, 0 where that is not known: among commas, one with more may have a number with separated
        thousands.
    ended_only : bool
        Whether a last line without a line end is left out.

    Raises
    ------
    FormatError
        For a layout that no file can have.
    """

    columns: tuple[int, ...]
    delimiter: str = ","
    marks: Marks = field(default_factory=Marks)
    comment: str = ""
    header_lines: int = 0
    missing: tuple[str, ...] = ()
    stamps: tuple[int, Clock] | None = None
    usual: int = 0
    ended_only: bool = False

    def __post_init__(self) -> None:
        if not self.columns and self.stamps is None:
            raise FormatError("columns must name at least one column, got none: leave it out for all of them")
        if min(self.columns, default=0) < 0:
            raise FormatError(f"column index must be at least 0, got {min(self.columns)}: the first column is 0")
        if not self.delimiter or "\n" in self.delimiter or "\r" in self.delimiter:
            raise FormatError(
                f"delimiter must be text within a line, got {self.delimiter!r}: leave it out, and the file tells it"
            )
        if self.header_lines < 0:
            raise FormatError(
                f"header_lines must be at least 0, got {self.header_lines}: leave it out, and the file tells it"
            )


def _nobody(_place: int, _count: int) -> None:
    """Tell nobody."""


def read(
    chunks: Iterable[bytes], layout: TextLayout, rounded: Callable[[int, int], None] = _nobody
) -> Iterator[npt.NDArray[np.float64]]:
    r"""Yield the wanted columns of a text file in blocks of rows.

    Parameters
    ----------
    chunks : iterable of bytes
        The file, cut anywhere. UTF-8 (with or without byte order mark), UTF-16 with byte order mark, or any
        superset of ASCII; LF, CRLF or CR line ends.
    layout : TextLayout
        Where the numbers are.
    rounded : callable, optional
        Told the place of a column in ``layout.columns``, and how many whole numbers in its next rows float64 does not hold.

    Yields
    ------
    ndarray of float64, shape (rows <= 8192, len(layout.columns))
        Values as recorded, in the order of ``layout.columns``; one more column in front of them for ``layout.stamps``.

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
    rows: list[tuple[int, str]] = []
    blank = 0
    begun = False
    lines = Lines(chunks)
    for number, line in enumerate(lines, start=1):
        if number <= layout.header_lines or (layout.ended_only and not lines.ended):
            continue
        if not line or line.isspace():
            blank = blank or number
            continue
        if layout.comment and line.lstrip(' \t"').startswith(layout.comment):
            continue
        if blank:
            raise FormatError(
                f"line {blank} must hold a row of numbers, got a blank line between rows: take it out, or save what follows as a file of its own",
                line=blank,
            )
        rows.append((number, line))
        begun = True
        if len(rows) == BLOCK_ROWS:
            yield _block(rows, layout, rounded)
            rows.clear()
    if rows:
        yield _block(rows, layout, rounded)
    if not begun:
        raise FormatError(
            f"file must hold at least one row after {layout.header_lines} header lines, got none: is header_lines right?"
        )


def _block(
    rows: Sequence[tuple[int, str]], layout: TextLayout, rounded: Callable[[int, int], None]
) -> npt.NDArray[np.float64]:
    """Return the values of some rows, each a line and its number."""
    if layout.usual and layout.delimiter == ",":
        for number, line in rows:
            if line.count(",") >= layout.usual:
                _check_groups(cut(line, ","), number, layout.usual)
    values = _values(rows, layout) if layout.columns else np.empty((len(rows), 0))
    _count_rounded(rows, values, layout, rounded)
    if layout.stamps is None:
        return values
    column, clock = layout.stamps
    stamps = []
    for number, line in rows:
        cells = line.split(layout.delimiter, column + 1) if '"' not in line else cut(line, layout.delimiter)
        if column >= len(cells):
            raise _too_few(number, column, len(cells))
        stamps.append(cells[column])
    try:
        seconds = clock.seconds(stamps)
    except FormatError as error:
        raise FormatError(f"lines {rows[0][0]} ... {rows[-1][0]}, column {column}: {error.message}") from error
    return np.column_stack([seconds, values])


def _count_rounded(
    rows: Sequence[tuple[int, str]],
    values: npt.NDArray[np.float64],
    layout: TextLayout,
    rounded: Callable[[int, int], None],
) -> None:
    """Look at cells again whose numbers are so large that float64 need not hold them."""
    large = np.abs(values) >= EXACT
    for place in np.flatnonzero(large.any(axis=0)).tolist():
        lines = (rows[row][1] for row in np.flatnonzero(large[:, place]).tolist())
        cells = (cut(line, layout.delimiter)[layout.columns[place]] for line in lines)
        rounded(place, inexact_whole(map(layout.marks.whole, cells)))


def _check_groups(cells: Sequence[str], number: int, usual: int) -> None:
    """Refuse a row of more cells than the others where two of them may be one number: 1,234.5."""
    for a, b in pairwise(cells):
        if len(cells) > usual and _HEAD_OF_GROUPS.fullmatch(a) and _GROUP.fullmatch(b):
            raise FormatError(
                f"line {number} has more cells than the others: {a},{b} may be two cells or one number with separated "
                "thousands; save it with another separator, or with quotes around the cells",
                line=number,
            )


def _values(rows: Sequence[tuple[int, str]], layout: TextLayout) -> npt.NDArray[np.float64]:
    """Return the values of rows: together, or in halves where that fails, so that one empty cell slows down only few."""
    values = _quickly([line for _, line in rows], layout)
    if values is not None:
        return values
    if len(rows) <= _FEW:
        return np.array([_row(line, number, layout) for number, line in rows])
    half = len(rows) // 2
    return np.concatenate([_values(rows[:half], layout), _values(rows[half:], layout)])


def _quickly(lines: list[str], layout: TextLayout) -> npt.NDArray[np.float64] | None:
    """Return the values, None where a line needs a closer look."""
    blank, decimal = layout.delimiter == " ", layout.marks.decimal
    if not blank and (len(layout.delimiter) > 1 or layout.delimiter == decimal):
        return None
    if decimal == ",":
        # a point is no decimal mark where commas are, and must not pass as one
        lines = [line.replace(".", "?").replace(",", ".") for line in lines]
    values = _loaded(lines, layout)
    if values is None and any(map(_SWITCH.search, lines)):
        values = _loaded([_SWITCH.sub(lambda state: f"{SWITCHES[state[0].lower()]:g}", line) for line in lines], layout)
    return values if values is not None and len(values) == len(lines) and bool(np.isfinite(values).all()) else None


def _loaded(lines: list[str], layout: TextLayout) -> npt.NDArray[np.float64] | None:
    """Return the values as numpy reads them, None where it does not."""
    try:
        return np.loadtxt(
            lines,
            delimiter=None if layout.delimiter == " " else layout.delimiter,
            usecols=layout.columns,
            comments=None,
            quotechar='"' if any('"' in line for line in lines) else None,
            ndmin=2,
        )
    except ValueError:
        return None


def _too_few(line: int, column: int, count: int) -> FormatError:
    return FormatError(
        f"line {line} must have a column {column} (counted from 0), got {count} columns: leave the row out or complete it, or say another column",
        line=line,
        column=column,
    )


def _row(line: str, number: int, layout: TextLayout) -> list[float]:
    cells = cut(line, layout.delimiter)
    values = []
    for column in layout.columns:
        if column >= len(cells):
            raise _too_few(number, column, len(cells))
        values.append(_value(cells[column], number, column, layout))
    return values


def _value(cell: str, line: int, column: int, layout: TextLayout) -> float:
    if cell in layout.missing:
        return math.nan
    value = layout.marks.value(cell)
    if value is None:
        raise FormatError(
            f"line {line}, column {column} must be a finite number, got {cell[:40]!r} "
            "(cells that stand for a missing sample are named in missing)",
            line=line,
            column=column,
        )
    return value


class Lines:
    """The lines of a file without their ends; ``ended`` says whether the one given last had one."""

    def __init__(self, chunks: Iterable[bytes]) -> None:
        self._chunks = chunks
        self.ended = True

    def __iter__(self) -> Iterator[str]:
        pending = ""
        for text in _decoded(self._chunks):
            lines = (pending + text).split("\n")
            pending = lines.pop()
            if len(pending) > MAX_LINE_CHARACTERS:
                raise FormatError(
                    f"line must have at most {MAX_LINE_CHARACTERS} characters, got more: is this a text file?"
                )
            yield from lines
        if pending:
            self.ended = False
            yield pending


def lines_of(chunks: Iterable[bytes]) -> Iterator[str]:
    """Yield the lines of the file without their ends."""
    return iter(Lines(chunks))


def encoding_of(head: bytes) -> str:
    """Return the encoding of a file that begins so."""
    if head.startswith(_UTF16_MARKS):
        return "utf-16-le" if head.startswith(codecs.BOM_UTF16_LE) else "utf-16-be"
    return "utf-8"


def decode(piece: bytes, encoding: str) -> str:
    """Return a piece of a file as text, with LF line ends."""
    text = piece.decode(encoding, errors="servotune.latin" if encoding == "utf-8" else "replace")
    return text.replace("\r\n", "\n").replace("\r", "\n")


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
            errors = "replace" if name == "utf-16" else "servotune.latin"
            decoder = codecs.getincrementaldecoder(name)(errors=errors)
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
