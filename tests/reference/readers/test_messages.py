"""MCAP files as the libraries of its makers write them: JSON, ROS 1 and ROS 2 messages, beside what those libraries decode."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mcap_ros1.decoder
import mcap_ros2.decoder
import mcap_ros2.writer
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from api.formats import FormatError
from api.formats.ros import decoder_of
from api.services.recordings.groups import groups_of
from tests.support.recorded import arrays, closed_files, opened  # noqa: F401 - a fixture for all tests here

RNG = np.random.default_rng(29)
BEGIN = 1_780_000_000_000_000_000
STATE = """# an axis
std_msgs/Header header
float64 position
float32[3] effort
uint8 MODE_OFF=0
int16[] codes
string name "none"
bool on true
builtin_interfaces/Duration lasted
sub/Point[] points
===
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
===
MSG: builtin_interfaces/Duration
int32 sec
uint32 nanosec
===
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
===
MSG: sub/Point
int8 a
float64 x
""".replace("===", "=" * 80)


def state(i: int) -> dict[str, Any]:
    return {
        "header": {"stamp": {"sec": 5 + i, "nanosec": i}, "frame_id": "a" * (i % 7)},
        "position": float(RNG.normal()),
        "effort": [float(np.float32(RNG.normal())) for _ in range(3)],
        "codes": [int(one) for one in RNG.integers(-99, 99, size=i % 3)],
        "name": "b" * (i % 5),
        "on": bool(i % 2),
        "lasted": {"sec": -1, "nanosec": 7 * i},
        "points": [{"a": i % 100, "x": float(RNG.normal())} for _ in range(2)],
    }


def flat(value: Any, path: str = "") -> dict[str, float]:
    """Return the numbers in a message, written once more."""
    found: dict[str, float] = {}
    if isinstance(value, dict):
        parts = [(f"{path}.{key}" if path else key, inner) for key, inner in value.items()]
    elif isinstance(value, (list, tuple)):
        parts = [(f"{path}[{i}]", inner) for i, inner in enumerate(value)]
    else:
        return {path: float(value)} if isinstance(value, (int, float)) else {}
    for where, inner in parts:
        found |= flat(inner, where)
    return found


def ros2(messages: list[dict[str, Any]], *, compression: CompressionType = CompressionType.ZSTD) -> bytes:
    target = io.BytesIO()
    writer = mcap_ros2.writer.Writer(target, compression=compression)
    schema = writer.register_msgdef("sub/Axis", STATE)
    for i, message in enumerate(messages):
        writer.write_message("/axis", schema, message, log_time=BEGIN + i * 2_000_000)
    writer.finish()
    return target.getvalue()


def compared(found: Any, messages: list[dict[str, Any]], topic: str) -> None:
    read = arrays(found)
    paths = dict.fromkeys(path for message in messages for path in flat(message))
    assert {name for name in read if name != f"{topic} log time"} == {f"{topic}.{path}" for path in paths}
    for path in paths:
        expected = [flat(message).get(path, np.nan) for message in messages]
        np.testing.assert_array_equal(read[f"{topic}.{path}"], expected, err_msg=path)


@pytest.mark.parametrize("compression", list(CompressionType))
def test_messages_of_ros_2(compression: CompressionType, tmp_path: Path) -> None:
    messages = [state(i) for i in range(60)]
    content = ros2(messages, compression=compression)
    found = opened("mcap", content, tmp_path)
    compared(found, messages, "/axis")
    np.testing.assert_allclose(arrays(found)["/axis log time"], np.arange(60) * 0.002, rtol=0, atol=1e-12)
    reader = make_reader(io.BytesIO(content), decoder_factories=[mcap_ros2.decoder.DecoderFactory()])
    theirs = [message.position for _, _, _, message in reader.iter_decoded_messages()]
    np.testing.assert_array_equal(arrays(found)["/axis.position"], theirs)


def test_messages_of_ros_1(tmp_path: Path) -> None:
    """Encoded by hand as its wiki says, decoded by ours and by the library of MCAP."""
    definition = "Header header\nfloat64 x\nint16[] n\ntime at\nduration lasted\n===\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
    definition = definition.replace("===", "=" * 80)
    import struct

    encoded = []
    for i in range(20):
        frame = b"f" * i
        encoded.append(
            struct.pack("<IIII", i, 5, 6, len(frame)) + frame + struct.pack("<dI2hIIii", 0.5 * i, 2, i, -i, 1, 2, -3, 4)
        )
    target = io.BytesIO()
    writer = Writer(target)
    writer.start()
    schema = writer.register_schema("sub/Axis", "ros1msg", definition.encode())
    channel = writer.register_channel("/axis", "ros1", schema)
    for i, data in enumerate(encoded):
        writer.add_message(channel, BEGIN + i, data, BEGIN + i)
    writer.finish()
    read = arrays(opened("mcap", target.getvalue(), tmp_path))
    reader = make_reader(io.BytesIO(target.getvalue()), decoder_factories=[mcap_ros1.decoder.DecoderFactory()])
    theirs = [message for _, _, _, message in reader.iter_decoded_messages()]
    expected: dict[str, Callable[[Any], float]] = {
        "header.seq": lambda one: one.header.seq, "header.stamp.sec": lambda one: one.header.stamp.secs,
        "header.stamp.nsec": lambda one: one.header.stamp.nsecs, "x": lambda one: one.x, "n[0]": lambda one: one.n[0],
        "n[1]": lambda one: one.n[1], "at.sec": lambda one: one.at.secs, "lasted.sec": lambda one: one.lasted.secs,
        "lasted.nsec": lambda one: one.lasted.nsecs,
    }  # fmt: skip
    for path, value in expected.items():
        np.testing.assert_array_equal(read[f"/axis.{path}"], [float(value(one)) for one in theirs], err_msg=path)


def json_file(topics: dict[str, list[tuple[int, Any]]], *, encoding: str = "json") -> bytes:
    target = io.BytesIO()
    writer = Writer(target)
    writer.start()
    for name, messages in topics.items():
        channel = writer.register_channel(name, encoding, 0)
        for when, message in messages:
            writer.add_message(channel, BEGIN + when, json.dumps(message).encode(), BEGIN + when)
    writer.finish()
    return target.getvalue()


def test_topics_of_several_rates_are_groups(tmp_path: Path) -> None:
    fast = [(i * 1_000_000, {"q": [float(RNG.normal()), i], "note": "x", "ok": i % 2 == 0}) for i in range(200)]
    slow = [(500_000 + i * 10_000_000, {"t": i} if i != 3 else {"other": 1.5}) for i in range(20)]
    found = opened("mcap", json_file({"/fast": fast, "/slow": slow}), tmp_path)
    read = arrays(found)
    for topic, messages in (("/fast", fast), ("/slow", slow)):
        paths = dict.fromkeys(path for _, message in messages for path in flat(message))
        for path in paths:
            expected = [flat(message).get(path, np.nan) for _, message in messages]
            np.testing.assert_array_equal(read[f"{topic}.{path}"], expected)
        np.testing.assert_allclose(read[f"{topic} log time"], [when * 1e-9 for when, _ in messages], atol=1e-12)
    assert [group.name for group in groups_of(found)] == ["/fast", "/slow"]


def test_what_cannot_be_read_is_refused_by_name(tmp_path: Path) -> None:
    content = json_file({"/text": [(0, {"a": "b"})], "/x": [(i, {"x": i}) for i in range(3)]})
    assert opened("mcap", content, tmp_path).refused == {
        "/text": "its messages hold no numbers, a channel must hold numbers: record a topic that has some"
    }
    found = opened("mcap", json_file({"/p": [(0, {})]}, encoding="protobuf"), tmp_path)
    assert found.refused == {
        "/p": "message 1: its messages are in 'protobuf': json, cdr (ROS 2) and ros1 are read; convert it to one of them"
    }
    with pytest.raises(FormatError, match="must hold messages, got none"):
        opened("mcap", json_file({}), tmp_path)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"\0\6\0\0" + bytes(8), "in plain CDR"),
        (b"\0\1\0\0" + bytes(4), "a message must be 12 bytes as its definition says, got 8"),
    ],
)
def test_messages_that_are_not_what_their_definition_says(data: bytes, message: str) -> None:
    with pytest.raises(FormatError, match=message):
        decoder_of("sub/A", "ros2msg", "float64 x")(data)
