"""Which channels the arrays of a container file (MATLAB, HDF5) are: vectors, and the long direction of matrices."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from api.formats import MOST_CHANNELS, Series

_TIME = re.compile(r"(t|time|zeit|timestamps?|temps|tiempo|timp)\b", re.IGNORECASE)
_STEP = {"ts", "dt", "t_s", "sample_time", "sampling_time", "delta_t", "tsample"}
_RATE = {"fs", "f_s", "sample_rate", "sampling_rate", "fsample", "samplerate"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One channel of an array: ``across`` is its place in the short direction; ``along`` is the axis of the samples."""

    array: int
    along: int
    across: int
    name: str
    count: int


def parts_of(name: str, shape: Sequence[int], *, array: int) -> tuple[list[Part], str]:
    """Return the channels of an array of numbers, or why it has none.

    Parameters
    ----------
    name : str
    shape : sequence of int
    array : int
        Its place among the arrays of the file.
    """
    long = [n for n in shape if n > 1]
    if not long:
        return [], "it is a single number" if all(shape) else "it is empty"
    if len(long) > 2:
        return [], f"it has {len(long)} directions, a recording has at most 2"
    axes = [axis for axis, n in enumerate(shape) if n > 1]
    if len(long) == 1:
        return [Part(array=array, along=axes[0], across=0, name=name, count=long[0])], ""
    along = axes[0] if long[0] >= long[1] else axes[1]
    count, channels = max(long), min(long)
    if channels > MOST_CHANNELS:
        return [], f"its {channels} channels are more than {MOST_CHANNELS}"
    form = "{name}(:,{i})" if along == axes[0] else "{name}({i},:)"
    return [
        Part(array=array, along=along, across=i, name=form.format(name=name, i=i + 1), count=count)
        for i in range(channels)
    ], ""


def is_time(name: str) -> bool:
    """Say whether an array of this name holds the instants of the samples."""
    return _TIME.fullmatch(name.rpartition(".")[2].rpartition("/")[2]) is not None


def _folder(name: str) -> str:
    """Return the structure or folder that an array lies in.

    >>> _folder("bench/x"), _folder("run.force(:,1)"), _folder("x")
    ('bench', 'run', '')
    """
    return name[: max(name.rfind("."), name.rfind("/"), 0)]


def series_of(parts: Sequence[Part], units: Sequence[str] | None = None) -> list[Series]:
    """Return the channels; the first vector of a structure or folder that is called t or time is the time of it."""
    groups = [_folder(part.name) for part in parts]
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
