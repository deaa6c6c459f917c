"""TDMS files of LabVIEW, DAQmx and their relatives: segments of metadata and raw values, read where they lie.

    byte(sample i of chunk c) = data of the segment + c * chunk + start of the channel + i * stride

The file is mapped, not loaded, so that its size does not matter; raw DAQmx values are scaled as their properties say.
"""

from __future__ import annotations

import bisect
import mmap
from collections.abc import Iterator
from datetime import datetime
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from api.formats import (
    NO_VALUES,
    DamagedFileError,
    Recording,
    Series,
    bounded,
    by_channel,
)
from api.formats.arrays import is_time
from api.formats.exactness import Rounded
from api.formats.tdms.metadata import EPOCH, Parser, TdmsObject, names_of, parts, quoted
from api.formats.tdms.scaling import Scaling, scaling_of


def open_file(file: BinaryIO) -> Recording:
    """Return what a TDMS file holds; channels of texts or without a scaling that is known are refused by name.

    Raises
    ------
    FormatError
        For another file, damaged metadata, or a file that is shorter than its segments say.
    """
    try:
        memory = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except ValueError as error:
        raise DamagedFileError("a TDMS file must begin with TDSm, got an empty file") from error
    parser = Parser(memory)
    parser.run()
    objects = parser.objects
    series: list[Series] = []
    channels: list[tuple[TdmsObject, Scaling | None]] = []
    refused: dict[str, str] = {}
    names = names_of([path for path in objects if len(parts(path)) == 2])
    whole = objects.get("/", TdmsObject()).properties
    for path, name in names.items():
        found = objects[path]
        group = objects.get(f"/{quoted(parts(path)[0])}", TdmsObject()).properties
        scaling, reason = scaling_of(found.properties, group, whole)
        reason = found.reason or reason or (NO_VALUES if not found.count else "")
        if reason:
            refused[name] = reason
            continue
        bounded(f"channel {name!r}", found.count)
        series.append(_series(name, len(series), found, group=parts(path)[0]))
        channels.append((found, scaling))

    def part(channel: int, start: int, stop: int) -> npt.NDArray[Any]:
        values, scaling = channels[channel]
        raw = np.concatenate(list(_raw(memory, values, start, stop)))
        memory.madvise(mmap.MADV_DONTNEED)  # what has been copied need not count as this process's memory
        return raw if scaling is None else scaling(raw)

    rounded = Rounded()
    return Recording(
        series=series,
        read=by_channel(series, part, rounded),
        rounded=rounded,
        refused=refused,
        remarks=parser.remarks,
    )


def _series(name: str, index: int, found: TdmsObject, *, group: str) -> Series:
    properties = found.properties
    step = properties.get("wf_increment")
    start = properties.get("wf_start_time")
    return Series(
        name=name,
        index=index,
        count=found.count,
        unit=str(properties.get("unit_string", properties.get("NI_UnitDescription", "")))[:64],
        sample_rate=1.0 / step if isinstance(step, float) and step > 0.0 else None,
        start_time=start if isinstance(start, datetime) and start > EPOCH else None,
        role="time" if not isinstance(step, float) and is_time(name.rpartition("/")[2]) else "channel",
        group=group,
    )


def _raw(memory: mmap.mmap, found: TdmsObject, start: int, stop: int) -> Iterator[npt.NDArray[Any]]:
    """Yield the values start <= i < stop of a channel as they lie in the file."""
    number = bisect.bisect_right(found.starts, start) - 1
    while start < stop:
        run, first = found.runs[number], start - found.starts[number]
        last = min(stop - found.starts[number], run.chunks * run.count)
        begin, end = first // run.count, -(-last // run.count)
        grid: npt.NDArray[Any] = np.ndarray(
            (end - begin, run.count),
            dtype=run.dtype,
            buffer=memory,
            offset=run.offset + begin * run.chunk,
            strides=(run.chunk, run.stride),
        )
        if end - begin == 1:
            yield grid[0, first - begin * run.count : last - begin * run.count]
        else:
            yield grid.reshape(-1)[first - begin * run.count : last - begin * run.count]
        start = found.starts[number] + last
        number += 1
