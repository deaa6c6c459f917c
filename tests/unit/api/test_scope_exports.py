"""Exports of TwinCAT Scope in the layout that Beckhoff documents: separators, decimal marks, shared instants, full time stamps."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from api.formats import FormatError
from api.services.recordings.groups import groups_of
from tests.support.recorded import arrays, closed_files, opened  # noqa: F401 - a fixture for all tests here

RNG = np.random.default_rng(29)
BEGIN = datetime(2026, 1, 2, 3, 4, 5, 250_000, tzinfo=UTC)
TICKS = (BEGIN - datetime(1601, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1) * 10
FAST, SLOW = np.arange(60) * 0.25, -3.0 + np.arange(12) * 5.0
POSITION, SWITCH, PRESSURE = np.round(RNG.normal(size=60), 6), RNG.random(60) > 0.5, np.round(RNG.normal(size=12), 6)


def export(
    *,
    mark: str = "\t",
    decimal: str = ".",
    shared: bool = True,
    full: bool = False,
    end: str = "EOF\n",
    kind: str = "REAL64",
) -> bytes:
    """Return an export of two channels of 0.25 ms and one of 5 ms; ``shared``: channels of one sample time share a column."""

    def number(value: float) -> str:
        return f"{value:.10g}".replace(".", decimal)

    def stamp(ms: float) -> str:
        return str(TICKS + round(ms * 10_000)) if full else number(ms)

    channels = [
        ("position", "mm (Length)", "0.25", FAST, [number(value) for value in POSITION], kind),
        ("switch", "(None)", "0.25", FAST, [str(int(value)) for value in SWITCH], "BIT"),
        ("pressure", "bar (Pressure)", "5", SLOW, [number(value) for value in PRESSURE], "REAL64"),
    ]  # fmt: skip
    columns: list[list[str]] = []
    keys = ("Name", "SymbolComment", "Data-Type", "SampleTime[ms]", "Unit")
    for place, (name, unit, step, times, values, type_) in enumerate(channels):
        if not shared or place in {0, 2}:
            columns.append([*keys, "", *(stamp(ms) for ms in times)])
        columns.append([name, "", type_, step.replace(".", decimal), unit, "", *values])
    longest = max(map(len, columns))
    rows = [mark.join(column[i] if i < len(column) else " " for column in columns) for i in range(longest)]
    rows[len(keys)] = ""
    head = [
        f"Name{mark}bench{mark}", f"File{mark}bench.csv{mark}", f"Starttime of export{mark}{TICKS}{mark}Friday{mark}03:04:05.250",
        f"Endtime of export{mark}{TICKS + 10**7}{mark}Friday{mark}03:04:06.250", "", "",
    ]  # fmt: skip
    return ("\n".join([*head, *rows]) + "\n" + end).encode()


@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize(("mark", "decimal"), [("\t", ","), (";", ","), (";", "."), (",", "."), (":", ".")])
def test_an_export_is_read_with_its_instants(mark: str, decimal: str, shared: bool, full: bool, tmp_path: Path) -> None:
    found = opened("csv", export(mark=mark, decimal=decimal, shared=shared, full=full), tmp_path)
    fast, slow = groups_of(found)
    assert [(one.name, one.unit, one.quantity, one.count, one.role) for one in fast.recording.series] == [
        (f"time of {fast.name}", "ms", "", 60, "time"), ("position", "mm", "length", 60, "channel"),
        ("switch", "", "", 60, "channel"),
    ]  # fmt: skip
    assert [(one.name, one.unit, one.count) for one in slow.recording.series] == [
        ("time of 5 ms", "ms", 12), ("pressure", "bar", 12),
    ]  # fmt: skip
    read = arrays(found)
    for name, values in {"position": POSITION, "switch": SWITCH, "pressure": PRESSURE}.items():
        np.testing.assert_array_equal(read[name], values)
    np.testing.assert_array_equal(read[f"time of {fast.name}"], FAST)
    np.testing.assert_array_equal(read["time of 5 ms"], SLOW)
    assert found.series[0].start_time == BEGIN
    assert slow.recording.series[0].start_time == BEGIN - timedelta(milliseconds=3)


def test_a_gap_in_the_rows_is_none_of_the_channel(tmp_path: Path) -> None:
    """Values of one instant stand in one row where the export is asked for that: rows between are empty for slower ones."""
    lines = export(end="").decode().split("\n")
    first = next(i for i, line in enumerate(lines) if line.startswith("0\t"))
    rows = [line.split("\t") for line in lines[first : first + 60]]
    spread = [[*row[:3], *(rows[i // 5][3:] if i % 5 == 0 else [" ", " "])] for i, row in enumerate(rows)]
    content = "\n".join([*lines[:first], *("\t".join(row) for row in spread), ""]).encode()
    read = arrays(opened("csv", content, tmp_path))
    np.testing.assert_array_equal(read["pressure"], PRESSURE)
    np.testing.assert_array_equal(read["position"], POSITION)


def test_texts_are_refused_by_name(tmp_path: Path) -> None:
    found = opened("csv", export(kind="STRING"), tmp_path)
    assert found.refused == {
        "position": "it is a text, a channel must hold numbers: write what it stands for as numbers"
    }
    assert [one.name for one in found.series if one.role == "channel"] == ["switch", "pressure"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (export(mark=" "), "export it with tabs or semicolons"),
        (export().replace(b"Name\tposition", b"Title\tposition"), "must have a line of the names of its channels"),
        (
            export(end="Trigger\t1\t2\t3\t4\n"),
            "line 73, column 0 must be a number or empty, got 'Trigger': export it anew without",
        ),
    ],
)
def test_what_cannot_be_read_says_how_to_export_it(content: bytes, message: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=message):
        arrays(opened("csv", content, tmp_path))
