"""The datasets 58 of a universal file: their headers, where their numbers are, and these numbers.

x_i = x_0 + i dx,   eleven lines of header (80 columns each), then the ordinates
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import BinaryIO

import numpy as np

from api.formats import ANOTHER, PIECE, DamagedFileError, FormatError, Values, claimed

_LINES = 11
_QUANTITIES = {
    2: "stress", 3: "strain", 5: "temperature", 8: "displacement", 9: "force", 11: "velocity", 12: "acceleration",
    13: "force", 15: "pressure", 16: "mass", 17: "time", 18: "frequency", 21: "pressure",
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Function:
    """One dataset 58: its header, and where its ordinates are."""

    name: str
    kind: int
    axis: int
    response: str
    reference: str
    reference_unit: str
    is_complex: bool
    double: bool
    count: int
    even: bool
    start: float
    step: float
    unit: str
    quantity: str
    recorded: datetime | None
    binary: str | None  # byte order, None for text
    offset: int
    size: int


def points_of(file: BinaryIO, function: Function) -> Iterator[Values]:
    """Yield the numbers of whole points, shape (points, numbers of each)."""
    width = len(_widths(function))
    rest = np.empty(0)
    for piece in _binary(file, function) if function.binary else _text(file, function):
        flat = np.concatenate([rest, piece]) if rest.size else piece
        whole = flat.size // width * width
        rest = flat[whole:]
        yield flat[:whole].reshape(-1, width)


def functions(file: BinaryIO, *, allow_truncated: bool) -> tuple[list[Function], list[int], list[str]]:
    """Return the datasets 58 of a file, the numbers of its other datasets, and what must be said of those that are cut."""
    size = file.seek(0, 2)
    found, ends, others = _scan(file)
    if allow_truncated:
        whole, remarks = _whole_points(file, found, [*ends, size])
        return whole, others, remarks
    if len(ends) < len(found):
        raise FormatError(
            f"the file must end with -1 after {found[-1].name!r}, got its end at byte {size}: it is cut off. "
            "Set allow_truncated: true to take what is there"
        )
    for one, end in zip(found, ends, strict=True):
        # the narrowest ordinate of the format is E13.5
        itemsize = 12 if one.binary is None else 8 if one.double else 4
        claimed(f"ordinates of {one.name!r}", one.count * len(_widths(one)), size=end - one.offset, itemsize=itemsize)
    return found, others, []


def _scan(file: BinaryIO) -> tuple[list[Function], list[int], list[int]]:
    """Return the datasets 58, where each of them ends (one fewer where the file ends within the last), and the numbers of the others."""
    file.seek(0)
    found: list[Function] = []
    ends: list[int] = []
    others: list[int] = []
    inside = any_delimiter = False
    while line := file.readline(4096):
        if line.strip() != b"-1":
            continue
        any_delimiter = True
        inside = not inside
        if not inside:
            ends += [file.tell() - len(line)] * (len(found) - len(ends))
            continue
        kind = file.readline(4096)
        if kind.strip() == b"-1":  # the end of one, written twice
            continue
        match = re.match(rb"\s*(\d+)(b?)", kind)
        if match is None:
            raise DamagedFileError(f"a dataset must begin with its number, got {kind[:20]!r}")
        if int(match[1]) != 58:
            others.append(int(match[1]))
            continue
        found.append(_function(file, kind.decode("ascii", errors="replace"), binary=bool(match[2])))
    if not any_delimiter:
        raise FormatError("a universal file must have its datasets between lines of -1, got none" + ANOTHER)
    return found, ends, others


def _whole_points(file: BinaryIO, found: Sequence[Function], ends: Sequence[int]) -> tuple[list[Function], list[str]]:
    """Return functions with the whole points that are there of each before its end, and what must be said of fewer ones."""
    kept, remarks = [], []
    for one, end in zip(found, ends, strict=False):
        room = max(end - one.offset, 0)
        if one.binary:
            there = room // ((8 if one.double else 4) * len(_widths(one)))
        else:
            file.seek(one.offset)
            # a line without an end may lack its last digits
            lines = (line for line in file.read(room).splitlines(keepends=True) if line.endswith(b"\n"))
            there = sum(len(line.rstrip()) // sum(_widths(one)) for line in lines)
        if min(there, one.count) < 2:
            raise DamagedFileError(f"{one.name!r} must have at least 2 points, got {min(there, one.count)}")
        if there < one.count:
            remarks.append(f"the file is cut off: {there} of the {one.count} points of {one.name!r} are there")
        kept.append(replace(one, count=min(there, one.count), size=min(one.size, room)))
    return kept, remarks


def _function(file: BinaryIO, kind: str, *, binary: bool) -> Function:
    head = [file.readline(4096).decode("latin-1").rstrip("\r\n").ljust(81) for _ in range(_LINES)]
    try:
        type_, response, node, direction = int(head[5][0:5]), head[5][31:41], head[5][41:51], head[5][51:55]
        ordinate, count, spacing = int(head[6][0:10]), int(head[6][10:20]), int(head[6][20:30])
        start, step = float(head[6][30:43]), float(head[6][43:56])
        axis, quantity = int(head[7][0:10] or 0), int(head[8][0:10] or 0)
    except ValueError as error:
        raise DamagedFileError(
            f"the header of a dataset 58 must have its numbers in their columns ({error})"
        ) from error
    if ordinate not in {2, 4, 5, 6}:
        raise DamagedFileError(f"the ordinate's data type must be 2, 4, 5 or 6, got {ordinate}")
    is_complex, double = ordinate > 4, ordinate in {4, 6}
    offset = file.tell()
    per_point = (2 if is_complex else 1) + (spacing == 0)
    order = None
    length = 0
    if binary:
        fields = kind.split()
        try:
            order, form, length = {"1": "<", "2": ">"}[fields[1]], fields[2], int(fields[4])
        except (IndexError, KeyError, ValueError) as error:
            raise DamagedFileError(
                f"the first line of a binary dataset 58 must name byte order and sizes, got {kind[:80]!r}"
            ) from error
        if form != "2":
            raise FormatError(
                f"binary ordinates must be in the format of IEEE 754 (2), got {form}: write it anew as text or with IEEE numbers"
            )
        length = _length(file, offset, stated=length, needed=count * per_point * (8 if double else 4))
        file.seek(offset + length)
    point = _point(response, node, direction)
    name = point if response.strip() not in {"", "NONE"} else head[0].strip() or f"function {node.strip()}"
    return Function(
        name=name[:200],
        kind=type_,
        axis=axis,
        response=point[:200],
        reference=_point(head[5][56:66], head[5][66:76], head[5][76:80])[:200],
        reference_unit=_unit(head[9]),
        is_complex=is_complex,
        double=double,
        count=count,
        even=spacing != 0,
        start=start,
        step=step,
        unit=_unit(head[8]),
        quantity=_QUANTITIES.get(quantity, ""),
        recorded=_recorded(head[2]),
        binary=order,
        offset=offset,
        size=length,
    )


def _length(file: BinaryIO, offset: int, *, stated: int, needed: int) -> int:
    """Return the bytes of binary ordinates: some programs state those of real ones for complex or uneven ones, too."""
    if stated < needed:
        file.seek(offset + needed)
        if file.readline(80).strip() in {b"", b"-1"}:
            return needed
    return stated


def _point(entity: str, node: str, direction: str) -> str:
    """Return a degree of freedom: entity, node and direction."""
    plain = entity.strip()
    return f"{'' if plain in {'NONE', 'N/A'} else plain} {node.strip()}{_direction(direction)}".strip()


def _unit(axis: str) -> str:
    """Return the unit of a line on an axis, "" where it has none."""
    unit = axis[46:66].strip()
    return "" if unit in {"NONE", "N/A"} else unit


def _direction(text: str) -> str:
    number = int(text) if text.strip().lstrip("+-").isdigit() else 0
    return {1: "+X", -1: "-X", 2: "+Y", -2: "-Y", 3: "+Z", -3: "-Z"}.get(number, "")


def _recorded(text: str) -> datetime | None:
    for form in ("%d-%b-%y %H:%M:%S", "%d-%b-%y"):
        try:
            return datetime.strptime(text.strip().title(), form)  # noqa: DTZ007 - the file names no zone
        except ValueError:
            continue
    return None


def _widths(function: Function) -> tuple[int, ...]:
    """Return the columns of the numbers of one point in text: an uneven abscissa, then the ordinate's one or two."""
    ordinate = 20 if function.double else 13
    return (*(() if function.even else (13,)), *([ordinate] * (2 if function.is_complex else 1)))


def _binary(file: BinaryIO, function: Function) -> Iterator[Values]:
    dtype = np.dtype(f"{function.binary}f{8 if function.double else 4}")
    total = function.count * len(_widths(function))
    for start in range(0, total, PIECE):
        file.seek(function.offset + start * dtype.itemsize)
        data = file.read(min(PIECE, total - start) * dtype.itemsize)
        yield np.frombuffer(data, dtype=dtype).astype(np.float64)


def _text(file: BinaryIO, function: Function) -> Iterator[Values]:
    """Yield the numbers of a function in text, which may touch each other, for their columns are fixed."""
    filled, position = 0, function.offset
    widths = _widths(function)
    point = sum(widths)
    begins = [sum(widths[:i]) for i in range(len(widths))]
    total = function.count * len(widths)
    while filled < total:
        file.seek(position)
        lines = file.readlines(PIECE * point)
        position = file.tell()
        cells = [
            line[i + begin : i + begin + width]
            for line in map(bytes.rstrip, lines)
            for i in range(0, len(line), point)
            for begin, width in zip(begins, widths, strict=True)
            if i + begin < len(line)
        ]
        cells = cells[: total - filled]
        try:
            values = np.array(cells, dtype="S").astype(np.float64)
        except ValueError as error:
            raise DamagedFileError(f"{function.name!r} must have {total} numbers, got {filled} and {error}") from error
        if not values.size:
            raise DamagedFileError(f"{function.name!r} must have {total} numbers, got {filled}")
        filled += values.size
        yield values
