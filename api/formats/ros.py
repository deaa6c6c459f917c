"""Messages of ROS 1 and ROS 2 (CDR) as their definitions describe them, which recorders keep beside the messages.

double x        ->  8 bytes, in CDR at a multiple of 8 behind the header of 4 bytes
float32[] a     ->  count (uint32), then as many numbers
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from api.formats import DamagedFileError, FormatError

_NUMBERS = {
    "bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i",
    "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
_FIELD = re.compile(r"(?P<type>[\w/]+)(?:<=\d+)?(?P<array>\[(?:<=)?(?P<count>\d*)\])?(?:<=\d+)?\s+(?P<name>\w+)")
_CONSTANT = re.compile(r"[\w/]+(?:<=\d+)?\s+\w+\s*=")
LONGEST_ARRAY = 64
"""Members of an array that are looked at: longer ones are pictures and clouds of points, no channels."""
_DEEPEST = 32
_TIMES = {"time": "II", "duration": "ii"}
"""Of ROS 1: seconds and nanoseconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Field:
    name: str
    type: str
    count: int | None
    """Members of an array, -1 where the message says how many; None for a single value."""


_SECONDS = [_Field(name="sec", type="int32", count=None), _Field(name="nanosec", type="uint32", count=None)]
"""Of the instants of ROS 2, which definitions may leave out."""


def decoder_of(name: str, encoding: str, text: str) -> Callable[[bytes], Any]:
    """Return what decodes the messages of a definition.

    Raises
    ------
    FormatError
        For a definition that is not one of ROS messages, or lacks a part.
    """
    if encoding not in {"ros1msg", "ros2msg"}:
        raise FormatError(
            f"its messages are described in {encoding[:40]!r}: ros1msg and ros2msg are read; record it with message definitions"
        )
    types = _definitions(name, text)
    aligned = encoding == "ros2msg"

    def decode(data: bytes) -> Any:
        return _Reader(data, types, aligned=aligned).value(name)

    return decode


def _definitions(name: str, text: str) -> dict[str, list[_Field]]:
    """Return the fields of a message and of all messages within it."""
    types: dict[str, list[_Field]] = {}
    current = types[name] = []
    for line in text.splitlines():
        plain = line.split("#", 1)[0].strip()
        if not plain or set(plain) == {"="}:
            continue
        if plain.startswith("MSG:"):
            current = types.setdefault(plain.removeprefix("MSG:").strip(), [])
            continue
        if _CONSTANT.match(plain):
            continue
        match = _FIELD.match(plain)
        if match is None:
            raise DamagedFileError(f"its definition must be fields of type and name, got {plain[:60]!r}")
        count = (
            None if not match["array"] else int(match["count"]) if match["count"] and "<" not in match["array"] else -1
        )
        current.append(_Field(name=match["name"], type=match["type"], count=count))
    return types


class _Reader:
    """Reads the values of one message in order."""

    def __init__(self, data: bytes, types: Mapping[str, list[_Field]], *, aligned: bool) -> None:
        self._data, self._types, self._aligned = data, types, aligned
        self._at = self._begin = 4 if aligned else 0
        self._order = ">" if aligned and data[1:2] == b"\0" else "<"
        if aligned and data[:2] not in {b"\0\0", b"\0\1"}:
            raise FormatError(
                f"its messages must be in plain CDR, got the encapsulation {data[:2]!r}: record it without XCDR2"
            )

    def value(self, type_: str, within: str = "", depth: int = 0) -> Any:
        """Return a value of a type: a number, a text, or the fields of a message."""
        if form := _NUMBERS.get(type_):
            return self._take(form)
        if type_ in {"string", "wstring"}:
            length = self._take("I") * (2 if type_ == "wstring" else 1)
            return self._bytes(length).decode("utf-8", errors="replace").rstrip("\0")
        if type_ in _TIMES and not self._aligned:
            sec, nsec = (self._take(form) for form in _TIMES[type_])
            return {"sec": sec, "nsec": nsec}
        name = self._found(type_, within)
        if depth > _DEEPEST:
            raise FormatError(
                f"messages must be nested at most {_DEEPEST} deep, got more in {name}: record the inner messages as topics of their own"
            )
        return {one.name: self._field(one, name, depth + 1) for one in self._types[name]}

    def _field(self, one: _Field, within: str, depth: int) -> Any:
        if one.count is None:
            return self.value(one.type, within, depth)
        count = self._take("I") if one.count < 0 else one.count
        if form := _NUMBERS.get(one.type):
            width = struct.calcsize(form)
            self._align(width if count else 1)
            data = self._bytes(count * width)
            return list(struct.unpack(f"{self._order}{count}{form}", data)) if count <= LONGEST_ARRAY else None
        self._bytes(0 if count <= len(self._data) else count)  # each member has a byte at least
        return [self.value(one.type, within, depth) for _ in range(count)]

    def _found(self, type_: str, within: str) -> str:
        """Return the full name of a message that a field names in short."""
        package = within.split("/", maxsplit=1)[0]
        last = type_.rpartition("/")[2]
        for name in (
            type_,
            f"{package}/{type_}",
            f"{package}/msg/{type_}",
            type_.replace("/", "/msg/", 1),
            "std_msgs/Header",
        ):
            if name in self._types and name.endswith(last):
                return name
        if last in {"Time", "Duration"} and type_.startswith("builtin_interfaces/"):
            self._types = {**self._types, type_: _SECONDS}
            return type_
        raise FormatError(f"its definition must hold {type_}, it does not: record it with whole message definitions")

    def _take(self, form: str) -> Any:
        width = struct.calcsize(form)
        self._align(width)
        return struct.unpack(self._order + form, self._bytes(width))[0]

    def _align(self, width: int) -> None:
        if self._aligned:
            self._at += -(self._at - self._begin) % width

    def _bytes(self, count: int) -> bytes:
        end = self._at + count
        if end > len(self._data):
            raise DamagedFileError(f"a message must be {end} bytes as its definition says, got {len(self._data)}")
        found, self._at = self._data[self._at : end], end
        return found
