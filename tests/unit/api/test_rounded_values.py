"""Whole numbers that float64 does not hold are counted by their channel, whatever the file; how many is told by Python's own integers."""

from __future__ import annotations

import io
import json
import struct

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
from asammdf import MDF, Signal
from mcap.writer import Writer
from nptdms import ChannelObject, TdmsWriter

from api.formats import FormatError
from api.formats.catalogue import open_file
from api.formats.exactness import inexact
from api.formats.text.tables import TableOptions
from engine.recordings.signal_quality import remarks

COUNT = 1000
SIGNED = np.arange(COUNT, dtype=np.int64) - 2**62 + 1
UNSIGNED = np.arange(COUNT, dtype=np.uint64) + 2**63
HELD = np.arange(COUNT, dtype=np.int64) * 2**53
"""Beyond 2^53, and multiples of it: float64 has each of them."""
COLUMNS = {"signed": SIGNED, "unsigned": UNSIGNED, "held": HELD}


def lost(numbers):
    """Return how many whole numbers change when they become float64, as Python's integers of any length say."""
    return sum(int(float(number)) != number for number in map(int, numbers))


def hdf5():
    content = io.BytesIO()
    with h5py.File(content, "w") as file:
        for name, values in COLUMNS.items():
            file[name] = values
    return content.getvalue()


def table(mark):
    rows = zip(*COLUMNS.values(), strict=True)
    head = mark.join(COLUMNS)
    return (head + "\n" + "".join(mark.join(map(str, row)) + "\n" for row in rows)).encode()


def grouped():
    rows = zip(*COLUMNS.values(), strict=True)
    lines = (";".join(f"{int(number):,}".replace(",", ".") + ",0" for number in row) for row in rows)
    return (";".join(COLUMNS) + "\n" + "\n".join(lines) + "\n").encode()


def labview():
    head = "LabVIEW Measurement\nSeparator\tTab\nDecimal_Separator\t.\nX_Columns\tNo\n***End_of_Header***\n"
    own = f"Channels\t3\nSamples\t{COUNT}\t{COUNT}\t{COUNT}\nDelta_X\t0.1\t0.1\t0.1\n***End_of_Header***\n"
    names = "X_Value\t" + "\t".join(COLUMNS) + "\tComment\n"
    rows = "".join("\t" + "\t".join(map(str, row)) + "\n" for row in zip(*COLUMNS.values(), strict=True))
    return (head + own + names + rows).encode()


def parquet():
    content = io.BytesIO()
    # a column with a missing number is no array of integers any more
    columns = {name: pa.array([*values.tolist(), None]) for name, values in COLUMNS.items() if name != "unsigned"}
    columns["unsigned"] = pa.array([*UNSIGNED.tolist(), None], pa.uint64())
    pq.write_table(pa.table(columns), content)
    return content.getvalue()


def matlab():
    content = io.BytesIO()
    scipy.io.savemat(content, COLUMNS)
    return content.getvalue()


def tdms():
    content = io.BytesIO()
    with TdmsWriter(content) as writer:
        writer.write_segment([ChannelObject("g", name, values) for name, values in COLUMNS.items()])
    return content.getvalue()


def mdf(path):
    instants = np.arange(COUNT) / 100
    with MDF(version="4.10") as file:
        file.append([Signal(values, instants, name=name) for name, values in COLUMNS.items()])
        return file.save(path / "bench.mf4").read_bytes()


def mcap():
    content = io.BytesIO()
    writer = Writer(content)
    writer.start()
    schema = writer.register_schema(name="sample", encoding="jsonschema", data=b"{}")
    channel = writer.register_channel(topic="axis", message_encoding="json", schema_id=schema)
    for number, row in enumerate(zip(*COLUMNS.values(), strict=True)):
        message = json.dumps(dict(zip(COLUMNS, map(int, row), strict=True))).encode()
        writer.add_message(channel, log_time=number * 10**6, publish_time=0, data=message)
    writer.finish()
    return content.getvalue()


FILES = {
    "hdf5": ("hdf5", hdf5), "csv": ("csv", lambda: table(",")), "txt": ("txt", lambda: table(" ")),
    "thousands": ("csv", grouped), "lvm": ("lvm", labview), "parquet": ("parquet", parquet), "mat": ("mat", matlab),
    "tdms": ("tdms", tdms), "mdf": ("mdf", mdf), "mcap": ("mcap", mcap),
}  # fmt: skip


def rounded_of(format_, content, tmp_path):
    """Return how many values of each channel are rounded, by the last part of its name; the file is read twice."""
    path = tmp_path / "content"
    path.write_bytes(content)
    with path.open("rb") as file:
        found = open_file(format_, file, TableOptions())
        for _ in range(2):
            for _, values in found.read(range(len(found.series))):
                assert values.dtype == np.float64
        counts = {one.name.rpartition(".")[2]: found.rounded.of(one.name) for one in found.series}
        found.close()
    return counts


@pytest.mark.parametrize("case", FILES)
def test_each_reader_counts_what_it_rounds(tmp_path, case):
    format_, make = FILES[case]
    content = make(tmp_path) if make is mdf else make()
    counts = rounded_of(format_, content, tmp_path)
    for name, values in COLUMNS.items():
        assert counts[name] == lost(values), name
    assert counts["held"] == 0 < min(counts["signed"], counts["unsigned"])


def test_a_sound_of_64_bits(tmp_path):
    samples = (SIGNED * 3).astype("<i8").tobytes()
    form = struct.pack("<HHIIHH", 1, 1, 1000, 8000, 8, 64)
    content = b"RIFF" + struct.pack("<I", 36 + len(samples)) + b"WAVEfmt " + struct.pack("<I", 16) + form
    content += b"data" + struct.pack("<I", len(samples)) + samples
    assert rounded_of("wav", content, tmp_path) == {"channel 1": lost(SIGNED * 3)}


def test_single_numbers_beside_the_channels_are_counted_too(tmp_path):
    for format_, suffix in (("hdf5", "h5"), ("mat", "mat")):
        path = tmp_path / f"one.{suffix}"
        if format_ == "mat":
            scipy.io.savemat(path, {"x": np.arange(9.0), "serial": np.int64(2**53 + 1)})
        else:
            with h5py.File(path, "w") as file:
                file["x"], file["serial"] = np.arange(9.0), np.int64(2**53 + 1)
        with path.open("rb") as file:
            found = open_file(format_, file, TableOptions())
            assert (found.rounded.of("serial"), found.rounded.of("x")) == (1, 0)
            found.close()


def test_numbers_that_float64_holds_are_none_of_them():
    for values in ([0, 2**53, -(2**53), -(2**63)], [], [2**63 - 2**10]):
        assert inexact(np.array(values, dtype=np.int64)) == 0
    assert inexact(np.array([2**64 - 1, 2**64 - 2048], dtype=np.uint64)) == 1
    assert inexact(np.array([2**53 + 1, -(2**53) - 1, 2**63 - 1], dtype=">i8")) == 3
    assert inexact(np.array([np.nan, np.inf, 0.5, np.longdouble(1) / 3], dtype=np.longdouble)) == 1


def test_a_channel_whose_numbers_became_equal_is_not_said_to_be_without_a_sensor():
    found = {"missing": 0, "constant": True, "clipped": {}}
    rule, equal = remarks("tick", found, 5, rounded=4)
    assert rule.startswith("tick: 4 of 5 values are rounded")
    assert "2^53 = 9007199254740992" in rule
    assert equal == "tick never changes once its values are rounded: nothing tells whether those in the file do"
    assert remarks("tick", found, 5) == ["tick never changes: is its sensor connected?"]


@pytest.mark.parametrize("digits", [309, 5000])
def test_a_number_of_too_many_digits_is_none_in_any_text(digits, tmp_path) -> None:
    rows = [f"{k * 0.001:.3f},{'9' * digits if k == 5 else k}" for k in range(50)]
    with pytest.raises(FormatError, match="must be a finite number, got '9999"):
        rounded_of("csv", "\n".join(["t,y", *rows, ""]).encode(), tmp_path)
