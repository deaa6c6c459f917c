"""Chunks of bytes come back as they were, also those that earlier versions wrote."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest
import zstandard

from storage.packing import DAMAGED, decode, encode

SAMPLES = np.sin(np.cumsum(np.random.default_rng(4).normal(size=5000)) / 50)
NOISE = np.random.default_rng(1).bytes(8000)


def shuffled(data: bytes) -> bytes:
    return b"".join(data[place::8] for place in range(8))


def planes(data: bytes) -> bytes:
    """As earlier versions wrote samples: each plane by itself, packed where that made it shorter."""
    size = len(data) // 8
    parts = [min(plane, zlib.compress(plane, 1), key=len) for plane in (data[place::8] for place in range(8))]
    assert size in map(len, parts)
    assert min(map(len, parts)) < size
    return struct.pack("<8I", *map(len, parts)) + b"".join(parts)


@pytest.mark.parametrize("itemsize", [1, 2, 8])
@pytest.mark.parametrize(
    "data", [SAMPLES.tobytes(), NOISE, b"", b"x" * 8, b"odd"], ids=["samples", "noise", "none", "short", "odd"]
)
def test_what_is_packed_comes_back(data: bytes, itemsize: int) -> None:
    encoding, packed = encode(data, itemsize)
    assert len(packed) <= len(data)
    assert decode(encoding, packed, len(data)) == data


def test_samples_are_shuffled_before_they_are_packed_and_noise_stays_as_it_is() -> None:
    data = SAMPLES.tobytes()
    encoding, packed = encode(data, 8)
    assert encoding == "zstd/8"
    assert zstandard.ZstdDecompressor().decompress(packed) == shuffled(data)
    assert len(packed) < len(encode(data, 1)[1])
    assert encode(NOISE, 8) == ("raw", NOISE)


@pytest.mark.parametrize(
    ("encoding", "pack"),
    [
        ("raw", bytes),
        ("zlib/1", lambda data: zlib.compress(data, 1)),
        ("zlib/8", lambda data: zlib.compress(shuffled(data), 1)),
        ("planes/8", planes),
    ],
)
def test_what_earlier_versions_packed_is_read(encoding: str, pack) -> None:
    data = (np.cumsum(np.random.default_rng(2).normal(size=3000)) / 1000).tobytes()
    assert decode(encoding, pack(data), len(data)) == data


@pytest.mark.parametrize("encoding", ["zstd/8", "zstd/1", "zlib/1", "planes/8"])
@pytest.mark.parametrize(
    "data", [b"", b"no such thing", b"\x28\xb5\x2f\xfd\xa0\xff\xff\xff\x7f"], ids=["none", "text", "huge"]
)
def test_damage_is_told_and_takes_no_memory(encoding: str, data: bytes) -> None:
    with pytest.raises(DAMAGED):
        decode(encoding, data, 80_000)


def test_a_chunk_that_unpacks_to_another_size_is_damaged() -> None:
    encoding, packed = encode(bytes(8000), 8)
    with pytest.raises(ValueError, match="must unpack to 80 bytes, it says 8000"):
        decode(encoding, packed, 80)
