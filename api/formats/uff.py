"""Universal files, dataset 58: functions at nodal degrees of freedom, as text or binary.

    x_i = x_0 + i dx,   eleven lines of header (80 columns each), then the ordinates

Time responses become channels, functions of frequency (responses, coherences, spectra) stay functions.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from api.formats import (
    ANOTHER,
    PIECE,
    DamagedFileError,
    FormatError,
    Recording,
    Series,
    SpectralFunction,
    Values,
    claimed,
)

_DELIMITER = b"    -1"
_LINES = 11
_SPECTRAL = {2, 3, 4, 5, 6, 9, 10, 12}
"""Types of functions that are of frequency where the file does not say what its abscissa is."""
_OVER_TIME = {0, 1, 7, 8}
FUNCTIONS = {
    0: "general", 1: "time response", 2: "auto spectrum", 3: "cross spectrum", 4: "frequency response",
    5: "transmissibility", 6: "coherence", 7: "auto correlation", 8: "cross correlation",
    9: "power spectral density", 10: "energy spectral density", 11: "probability density", 12: "spectrum",
}  # fmt: skip
"""Type of a function -> what it is."""
_QUANTITIES = {
    2: "stress", 3: "strain", 5: "temperature", 8: "displacement", 9: "force", 11: "velocity", 12: "acceleration",
    13: "force", 15: "pressure", 16: "mass", 17: "time", 18: "frequency", 21: "pressure",
}  # fmt: skip
_FREQUENCY = 18
"""Kind of abscissa, and of what the lines of a function are."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Function:
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


def open_file(file: BinaryIO, *, allow_truncated: bool = False) -> Recording:
    """Return the time responses and the functions of frequency of a universal file; the rest is refused by name.

    Parameters
    ----------
    file : binary file
    allow_truncated : bool
        Take the whole points of the last function where the file ends within it, and say so.

    Raises
    ------
    FormatError
        For another file, a header that is damaged or claims more ordinates than there are, or a file that ends early.
    """
    found, others, remarks = _functions(file, allow_truncated=allow_truncated)
    refused = {
        f"dataset {number}": "only datasets 58 hold recordings and functions: what else is in the file is not needed for them"
        for number in others
    }
    channels = _Channels(file)
    spectral: list[SpectralFunction] = []
    names: set[str] = set()
    for number, function in enumerate(found, start=1):
        over_frequency = function.axis == _FREQUENCY or (function.axis in {0, 1} and function.kind in _SPECTRAL)
        plain = _spectral_name(function) if over_frequency else function.name
        name = plain if plain not in names else f"{plain} ({number})"
        names.add(name)
        if over_frequency:
            spectral.append(_spectral(file, function, name))
        elif reason := _reason(function):
            refused[name] = reason
        else:
            channels.add(function, name)

    def read(wanted: Sequence[int]) -> Iterator[tuple[int, Values]]:
        for position, one in enumerate(wanted):
            function, column = channels.places[one]
            for points in _points(file, function):
                yield position, np.ascontiguousarray(points[:, column])

    if any(one.sample_rate for one in channels.series):
        remarks.append(
            "the file states the time step with six digits: the sample rate is known to about 3e-6 of itself"
        )
    return Recording(
        series=channels.series,
        read=read,
        refused=refused,
        remarks=remarks,
        functions=spectral,
    )


class _Channels:
    """The responses over time: those at uneven instants stand behind these, once for all that have the same."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.series: list[Series] = []
        self.places: list[tuple[_Function, int]] = []
        self._groups: dict[bytes, str] = {}

    def add(self, function: _Function, name: str) -> None:
        """Append the channels of a function: one, or its real and imaginary part."""
        group = "" if function.even else self._instants(function, name)
        first = 0 if function.even else 1
        for column, part in enumerate((" (real)", " (imaginary)") if function.is_complex else ("",), start=first):
            self.places.append((function, column))
            self.series.append(
                Series(
                    name=f"{name}{part}",
                    index=len(self.series),
                    count=function.count,
                    unit=function.unit,
                    quantity=function.quantity,
                    sample_rate=1.0 / function.step if function.even else None,
                    start_time=function.recorded,
                    group=group,
                )
            )

    def _instants(self, function: _Function, name: str) -> str:
        """Return the group of those that have the instants of a function."""
        digest = hashlib.sha256()
        for points in _points(self._file, function):
            digest.update(np.ascontiguousarray(points[:, 0]).tobytes())
        known = self._groups.get(digest.digest())
        if known is not None:
            return known
        self._groups[digest.digest()] = name
        self.places.append((function, 0))
        self.series.append(
            Series(
                name=f"time of {name}",
                index=len(self.series),
                count=function.count,
                unit="s",
                role="time",
                group=name,
            )
        )
        return name


def _spectral_name(function: _Function) -> str:
    return f"{function.response} over {function.reference}, {FUNCTIONS.get(function.kind, f'type {function.kind}')}"


def _spectral(file: BinaryIO, function: _Function, name: str) -> SpectralFunction:
    def read() -> tuple[Values, npt.NDArray[np.complex128]]:
        points = np.concatenate(list(_points(file, function)))
        first = 0 if function.even else 1
        values = points[:, first].astype(np.complex128)
        if function.is_complex:
            values += 1j * points[:, first + 1]
        frequency = function.start + function.step * np.arange(function.count) if function.even else points[:, 0]
        return np.asarray(frequency, dtype=np.float64), values

    return SpectralFunction(
        name=name,
        kind=FUNCTIONS.get(function.kind, f"type {function.kind}"),
        response=function.response,
        reference=function.reference,
        response_unit=function.unit,
        reference_unit=function.reference_unit,
        count=function.count,
        read=read,
    )


def _reason(function: _Function) -> str | None:
    if function.kind not in _OVER_TIME:
        return f"it is a {FUNCTIONS.get(function.kind, 'function')} (type {function.kind}), neither over time nor over frequency: export time responses or frequency responses of it"
    if function.even and not function.step > 0.0:
        return f"its time step must be > 0 s, got {function.step:g}: write it anew with its step, or with its abscissa"
    return None


def _points(file: BinaryIO, function: _Function) -> Iterator[Values]:
    """Yield the numbers of whole points, shape (points, numbers of each)."""
    width = len(_widths(function))
    rest = np.empty(0)
    for piece in _binary(file, function) if function.binary else _text(file, function):
        flat = np.concatenate([rest, piece]) if rest.size else piece
        whole = flat.size // width * width
        rest = flat[whole:]
        yield flat[:whole].reshape(-1, width)


def _functions(file: BinaryIO, *, allow_truncated: bool) -> tuple[list[_Function], list[int], list[str]]:
    """Return the datasets 58 of a file, the numbers of its other datasets, and what must be said of its end."""
    file.seek(0, 2)
    size = file.tell()
    file.seek(0)
    found: list[_Function] = []
    others: list[int] = []
    inside = False
    any_delimiter = False
    while line := file.readline(4096):
        if line.strip() != b"-1":
            continue
        any_delimiter = True
        inside = not inside
        if not inside:
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
    remarks = _at_the_end(file, found, size, allow_truncated=allow_truncated) if inside and found else []
    for one in found:
        # the narrowest ordinate of the format is E13.5
        room, itemsize = (size - one.offset, 12) if one.binary is None else (one.size, 8 if one.double else 4)
        claimed(f"ordinates of {one.name!r}", one.count * len(_widths(one)), size=room, itemsize=itemsize)
    return found, others, remarks


def _at_the_end(file: BinaryIO, found: list[_Function], size: int, *, allow_truncated: bool) -> list[str]:
    """Refuse that the last function is cut, or cut it to its whole points and return what must be said of that."""
    last = found[-1]
    if not allow_truncated:
        raise FormatError(
            f"the file must end with -1 after {last.name!r}, got its end at byte {size}: it is cut off. "
            "Set allow_truncated: true to take what is there"
        )
    if last.binary:
        there = max(size - last.offset, 0) // ((8 if last.double else 4) * len(_widths(last)))
    else:
        file.seek(last.offset)
        # a line without an end may lack its last digits
        lines = (line for line in file if line.endswith(b"\n"))
        there = sum(len(line.rstrip()) // sum(_widths(last)) for line in lines)
    there = min(there, last.count)
    if there < 2:
        raise DamagedFileError(f"{last.name!r} must have at least 2 points, got {there} before the file ends")
    found[-1] = replace(last, count=there, size=min(last.size, max(size - last.offset, 0)))
    return [f"the file is cut off: {there} of the {last.count} points of {last.name!r} are there"]


def _function(file: BinaryIO, kind: str, *, binary: bool) -> _Function:
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
    return _Function(
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


def _widths(function: _Function) -> tuple[int, ...]:
    """Return the columns of the numbers of one point in text: an uneven abscissa, then the ordinate's one or two."""
    ordinate = 20 if function.double else 13
    return (*(() if function.even else (13,)), *([ordinate] * (2 if function.is_complex else 1)))


def _binary(file: BinaryIO, function: _Function) -> Iterator[Values]:
    dtype = np.dtype(f"{function.binary}f{8 if function.double else 4}")
    total = function.count * len(_widths(function))
    for start in range(0, total, PIECE):
        file.seek(function.offset + start * dtype.itemsize)
        data = file.read(min(PIECE, total - start) * dtype.itemsize)
        yield np.frombuffer(data, dtype=dtype).astype(np.float64)


def _text(file: BinaryIO, function: _Function) -> Iterator[Values]:
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
