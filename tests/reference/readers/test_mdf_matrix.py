"""MDF files of both versions as asammdf writes them: types, conversions, compression, groups; each channel as asammdf reads it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.recorded import arrays, closed_files, opened  # noqa: F401 - a fixture for all tests here

asammdf = pytest.importorskip("asammdf", reason="it comes with the extra `formats`")

RNG = np.random.default_rng(29)
COUNT = 300
TIME = np.arange(COUNT) * 0.002
LATE = 0.5 + np.cumsum(RNG.uniform(0.001, 0.003, size=70))
TYPES = ["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8"]
CONVERSIONS: dict[str, dict[str, Any]] = {
    "linear": {"a": 0.25, "b": -3.0},
    "rational": {"P1": 0.0, "P2": 2.0, "P3": 1.0, "P4": 0.0, "P5": 0.0, "P6": 4.0},
    "algebraic": {"formula": "2 * X + 1"},
    "points": {f"{kind}_{i}": float(value) for i in range(3) for kind, value in (("raw", 50 * i), ("phys", i**2))},
    "texts": {"val_0": 0, "text_0": b"off", "val_1": 1, "text_1": b"on"},
}
POINTS = {"interpolation": True}


def signals(kinds: list[str]) -> list[Any]:
    made = []
    for kind in kinds:
        if kind in TYPES:
            dtype = np.dtype(kind)
            if dtype.kind == "f":
                values = RNG.normal(size=COUNT).astype(dtype)
            else:
                info = np.iinfo(dtype)
                values = RNG.integers(info.min, info.max, size=COUNT, dtype=dtype, endpoint=True)
            made.append(asammdf.Signal(values, TIME, name=f"as {kind}", unit="mm"))
        else:
            values = RNG.integers(0, 2 if kind == "texts" else 100, size=COUNT).astype("u1")
            more = POINTS if kind == "points" else {}
            made.append(asammdf.Signal(values, TIME, name=kind, unit="V", conversion={**CONVERSIONS[kind], **more}))
    return made


def compared(content: bytes, path: Path, tmp_path: Path) -> set[str]:
    """Compare every channel with asammdf's; return the names of those that were read."""
    found = opened("mdf", content, tmp_path)
    read = arrays(found)
    with asammdf.MDF(path) as theirs:
        for one in found.series:
            if one.role == "time":
                continue
            name, _, rest = one.name.partition(" (group ")
            places = theirs.whereis(name)
            group, index = places[0] if not rest else next(p for p in places if p[0] == int(rest.removesuffix(")")))
            raw = theirs.get(group=group, index=index, raw=True)
            texts = theirs.get(group=group, index=index).samples.dtype.kind in "SOU"
            expected = (raw if texts else theirs.get(group=group, index=index)).samples
            np.testing.assert_array_equal(read[one.name], np.asarray(expected, dtype=np.float64), err_msg=one.name)
            times = [other for other in found.series if other.role == "time" and other.group == one.group]
            np.testing.assert_array_equal(read[times[0].name], raw.timestamps, err_msg=one.name)
    return {one.name for one in found.series}


@pytest.mark.parametrize("compression", [0, 1, 2])
@pytest.mark.parametrize("version", ["3.00", "3.30", "4.00", "4.10", "4.11"])
def test_types_conversions_and_groups(version: str, compression: int, tmp_path: Path) -> None:
    path = tmp_path / ("file.mdf" if version < "4" else "file.mf4")
    with asammdf.MDF(version=version) as file:
        file.append(signals(TYPES), common_timebase=True)
        file.append(signals(list(CONVERSIONS)), common_timebase=True)
        file.append([asammdf.Signal(RNG.normal(size=LATE.size), LATE, name="late", unit="N")])
        file.append([asammdf.Signal(RNG.normal(size=LATE.size), LATE, name="as f8", unit="N")])
        path = Path(file.save(path, overwrite=True, compression=compression))
    names = compared(path.read_bytes(), path, tmp_path)
    assert {f"as {kind}" for kind in TYPES if kind != "f8"} | set(CONVERSIONS) | {"late"} <= names


@pytest.mark.parametrize("compression", [0, 2])
def test_samples_called_invalid_are_missing(compression: int, tmp_path: Path) -> None:
    invalid = RNG.random(COUNT) < 0.2
    values = RNG.normal(size=COUNT)
    signal = asammdf.Signal(values, TIME, name="x", invalidation_bits=invalid)
    with asammdf.MDF(version="4.10") as file:
        file.append([signal, asammdf.Signal(values, TIME, name="y")], common_timebase=True)
        path = Path(file.save(tmp_path / "file.mf4", overwrite=True, compression=compression))
    read = arrays(opened("mdf", path.read_bytes(), tmp_path))
    np.testing.assert_array_equal(read["x"], np.where(invalid, np.nan, values))
    np.testing.assert_array_equal(read["y"], values)


def test_frames_of_a_bus_are_refused_with_the_remedy_which_works(tmp_path: Path) -> None:
    """A log of CAN: what is said of the frames is a channel, the frames are not until a database has decoded them."""
    v4 = asammdf.blocks.v4_constants
    speed = RNG.integers(-200, 200, size=COUNT).astype("<i2")
    fields = [("ID", "<u4"), ("DLC", "u1"), ("DataLength", "u1"), ("DataBytes", "(8,)u1"), ("Dir", "u1")]
    frames = np.zeros(
        COUNT, dtype=[("CAN_DataFrame.BusChannel", "u1"), *((f"CAN_DataFrame.{a}", b) for a, b in fields)]
    )
    for field, value in (("BusChannel", 1), ("ID", 291), ("DLC", 8), ("DataLength", 8)):
        frames[f"CAN_DataFrame.{field}"] = value
    frames["CAN_DataFrame.DataBytes"][:, :2] = speed.view("u1").reshape(COUNT, 2)
    bus = asammdf.Source("CAN1", "CAN1", "", v4.SOURCE_BUS, v4.BUS_TYPE_CAN)
    with asammdf.MDF(version="4.11") as file:
        file.append(asammdf.Signal(frames, TIME, name="CAN_DataFrame", source=bus), acq_source=bus, acq_name="CAN1")
        file.groups[-1].channel_group.flags |= v4.FLAG_CG_BUS_EVENT
        logged = Path(file.save(tmp_path / "log.mf4", overwrite=True))
    found = opened("mdf", logged, tmp_path)
    np.testing.assert_array_equal(arrays(found)["CAN_DataFrame.ID"], 291.0)
    assert found.refused["CAN_DataFrame"] == "it is a structure: its parts are channels of their own"
    assert "extract_bus_logging" in found.refused["CAN_DataFrame.DataBytes"]
    database = tmp_path / "drive.dbc"
    database.write_text(
        'VERSION ""\nNS_ :\nBS_:\nBU_: ECU\n\nBO_ 291 Drive: 8 ECU\n SG_ speed : 0|16@1- (0.5,0) [-100|100] "rad/s" ECU\n'
    )
    with asammdf.MDF(logged) as file, file.extract_bus_logging({"CAN": [(database, 0)]}) as decoded:
        path = Path(decoded.save(tmp_path / "decoded.mf4", overwrite=True))
    found = opened("mdf", path, tmp_path)
    np.testing.assert_array_equal(arrays(found)["speed"], 0.5 * speed)
    assert next(one.unit for one in found.series if one.name == "speed") == "rad/s"


def test_texts_and_blocks_of_version_2(tmp_path: Path) -> None:
    with asammdf.MDF(version="2.14") as file:
        words = np.array([b"stop", b"go"] * (COUNT // 2))
        file.append(
            [asammdf.Signal(words, TIME, name="word", encoding="latin-1"), asammdf.Signal(TIME + 1.0, TIME, name="x")],
            common_timebase=True,
        )
        path = Path(file.save(tmp_path / "file.mdf", overwrite=True))
    found = opened("mdf", path, tmp_path)
    np.testing.assert_array_equal(arrays(found)["x"], TIME + 1.0)
    assert found.refused == {"word": "it is a text, a channel must hold numbers: write what it stands for as numbers"}


def test_arrays_are_refused_by_name(tmp_path: Path) -> None:
    values = np.rec.fromarrays([RNG.normal(size=(COUNT, 3))], dtype=[("field", "(3, )<f8")])
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(values, TIME, name="field"), asammdf.Signal(TIME, TIME, name="x")])
        path = Path(file.save(tmp_path / "file.mf4", overwrite=True))
    found = opened("mdf", path.read_bytes(), tmp_path)
    read = arrays(found, ["x"])
    np.testing.assert_array_equal(read["x"], TIME)
    names = {one.name for one in found.series}
    for i in range(3):
        if f"field[{i}]" in names:
            np.testing.assert_array_equal(arrays(found)[f"field[{i}]"], values["field"][:, i])
    assert "field" in found.refused or "field[0]" in names
