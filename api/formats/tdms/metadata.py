"""The metadata of a TDMS file: its segments, the objects that they speak of, and where the values of these lie."""

from __future__ import annotations

import mmap
import struct
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from api.formats import (
    DamagedFileError,
    FormatError,
    text_reason,
)

_METADATA, _NEW_LIST, _RAW, _INTERLEAVED, _BIG_ENDIAN, _DAQMX = 1 << 1, 1 << 2, 1 << 3, 1 << 5, 1 << 6, 1 << 7
_LEAD_IN = 28
_UNFINISHED = 0xFFFFFFFFFFFFFFFF
_NO_DATA, _AS_BEFORE = 0xFFFFFFFF, 0
_FORMAT_CHANGING, _DIGITAL_LINE = 0x1269, 0x126A
_NUMBERS = {1: "i1", 2: "i2", 3: "i4", 4: "i8", 5: "u1", 6: "u2", 7: "u4", 8: "u8", 9: "f4", 10: "f8", 0x19: "f4",
            0x1A: "f8", 0x21: "u1"}  # fmt: skip
_SIZES = {11: 16, 0x1B: 16, 0x44: 16, 0x08000C: 8, 0x10000D: 16}
_STRING, _TIME, _BOOLEAN = 0x20, 0x44, 0x21
_DAQMX_NUMBERS = ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8")
EPOCH = datetime(1904, 1, 1, tzinfo=UTC)
_MOST_SEGMENTS = 5_000_000


@dataclass(slots=True, kw_only=True)
class _Index:
    """How the values of one channel lie in each chunk of a segment."""

    kind: int
    count: int
    dtype: str | None = None
    size: int = 0  # bytes of one value, 0 where they differ
    total: int = 0  # bytes of the channel in a chunk
    buffer: int = 0  # DAQmx: which raw buffer, and where in its rows
    offset: int = 0
    scale: int = 0
    widths: tuple[int, ...] = ()
    reason: str = ""  # why the values cannot be read


@dataclass(slots=True, kw_only=True)
class TdmsObject:
    """A channel, group or the file itself: its properties and where its values are."""

    properties: dict[str, Any] = field(default_factory=dict)
    index: _Index | None = None
    runs: list[Run] = field(default_factory=list)
    starts: list[int] = field(default_factory=list)
    count: int = 0
    reason: str = ""

    def add(self, run: Run) -> None:
        """Append the values of one segment."""
        if run.chunks and run.count:
            self.starts.append(self.count)
            self.runs.append(run)
            self.count += run.chunks * run.count


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """The values of a channel in the chunks of one segment."""

    offset: int
    chunks: int
    chunk: int
    count: int
    stride: int
    dtype: str


class Parser:
    """Reads the metadata of all segments."""

    def __init__(self, memory: mmap.mmap) -> None:
        self._memory = memory
        self._order = "<"
        self._at = 0
        self._end = 0
        self.objects: dict[str, TdmsObject] = {}
        self.remarks: list[str] = []

    def run(self) -> None:
        """Go through the file from segment to segment."""
        size, position, listed = len(self._memory), 0, list[str]()
        segments = 0
        while position < size:
            if self._memory[position : position + 4] != b"TDSm" or size - position < _LEAD_IN:
                what = "a TDMS file" if position == 0 else "a segment of a TDMS file"
                raise DamagedFileError(
                    f"{what} must begin with TDSm, got {self._memory[position : position + 4]!r} at {position}"
                )
            (mask,) = struct.unpack_from("<I", self._memory, position + 4)
            self._order = ">" if mask & _BIG_ENDIAN else "<"
            following, raw = struct.unpack_from(f"{self._order}QQ", self._memory, position + 12)
            data, end = position + _LEAD_IN + raw, position + _LEAD_IN + following
            if following == _UNFINISHED:
                end = size
                self.remarks.append(
                    "the file was not closed: the program that wrote it may have crashed; what is there is read"
                )
                if data > size:
                    break
            if not position + _LEAD_IN <= data <= end <= size:
                raise DamagedFileError(
                    f"the segment at byte {position} must end within the {size} bytes of the file, got {end}"
                )
            if mask & _METADATA:
                self._at, self._end = position + _LEAD_IN, data
                listed = self._metadata([] if mask & _NEW_LIST else listed)
            if mask & _RAW:
                self._values(mask, listed, data, end, closed=following != _UNFINISHED)
            position = end
            segments += 1
            if segments > _MOST_SEGMENTS:
                raise FormatError(
                    f"a TDMS file must have at most {_MOST_SEGMENTS} segments, got more: defragment it (TDMS Defragment in LabVIEW)"
                )

    def _metadata(self, listed: list[str]) -> list[str]:
        """Read the objects of a segment; return the paths of those that have values, in the order of their values."""
        order = dict.fromkeys(listed)
        for _ in range(self._number("I")):
            path = self._text()
            found = self.objects.setdefault(path, TdmsObject())
            head = self._number("I")
            if head == _AS_BEFORE:
                if found.index is None:
                    raise DamagedFileError(
                        f"the values of {path} must be described before they are called the same as before"
                    )
            elif head != _NO_DATA:
                found.index = self._index(head)
            if head == _NO_DATA:
                order.pop(path, None)
            else:
                order.setdefault(path)
            for _ in range(self._number("I")):
                name = self._text()
                found.properties[name] = self._property(path, name)
        return list(order)

    def _index(self, head: int) -> _Index:
        if head in {_FORMAT_CHANGING, _DIGITAL_LINE}:
            return self._daqmx(head)
        kind, _, count = self._number("I"), self._number("I"), self._number("Q")
        if kind == _STRING:
            return _Index(kind=kind, count=count, total=self._number("Q"), reason=text_reason())
        dtype = _NUMBERS.get(kind)
        size = np.dtype(dtype).itemsize if dtype else _SIZES.get(kind, 0)
        if not size:
            raise DamagedFileError(f"the type of values must be one of TDMS, got {kind:#x}")
        reason = "" if dtype else "its values are no plain numbers (times, complex or extended): save it as double"
        return _Index(kind=kind, count=count, dtype=dtype, size=size, total=size * count, reason=reason)

    def _daqmx(self, head: int) -> _Index:
        _, _, count = self._number("I"), self._number("I"), self._number("Q")
        scalers = []
        for _ in range(self._few("scalers")):
            code, buffer, offset = self._number("I"), self._number("I"), self._number("I")
            self._number("I" if head == _FORMAT_CHANGING else "B")
            scalers.append((code, buffer, offset, self._number("I")))
        widths = tuple(self._number("I") for _ in range(self._few("buffers")))
        code, buffer, offset, scale = scalers[0] if scalers else (0xFFFFFFFF, 0, 0, 0)
        reason = ""
        if head == _DIGITAL_LINE:
            reason = "it holds raw digital lines: export it with scaled values"
        elif len(scalers) != 1 or code >= len(_DAQMX_NUMBERS):
            reason = (
                f"its raw values have {len(scalers)} scalers of a kind that is not read: export it with scaled values"
            )
        elif buffer >= len(widths) or offset + np.dtype(_DAQMX_NUMBERS[code]).itemsize > widths[buffer]:
            raise DamagedFileError(
                f"raw values must lie within their buffers, got offset {offset} in buffer {buffer} of {widths}"
            )
        return _Index(
            kind=head,
            count=count,
            dtype=None if reason else _DAQMX_NUMBERS[code],
            buffer=buffer,
            offset=offset,
            scale=scale,
            widths=widths,
            reason=reason,
        )

    def _values(self, mask: int, listed: Sequence[str], data: int, end: int, *, closed: bool) -> None:
        """Find the values of a segment, whose last chunk may be shorter."""
        described = [(self.objects[path], index) for path in listed if (index := self.objects[path].index) is not None]
        for found, index in described:
            found.reason = found.reason or index.reason
        if not described or end == data:
            return
        if mask & _DAQMX:
            self._raw_buffers(described, data, end)
        elif mask & _INTERLEAVED:
            row = sum(index.size for _, index in described)
            if any(not index.size for _, index in described):
                raise FormatError(
                    "interleaved values must be numbers, got texts: write them anew, each channel by itself"
                )
            offset = data
            for found, index in described:
                if index.dtype:
                    rows = (end - data) // row
                    dtype = self._order + index.dtype
                    found.add(Run(offset=offset, chunks=1, chunk=0, count=rows, stride=row, dtype=dtype))
                offset += index.size
        else:
            self._one_by_one(described, data, end, closed=closed)

    def _one_by_one(self, described: Sequence[tuple[TdmsObject, _Index]], data: int, end: int, *, closed: bool) -> None:
        """Find values that lie channel after channel in each chunk.

        A shorter last chunk of a segment that was closed has fewer values of each channel, in the same proportion; one that
        was not closed ends somewhere in a whole chunk.
        """
        chunk = sum(index.total for _, index in described)
        if not chunk:
            return
        chunks, rest = divmod(end - data, chunk)
        offset, left, at = data, rest, data + chunks * chunk
        for found, index in described:
            if closed and index.size:
                remaining = index.count * rest // chunk
                following = at + remaining * index.size
            else:
                remaining = min(max(left, 0) // index.size, index.count) if index.size else 0
                following = at + index.total
            if index.dtype:
                dtype, width = self._order + index.dtype, index.size
                found.add(Run(offset=offset, chunks=chunks, chunk=chunk, count=index.count, stride=width, dtype=dtype))
                found.add(Run(offset=at, chunks=1, chunk=0, count=remaining, stride=width, dtype=dtype))
            at = following
            offset += index.total
            left -= index.total

    def _raw_buffers(self, described: Sequence[tuple[TdmsObject, _Index]], data: int, end: int) -> None:
        widths = described[0][1].widths
        if any(index.widths != widths for _, index in described):
            raise DamagedFileError("the channels of a raw segment must have the same buffers, got others")
        rows = [
            max((index.count for _, index in described if index.buffer == i), default=0) for i in range(len(widths))
        ]
        begins = np.concatenate([[0], np.cumsum(np.array(rows, dtype=object) * np.array(widths, dtype=object))])
        chunk = int(begins[-1])
        if not chunk:
            return
        chunks, rest = divmod(end - data, chunk)
        for found, index in described:
            if index.dtype is None:
                continue
            width, dtype = widths[index.buffer], self._order + index.dtype
            begin = data + int(begins[index.buffer]) + index.offset
            found.add(Run(offset=begin, chunks=chunks, chunk=chunk, count=index.count, stride=width, dtype=dtype))
            remaining = min(max(rest - int(begins[index.buffer]), 0) // width, index.count)
            at = begin + chunks * chunk
            found.add(Run(offset=at, chunks=1, chunk=0, count=remaining, stride=width, dtype=dtype))

    def _property(self, path: str, name: str) -> Any:
        kind = self._number("I")
        if kind == _STRING:
            return self._text()
        if kind == _TIME:
            # the parts of the second come first, unless the file is big-endian
            parts = self._take("Qq") if self._order == "<" else self._take("qQ")[::-1]
            try:
                return EPOCH + timedelta(seconds=parts[1], microseconds=parts[0] * 1e6 / 2**64)
            except OverflowError:
                return None
        if kind == _BOOLEAN:
            return bool(self._number("B"))
        if dtype := _NUMBERS.get(kind):
            width = np.dtype(dtype).itemsize
            self._need(width)
            value = np.frombuffer(self._memory, dtype=self._order + dtype, count=1, offset=self._at)[0].item()
            self._at += width
            return value
        if size := _SIZES.get(kind):
            self._need(size)
            self._at += size
            return None
        raise DamagedFileError(f"property {name!r} of {path} must have a type of TDMS, got {kind:#x}")

    def _few(self, what: str) -> int:
        count = self._number("I")
        if count > 1000:
            raise DamagedFileError(f"{what} of raw values must be at most 1000, got {count}")
        return count

    def _number(self, form: str) -> int:
        return int(self._take(form)[0])

    def _take(self, form: str) -> tuple[Any, ...]:
        layout = struct.Struct(self._order + form)
        self._need(layout.size)
        values = layout.unpack_from(self._memory, self._at)
        self._at += layout.size
        return values

    def _text(self) -> str:
        length = self._number("I")
        self._need(length)
        text = self._memory[self._at : self._at + length].decode("utf-8", errors="replace")
        self._at += length
        return text

    def _need(self, count: int) -> None:
        if self._at + count > self._end:
            raise DamagedFileError(f"metadata must end at byte {self._end}, got more at byte {self._at}")


def parts(path: str) -> list[str]:
    """Return ["group", "channel"] for "/'group'/'channel'"; a quote within a name is doubled."""
    if path == "/":
        return []
    return [part.replace("''", "'") for part in path[2:-1].split("'/'")]


def quoted(name: str) -> str:
    """Return a name as it stands in paths."""
    return "'" + name.replace("'", "''") + "'"


def names_of(paths: Sequence[str]) -> Mapping[str, str]:
    """Return path -> name: that of the channel, with its group where several groups have one of that name."""
    short = [parts(path)[1] for path in paths]
    often = Counter(short)
    return {path: name if often[name] == 1 else "/".join(parts(path)) for path, name in zip(paths, short, strict=True)}
