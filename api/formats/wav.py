"""WAV files (RIFF, RF64): PCM of 8 to 64 bits and floating point, as shares of full scale.

    value = whole number / 2^(bits - 1),   floating point as it is

What a full scale is in volts or m/s^2, no such file says: that is the channel's `scale` and `unit`.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from api.formats import (
    ANOTHER,
    MOST_CHANNELS,
    DamagedFileError,
    FormatError,
    Recording,
    Series,
    bounded,
    by_channel,
)
from api.formats.exactness import Rounded

_PCM, _FLOAT, _EXTENSIBLE = 1, 3, 0xFFFE
_UNKNOWN = 0xFFFFFFFF
"""Length of a part that was not written when the file was closed, or stands in the part ds64."""
_MOST_PARTS = 10_000


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sound:
    """How the samples lie: frames of one sample of each channel."""

    kind: int
    channels: int
    rate: int
    bits: int
    offset: int
    frames: int

    @property
    def width(self) -> int:
        """Bytes of one sample."""
        return -(-self.bits // 8)

    @property
    def whole(self) -> int:
        """Bytes of the whole number that holds one."""
        return 1 if self.width == 1 else 4 if self.width <= 4 else 8


def open_file(file: BinaryIO) -> Recording:
    """Return the channels of a WAV file.

    Raises
    ------
    FormatError
        For another file, or samples that are neither PCM nor floating point.
    """
    sound, remarks = _parts(file)
    if not sound.frames:
        raise FormatError("a WAV file must have samples, got none: it is cut off, or empty")
    bounded("the samples", sound.frames * sound.channels)
    series = [
        Series(name=f"channel {i + 1}", index=i, count=sound.frames, sample_rate=float(sound.rate))
        for i in range(sound.channels)
    ]

    def part(channel: int, start: int, stop: int) -> npt.NDArray[Any]:
        frame = sound.width * sound.channels
        file.seek(sound.offset + start * frame)
        raw = np.frombuffer(file.read((stop - start) * frame), dtype=np.uint8)
        return _values(raw.reshape(-1, sound.channels, sound.width)[:, channel], sound)

    form = "floating point" if sound.kind == _FLOAT else f"PCM of {sound.bits} bits, +-1 is full scale"
    said = f"{form}: the file names no unit; what full scale stands for belongs into scale and unit of columns"
    rounded = Rounded()
    read = by_channel(series, part, rounded, scale=_scale(sound))
    return Recording(series=series, read=read, rounded=rounded, remarks=[*remarks, said])


def _values(raw: npt.NDArray[np.uint8], sound: _Sound) -> npt.NDArray[Any]:
    """Return samples from their bytes (n, width): whole numbers, or shares of full scale."""
    if sound.kind == _FLOAT:
        return np.ascontiguousarray(raw).view(f"<f{sound.width}")[:, 0]
    if sound.width == 1:  # alone without a sign
        return raw[:, 0].astype(np.int16) - 128
    # the bits stand at the upper end of their bytes
    wide = np.zeros((len(raw), sound.whole), dtype=np.uint8)
    wide[:, sound.whole - sound.width :] = raw
    return wide.view(f"<i{sound.whole}")[:, 0]


def _scale(sound: _Sound) -> float:
    """Return what a sample is multiplied by to be a share of full scale."""
    return 1.0 if sound.kind == _FLOAT else 0.5 ** (8 * sound.whole - 1)


def _parts(file: BinaryIO) -> tuple[_Sound, list[str]]:
    """Go through the parts of a file to its samples."""
    size = file.seek(0, 2)
    file.seek(0)
    head = file.read(12)
    if head[:4] not in {b"RIFF", b"RF64"} or head[8:12] != b"WAVE":
        raise FormatError("a WAV file must begin with RIFF or RF64 and WAVE, got something else" + ANOTHER)
    form: Sequence[int] = ()
    long = 0
    position = 12
    for _ in range(_MOST_PARTS):
        file.seek(position)
        start = file.read(8)
        if len(start) < 8:
            break
        name, length = start[:4], struct.unpack("<I", start[4:])[0]
        if name == b"ds64":
            long = struct.unpack("<QQ", file.read(16).ljust(16, b"\0"))[1]
        elif name == b"fmt ":
            form = _form(file.read(min(length, 40)))
        elif name == b"data":
            if not form:
                raise DamagedFileError("a WAV file must say how its samples lie (fmt) before them, it does not")
            return _sound(form, position + 8, stated=long if length == _UNKNOWN and long else length, size=size)
        position += 8 + length + length % 2
    raise FormatError("a WAV file must have samples (data), got none: it is cut off, or empty")


def _form(head: bytes) -> tuple[int, int, int, int]:
    if len(head) < 16:
        raise DamagedFileError(f"the part fmt must be at least 16 bytes, got {len(head)}")
    kind, channels, rate, _, frame, bits = struct.unpack("<HHIIHH", head[:16])
    if kind == _EXTENSIBLE and len(head) >= 26:
        kind = struct.unpack("<H", head[24:26])[0]
    fitting = bits in {32, 64} if kind == _FLOAT else kind == _PCM and 1 <= bits <= 64
    if not fitting:
        raise FormatError(
            f"samples must be PCM (1) of up to 64 bits or floating point (3) of 32 or 64, got {kind} of {bits} bits: save "
            "them so, without compression"
        )
    if not 1 <= channels <= MOST_CHANNELS or not rate or frame != channels * -(-bits // 8):
        raise DamagedFileError(
            f"a WAV file must have 1 ... {MOST_CHANNELS} channels, a rate and frames of their width, got {channels} channels, "
            f"{rate} samples/s and frames of {frame} bytes"
        )
    return kind, channels, rate, bits


def _sound(form: Sequence[int], offset: int, *, stated: int, size: int) -> tuple[_Sound, list[str]]:
    kind, channels, rate, bits = form
    frame = channels * -(-bits // 8)
    there = size - offset
    remarks = []
    if stated in {0, _UNKNOWN} and there:
        remarks.append("the file was not closed: the program that wrote it may have crashed; what is there is read")
        stated = there
    elif stated > there:
        remarks.append(f"the file is cut off: {there} of {stated} bytes of samples are there")
    frames = min(stated, there) // frame
    return _Sound(kind=kind, channels=channels, rate=rate, bits=bits, offset=offset, frames=frames), remarks
