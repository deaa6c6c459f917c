"""Which channels the arrays of a container file (MATLAB, HDF5) are: vectors, and the long direction of matrices; when they began."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

import numpy as np

from api.formats import (
    MOST_CHANNELS,
    SAMPLES,
    Series,
)
from api.formats.spectral.names import frequency_scale

_TIME = re.compile(r"(t|time|zeit|timestamps?|temps|tiempo|timp)\b", re.IGNORECASE)
_STEP = {"ts", "dt", "t_s", "sample_time", "sampling_time", "delta_t", "tsample"}
_RATE = {"fs", "f_s", "sample_rate", "sampling_rate", "fsample", "samplerate"}


REAL, IMAGINARY = " (real)", " (imaginary)"
"""What is added to the name of a complex array: its parts are channels where no frequencies stand beside it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One channel of an array: all places of it along one axis.

    Parameters
    ----------
    array : int
        Its place among the arrays of the file.
    along : int
        Axis of the samples.
    place : tuple of int
        Where the first sample is, by axis.
    imaginary : bool
        Whether it is the imaginary part of complex numbers.
    """

    array: int
    along: int
    place: tuple[int, ...]
    name: str
    count: int
    imaginary: bool = False


def parts_of(
    name: str, shape: Sequence[int], *, array: int, is_complex: bool = False, lines: Collection[int] = ()
) -> tuple[list[Part], str]:
    """Return the channels of an array of numbers, or why it has none.

    Parameters
    ----------
    name : str
    shape : sequence of int
    array : int
        Its place among the arrays of the file.
    is_complex : bool
        Whether each number has two parts, which are channels of their own.
    lines : collection of int
        Lengths of the vectors of frequencies beside it: a direction of such a length is that of the lines.
    """
    long = [axis for axis, n in enumerate(shape) if n > 1]
    if not long:
        what = "a single number" if all(shape) else f"empty (of shape {tuple(shape)})"
        return [], f"it is {what}, {SAMPLES}: leave it out, or save what was recorded"
    over_lines = [axis for axis in long if shape[axis] in lines]
    if len(long) > 2 and not over_lines:
        return [], f"it has {len(long)} directions, a recording has at most 2: save its columns as matrices"
    # responses of MATLAB have their lines in the last direction, matrices of samples in the longest
    along = over_lines[-1 if len(long) > 2 else 0] if over_lines else max(long, key=lambda axis: shape[axis])
    across = [axis for axis in long if axis != along]
    channels = math.prod(shape[axis] for axis in across)
    if channels > MOST_CHANNELS:
        return [], f"its {channels} channels are more than {MOST_CHANNELS}: save parts of it"
    found = []
    for there in np.ndindex(*(shape[axis] for axis in across)):
        place = [0] * len(shape)
        for axis, i in zip(across, there, strict=True):
            place[axis] = i
        shown = ",".join(":" if axis == along else str(place[axis] + 1) for axis in long)
        label = f"{name}({shown})" if across else name
        for part, imaginary in ((REAL, False), (IMAGINARY, True)) if is_complex else (("", False),):
            found.append(
                Part(
                    array=array,
                    along=along,
                    place=tuple(place),
                    name=f"{label}{part}",
                    count=shape[along],
                    imaginary=imaginary,
                )
            )
    return found, ""


def line_counts(arrays: Iterable[tuple[str, Sequence[int]]]) -> set[int]:
    """Return the lengths of the vectors that may be frequencies, by their names."""
    return {
        max(shape)
        for name, shape in arrays
        if sum(n > 1 for n in shape) == 1
        and frequency_scale(name.removeprefix(folder_of(name)).lstrip("./"), "") is not None
    }


def frequency_unit(name: str, names: Collection[str], texts: Mapping[str, str]) -> str:
    """Return the unit of the frequencies of a response as MATLAB keeps it: in a text beside them, rad/s where there is none.

    >>> frequency_unit("g.Frequency", ["g.ResponseData", "g.Frequency"], {"g.FrequencyUnit": "Hz"})
    'Hz'
    """
    folder = folder_of(name)
    beside = {mark: f"{folder}{mark}" if folder else "" for mark in "./"}
    if name.removeprefix(folder).lstrip("./") != "Frequency" or not any(
        f"{path}ResponseData" in names for path in beside.values()
    ):
        return ""
    told = [texts.get(f"{path}{label}", "") for path in beside.values() for label in ("FrequencyUnit", "Units")]
    unit = next((text for text in told if text), "rad/TimeUnit")
    return {"rad/TimeUnit": "rad/s", "cycles/TimeUnit": "Hz"}.get(unit, unit)


def is_time(name: str) -> bool:
    """Say whether an array of this name holds the instants of the samples."""
    return _TIME.fullmatch(name.rpartition(".")[2].rpartition("/")[2]) is not None


def folder_of(name: str) -> str:
    """Return the structure or folder that an array lies in.

    >>> folder_of("bench/x"), folder_of("run.force(:,1)"), folder_of("x")
    ('bench', 'run', '')
    """
    return name[: max(name.rfind("."), name.rfind("/"), 0)]


def series_of(parts: Sequence[Part], units: Sequence[str] | None = None) -> list[Series]:
    """Return the channels; the first vector of a structure or folder that is called t or time is the time of it."""
    groups = [folder_of(part.name) for part in parts]
    times: dict[str, int] = {}
    for i, part in enumerate(parts):
        if is_time(part.name):
            times.setdefault(groups[i], i)
    return [
        Series(
            name=part.name,
            index=i,
            count=part.count,
            unit=units[part.array] if units else "",
            role="time" if i == times.get(groups[i]) else "channel",
            group=groups[i],
        )
        for i, part in enumerate(parts)
    ]


def stated_rate(scalars: dict[str, float]) -> tuple[float | None, list[str]]:
    """Return the sample rate that a single number of a known name states, with a remark that says so."""
    for name, value in scalars.items():
        plain = name.rpartition(".")[2].rpartition("/")[2].lower()
        if value > 0.0 and plain in _STEP | _RATE:
            rate = 1.0 / value if plain in _STEP else value
            return rate, [f"{name} = {value:g} is taken for the sample rate, {rate:.12g} samples/s"]
    return None, []


def started(text: str, first: float) -> datetime | None:
    """Return when the first sample of a file was taken, ``first`` s after the start that the file tells; None where it tells none.

    >>> started("2026-11-28T05:00:00+00:00", 1.5)
    datetime.datetime(2026, 11, 28, 5, 0, 1, 500000, tzinfo=datetime.timezone.utc)
    >>> started("in the morning", 0.0)
    """
    try:
        return datetime.fromisoformat(text) + timedelta(seconds=first)
    except (ValueError, OverflowError):
        return None
