"""MATLAB version 5: a column vector for each channel, the time t in s, the sample rate, names, units and the start as texts.

Written element by element without compression, so that nothing has to be in memory at once.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping, Sequence

from api.formats import FormatError
from api.formats.writing import PIECE, Outgoing

HEADER = b"MATLAB 5.0 MAT-file, a recording of Servotune"
UNITS = "units"
"""The structure that has a text for each channel that has a unit."""
_MATRIX, _INT8, _UINT16, _INT32, _UINT32, _DOUBLE = 14, 1, 4, 5, 6, 9
_CLASS_STRUCT, _CLASS_DOUBLE, _CLASS_CHAR = 2, 6, 4
_MOST_SAMPLES = (2**31 - 4096) // 8
_LONGEST_NAME = 63


def write(recording: Outgoing) -> Iterator[bytes]:
    """Yield the file.

    Raises
    ------
    FormatError
        For more samples than a variable of version 5 can have.
    """
    if recording.count > _MOST_SAMPLES:
        raise FormatError(
            f"a MATLAB file of version 5 must have at most {_MOST_SAMPLES} samples, got {recording.count}: "
            "export a shorter stretch, or as hdf5"
        )
    yield HEADER.ljust(124) + struct.pack("<H2s", 0x0100, b"IM")
    names = variables([column.name for column in recording.columns])
    listed = "\n".join(f"{name}: {label}" for name, label in zip(names, recording.labels(), strict=True))
    yield _text("channels", listed)
    units = {name: column.unit for name, column in zip(names, recording.columns, strict=True) if column.unit}
    if units:
        yield _structure(UNITS, units)
    yield _text("start_time", recording.start_time)
    if recording.sample_rate is not None:
        yield _head("sample_rate", 1) + struct.pack("<d", recording.sample_rate)
    yield _head("t", recording.count)
    for start in range(0, recording.count, PIECE):
        stop = min(start + PIECE, recording.count)
        yield recording.instants(start, stop).astype("<f8").tobytes()
    for channel, name in enumerate(names):
        yield _head(name, recording.count)
        for start in range(0, recording.count, PIECE):
            yield recording.read(channel, start, min(start + PIECE, recording.count)).astype("<f8").tobytes()


def variables(names: Sequence[str]) -> list[str]:
    """Return names that MATLAB takes for variables, all different.

    >>> variables(["force 1", "2nd", "t"])
    ['force_1', 'x2nd', 't_1']
    """
    taken = {"t", "sample_rate", "channels", "start_time", UNITS}
    found = []
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_") or "x"
        plain = (plain if plain[0].isalpha() else f"x{plain}")[: _LONGEST_NAME - 5]
        unique, number = plain, 0
        while unique in taken:
            number += 1
            unique = f"{plain}_{number}"
        taken.add(unique)
        found.append(unique)
    return found


def _element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def _start(name: str, class_: int, shape: tuple[int, int]) -> bytes:
    return (
        _element(_UINT32, struct.pack("<II", class_, 0))
        + _element(_INT32, struct.pack("<ii", *shape))
        + _element(_INT8, name.encode("ascii"))
    )


def _head(name: str, count: int) -> bytes:
    """Return everything of a column vector but its numbers, which fill up to 8 bytes by themselves."""
    start = _start(name, _CLASS_DOUBLE, (count, 1))
    values = struct.pack("<II", _DOUBLE, 8 * count)
    return struct.pack("<II", _MATRIX, len(start) + len(values) + 8 * count) + start + values


def _text(name: str, text: str) -> bytes:
    data = text.encode("utf-16-le", errors="replace")
    body = _start(name, _CLASS_CHAR, (min(len(text), 1), len(data) // 2)) + _element(_UINT16, data)
    return struct.pack("<II", _MATRIX, len(body)) + body


def _structure(name: str, texts: Mapping[str, str]) -> bytes:
    """Return a structure of one element, whose fields are texts."""
    width = _LONGEST_NAME + 1
    names = b"".join(field.encode("ascii").ljust(width, b"\0") for field in texts)
    start = _start(name, _CLASS_STRUCT, (1, 1)) + _element(_INT32, struct.pack("<i", width)) + _element(_INT8, names)
    body = start + b"".join(_text("", text) for text in texts.values())
    return struct.pack("<II", _MATRIX, len(body)) + body
