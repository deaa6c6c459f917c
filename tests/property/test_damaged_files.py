"""Files of every format with bytes changed, left out, doubled or cut off: numbers or a refusal in words, never anything else."""

from __future__ import annotations

import gc
import io
import json
import tempfile
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io.wavfile
from hypothesis import settings
from mcap.writer import CompressionType, Writer
from nptdms import ChannelObject, TdmsWriter

from api.formats import FormatError
from api.formats.catalogue import _READERS, TABLES
from tests.support.recorded import arrays, closed_files, opened  # noqa: F401 - a fixture for all tests here

# of the libraries some leave a file to the collector that they could not open
pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")

WHOLE = settings().max_examples > 1000
CHANGED, CUT = (1000, 200) if WHOLE else (40, 15)
COUNT = 300
RNG = np.random.default_rng(5)
LINES = {"csv", "txt", "touchstone", "frd"}
"""Formats that do not say how many samples they hold: whole rows are all that can be known of them."""
TIME, X = np.arange(COUNT) / 100.0, RNG.normal(size=COUNT)
DATA = Path(__file__).parents[2] / "examples" / "data"


def _tdms() -> bytes:
    target = io.BytesIO()
    with TdmsWriter(target) as writer:
        for part in np.array_split(X, 3):
            writer.write_segment([ChannelObject("bench", "x", part, {"wf_increment": 0.01, "unit_string": "mm"})])
    return target.getvalue()


def _matlab(*, squeezed: bool = True) -> bytes:
    target = io.BytesIO()
    scipy.io.savemat(target, {"t": TIME, "x": X, "s": {"y": X}}, do_compression=squeezed)
    return target.getvalue()


def _hdf5(*, compression: str | None = "gzip", userblock: int = 0) -> bytes:
    target = io.BytesIO()
    with h5py.File(target, "w", userblock_size=userblock) as file:
        made = file.create_dataset("x", data=X, compression=compression)
        made.attrs["sample_rate"] = 100.0
        if userblock:
            made.attrs["MATLAB_class"] = np.bytes_("double")
    return target.getvalue()


def _matlab_7_3() -> bytes:
    return b"MATLAB 7.3 MAT-file".ljust(512) + _hdf5(userblock=512)[512:]


def _parquet(*, compression: str = "snappy") -> bytes:
    target = io.BytesIO()
    pq.write_table(pa.table({"t": TIME, "x": X}), target, compression=compression)
    return target.getvalue()


def _mdf(*, version: str = "4.10", compression: int = 2) -> bytes:
    asammdf = pytest.importorskip("asammdf", reason="it comes with the extra `formats`")
    with tempfile.TemporaryDirectory() as folder, asammdf.MDF(version=version) as file:
        file.append([asammdf.Signal(X, TIME, name="x", unit="mm")])
        return Path(file.save(Path(folder) / "x.mf4", compression=compression)).read_bytes()


def _uff() -> bytes:
    text = (DATA / "uff_vibration" / "Sample_UFF58_ascii.uff").read_bytes()
    place = text.index(b"    58\n") if b"    58\n" in text else text.index(b"    58\r\n")
    end = text.index(b"    -1", place)
    return b"    -1\n" + text[place:end] + b"    -1\n"


def _uff_binary() -> bytes:
    """Return the same header with ordinates in the binary form of little-endian doubles."""
    lines = _uff().splitlines(keepends=True)
    data = X.astype("<f8").tobytes()
    numbers = "".join(f"{n:6d}" for n in (1, 2)) + "".join(f"{n:12d}" for n in (11, len(data), 0, 0, 0, 0))
    lines[1] = f"    58b{numbers}\n".encode()
    lines[8] = f"{4:10d}{COUNT:10d}{1:10d}".encode() + lines[8][30:]
    return b"".join(lines[:13]) + data + b"\n    -1\n"


def _lvm() -> bytes:
    return (DATA / "lvm_labview" / "short.lvm").read_bytes()


def _wav(kind: str = "i2") -> bytes:
    target = io.BytesIO()
    scipy.io.wavfile.write(target, 1000, (X * 5000).astype(kind))
    return target.getvalue()


def _mcap(compression: CompressionType = CompressionType.LZ4) -> bytes:
    target = io.BytesIO()
    writer = Writer(target, compression=compression)
    writer.start()
    channel = writer.register_channel("/x", "json", 0)
    for i, x in enumerate(X):
        writer.add_message(channel, i * 10_000_000, json.dumps({"x": x}).encode(), i * 10_000_000)
    writer.finish()
    return target.getvalue()


def _touchstone() -> bytes:
    return ("# Hz S RI R 50\n" + "".join(f"{1 + t:.2f} {x:.6f} 0.5\n" for t, x in zip(TIME, X, strict=True))).encode()


def _frd() -> bytes:
    return _touchstone().split(b"\n", 1)[1]


def _csv() -> bytes:
    return ("time [s],x [mm]\n" + "".join(f"{t:.2f},{x:.6f}\n" for t, x in zip(TIME, X, strict=True))).encode()


FILES: dict[str, Callable[[], bytes]] = {
    "tdms": _tdms, "mat": _matlab, "hdf5": _hdf5, "parquet": _parquet, "mdf": _mdf, "uff": _uff, "lvm": _lvm, "csv": _csv,
    "wav": _wav, "mcap": _mcap, "touchstone": _touchstone, "frd": _frd,
    "txt": lambda: _csv().replace(b",", b"\t"),
}  # fmt: skip


OTHERS: dict[str, Callable[[], bytes]] = {
    "mat 7.3": _matlab_7_3, "mat plain": lambda: _matlab(squeezed=False), "hdf5 plain": lambda: _hdf5(compression=None),
    "parquet zstd": lambda: _parquet(compression="zstd"), "mdf plain": lambda: _mdf(compression=0),
    "mdf 3": lambda: _mdf(version="3.30", compression=0), "uff binary": _uff_binary, "wav float": lambda: _wav("f4"),
    "mcap zstd": lambda: _mcap(CompressionType.ZSTD),
}  # fmt: skip
"""Further ways in which files of a format are written: the format is the first word."""
ALL = FILES | OTHERS


def test_every_format_is_here() -> None:
    assert set(FILES) == {*_READERS, *TABLES, "lvm", "uff"}


def changed(whole: bytes, rng: np.random.Generator) -> bytes:
    """Return a file with some bytes changed, left out, doubled or exchanged."""
    content = bytearray(whole)
    for _ in range(int(rng.integers(1, 4))):
        place, length = int(rng.integers(len(content))), int(rng.integers(1, 40))
        match int(rng.integers(4)):
            case 0:
                content[place] = int(rng.integers(256))
            case 1:
                del content[place : place + length]
            case 2:
                content[place:place] = content[place : place + length]
            case _:
                content[place : place + length] = rng.bytes(min(length, len(content) - place))
    return bytes(content)


@pytest.mark.parametrize("kind", ALL)
def test_a_changed_file_is_read_or_refused_in_words(kind: str, tmp_path: Path) -> None:
    whole, refused, format_ = ALL[kind](), 0, kind.split(maxsplit=1)[0]
    for seed in range(CHANGED):
        try:
            arrays(opened(format_, changed(whole, np.random.default_rng([7, seed])), tmp_path))
        except FormatError:
            refused += 1
    gc.collect()  # what libraries have left half open is let go of here, where its complaints are known
    assert refused


@pytest.mark.parametrize("kind", ALL)
def test_a_cut_file_is_refused_or_what_is_missing_is_said(kind: str, tmp_path: Path) -> None:
    whole, format_ = ALL[kind](), kind.split(maxsplit=1)[0]
    intact = opened(format_, whole, tmp_path)
    truth = {**arrays(intact), **{one.name: one.read()[1] for one in intact.functions}}
    for seed in range(CUT):
        length = int(np.random.default_rng([8, seed]).integers(len(whole)))
        try:
            found = opened(format_, whole[:length], tmp_path)
            read = arrays(found)
        except FormatError:
            continue
        for name, values in {**read, **{one.name: one.read()[1] for one in found.functions}}.items():
            said = len(values) == len(truth[name]) or format_ in LINES or found.remarks
            assert said, (seed, length)
            np.testing.assert_array_equal(values, truth[name][: len(values)], err_msg=f"{seed}, {length}")
    gc.collect()
