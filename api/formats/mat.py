"""MATLAB files of version 5 to 7.2: variables, structures and cells of numbers; objects of classes are refused by name.

    element = type (uint32), bytes (uint32), data, filled up to 8 bytes;   a variable may be an element of zlib data

Compressed variables are unpacked into a temporary file, no further than a bound, so that memory stays small and a file
of a megabyte cannot become one of a gigabyte. Version 7.3 is HDF5, see there.
"""

from __future__ import annotations

import math
import struct
import tempfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from api.formats import (
    ANOTHER,
    ONE_COMPLEX,
    PIECE,
    DamagedFileError,
    FormatError,
    Recording,
    by_channel,
    claimed,
    proportionate,
    text_reason,
)
from api.formats.arrays import Part, frequency_unit, line_counts, parts_of, series_of, started, stated_rate
from api.formats.exactness import Reading, Rounded
from api.formats.mat4 import is_version_4
from api.formats.writing.mat import HEADER, UNITS

_HEAD = 128
_CHUNK = 1 << 20
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CELL, _STRUCT, _OBJECT, _TEXT, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_NUMERIC = set(range(6, 16))
_COMPLEX, _LOGICAL = 0x08, 0x02
_DEEPEST = 32
_MOST_VARIABLES = 100_000
_LONGEST_TEXT = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class _Array:
    """Numbers in a file, column after column."""

    name: str
    shape: tuple[int, ...]
    file: BinaryIO
    offset: int
    dtype: str
    imaginary: tuple[int, str] | None = None
    """Where the imaginary parts are, and their type."""


@dataclass(slots=True)
class _Found:
    arrays: list[_Array] = field(default_factory=list)
    texts: dict[str, str] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)
    unpacked: int = 0
    own: bool = False
    """Whether it is an export of this program."""


def open_file(file: BinaryIO) -> Recording:
    """Return the vectors and matrices of numbers of a MATLAB file.

    Raises
    ------
    FormatError
        For another file, a damaged or truncated one, one of more than 2 GiB for a variable, or one that unpacks to
        more than 64 times its size (and more than 256 MiB).
    """
    file.seek(0, 2)
    size = file.tell()
    file.seek(0)
    head = file.read(_HEAD)
    if is_version_4(head):
        raise FormatError(
            "a MATLAB file must be of version 5 to 7.3, got one of version 4: load it in MATLAB or Octave and save it with -v7"
        )
    if len(head) < _HEAD or head[126:128] not in {b"IM", b"MI"}:
        raise FormatError("a MATLAB file must begin with its header of 128 bytes, got something else" + ANOTHER)
    order = "<" if head[126:128] == b"IM" else ">"
    with ExitStack() as undo:
        found = _found(file, size, order, undo)
        found.own = head.startswith(HEADER)
        return _recording(found, undo.pop_all().close)


def _found(file: BinaryIO, size: int, order: str, undo: ExitStack) -> _Found:
    """Go through the variables; what is unpacked stays in files that ``undo`` closes."""
    found = _Found()
    position = _HEAD
    while position < size:
        kind, length, data, following = _tag(file, order, position, size)
        if kind == _COMPRESSED:
            following = position + 8 + length  # not filled up
            spool = undo.enter_context(tempfile.TemporaryFile())  # noqa: SIM115 - read as long as the recording is
            unpacked = _unpack(file, data, length, spool, size=size, before=found.unpacked)
            found.unpacked += unpacked
            inner, inner_length, inner_data, _ = _tag(spool, order, 0, unpacked)
            if inner == _MATRIX:
                _Variables(spool, order, found).read(inner_data, inner_data + inner_length, "", 0)
        elif kind == _MATRIX:
            _Variables(file, order, found).read(data, data + length, "", 0)
        position = following
    return found


def _recording(found: _Found, close: Callable[[], None]) -> Recording:
    parts: list[Part] = []
    scalars: dict[str, float] = {}
    rounded = Rounded()
    names = [array.name for array in found.arrays]
    lines = line_counts((array.name, array.shape) for array in found.arrays)
    for i, array in enumerate(found.arrays):
        if array.shape and all(n == 1 for n in array.shape):
            if array.imaginary is None:
                scalars[array.name] = float(Reading(rounded).floats(array.name, _values(array, 0, 1))[0])
            else:
                found.refused[array.name] = ONE_COMPLEX
            continue
        more, reason = parts_of(array.name, array.shape, array=i, is_complex=array.imaginary is not None, lines=lines)
        parts += more
        if reason:
            found.refused[array.name] = reason

    def part(channel: int, start: int, stop: int) -> npt.NDArray[Any]:
        one = parts[channel]
        array = found.arrays[one.array]
        # column after column
        strides = [math.prod(array.shape[:axis]) for axis in range(len(array.shape))]
        first = sum(i * stride for i, stride in zip(one.place, strides, strict=True))
        stride = strides[one.along]
        rows = max(PIECE // stride, 1)
        cuts = [(i, min(i + rows, stop)) for i in range(start, stop, rows)]
        return np.concatenate(
            [
                _values(array, first + i * stride, first + (j - 1) * stride + 1, imaginary=one.imaginary)[::stride]
                for i, j in cuts
            ]
        )

    rate, remarks = stated_rate(scalars)
    start = _start_of(found)
    units = [found.texts.get(f"{UNITS}.{name}", "") or frequency_unit(name, names, found.texts) for name in names]
    for told in ("start_time",) * (start is not None) + tuple(f"{UNITS}.{name}" for name in names):
        found.refused.pop(told, None)
    series = [replace(one, start_time=start) for one in series_of(parts, units)]
    return Recording(
        series=series,
        read=by_channel(series, part, rounded),
        rounded=rounded,
        refused=found.refused,
        scalars=scalars,
        layout={"sample_rate": rate} if rate else {},
        remarks=remarks,
        close=close,
    )


def _start_of(found: _Found) -> datetime | None:
    """Return when the first sample was taken; in an export the time t counts from the start of the whole recording."""
    time = next((array for array in found.arrays if array.name == "t"), None)
    first = float(_values(time, 0, 1)[0]) if found.own and time is not None else 0.0
    return started(found.texts.get("start_time", ""), first)


def _values(array: _Array, start: int, stop: int, *, imaginary: bool = False) -> npt.NDArray[Any]:
    offset, dtype = array.imaginary if imaginary and array.imaginary else (array.offset, array.dtype)
    width = np.dtype(dtype).itemsize
    array.file.seek(offset + start * width)
    return np.frombuffer(array.file.read((stop - start) * width), dtype=dtype)


def _tag(file: BinaryIO, order: str, position: int, end: int) -> tuple[int, int, int, int]:
    """Return type and bytes of an element, where its data begin, and where the next element does."""
    file.seek(position)
    tag = file.read(8)
    if len(tag) < 8 or position + 8 > end:
        raise DamagedFileError(f"an element must be complete, got the end of the file at byte {position}")
    kind, length = struct.unpack(f"{order}II", tag)
    if kind >> 16:  # a small element: bytes and type share the first word, up to four bytes of data follow
        return kind & 0xFFFF, min(kind >> 16, 4), position + 4, position + 8
    data = position + 8
    if data + length > end:
        raise DamagedFileError(f"the element at byte {position} must be {length} bytes, got {end - data}")
    return kind, length, data, data + -(-length // 8) * 8


def _unpack(file: BinaryIO, data: int, length: int, spool: BinaryIO, *, size: int, before: int) -> int:
    """Unpack zlib data into a file, after as many bytes as were unpacked ``before``; return its length."""
    unpacker = zlib.decompressobj()
    done = 0
    file.seek(data)
    left = length
    while left and not unpacker.eof:
        piece = file.read(min(_CHUNK, left))
        left -= len(piece)
        while piece and not unpacker.eof:
            try:
                plain = unpacker.decompress(piece, _CHUNK)
            except zlib.error as error:
                raise DamagedFileError(f"a compressed variable must be zlib data, got {error}") from error
            piece = unpacker.unconsumed_tail
            done += len(plain)
            proportionate("the variables", before + done, size=size)
            spool.write(plain)
    if not unpacker.eof:
        raise DamagedFileError("a compressed variable must be complete, got a part of it")
    return done


class _Variables:
    """Finds the arrays of numbers in one variable."""

    def __init__(self, file: BinaryIO, order: str, found: _Found) -> None:
        self._file = file
        self._order = order
        self._found = found

    def read(self, position: int, end: int, name: str, depth: int) -> None:
        """Read the matrix whose elements lie in position ... end; ``name`` is that of its place, "" for a variable."""
        if position == end:
            return  # an empty field
        if depth > _DEEPEST or len(self._found.arrays) + len(self._found.refused) > _MOST_VARIABLES:
            raise FormatError(
                f"variables must be at most {_MOST_VARIABLES}, nested at most {_DEEPEST} deep, got more: save fewer of them into one file"
            )
        flags, position = self._numbers(position, end)
        kind, bits = (int(flags[0]) & 0xFF, int(flags[0]) >> 8) if flags.size else (0, 0)
        if kind == _OPAQUE:
            self._opaque(position, end, name)
            return
        shape, position = self._numbers(position, end)
        own, position = self._text(position, end)
        path = name or own
        dims = tuple(int(n) for n in shape)
        if not path:
            return  # what MATLAB keeps of its own behind the variables
        if kind in _NUMERIC:
            self._array(position, end, path, dims, bits)
        elif kind == _TEXT:
            self._letters(position, end, path)
            self._found.refused[path] = text_reason(self._found.texts.get(path, ""))
        elif kind == _STRUCT:
            self._struct(position, end, path, dims, depth)
        elif kind == _CELL:
            self._cells(position, end, path, dims, depth)
        else:
            what = {
                _OBJECT: "an object of a MATLAB class: save what is in it as plain arrays",
                _SPARSE: "a sparse matrix: save it as full",
                _FUNCTION: "a function: save its values",
            }
            self._found.refused[path] = (
                f"it is {what.get(kind, f'of the class {kind}, arrays of numbers are read: save its values as such an array')}"
            )

    def _opaque(self, position: int, end: int, name: str) -> None:
        words = []
        for _ in range(3):
            if position >= end:
                break
            word, position = self._text(position, end)
            words.append(word)
        own, _, class_ = [*words, "", "", ""][:3]
        self._found.refused[name or own] = (
            f"it is an object of the MATLAB class {class_!r}: save what is in it as plain arrays"
        )

    def _array(self, position: int, end: int, path: str, shape: tuple[int, ...], bits: int) -> None:
        if min(shape, default=0) < 0:
            raise DamagedFileError(f"the size of {path} must not be negative, got {shape}")
        offset, dtype, position = self._part(position, end, path, shape)
        imaginary = self._part(position, end, path, shape)[:2] if bits & _COMPLEX else None
        self._found.arrays.append(
            _Array(name=path, shape=shape, file=self._file, offset=offset, dtype=dtype, imaginary=imaginary)
        )

    def _part(self, position: int, end: int, path: str, shape: tuple[int, ...]) -> tuple[int, str, int]:
        """Return where the real or imaginary parts of an array are, their type, and where the next element is."""
        kind, length, data, following = _tag(self._file, self._order, position, end)
        if kind not in _NUMBERS:
            raise DamagedFileError(f"the values of {path} must be of a type of numbers, got {kind}")
        dtype = self._order + _NUMBERS[kind]
        claimed(f"the values of {path}", math.prod(shape), size=length, itemsize=np.dtype(dtype).itemsize)
        return data, dtype, following

    def _letters(self, position: int, end: int, path: str) -> None:
        """Keep a short text, which may be a unit."""
        kind, length, data, _ = _tag(self._file, self._order, position, end)
        if length <= _LONGEST_TEXT:
            self._file.seek(data)
            raw = self._file.read(length)
            wide = {4: "utf-16-le" if self._order == "<" else "utf-16-be", 18: "utf-32"}
            self._found.texts[path] = raw.decode(wide.get(kind, "utf-8"), errors="replace").strip("\0 ")

    def _struct(self, position: int, end: int, path: str, shape: tuple[int, ...], depth: int) -> None:
        width, position = self._numbers(position, end)
        kind, length, data, position = _tag(self._file, self._order, position, end)
        size = int(width[0]) if width.size else 0
        if kind != 1 or size < 1:
            raise DamagedFileError(f"the names of the fields of {path} must be text, got elements of type {kind}")
        self._file.seek(data)
        text = self._file.read(length)
        names = [text[i : i + size].split(b"\0")[0].decode("latin-1") for i in range(0, len(text), size)]
        several = int(np.prod(shape)) > 1
        for i, field_end in enumerate(self._members(position, end)):
            begin, stop = field_end
            element = f"({i // len(names) + 1})" if several else ""
            self.read(begin, stop, f"{path}{element}.{names[i % len(names)]}", depth + 1)

    def _cells(self, position: int, end: int, path: str, shape: tuple[int, ...], depth: int) -> None:
        del shape
        for i, (begin, stop) in enumerate(self._members(position, end)):
            self.read(begin, stop, f"{path}{{{i + 1}}}", depth + 1)

    def _members(self, position: int, end: int) -> Iterator[tuple[int, int]]:
        while position < end:
            kind, length, data, position = _tag(self._file, self._order, position, end)
            if kind != _MATRIX:
                raise DamagedFileError(f"a field or cell must be a matrix, got an element of type {kind}")
            yield data, data + length

    def _numbers(self, position: int, end: int) -> tuple[npt.NDArray[np.int64], int]:
        kind, length, data, following = _tag(self._file, self._order, position, end)
        if kind not in _NUMBERS or length > 4096:
            raise DamagedFileError(f"the header of a variable must be numbers, got an element of type {kind}")
        self._file.seek(data)
        values = np.frombuffer(self._file.read(length), dtype=self._order + _NUMBERS[kind])
        return values.astype(np.int64), following

    def _text(self, position: int, end: int) -> tuple[str, int]:
        _, length, data, following = _tag(self._file, self._order, position, end)
        self._file.seek(data)
        return self._file.read(min(length, 4096)).decode("latin-1").strip("\0"), following
