"""Apache Parquet: a column for each channel behind the time in s; units and sample rate stand in the metadata."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from typing import Any

import numpy as np

from api.formats import Values
from api.formats.writing import Outgoing

_ROW_GROUP = 1 << 20


class _Sink(io.RawIOBase):
    """Takes what is written, until it is fetched."""

    def __init__(self) -> None:
        super().__init__()
        self._pending = bytearray()
        self._position = 0

    def writable(self) -> bool:
        return True

    def write(self, data: bytes | memoryview, /) -> int:  # type: ignore[override]  # any buffer, as the base class has it
        self._pending += data
        self._position += len(data)
        return len(data)

    def tell(self) -> int:
        return self._position

    def fetch(self) -> bytes:
        data = bytes(self._pending)
        self._pending.clear()
        return data


def write(recording: Outgoing) -> Iterator[bytes]:
    """Yield the file."""
    # its own allocator keeps what was freed, where api.runtime.memory cannot reach it; read when the library is loaded
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
    import pyarrow as pa  # noqa: PLC0415 - loads a library that most processes never need
    import pyarrow.parquet as pq  # noqa: PLC0415 - as above

    fields = [
        pa.field(column.name, pa.float64(), metadata={"unit": column.unit, "quantity": column.quantity})
        for column in recording.columns
    ]
    taken = {column.name for column in recording.columns}
    time = next(
        name for name in ("time", "t", "time [s]", *(f"time_{i}" for i in range(len(taken) + 1))) if name not in taken
    )
    metadata = {
        "name": recording.name,
        **({"sample_rate": repr(recording.sample_rate)} if recording.sample_rate is not None else {}),
        "start_time": recording.start_time,
    }
    schema = pa.schema([pa.field(time, pa.float64(), metadata={"unit": "s"}), *fields], metadata=metadata)
    sink = _Sink()
    with pq.ParquetWriter(pa.PythonFile(sink, mode="w"), schema) as writer:
        for start, stop in recording.rows():
            columns = [
                recording.instants(start, stop),
                *(recording.read(channel, start, stop) for channel in range(len(fields))),
            ]
            writer.write_table(pa.Table.from_arrays([_column(one) for one in columns], schema=schema), _ROW_GROUP)
            yield sink.fetch()
    yield sink.fetch()


def _column(values: Values) -> Any:
    """Return values as a column that shares their memory; ``pa.array`` would load pandas, 45 MiB that stay."""
    import pyarrow as pa  # noqa: PLC0415 - as above

    return pa.Array.from_buffers(pa.float64(), values.size, [None, pa.py_buffer(np.ascontiguousarray(values, "<f8"))])
