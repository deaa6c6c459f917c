"""WAV files as scipy writes and reads them, and as the standard library does: every width and kind of number."""

from __future__ import annotations

import io
import struct
import wave
from pathlib import Path

import numpy as np
import pytest
import scipy.io.wavfile

from api.formats import FormatError
from tests.support.recorded import arrays, closed_files, opened  # noqa: F401 - a fixture for all tests here

RNG = np.random.default_rng(29)


@pytest.mark.parametrize("channels", [1, 2, 5])
@pytest.mark.parametrize("dtype", ["u1", "<i2", "<i4", "<i8", "<f4", "<f8"])
def test_what_scipy_reads(dtype: str, channels: int, tmp_path: Path) -> None:
    kind = np.dtype(dtype)
    shape = (3000, channels)
    if kind.kind == "f":
        values = RNG.normal(size=shape).astype(kind)
    else:
        info = np.iinfo(kind)
        values = RNG.integers(info.min, info.max, size=shape, dtype=kind, endpoint=True)
    target = io.BytesIO()
    scipy.io.wavfile.write(target, 44_100, values)
    rate, theirs = scipy.io.wavfile.read(io.BytesIO(target.getvalue()))
    found = opened("wav", target.getvalue(), tmp_path)
    assert [(one.name, one.count, one.sample_rate, one.unit) for one in found.series] == [
        (f"channel {i + 1}", 3000, rate, "") for i in range(channels)
    ]
    middle, full = {"u": (128, 128.0), "i": (0, 2.0 ** (8 * kind.itemsize - 1)), "f": (0, 1.0)}[kind.kind]
    expected = (theirs.reshape(shape).astype(np.float64) - middle) / full
    np.testing.assert_array_equal(np.transpose(list(arrays(found).values())), expected)
    assert "scale and unit" in found.remarks[-1]


def test_24_bits(tmp_path: Path) -> None:
    """Packed in three bytes, by the standard library; scipy reads them at the upper end of four."""
    values = RNG.integers(-(2**23), 2**23 - 1, size=2000)
    values[:2] = -(2**23), 2**23 - 1
    target = io.BytesIO()
    with wave.open(target, "wb") as file:
        file.setparams((1, 3, 48_000, 0, "NONE", ""))
        file.writeframes(b"".join(int(value).to_bytes(3, "little", signed=True) for value in values))
    (read,) = arrays(opened("wav", target.getvalue(), tmp_path)).values()
    np.testing.assert_array_equal(read, values / 2.0**23)
    np.testing.assert_array_equal(read, scipy.io.wavfile.read(io.BytesIO(target.getvalue()))[1] / 2.0**31)


def _pcm(values: np.ndarray, *, before: bytes = b"", stated: int | None = None, kind: int = 1, bits: int = 16) -> bytes:
    form = struct.pack("<HHIIHH", kind, 1, 1000, 2000, 2, bits)
    data = values.astype("<i2").tobytes()
    body = b"WAVE" + before + b"fmt " + struct.pack("<I", 16) + form
    return b"RIFF\0\0\0\0" + body + b"data" + struct.pack("<I", len(data) if stated is None else stated) + data


def test_parts_that_are_not_known_are_passed_over(tmp_path: Path) -> None:
    values = np.arange(-50, 50)
    extra = b"LIST" + struct.pack("<I", 5) + b"ab\0cd\0"  # filled up to an even length
    (read,) = arrays(opened("wav", _pcm(values, before=extra), tmp_path)).values()
    np.testing.assert_array_equal(read, values / 2.0**15)


@pytest.mark.parametrize(
    ("stated", "said"), [(0, "was not closed"), (0xFFFFFFFF, "was not closed"), (5000, "is cut off")]
)
def test_a_recording_that_was_not_ended_is_read_and_said_so(stated: int, said: str, tmp_path: Path) -> None:
    values = np.arange(100)
    found = opened("wav", _pcm(values, stated=stated), tmp_path)
    (read,) = arrays(found).values()
    np.testing.assert_array_equal(read, values / 2.0**15)
    assert said in found.remarks[0]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"RIFF\0\0\0\0AVI LIST", "must begin with RIFF or RF64 and WAVE"),
        (_pcm(np.arange(9), kind=2), "got 2 of 16 bits: save them so, without compression"),
        (_pcm(np.arange(9), bits=24), "frames of 2 bytes"),
        (_pcm(np.arange(9))[:40], "must have samples"),
    ],
)
def test_other_files_are_refused(content: bytes, message: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=message):
        opened("wav", content, tmp_path)
