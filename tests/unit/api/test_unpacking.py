"""Small files that unpack to large ones, and files that claim more than they hold: refused before memory is taken for them."""

from __future__ import annotations

import io
import json
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
from nptdms import ChannelObject, TdmsWriter

DATA = Path(__file__).parents[3] / "examples" / "data"
MOST_MEMORY = 200 << 20

#: Opens a file, reads all that it offers, and tells what became of that and how much memory it took.
READ = """
import importlib, json, resource, sys
import numpy as np
from api.formats import FormatError, catalogue
from api.formats.text.tables import TableOptions
from api.formats.text.guess import Known
from api.processes.memory import bound_memory

libraries = {"mdf": "asammdf", "hdf5": "h5py", "mat": "h5py", "parquet": "pyarrow.parquet"}
importlib.import_module(libraries.get(sys.argv[1], "json"))
bound_memory(0, more=1 << 30)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
said, count = "", 0
with open(sys.argv[2], "rb") as file:
    try:
        found = catalogue.open_file(sys.argv[1], file, TableOptions(known=Known()))
        said = " ".join(found.refused.values())
        for _, values in found.read(range(len(found.series))):
            count += len(values)
    except FormatError as error:
        said = error.message
    except MemoryError:
        said = "memory"
taken = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
print(json.dumps({"said": said, "count": count, "taken": taken}))
"""


def _hdf5(*, samples: int, chunk: int, matlab: bool = False) -> bytes:
    target = io.BytesIO()
    with h5py.File(target, "w", userblock_size=512 if matlab else 0) as file:
        made = file.create_dataset(
            "x", shape=(samples,), maxshape=(None,), dtype="f8", chunks=(chunk,), compression="gzip"
        )
        packed = zlib.compress(bytes(8 * chunk), 9)
        for start in range(0, samples, chunk):
            made.id.write_direct_chunk((start,), packed)
        if matlab:
            made.attrs["MATLAB_class"] = np.bytes_("double")
    content = target.getvalue()
    return (b"MATLAB 7.3 MAT-file".ljust(512) + content[512:]) if matlab else content


def _hdf5_that_lies() -> bytes:
    """Return an array of one chunk of a megabyte whose stream goes on for a gigabyte and a half."""
    target = io.BytesIO()
    with h5py.File(target, "w") as file:
        made = file.create_dataset("x", shape=(1 << 17,), dtype="f8", chunks=(1 << 17,), compression="gzip")
        made.id.write_direct_chunk((0,), _zeros(zlib.compressobj(1), 1536))
    return target.getvalue()


def _zeros(squeezer: zlib._Compress, megabytes: int) -> bytes:
    """Return the rest of a stream that ends with many zeros: after a full flush equal content is equal bytes."""
    begin = squeezer.flush(zlib.Z_FULL_FLUSH)
    piece = squeezer.compress(bytes(1 << 20)) + squeezer.flush(zlib.Z_FULL_FLUSH)
    return begin + piece * megabytes + squeezer.flush()


def _parquet() -> bytes:
    target = io.BytesIO()
    table = pa.table({"x": np.zeros(1 << 20)})
    with pq.ParquetWriter(target, table.schema) as writer:
        for _ in range(40):
            writer.write_table(table)
    return target.getvalue()


def _mat() -> bytes:
    size = 320 << 20
    head = (
        struct.pack("<IIII", 6, 8, 6, 0) + struct.pack("<IIii", 5, 8, size // 8, 1) + struct.pack("<HH4s", 1, 1, b"x")
    )
    squeezer = zlib.compressobj(1)
    data = squeezer.compress(struct.pack("<II", 14, len(head) + 8 + size) + head + struct.pack("<II", 9, size))
    data += _zeros(squeezer, size >> 20)
    target = io.BytesIO()
    scipy.io.savemat(target, {})
    return target.getvalue()[:128] + struct.pack("<II", 15, len(data)) + data


def _mdf() -> bytes:
    asammdf = pytest.importorskip("asammdf", reason="it comes with the extra `formats`")
    target = io.BytesIO()
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(np.arange(50.0), np.arange(50.0), name="x")])
        file.save(target, compression=2)
    content = bytearray(target.getvalue())
    place = content.index(b"##CG") + 80  # behind header, six links and the number of the record
    assert struct.unpack_from("<Q", content, place) == (50,)
    struct.pack_into("<Q", content, place, 10**9)
    return bytes(content)


def _tdms() -> bytes:
    target = io.BytesIO()
    with TdmsWriter(target) as writer:
        writer.write_segment([ChannelObject("bench", "x", np.arange(50.0), {"wf_increment": 0.01})])
    index = struct.pack("<IIQ", 10, 1, 50)
    assert target.getvalue().count(index) == 1
    return target.getvalue().replace(index, struct.pack("<IIQ", 10, 1, 10**15))


def _uff() -> bytes:
    text = (DATA / "uff_vibration" / "Sample_UFF58_ascii.uff").read_bytes()
    place = text.index(b"    58\n") if b"    58\n" in text else text.index(b"    58\r\n")
    lines = text[place:].splitlines(keepends=True)
    lines[7] = lines[7][:10] + b"1000000000" + lines[7][20:]
    return b"    -1\n" + b"".join(lines)


#: Format, content, what is said, and how many samples may be read all the same.
FILES: dict[str, tuple[str, Callable[[], bytes], str, int]] = {
    "HDF5, 1.6 GB of zeros": ("hdf5", lambda: _hdf5(samples=200 << 20, chunk=1 << 20), "must unpack to at most", 0),
    "HDF5, one chunk": ("hdf5", lambda: _hdf5(samples=25 << 20, chunk=25 << 20), "packed too densely", 0),
    "HDF5, one value in a large chunk": ("hdf5", lambda: _hdf5(samples=1, chunk=25 << 20), "packed too densely", 0),
    "MATLAB 7.3": ("mat", lambda: _hdf5(samples=40 << 20, chunk=1 << 20, matlab=True), "must unpack to at most", 0),
    "MATLAB 5": ("mat", _mat, "the variables must unpack to at most", 0),
    "Parquet": ("parquet", _parquet, "must unpack to at most", 0),
    "MDF, a count that is none": ("mdf", _mdf, "must unpack to at most", 0),
    "TDMS, a count that is none": ("tdms", _tdms, "", 50),
    "UFF, a count that is none": ("uff", _uff, "must fit into the", 0),
}  # fmt: skip


def read(format_: str, content: bytes, folder: Path) -> dict[str, object]:
    (folder / "file").write_bytes(content)
    command = [sys.executable, "-c", READ, format_, str(folder / "file")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found: dict[str, object] = json.loads(done.stdout)
    return found


@pytest.mark.parametrize("what", FILES)
def test_what_unpacks_to_much_or_claims_much_is_refused_in_little_memory(what: str, tmp_path: Path) -> None:
    format_, make, says, count = FILES[what]
    content = make()
    assert len(content) < 4 << 20
    found = read(format_, content, tmp_path)
    assert says in str(found["said"])
    assert found["count"] == count
    assert found["taken"] < MOST_MEMORY  # type: ignore[operator] # a number


def test_a_stream_that_goes_on_behind_what_it_claims_ends_at_the_memory_of_a_reader(tmp_path: Path) -> None:
    found = read("hdf5", _hdf5_that_lies(), tmp_path)
    assert found["count"] == 0
    assert found["said"]
    assert found["taken"] < (1 << 30) + MOST_MEMORY  # type: ignore[operator] # a number
