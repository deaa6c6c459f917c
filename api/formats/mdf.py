"""ASAM MDF, versions 3 and 4: groups of channels, each with its own master of time.

Groups whose masters hold the same instants are one group. Samples that the file calls invalid are missing (NaN); channels
whose numbers stand for texts (states, switches) are those numbers.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from api.formats import (
    ANOTHER,
    PIECE,
    DamagedFileError,
    FormatError,
    Recording,
    Series,
    Values,
    bounded,
    proportionate,
    text_reason,
)
from api.formats.exactness import Reading, Rounded, inexact

_NUMBERS = {3: {0, 1, 2, 3, *range(9, 17)}, 4: set(range(6))}
"""Types of data of each version that are plain numbers."""
_WORDS = {3: {7}, 4: {6, 7, 8, 9, 17}}
"""Types of data of each version that are text."""
_STRUCTURE = "it is a structure: its parts are channels of their own"
_TEXTS = {3: {11, 12}, 4: {7, 8, 11}}
"""Conversions of each version that make texts of numbers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Place:
    """Where a channel is; ``index`` is None for the master of its group, ``element`` a field of an array and a place in it."""

    group: int
    index: int | None
    raw: bool = False
    element: tuple[str, int] | None = None


def open_file(file: BinaryIO) -> Recording:
    """Return the channels of an MDF file; each group's master is a channel of the role time.

    Raises
    ------
    FormatError
        For another or a damaged file, or where asammdf is not installed.
    """
    try:
        from asammdf import MDF  # noqa: PLC0415 - an optional extra (LGPL), needed for these files alone
        from asammdf.blocks.mdf_v4 import MDF4  # noqa: PLC0415 - as above
    except ImportError as error:
        raise FormatError("reading MDF needs the package asammdf: install servotune-server[formats]") from error
    file.seek(0)
    if file.read(3) != b"MDF":
        raise FormatError("an MDF file must begin with MDF, got something else" + ANOTHER)
    MDF4.__del__ = _ended  # type: ignore[method-assign]
    source = MDF(f"/proc/self/fd/{file.fileno()}")
    places, series, refused = _channels(source, size=file.seek(0, 2))

    rounded = Rounded()

    def read(wanted: Sequence[int]) -> Iterator[tuple[int, Values]]:
        reading = Reading(rounded)
        for position, one in enumerate(wanted):
            count = series[one].count or 0
            for start in range(0, count, PIECE):
                lost = partial(reading.count, series[one].name)
                yield position, _values(source, places[one], start, min(PIECE, count - start), lost)

    texts = [one.name for one, place in zip(series, places, strict=True) if place.raw]
    remarks = [f"{name}: its numbers are taken, not the texts that they stand for" for name in texts]
    return Recording(
        series=series,
        read=read,
        refused=refused,
        remarks=remarks,
        complete=not texts,
        rounded=rounded,
        close=source.close,
    )


def _ended(made: Any) -> None:
    """End an object of asammdf: one that a damaged file left half made misses what its own end asks for, and would tell a stack trace."""
    with suppress(AttributeError):
        made.close()


def _values(source: Any, place: _Place, start: int, count: int, lost: Callable[[int], None] | None = None) -> Values:
    """Return samples of a channel; invalid ones are NaN, and how many others float64 does not hold is told."""
    if place.index is None:
        return np.asarray(source.get_master(place.group, record_offset=start, record_count=count), dtype=np.float64)
    samples, invalid = source.get(
        group=place.group,
        index=place.index,
        raw=place.raw,
        record_offset=start,
        record_count=count,
        samples_only=True,
        ignore_invalidation_bits=True,  # they are handed over instead of being left out, which would shift the rest
    )
    if place.element is not None:
        name, number = place.element
        samples = (samples[name] if name else samples).reshape(count, -1)[:, number]
    gone = np.zeros(len(samples), dtype=bool) if invalid is None else np.asarray(invalid, dtype=bool)
    if lost is not None:
        lost(inexact(np.asarray(samples)[~gone]))
    values = np.array(samples, dtype=np.float64)
    values[gone] = np.nan
    return values


def _channels(source: Any, *, size: int) -> tuple[list[_Place], list[Series], dict[str, str]]:
    """Return where each channel is, what it is, and what is refused."""
    places: list[_Place] = []
    series: list[Series] = []
    refused: dict[str, str] = {}
    taken: set[str] = set()
    used = [group for group in range(len(source.groups)) if source.groups[group].channel_group.cycles_nr]
    names = Counter(channel.name for group in used for channel in source.groups[group].channels)
    start = source.header.start_time
    version = 4 if str(source.version) >= "4" else 3
    labels: dict[bytes, str] = {}
    for group in used:
        count = int(source.groups[group].channel_group.cycles_nr)
        bounded(f"the samples of group {group}", count)
        proportionate(f"the samples of group {group}", 8 * count, size=size)
        _check_places(source.groups[group], group)
        master = source.masters_db.get(group)
        label = labels.setdefault(_digest(source, group, count, timed=master is not None), _label(source, group))
        known = len([one for one in series if one.group == label and one.role == "time"])
        own = {channel.name for channel in source.groups[group].channels}
        for index, channel in enumerate(source.groups[group].channels):
            name = channel.name if names[channel.name] == 1 else f"{channel.name} (group {group})"
            if name in taken:
                name = f"{channel.name} (group {group}, channel {index})"
            taken.add(name)
            if channel.data_type not in _NUMBERS[version]:
                parts = source.groups[group].channel_dependencies[index]
                refused[name] = _STRUCTURE if parts else _why_refused(channel, version)
                continue
            if source.groups[group].channel_dependencies[index]:
                elements = _elements(source, group, index)
                if not elements:
                    refused[name] = _STRUCTURE
                for label_of, element in elements.items():
                    if f"{channel.name}{label_of}" in own:
                        continue  # it is a channel of its own
                    series.append(
                        Series(
                            name=f"{name}{label_of}",
                            index=len(series),
                            count=count,
                            unit=_unit(channel),
                            start_time=start,
                            group=label,
                        )
                    )
                    places.append(_Place(group=group, index=index, element=element))
                continue
            timed = index == master
            if timed and known:
                continue  # the same instants once more
            series.append(
                Series(
                    name=name,
                    index=len(series),
                    count=count,
                    unit="" if timed else _unit(channel),
                    start_time=start,
                    role="time" if timed else "channel",
                    group=label,
                )
            )
            kind = getattr(channel.conversion, "conversion_type", None)
            places.append(
                _Place(group=group, index=None if timed else index, raw=not timed and kind in _TEXTS[version])
            )
    return places, series, refused


def _unit(channel: Any) -> str:
    """Return the unit of a channel; version 3 keeps it with the conversion."""
    return str(getattr(channel, "unit", "") or getattr(channel.conversion, "unit", "") or "")[:64]


def _why_refused(channel: Any, version: int) -> str:
    """Return why the values of a channel are none."""
    if channel.data_type in _WORDS[version]:
        return text_reason()
    return (
        f"it holds {channel.bit_count // 8} bytes a sample, a channel must hold one number: decode frames of a bus (CAN, LIN ...) with "
        "their database first, with asammdf's extract_bus_logging, and send the file that this writes"
    )


def _elements(source: Any, group: int, index: int) -> dict[str, tuple[str, int]]:
    """Return the numbers of an array by what is added to its name: [1][0]; its axes are arrays of their own."""
    samples = source.get(group=group, index=index, record_offset=0, record_count=1, samples_only=True)[0]
    fields = samples.dtype.names or ("",)
    name = source.groups[group].channels[index].name
    found = {}
    for field in fields:
        part = samples[field] if field else samples
        if part.dtype.kind not in "iufb" or part.ndim < 2:
            continue
        for number, place in enumerate(np.ndindex(*part.shape[1:])):
            axis = "" if field in {"", name} else f" {field}"
            found[f"{axis}{''.join(f'[{i}]' for i in place)}"] = (field, number)
    return found


def _check_places(group: Any, number: int) -> None:
    """Refuse channels that lie outside of their records, which the library reads all the same, whatever memory that is."""
    head = group.channel_group
    size = head.samples_byte_nr + getattr(head, "invalidation_bytes_nr", 0)
    for channel in group.channels:
        if hasattr(channel, "byte_offset"):
            end = 8 * channel.byte_offset + channel.bit_offset + channel.bit_count
        else:  # versions 2 and 3; the blocks of version 2 end before that offset
            end = 8 * getattr(channel, "additional_byte_offset", 0) + channel.start_offset + channel.bit_count
        if end > 8 * size:
            raise DamagedFileError(
                f"channel {channel.name!r} must lie within the {size} bytes of a record of group {number}, got its end at bit "
                f"{end}"
            )


def _label(source: Any, group: int) -> str:
    name = str(getattr(source.groups[group].channel_group, "acq_name", "") or "")
    return f"{name[:80]} (group {group})" if name else f"group {group}"


def _digest(source: Any, group: int, count: int, *, timed: bool) -> bytes:
    """Return what groups of the same instants have in common."""
    found = hashlib.sha256(f"{count} {'' if timed else group}".encode())
    for start in range(0, count if timed else 0, PIECE):
        master = _Place(group=group, index=None)
        found.update(_values(source, master, start, min(PIECE, count - start)).tobytes())
    return found.digest()
