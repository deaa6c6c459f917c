"""Universal files, dataset 58: functions at nodal degrees of freedom, as text or binary.

    x_i = x_0 + i dx,   eleven lines of header (80 columns each), then the ordinates

Time responses become channels; `write` makes text of frequency responses, which every program reads, whereas binary
files are read by few.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from api.formats import PIECE, FormatError, Recording, Series, Values, claimed

_DELIMITER = b"    -1"
_LINES = 11
_FUNCTIONS = {
    0: "general", 1: "time response", 2: "auto spectrum", 3: "cross spectrum", 4: "frequency response",
    5: "transmissibility", 6: "coherence", 7: "auto correlation", 8: "cross correlation",
    9: "power spectral density", 10: "energy spectral density", 11: "probability density", 12: "spectrum",
}  # fmt: skip
_QUANTITIES = {
    2: "stress", 3: "strain", 5: "temperature", 8: "displacement", 9: "force", 11: "velocity", 12: "acceleration",
    13: "force", 15: "pressure", 16: "mass", 17: "time", 18: "frequency", 21: "pressure",
}  # fmt: skip
_CODES = {"displacement": 8, "force": 13, "velocity": 11, "acceleration": 12, "pressure": 15, "": 0}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Function:
    """One dataset 58: its header, and where its ordinates are."""

    name: str
    kind: int
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


def open_file(file: BinaryIO) -> Recording:
    """Return the time responses of a universal file; other functions and datasets are refused by name.

    Raises
    ------
    FormatError
        For another file, a header that is damaged or claims more ordinates than there are, or a file that ends early.
    """
    found, others = _functions(file)
    refused = {f"dataset {number}": "only datasets 58 hold recordings" for number in others}
    series: list[Series] = []
    usable: list[_Function] = []
    names: set[str] = set()
    for function in found:
        name = function.name if function.name not in names else f"{function.name} ({len(series) + 1})"
        names.add(name)
        reason = _reason(function)
        if reason:
            refused[name] = reason
            continue
        series.append(
            Series(
                name=name,
                index=len(series),
                count=function.count,
                unit=function.unit,
                quantity=function.quantity,
                sample_rate=1.0 / function.step,
                start_time=function.recorded,
            )
        )
        usable.append(function)

    def read(wanted: Sequence[int]) -> Iterator[tuple[int, Values]]:
        for position, one in enumerate(wanted):
            function = usable[one]
            for piece in _binary(file, function) if function.binary else _text(file, function):
                yield position, piece

    remarks = ["the file states the time step with six digits: the sample rate is known to about 3e-6 of itself"]
    return Recording(
        series=series,
        read=read,
        refused=refused,
        remarks=remarks if usable else [],
    )


def _reason(function: _Function) -> str | None:
    if function.kind not in {0, 1}:
        return f"it is a {_FUNCTIONS.get(function.kind, 'function')} (type {function.kind}), not a recording over time"
    if function.is_complex:
        return "its ordinates are complex"
    if not function.even:
        return "its abscissa is uneven"
    if not function.step > 0.0:
        return f"its time step must be > 0 s, got {function.step:g}"
    return None


def _functions(file: BinaryIO) -> tuple[list[_Function], list[int]]:
    """Return the datasets 58 of a file, and the numbers of its other datasets."""
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
            raise FormatError(f"a dataset must begin with its number, got {kind[:20]!r}")
        if int(match[1]) != 58:
            others.append(int(match[1]))
            continue
        found.append(_function(file, kind.decode("ascii", errors="replace"), binary=bool(match[2]), size=size))
    if not any_delimiter:
        raise FormatError("a universal file must have its datasets between lines of -1, got none")
    if inside and found:
        raise FormatError(
            f"the file must end with -1 after {found[-1].name!r}, got its end at byte {size}: it is cut off"
        )
    return found, others


def _function(file: BinaryIO, kind: str, *, binary: bool, size: int) -> _Function:
    head = [file.readline(4096).decode("latin-1").rstrip("\r\n").ljust(81) for _ in range(_LINES)]
    try:
        type_, response, node, direction = int(head[5][0:5]), head[5][31:41], head[5][41:51], head[5][51:55]
        ordinate, count, spacing = int(head[6][0:10]), int(head[6][10:20]), int(head[6][20:30])
        start, step = float(head[6][30:43]), float(head[6][43:56])
        quantity = int(head[8][0:10] or 0)
    except ValueError as error:
        raise FormatError(f"the header of a dataset 58 must have its numbers in their columns ({error})") from error
    if ordinate not in {2, 4, 5, 6}:
        raise FormatError(f"the ordinate's data type must be 2, 4, 5 or 6, got {ordinate}")
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
            raise FormatError(
                f"the first line of a binary dataset 58 must name byte order and sizes, got {kind[:80]!r}"
            ) from error
        if form != "2":
            raise FormatError(f"binary ordinates must be in the format of IEEE 754 (2), got {form}")
        if length > size - offset:
            raise FormatError(f"the ordinates must be {length} bytes, got {size - offset} before the file ends")
        claimed(f"ordinates of {head[0].strip()!r}", count * per_point, size=length, itemsize=8 if double else 4)
        file.seek(offset + length)
    else:
        # the narrowest ordinate of the format is E13.5
        claimed(f"ordinates of {head[0].strip()!r}", count * per_point, size=size - offset, itemsize=12)
    point = f"{response.strip()} {node.strip()}{_direction(direction)}".strip()
    name = point if response.strip() not in {"", "NONE"} else head[0].strip() or f"function {node.strip()}"
    unit = head[8][46:66].strip()
    return _Function(
        name=name[:200],
        kind=type_,
        is_complex=is_complex,
        double=double,
        count=count,
        even=spacing != 0,
        start=start,
        step=step,
        unit="" if unit in {"NONE", "N/A"} else unit,
        quantity=_QUANTITIES.get(quantity, ""),
        recorded=_recorded(head[2]),
        binary=order,
        offset=offset,
        size=length,
    )


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


def _binary(file: BinaryIO, function: _Function) -> Iterator[Values]:
    dtype = np.dtype(f"{function.binary}f{8 if function.double else 4}")
    for start in range(0, function.count, PIECE):
        file.seek(function.offset + start * dtype.itemsize)
        data = file.read(min(PIECE, function.count - start) * dtype.itemsize)
        yield np.frombuffer(data, dtype=dtype).astype(np.float64)


def _text(file: BinaryIO, function: _Function) -> Iterator[Values]:
    """Yield the ordinates of a function in text; its numbers may touch each other, for their columns are fixed."""
    filled, position = 0, function.offset
    width = 20 if function.double else 13
    while filled < function.count:
        file.seek(position)
        lines = file.readlines(PIECE * width)
        position = file.tell()
        cells = [line[i : i + width] for line in map(bytes.rstrip, lines) for i in range(0, len(line), width)]
        cells = cells[: function.count - filled]
        try:
            values = np.array(cells, dtype="S").astype(np.float64)
        except ValueError as error:
            raise FormatError(
                f"{function.name!r} must have {function.count} ordinates, got {filled} and {error}"
            ) from error
        if not values.size:
            raise FormatError(
                f"{function.name!r} must have {function.count} ordinates, got {filled}: the file is cut off"
            )
        filled += values.size
        yield values


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrequencyResponse:
    """A measured frequency response, for a universal file.

    Parameters
    ----------
    frequency : ndarray, shape (lines,)
        Hz, evenly spaced.
    values : ndarray of complex, shape (lines,)
        Response over reference, in ``unit``.
    name : str
        A line that says what it is.
    response, reference : str
        Names of the two channels; up to 10 characters stand in the file, the rest is cut.
    response_quantity, reference_quantity : str
        "displacement", "velocity", "acceleration", "force", "pressure" or "".
    response_unit, reference_unit : str
    coherence : ndarray, shape (lines,), optional
        Written as a function of its own behind the response.
    """

    frequency: npt.NDArray[np.float64]
    values: npt.NDArray[np.complex128]
    name: str = ""
    response: str = ""
    reference: str = ""
    response_quantity: str = ""
    reference_quantity: str = ""
    response_unit: str = ""
    reference_unit: str = ""
    coherence: npt.NDArray[np.float64] | None = None


def write(functions: Iterable[FrequencyResponse], *, recorded: datetime) -> Iterator[bytes]:
    """Yield a universal file (text, double precision) with frequency responses, piece by piece.

    Parameters
    ----------
    functions : iterable of FrequencyResponse
    recorded : datetime
        Written into each header.

    Raises
    ------
    FormatError
        For frequencies that are not evenly spaced, or a response of another length.
    """
    for function in functions:
        yield _written(function, function.values, 4, recorded)
        if function.coherence is not None:
            yield _written(function, function.coherence, 6, recorded)


def _written(
    function: FrequencyResponse,
    values: npt.NDArray[np.float64] | npt.NDArray[np.complex128],
    kind: int,
    recorded: datetime,
) -> bytes:
    frequency = np.asarray(function.frequency, dtype=np.float64)
    count = frequency.size
    if count < 2 or values.shape != frequency.shape:
        raise FormatError(
            f"a frequency response must be as long as its {count} (at least 2) frequencies, got {values.shape}"
        )
    step = (frequency[-1] - frequency[0]) / (count - 1)
    if not step > 0.0 or float(np.max(np.abs(frequency - frequency[0] - step * np.arange(count)))) > 1e-6 * step:
        raise FormatError("the frequencies of a universal file must be evenly spaced and rising, got others")
    complex_values = kind == 4
    ratio = (function.response_unit, function.reference_unit) if complex_values else ("NONE", "NONE")
    lines = [
        "    -1",
        "    58",
        _line(function.name or f"{function.response} / {function.reference}", 80),
        _line(f"{_FUNCTIONS[kind]}", 80),
        recorded.strftime("%d-%b-%y %H:%M:%S"),
        "NONE",
        "NONE",
        f"{kind:5d}{0:10d}{0:5d}{0:10d} {_line(function.response, 10):10s}{1:10d}{0:4d} {_line(function.reference, 10):10s}{1:10d}{0:4d}",
        f"{6 if complex_values else 4:10d}{count:10d}{1:10d}{frequency[0]:13.5E}{step:13.5E}{0.0:13.5E}",
        _axis(18, "Frequency", "Hz"),
        _axis(_CODES.get(function.response_quantity, 0) if complex_values else 0, function.response, ratio[0]),
        _axis(_CODES.get(function.reference_quantity, 0) if complex_values else 0, function.reference, ratio[1]),
        _axis(0, "NONE", "NONE"),
    ]
    flat = np.ascontiguousarray(values).view(np.float64) if complex_values else np.asarray(values, dtype=np.float64)
    lines += ["".join(f"{value:20.12E}" for value in flat[i : i + 4]) for i in range(0, flat.size, 4)]
    return "\n".join([*lines, "    -1", ""]).encode("ascii", errors="replace")


def _axis(kind: int, label: str, unit: str) -> str:
    return f"{kind:10d}{0:5d}{0:5d}{0:5d} {_line(label or 'NONE', 20):20s} {_line(unit or 'NONE', 20):20s}"


def _line(text: str, width: int) -> str:
    return " ".join(text.split())[:width]
