"""Containers of measurements: the same numbers as the libraries that wrote them, and clear words for what cannot be read."""

from __future__ import annotations

import io
import struct
import tracemalloc
import zlib
from datetime import UTC, datetime, timedelta

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
from nptdms import ChannelObject, RootObject, TdmsFile, TdmsWriter

from api import formats
from api.formats import FormatError
from api.formats.tdms.scaling import scaling_of
from tests.support.recorded import arrays, closed_files, opened  # noqa: F401 - a fixture for all tests here

RNG = np.random.default_rng(3)
X, Y = RNG.normal(size=5000), RNG.normal(size=5000)


def tdms_bytes(*, segments=1, **properties):
    target = io.BytesIO()
    with TdmsWriter(target) as writer:
        for part in np.array_split(np.arange(5000), segments):
            writer.write_segment(
                [
                    RootObject({"author": "me"}),
                    ChannelObject("bench", "x", X[part], {"wf_increment": 1e-3, "unit_string": "mm", **properties}),
                    ChannelObject("bench", "n", part.astype("i2"), {"wf_increment": 1e-3}),
                    ChannelObject("other", "x", Y[part].astype("f4")),
                ]
            )
    return target.getvalue()


@pytest.mark.parametrize("segments", [1, 7])
def test_tdms(tmp_path, segments):
    start = datetime(2026, 1, 2, 3, 4, 5, 250_000, tzinfo=UTC)
    found = opened(
        "tdms", tdms_bytes(segments=segments, wf_start_time=np.datetime64(start.replace(tzinfo=None))), tmp_path
    )
    assert [(one.name, one.count, one.unit, one.sample_rate) for one in found.series] == [
        ("bench/x", 5000, "mm", 1000.0),
        ("n", 5000, "", 1000.0),
        ("other/x", 5000, "", None),
    ]
    assert abs(found.series[0].start_time - start) < timedelta(microseconds=1)
    read = arrays(found)
    np.testing.assert_array_equal(read["bench/x"], X)
    np.testing.assert_array_equal(read["n"], np.arange(5000))
    np.testing.assert_array_equal(read["other/x"], Y.astype("f4"))


def segment(values, *, interleaved=False, big=False, objects=None, following=None):
    """Return one segment as the published format has it."""
    order = ">" if big else "<"
    dtype = f"{order}i2"
    meta = struct.pack(f"{order}I", len(values))
    for name in values:
        path = f"/'g'/'{name}'".encode()
        meta += struct.pack(f"{order}I", len(path)) + path
        count = len(values[name]) if objects is None else objects
        meta += struct.pack(f"{order}IIIQ", 20, 2, 1, count) + struct.pack(f"{order}I", 0)
    columns = [np.asarray(one, dtype) for one in values.values()]
    data = (
        np.column_stack(columns).astype(dtype).tobytes() if interleaved else b"".join(one.tobytes() for one in columns)
    )
    mask = 0xE | (0x20 if interleaved else 0) | (0x40 if big else 0)
    length = len(meta) + len(data) if following is None else following
    return b"TDSm" + struct.pack("<I", mask) + struct.pack(f"{order}IQQ", 4713, length, len(meta)) + meta + data


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("interleaved", [False, True])
def test_tdms_of_every_layout(tmp_path, big, interleaved):
    a, b = np.arange(300), np.arange(300)[::-1]
    content = segment({"a": a, "b": b}, interleaved=interleaved, big=big) * 2
    read = arrays(opened("tdms", content, tmp_path))
    np.testing.assert_array_equal(read["a"], np.tile(a, 2))
    np.testing.assert_array_equal(read["b"], np.tile(b, 2))
    theirs = TdmsFile.read(io.BytesIO(content))
    np.testing.assert_array_equal(read["b"], theirs["g"]["b"][:])


def test_chunks_that_repeat_within_a_segment(tmp_path):
    # the index speaks of 100 values, the segment holds three such chunks of both channels
    chunks = [np.arange(i, i + 100) for i in range(6)]
    content = segment({"a": np.concatenate(chunks[:3]), "b": np.concatenate(chunks[3:])}, objects=100)
    read = arrays(opened("tdms", content, tmp_path))
    theirs = TdmsFile.read(io.BytesIO(content))
    for name in ("a", "b"):
        np.testing.assert_array_equal(read[name], theirs["g"][name][:])


@pytest.mark.parametrize("name", ["raw1", "big_endian", "Digital_Input", "raw_timestamps"])
def test_files_of_real_instruments(tmp_path, name):
    """Those that the library brings with it: raw DAQmx values with scalings, big-endian, interleaved."""
    from importlib.resources import files

    path = files("nptdms") / "test" / "data" / f"{name}.tdms"
    if not path.is_file():
        pytest.skip("this build of npTDMS comes without the files of its tests")
    found = opened("tdms", path.read_bytes(), tmp_path)
    theirs = TdmsFile.read(io.BytesIO(path.read_bytes()))
    expected = {
        label: channel[:]
        for group in theirs.groups()
        for channel in group.channels()
        for label in (channel.name, f"{group.name}/{channel.name}")
    }
    read = arrays(found)
    assert read
    for label, values in read.items():
        np.testing.assert_array_equal(values, expected[label].astype(np.float64))


def test_raw_values_of_an_instrument_are_in_volts(tmp_path):
    """Figures of the first samples as the programs of the instrument's maker show them."""
    from importlib.resources import files

    path = files("nptdms") / "test" / "data" / "raw1.tdms"
    if not path.is_file():
        pytest.skip("this build of npTDMS comes without the files of its tests")
    found = opened("tdms", path.read_bytes(), tmp_path)
    assert len(found.series) == 7
    assert {(one.count, one.unit, round(one.sample_rate)) for one in found.series} == {(2000, "Volts", 50_000)}
    first = arrays(found)["First  Channel"]
    np.testing.assert_allclose(first[:3], [-0.184027, 0.148015, -0.245064], rtol=0, atol=5e-7)


def test_big_endian_values_of_an_instrument(tmp_path):
    """Two channels of 3500 samples at 1 kHz; the deviation is that which the library's own reading gives."""
    from importlib.resources import files

    path = files("nptdms") / "test" / "data" / "big_endian.tdms"
    if not path.is_file():
        pytest.skip("this build of npTDMS comes without the files of its tests")
    found = opened("tdms", path.read_bytes(), tmp_path)
    (sweep,) = [one for one in found.series if "Amplitude sweep" in one.name]
    assert (sweep.count, round(sweep.sample_rate)) == (3500, 1000)
    assert arrays(found)[sweep.name].std() == pytest.approx(2.558365, abs=5e-7)


def test_a_chain_of_scalings():
    properties = {
        "NI_Number_Of_Scales": 3,
        "NI_Scale[1]_Scale_Type": "Linear",
        "NI_Scale[1]_Linear_Slope": 2.0,
        "NI_Scale[1]_Linear_Y_Intercept": 1.0,
        "NI_Scale[1]_Linear_Input_Source": 0,
        "NI_Scale[2]_Scale_Type": "Polynomial",
        "NI_Scale[2]_Polynomial_Coefficients_Size": 3,
        "NI_Scale[2]_Polynomial_Coefficients[0]": 1.0,
        "NI_Scale[2]_Polynomial_Coefficients[1]": 0.0,
        "NI_Scale[2]_Polynomial_Coefficients[2]": 0.5,
        "NI_Scale[2]_Polynomial_Input_Source": 1,
    }
    scaling, reason = scaling_of(properties)
    assert reason == ""
    assert scaling(np.array([0, 1, 2], "i2")).tolist() == [1.5, 5.5, 13.5]  # 1 + (2 x + 1)^2 / 2
    assert scaling_of(properties | {"NI_Scaling_Status": "scaled"}) == (None, "")
    assert "the kind 'Voodoo', which is not known" in scaling_of(properties | {"NI_Scale[1]_Scale_Type": "Voodoo"})[1]
    cyclic = properties | {"NI_Scale[1]_Linear_Input_Source": 2}
    assert "must be fed by one before it" in scaling_of(cyclic)[1]


def damaged_tdms():
    good = tdms_bytes()
    text = segment({"a": np.arange(10)})
    return {
        "empty": (b"", "begin with TDSm, got an empty file"),
        "other": (b"PK\x03\x04" * 20, "must begin with TDSm"),
        "cut off": (good[:-500], "must end within the .* bytes of the file, got .*: the file is cut off"),
        "cut in its header": (good[:60], "is cut off"),
        "garbage behind": (good + b"garbage" * 10, "a segment of a TDMS file must begin with TDSm"),
        "a name longer than the file": (text[:32] + b"\xff\xff\xff\x7f" + text[36:], "metadata must end .* damaged"),
    }


@pytest.mark.parametrize("case", damaged_tdms())
def test_damaged_tdms_is_refused(tmp_path, case):
    content, message = damaged_tdms()[case]
    with pytest.raises(FormatError, match=message):
        arrays(opened("tdms", content, tmp_path))


def test_a_billion_claimed_samples_cost_nothing(tmp_path):
    content = segment({"a": np.arange(10)}, objects=10**9)
    found = opened("tdms", content, tmp_path)
    # what is there counts, not what the index claims: a chunk that is not complete
    assert found.series[0].count == 10
    assert arrays(found)["a"].tolist() == list(range(10))


def test_a_file_that_was_not_closed_is_read_and_said_so(tmp_path):
    content = segment({"a": np.arange(100)}, following=0xFFFFFFFFFFFFFFFF)[:-51]
    found = opened("tdms", content, tmp_path)
    assert "was not closed" in found.remarks[0]
    assert arrays(found)["a"].tolist() == list(range(74))


def mat_bytes(variables, **options):
    target = io.BytesIO()
    scipy.io.savemat(target, variables, **options)
    return target.getvalue()


@pytest.mark.parametrize("do_compression", [False, True])
def test_matlab_5(tmp_path, do_compression):
    matrix = RNG.normal(size=(5000, 3))
    cells = np.empty(2, dtype=object)
    cells[0], cells[1] = X, Y
    content = mat_bytes(
        {
            "t": np.arange(5000) / 1000,
            "x": X.astype("f4"),
            "n": np.arange(5000, dtype="i2")[:, None],
            "M": matrix,
            "R": matrix.T,
            "rec": {"force": Y, "deep": {"flag": np.arange(5000) % 2 == 0}},
            "cells": cells,
            "Ts": 0.001,
            "name": "a text",
            "z": X + 1j,
        },
        do_compression=do_compression,
    )
    found = opened("mat", content, tmp_path)
    read = arrays(found)
    expected = {"t": np.arange(5000) / 1000, "x": X.astype("f4"), "n": np.arange(5000), "rec.force": Y,
                "rec.deep.flag": np.arange(5000) % 2 == 0, "cells{1}": X, "cells{2}": Y}  # fmt: skip
    expected |= {"z (real)": X, "z (imaginary)": np.ones(5000)}
    expected |= {f"M(:,{i + 1})": matrix[:, i] for i in range(3)} | {f"R({i + 1},:)": matrix[:, i] for i in range(3)}
    assert read.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(read[name], values)
    assert next(one for one in found.series if one.role == "time").name == "t"
    assert found.scalars == {"Ts": 0.001}
    assert found.layout == {"sample_rate": 1000.0}
    assert found.refused == {
        "name": "it is a text such as 'a text', a channel must hold numbers: write what it stands for as numbers"
    }


def element(kind, data):
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def matlab(*elements):
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"".join(elements)


def test_objects_of_matlab_classes_are_refused_by_name(tmp_path):
    opaque = (
        element(6, struct.pack("<II", 17, 0)) + element(1, b"run") + element(1, b"MCOS") + element(1, b"timeseries")
    )
    plain = element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack("<ii", 2, 1)) + element(1, b"x")
    content = matlab(element(14, opaque), element(14, plain + element(9, struct.pack("<dd", 1.5, 2.5))))
    found = opened("mat", content, tmp_path)
    assert found.refused == {
        "run": "it is an object of the MATLAB class 'timeseries': save what is in it as plain arrays"
    }
    assert arrays(found)["x"].tolist() == [1.5, 2.5]


def bomb(size):
    """Return a variable of zeros, compressed a thousandfold."""
    head = element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack("<ii", size // 8, 1)) + element(1, b"x")
    squeezer = zlib.compressobj(9)
    data = squeezer.compress(struct.pack("<II", 14, len(head) + 8 + size) + head + struct.pack("<II", 9, size))
    data += b"".join(squeezer.compress(bytes(1 << 20)) for _ in range(size >> 20)) + squeezer.flush()
    return matlab(struct.pack("<II", 15, len(data)) + data)


def test_a_zip_bomb_is_refused_before_it_fills_memory_or_disk(tmp_path, monkeypatch):
    monkeypatch.setattr(formats, "LEAST_UNPACKED", 8 << 20)
    content = bomb(24 << 20)
    assert len(content) < 100_000
    tracemalloc.start()
    with pytest.raises(FormatError, match="must unpack to at most 8 MiB or 64 times the size of the file"):
        opened("mat", content, tmp_path)
    assert tracemalloc.get_traced_memory()[1] < 6 << 20
    tracemalloc.stop()
    monkeypatch.setattr(formats, "LEAST_UNPACKED", 32 << 20)
    assert opened("mat", content, tmp_path).series[0].count == 3 << 20


def damaged_mat():
    plain = mat_bytes({"x": X})
    squeezed = mat_bytes({"x": X}, do_compression=True)
    huge = element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack("<ii", 10**9, 1)) + element(1, b"x")
    return {
        "other": (b"not MATLAB" * 30, "must begin with its header"),
        "short": (b"MATLAB", "must begin with its header"),
        "cut off": (plain[:-100], "the file is cut off"),
        "cut within a compressed variable": (squeezed[:-100], "the file is cut off"),
        "damaged data": (squeezed[:300] + bytes(40) + squeezed[340:], "must be zlib data|must be complete|must be"),
        "a billion samples": (
            matlab(element(14, huge + element(9, bytes(16)))),
            "must fit into the 16 bytes .* got 1000000000",
        ),
    }


@pytest.mark.parametrize("case", damaged_mat())
def test_damaged_matlab_files_are_refused(tmp_path, case):
    content, message = damaged_mat()[case]
    with pytest.raises(FormatError, match=message):
        arrays(opened("mat", content, tmp_path))


def test_matlab_7_3(tmp_path):
    path = tmp_path / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("t", np.arange(5000) / 200), ("x", X)):
            file[name] = values[None, :]  # MATLAB's column is a row of HDF5
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        file["M"] = np.stack([X, Y])
        file["M"].attrs["MATLAB_class"] = np.bytes_("double")
        file["word"] = np.array([[104, 105]], "u2")
        file["word"].attrs["MATLAB_class"] = np.bytes_("char")
        file["obj"] = np.zeros((1, 6), "u4")
        file["obj"].attrs["MATLAB_class"] = np.bytes_("timetable")
        file["obj"].attrs["MATLAB_object_decode"] = 3
        file.create_group("rec")["force"] = Y[None, :]
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    found = opened("mat", path, tmp_path)
    read = arrays(found)
    for name, values in {"x": X, "M(:,1)": X, "M(:,2)": Y, "rec.force": Y}.items():
        np.testing.assert_array_equal(read[name], values)
    assert found.refused == {
        "word": "it is a text such as 'hi', a channel must hold numbers: write what it stands for as numbers",
        "obj": "it is an object of the MATLAB class 'timetable': save what is in it as plain arrays",
    }


def test_hdf5(tmp_path):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        force = file.create_dataset("bench/force", data=X, chunks=(512,), compression="gzip")
        force.attrs["unit"], force.attrs["dt"] = "kN", 0.002
        file.create_dataset("pair", data=np.column_stack([X, Y]))
        file["words"] = [b"a", b"b"]
        file["complex"] = X + 1j
        file.create_dataset("huge", shape=(10**9,), dtype="f8")
        file.create_dataset("external", shape=(10,), dtype="u1", external=[("/etc/hostname", 0, 10)])
        file["fs"] = 500.0
    found = opened("hdf5", path, tmp_path)
    read = arrays(found)
    for name, values in {"bench/force": X, "pair(:,1)": X, "pair(:,2)": Y, "complex (real)": X}.items():
        np.testing.assert_array_equal(read[name], values)
    assert (found.series[0].unit, found.series[0].sample_rate) == ("kN", 500.0)
    assert found.layout == {"sample_rate": 500.0}
    assert set(found.refused) == {"words", "huge", "external"}
    assert found.refused["huge"] == (
        "it claims 1000000000 values and has 0 bytes of them: it is damaged or was not closed, write it anew"
    )
    assert found.refused["external"] == "its values lie in other files: copy them into this one (h5repack)"


def test_parquet(tmp_path):
    start = datetime(2026, 1, 1, tzinfo=UTC)
    when = pa.array([start + timedelta(milliseconds=5 * i) for i in range(5000)], pa.timestamp("us", "UTC"))
    fields = [pa.field("when", when.type), pa.field("x", pa.float64(), metadata={"unit": "mm"}), pa.field("n", pa.int32()),
              pa.field("word", pa.string())]  # fmt: skip
    gaps = pa.array([None if i % 7 == 0 else i for i in range(5000)], pa.int32())
    table = pa.table([when, pa.array(X), gaps, pa.array(["a"] * 5000)], schema=pa.schema(fields))
    pq.write_table(table, tmp_path / "a.parquet", row_group_size=999)
    found = opened("parquet", tmp_path / "a.parquet", tmp_path)
    read = arrays(found)
    np.testing.assert_allclose(read["when"], np.arange(5000) * 0.005, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(read["x"], X)
    np.testing.assert_array_equal(read["n"], [np.nan if i % 7 == 0 else i for i in range(5000)])
    assert [(one.name, one.unit, one.role) for one in found.series] == [
        ("when", "", "time"),
        ("x", "mm", "channel"),
        ("n", "", "channel"),
    ]
    assert found.refused == {"word": "its values are no plain numbers (string): cast it to double"}


def test_mdf(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    t = np.arange(5000) / 1000
    with asammdf.MDF(version="4.10") as target:
        target.append([asammdf.Signal(X, t, name="x", unit="mm"), asammdf.Signal(Y, t, name="y", unit="N")])
        target.append([asammdf.Signal(np.arange(100, dtype="u1"), t[:100], name="n")])
        target.save(tmp_path / "a.mf4", overwrite=True)
    found = opened("mdf", tmp_path / "a.mf4", tmp_path)
    assert [(one.name, one.count, one.unit, one.role) for one in found.series] == [
        ("time (group 0)", 5000, "", "time"),
        ("x", 5000, "mm", "channel"),
        ("y", 5000, "N", "channel"),
        ("time (group 1)", 100, "", "time"),
        ("n", 100, "", "channel"),
    ]
    read = arrays(found)
    for name, values in {"time (group 0)": t, "x": X, "y": Y, "n": np.arange(100)}.items():
        np.testing.assert_array_equal(read[name], values)


def test_units_of_an_older_mdf(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    t = np.arange(100) / 500
    with asammdf.MDF(version="3.30") as target:
        bent = asammdf.Signal(np.arange(100, dtype="u1"), t, name="bent", unit="mm", conversion={"a": 2.0, "b": 1.0})
        target.append([asammdf.Signal(t * 2, t, name="straight", unit="N"), bent])
        target.save(tmp_path / "a.mdf")
    found = opened("mdf", tmp_path / "a.mdf", tmp_path)
    units = {series.name: series.unit for series in found.series if series.role == "channel"}
    assert units == {"straight": "N", "bent": "mm"}


@pytest.mark.parametrize("format_", ["hdf5", "parquet", "mdf", "uff", "lvm"])
def test_another_file_is_refused(tmp_path, format_):
    for content in (b"", b"something else entirely\n" * 50, bytes(2000)):
        with pytest.raises(FormatError, match="must"):
            opened(format_, content, tmp_path)


@pytest.mark.parametrize("format_", ["hdf5", "parquet"])
def test_truncated_containers_are_refused(tmp_path, format_):
    path = tmp_path / "whole"
    if format_ == "hdf5":
        with h5py.File(path, "w") as file:
            file.create_dataset("x", data=X)
    else:
        pq.write_table(pa.table({"x": X}), path)
    with pytest.raises(FormatError, match="must be complete"):
        arrays(opened(format_, path.read_bytes()[:-2000], tmp_path))
