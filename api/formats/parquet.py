"""Apache Parquet: every column of numbers is a channel, a column of instants the time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, BinaryIO

import numpy as np

from api.formats import PIECE, FormatError, Recording, Series, Values, bounded, proportionate
from api.formats.arrays import is_time, started
from api.formats.exactness import Reading, Rounded

_ROWS = PIECE // 2


def open_file(file: BinaryIO) -> Recording:
    """Return the columns of a Parquet file.

    Raises
    ------
    FormatError
        For another, truncated or damaged file.
    """
    import pyarrow as pa  # noqa: PLC0415 - loads a library that most processes never need
    import pyarrow.parquet as pq  # noqa: PLC0415 - as above

    source = pq.ParquetFile(file, buffer_size=1 << 20, pre_buffer=False)
    schema, count = source.schema_arrow, source.metadata.num_rows
    bounded("the rows of the file", count * max(len(schema), 1))
    size = file.seek(0, 2)
    series: list[Series] = []
    refused: dict[str, str] = {}
    metadata = {key.decode(errors="replace"): value for key, value in (schema.metadata or {}).items()}
    rate = _number(metadata.get("sample_rate"))
    timed = stamped = False
    for field in schema:
        temporal = pa.types.is_timestamp(field.type) or pa.types.is_duration(field.type)
        plain = pa.types.is_integer(field.type) or pa.types.is_floating(field.type) or pa.types.is_boolean(field.type)
        if not plain and not (temporal and not timed):
            refused[field.name] = f"its values are no plain numbers ({field.type}): cast it to double"
            continue
        time = not timed and (temporal or is_time(field.name))
        timed, stamped = timed or time, stamped or temporal
        unit = (field.metadata or {}).get(b"unit", b"").decode(errors="replace")[:64]
        series.append(
            Series(
                name=field.name,
                index=len(series),
                count=count,
                unit="" if temporal else unit,
                sample_rate=rate,
                role="time" if time else "channel",
            )
        )

    rounded = Rounded()

    def read(wanted: Sequence[int]) -> Iterator[tuple[int, Values]]:
        names = [series[place].name for place in wanted]
        proportionate("the columns", _unpacked(source.metadata, set(names)), size=size)
        first: dict[str, Any] = {}
        reading = Reading(rounded)
        for batch in source.iter_batches(batch_size=_ROWS, columns=names, use_threads=False):
            for position, name in enumerate(names):
                yield position, _values(batch.column(name), first, name, reading)

    start_text = metadata.get("start_time", b"").decode(errors="replace")
    if start_text:  # that of the whole recording, of which an export may be a stretch
        time = next((one for one in series if one.role == "time"), None)
        first = float(next(read([time.index]))[1][0]) if time is not None and count else 0.0
        series = [replace(one, start_time=started(start_text, first)) for one in series]
    layout = {"sample_rate": rate} if rate else {}
    return Recording(
        series=series,
        read=read,
        refused=refused,
        layout=layout,
        complete=not stamped,  # stamps count from the first of them, whose date is not taken
        rounded=rounded,
        close=source.close,
    )


def _unpacked(metadata: Any, names: set[str]) -> int:
    """Return how many bytes the pages of some columns say that they unpack to."""
    groups = (metadata.row_group(i) for i in range(metadata.num_row_groups))
    columns = (group.column(i) for group in groups for i in range(group.num_columns))
    return sum(column.total_uncompressed_size for column in columns if column.path_in_schema in names)


def _values(column: Any, first: dict[str, Any], name: str, reading: Reading) -> Values:
    """Return the numbers of a column, missing ones as NaN; instants count in s from the first."""
    import pyarrow as pa  # noqa: PLC0415 - as above

    if pa.types.is_timestamp(column.type) or pa.types.is_duration(column.type):
        scale = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[column.type.unit]
        ticks = column.cast(pa.int64()).to_numpy(zero_copy_only=False)
        if np.issubdtype(ticks.dtype, np.floating):
            raise FormatError(
                f"the instants of {name} must have no gaps, got a missing one: leave out the rows without an instant"
            )
        begin = first.setdefault(name, ticks[0] if ticks.size else 0)
        return np.asarray((ticks - begin) * scale, dtype=np.float64)
    if pa.types.is_boolean(column.type):
        column = column.cast(pa.int8())
    if column.null_count and pa.types.is_integer(column.type):  # whole numbers that are there are counted as such
        gone = column.is_null().to_numpy(zero_copy_only=False)
        values = reading.floats(name, column.fill_null(0).to_numpy(zero_copy_only=False))
        return np.where(gone, np.nan, values)
    return reading.floats(name, column.to_numpy(zero_copy_only=False))


def _number(text: bytes | None) -> float | None:
    try:
        value = float(text or b"nan")
    except ValueError:
        return None
    return value if math.isfinite(value) and value > 0.0 else None
