"""HDF5: a dataset for each channel with its unit, the sample rate and the start as attributes of the file."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator

from api.formats.writing import PIECE, Outgoing

_CHUNK = 1 << 16
_SENT = 1 << 20


def write(recording: Outgoing) -> Iterator[bytes]:
    """Yield the file, once it is complete: the format writes back into its beginning.

    Until then what is yielded is empty: the thread is others' in between, and whoever asked may have left.
    """
    import h5py  # noqa: PLC0415 - loads a library that most processes never need

    with tempfile.TemporaryFile() as file:
        with h5py.File(file, "w") as target:
            target.attrs["name"] = recording.name
            target.attrs["t0"] = float(recording.instants(0, 1)[0])
            if recording.sample_rate is None:
                taken = {column.name for column in recording.columns}
                name = next(name for name in ("time", "t", "time [s]") if name not in taken)
                time = target.create_dataset(name, shape=(recording.count,), dtype="<f8")
                time.attrs["unit"] = "s"
                for start in range(0, recording.count, PIECE):
                    stop = min(start + PIECE, recording.count)
                    time[start:stop] = recording.instants(start, stop)
            else:
                target.attrs["sample_rate"] = recording.sample_rate
            target.attrs["start_time"] = recording.start_time
            for channel, column in enumerate(recording.columns):
                # a slash would make a group of what stands before it
                values = target.create_dataset(
                    column.name.replace("/", "|"),
                    shape=(recording.count,),
                    dtype="<f8",
                    chunks=(min(_CHUNK, recording.count),),
                    compression="gzip",
                    compression_opts=1,
                    shuffle=True,
                )
                values.attrs["unit"] = column.unit
                values.attrs["quantity"] = column.quantity
                for start in range(0, recording.count, PIECE):
                    stop = min(start + PIECE, recording.count)
                    values[start:stop] = recording.read(channel, start, stop)
                    yield b""
        file.seek(0)
        while piece := file.read(_SENT):
            yield piece
