"""ASAM MDF, versions 3 and 4: groups of channels, each with its own master of time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, BinaryIO

import numpy as np

from api.formats import PIECE, FormatError, Recording, Series, Values, bounded


def open_file(file: BinaryIO) -> Recording:
    """Return the channels of an MDF file; each group's master is a channel of the role time.

    Raises
    ------
    FormatError
        For another or a damaged file, or where asammdf is not installed.
    """
    try:
        from asammdf import MDF  # noqa: PLC0415 - an optional extra (LGPL), needed for these files alone
        from asammdf.blocks.utils import MdfException  # noqa: PLC0415 - as above
    except ImportError as error:
        raise FormatError("reading MDF needs the package asammdf: install servotune[formats]") from error
    file.seek(0)
    if file.read(3) != b"MDF":
        raise FormatError("an MDF file must begin with MDF, got something else")
    wrong = (MdfException, ValueError, KeyError, IndexError, OSError, TypeError, AttributeError, OverflowError)
    try:
        source = MDF(f"/proc/self/fd/{file.fileno()}")
        places, series, refused = _channels(source)
    except wrong as error:
        raise FormatError(f"an MDF file must be complete, got one that the library does not open: {error}") from error

    def read(wanted: Sequence[int]) -> Iterator[tuple[int, Values]]:
        for position, one in enumerate(wanted):
            group, index, name = places[one]
            count = series[one].count or 0
            for start in range(0, count, PIECE):
                length = min(PIECE, count - start)
                try:
                    if index is None:
                        values = source.get_master(group, record_offset=start, record_count=length)
                    else:
                        values = source.get(
                            group=group,
                            index=index,
                            record_offset=start,
                            record_count=length,
                            samples_only=True,
                            ignore_invalidation_bits=True,
                        )[0]
                    yield position, np.asarray(values, dtype=np.float64)
                except wrong as error:
                    raise FormatError(f"channel {name!r} must be numbers, got {error}") from error

    return Recording(series=series, read=read, refused=refused, close=source.close)


def _channels(source: Any) -> tuple[list[tuple[int, int | None, str]], list[Series], dict[str, str]]:
    """Return where each channel is (group, index), what it is, and what is refused."""
    places: list[tuple[int, int | None, str]] = []
    series: list[Series] = []
    refused: dict[str, str] = {}
    used = [group for group in range(len(source.groups)) if source.groups[group].channel_group.cycles_nr]
    names = [channel.name for group in used for channel in source.groups[group].channels]
    start = source.header.start_time
    for group in used:
        count = int(source.groups[group].channel_group.cycles_nr)
        master = source.masters_db.get(group)
        for index, channel in enumerate(source.groups[group].channels):
            name = channel.name if names.count(channel.name) == 1 else f"{channel.name} (group {group})"
            bounded(f"channel {name!r}", count)
            if getattr(channel, "data_type", 0) > 5:
                refused[name] = "its values are no plain numbers"
                continue
            series.append(
                Series(
                    name=name,
                    index=len(series),
                    count=count,
                    unit="" if index == master else str(getattr(channel, "unit", "") or "")[:64],
                    start_time=start,
                    role="time" if index == master else "channel",
                )
            )
            places.append((group, None if index == master else index, name))
    return places, series, refused
