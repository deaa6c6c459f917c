"""MCAP, the container of robots' recorders: messages of topics, each topic a group with the instants of its messages.

Messages in JSON and in the encodings of ROS 1 and ROS 2 are read; their numbers, however deep, are channels. A topic's
instants are when its messages were logged, in s from the first message of the file.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any, BinaryIO

import numpy as np

from api.formats import (
    ANOTHER,
    MOST_CHANNELS,
    NUMBERS,
    PIECE,
    FormatError,
    Recording,
    Series,
    Values,
    proportionate,
)
from api.formats.exactness import Reading, Rounded, inexact_whole
from api.formats.ros import LONGEST_ARRAY, decoder_of

_BLOCK = PIECE // 16
_LARGEST_RECORD = 256 << 20
_DEEPEST = 16
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)

Decode = Callable[[bytes], Any]


@dataclass(slots=True, kw_only=True)
class _Topic:
    """The messages of one topic: how one is decoded, and the numbers that were found in them."""

    decode: Decode
    count: int = 0
    fields: dict[str, int] = field(default_factory=dict)
    crowded: bool = False


def open_file(file: BinaryIO) -> Recording:
    """Return the numbers in the messages of an MCAP file; topics in other encodings are refused by name.

    Raises
    ------
    FormatError
        For another or a damaged file, or where the package mcap is not installed.
    """
    file.seek(0)
    if file.read(5) != b"\x89MCAP":
        raise FormatError("an MCAP file must begin with its mark, got something else" + ANOTHER)

    def messages(topics: Sequence[str] | None = None) -> Iterator[tuple[Any, Any, Any]]:
        return _messages(file, topics)

    topics, refused, begin = _topics(messages)
    series, places = _series(topics, begin)
    for name in [name for name, topic in topics.items() if not topic.fields]:
        refused[name] = f"its messages hold no numbers, {NUMBERS}: record a topic that has some"
    for name in [name for name, topic in topics.items() if topic.crowded]:
        refused[f"{name}, further numbers"] = (
            f"only the first {MOST_CHANNELS} of a topic are taken, it has more: record those that matter in a topic of their own"
        )

    rounded = Rounded()

    def read(wanted: Sequence[int]) -> Iterator[tuple[int, Values]]:
        reading = Reading(rounded)
        asked: dict[str, list[tuple[int, str, str]]] = {}
        for position, place in enumerate(wanted):
            name, path = places[place]
            asked.setdefault(name, []).append((position, path, series[place].name))

        blocks: dict[str, list[dict[str, int | float]]] = {name: [] for name in asked}
        for _, channel, message in messages(list(asked)):
            block = blocks[channel.topic]
            found = dict(_numbers(topics[channel.topic].decode(message.data)))
            found[""] = (message.log_time - begin) * 1e-9
            block.append(found)
            if len(block) == _BLOCK:
                yield from _columns(block, asked[channel.topic], reading)
                block.clear()
        for name, block in blocks.items():
            yield from _columns(block, asked[name], reading)

    remarks = ["the instants of a topic are when its messages were logged, in s from the first message of the file"]
    return Recording(
        series=series,
        read=read,
        refused=refused,
        remarks=remarks,
        complete=False,  # of a message its texts, long arrays and the instant at which it was published are not taken
        rounded=rounded,
    )


def _messages(file: BinaryIO, topics: Sequence[str] | None) -> Iterator[tuple[Any, Any, Any]]:
    """Yield schema, channel and message of some topics, as they were logged."""
    try:
        from mcap.reader import SeekingReader  # noqa: PLC0415 - an optional extra, needed for these files alone
    except ImportError as error:
        raise FormatError("reading MCAP needs the package mcap: install servotune-server[formats]") from error
    size = file.seek(0, 2)
    file.seek(0)
    reader = SeekingReader(file, validate_crcs=True, record_size_limit=_LARGEST_RECORD)
    _bounded(reader.get_summary(), size)
    yield from reader.iter_messages(topics)


def _columns(
    block: Sequence[Mapping[str, int | float]],
    asked: Sequence[tuple[int, str, str]],
    reading: Reading,
) -> Iterator[tuple[int, Values]]:
    """Yield the samples of some messages; a number that one of them does not have is missing."""
    if block:
        for position, path, name in asked:
            numbers = [found.get(path, math.nan) for found in block]
            reading.count(name, inexact_whole(one for one in numbers if isinstance(one, int)))
            yield position, np.array(numbers, dtype=np.float64)


def _bounded(summary: Any, size: int) -> None:
    """Refuse a file that unpacks to far more than its size."""
    unpacked = sum(chunk.uncompressed_size for chunk in summary.chunk_indexes) if summary else 0
    proportionate("the messages", unpacked, size=size)


def _topics(messages: Callable[[], Iterator[tuple[Any, Any, Any]]]) -> tuple[dict[str, _Topic], dict[str, str], int]:
    """Go through all messages once; return the topics, why others are refused, and when the first one was logged (ns)."""
    topics: dict[str, _Topic] = {}
    refused: dict[str, str] = {}
    begin = None
    for schema, channel, message in messages():
        begin = message.log_time if begin is None else begin
        name = channel.topic
        if name in refused:
            continue
        try:
            topic = topics.get(name) or topics.setdefault(name, _Topic(decode=_decoder(schema, channel)))
            _look(topic, topic.decode(message.data))
        except (FormatError, ValueError) as error:
            refused[name] = f"message {topics[name].count + 1 if name in topics else 1}: {error}"
            topics.pop(name, None)
    if begin is None:
        raise FormatError("an MCAP file must hold messages, got none: was the recording begun?")
    return topics, refused, begin


def _look(topic: _Topic, message: Any) -> None:
    """Count a message and what is new in it."""
    topic.count += 1
    for path, _ in _numbers(message):
        if path not in topic.fields:
            if len(topic.fields) == MOST_CHANNELS:
                topic.crowded = True
                return
            topic.fields[path] = len(topic.fields)


def _decoder(schema: Any, channel: Any) -> Decode:
    if channel.message_encoding == "json":
        return json.loads
    if channel.message_encoding in {"cdr", "ros1"} and schema is not None:
        return decoder_of(schema.name, schema.encoding, schema.data.decode("utf-8", errors="replace"))
    raise FormatError(
        f"its messages are in {channel.message_encoding[:40] or 'no encoding'!r}: json, cdr (ROS 2) and ros1 are read; convert "
        "it to one of them"
    )


def _numbers(value: Any, path: str = "", depth: int = 0) -> Iterator[tuple[str, int | float]]:
    """Yield the numbers within a message with their paths: pose.position.x, effort[0]."""
    if isinstance(value, (bool, int, float)):
        yield path or "value", value
    elif depth < _DEEPEST and isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _numbers(inner, f"{path}.{key}" if path else str(key), depth + 1)
    elif depth < _DEEPEST and isinstance(value, (list, tuple)) and len(value) <= LONGEST_ARRAY:
        for i, inner in enumerate(value):
            yield from _numbers(inner, f"{path}[{i}]", depth + 1)


def _series(topics: Mapping[str, _Topic], begin: int) -> tuple[list[Series], list[tuple[str, str]]]:
    """Return the channels, the instants of each topic before its own, and topic and path of each."""
    start = _EPOCH + timedelta(microseconds=begin // 1000)
    series: list[Series] = []
    places: list[tuple[str, str]] = []
    for name, topic in topics.items():
        for path in ("", *topic.fields) if topic.fields else ():
            series.append(
                Series(
                    name=f"{name}.{path}" if path else f"{name} log time",
                    index=len(series),
                    count=topic.count,
                    unit="" if path else "s",
                    start_time=start,
                    role="channel" if path else "time",
                    group=name,
                )
            )
            places.append((name, path))
    return series, places
