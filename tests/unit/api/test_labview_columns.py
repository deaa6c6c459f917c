"""LabVIEW text with one or several columns of X_Value, beside the reader lvm_read."""

from __future__ import annotations

import lvm_read
import numpy as np
import pytest

from api.formats import FormatError
from api.services.recordings.groups import groups_of
from tests.support.recorded import arrays, closed_files, opened  # noqa: F401 - a fixture for all tests here

RNG = np.random.default_rng(11)


def file_of(
    channels: dict[str, tuple[np.ndarray, np.ndarray]], *, kind: str, step: float, decimal: str = ".", separator="Tab"
) -> str:
    """Return a file in the layout of LabVIEW: samples (X, Y) of each channel, shorter ones followed by empty cells."""
    mark = {"Tab": "\t", "Comma": ","}[separator]
    several, count = kind == "Multi", len(channels)
    wide = 2 * count if several else count + 1

    def head(key: str, values: list[str]) -> str:
        cells = [key] + [""] * wide
        for i, value in enumerate(values):
            cells[2 * i + 1 if several else i + 1] = value
        return mark.join(cells)

    longest = max(len(y) for _, y in channels.values())
    rows = []
    for i in range(longest):
        row = []
        for number, (x, y) in enumerate(channels.values()):
            if several or not number:
                row.append(f"{x[i]:.6f}" if i < len(x) and kind != "No" else "")
            row.append(f"{y[i]:.6f}" if i < len(y) else "")
        rows.append(mark.join(row))
    names = [name for one in channels for name in (("X_Value", one) if several else (one,))]
    lines = [
        "LabVIEW Measurement" + mark, f"Separator{mark}{separator}", f"Decimal_Separator{mark}{decimal}",
        f"X_Columns{mark}{kind}", f"***End_of_Header***{mark}", mark,
        head("Channels", [str(count)]), head("Samples", [str(len(y)) for _, y in channels.values()]),
        head("Date", ["2026/01/02"] * count), head("Time", ["10:00:00.25"] * count),
        head("Y_Unit_Label", ["mm"] * count), head("X0", ["0.0000000000000000E+0"] * count),
        head("Delta_X", [f"{step:.6f}"] * count), head("***End_of_Header***", []),
        mark.join([*names, "Comment"] if several else ["X_Value", *names, "Comment"]), *rows, "",
    ]  # fmt: skip
    text = "\n".join(lines)
    return text.replace(".", decimal) if decimal != "." else text


def beside(text: str, decimal: str = ".") -> np.ndarray:
    """Return the rows of the file as lvm_read has them, X first where the file has it."""
    return lvm_read.read_str(text)[0]["data"]


def even(count: int, step: float) -> np.ndarray:
    return np.arange(count) * step


@pytest.mark.parametrize("decimal", [".", ","])
def test_several_columns_of_x_that_agree_are_one_recording(tmp_path, decimal):
    channels = {name: (even(50, 0.00025), RNG.normal(size=50)) for name in ("ax", "ay", "az")}
    text = file_of(channels, kind="Multi", step=0.00025, decimal=decimal)
    found = opened("lvm", text.encode(), tmp_path)
    assert [(one.name, one.unit, one.count, one.sample_rate, one.role) for one in found.series] == [
        (name, "mm", 50, 4000.0, "channel") for name in channels
    ]
    assert found.remarks == ["X_Value and Delta_X say the same: the sample rate is that of Delta_X"]
    rows = beside(text, decimal)
    for i, name in enumerate(channels):
        np.testing.assert_array_equal(arrays(found)[name], rows[:, 2 * i + 1])
    assert len(groups_of(found)) == 1


def test_columns_of_x_of_several_lengths_and_instants_are_groups(tmp_path):
    uneven = np.cumsum(RNG.uniform(0.5, 1.5, size=30)) * 0.001
    channels = {
        "fast": (even(80, 0.001), RNG.normal(size=80)),
        "late": (uneven, RNG.normal(size=30)),
        "with late": (uneven, RNG.normal(size=30)),
    }
    text = file_of(channels, kind="Multi", step=0.001)
    found = opened("lvm", text.encode(), tmp_path)
    groups = {group.name: [one.name for one in group.recording.series] for group in groups_of(found)}
    assert sorted(map(sorted, groups.values())) == [["X_Value of late", "late", "with late"], ["fast"]]
    rows, read = beside(text), arrays(found)
    for i, (name, (_, y)) in enumerate(channels.items()):
        np.testing.assert_array_equal(read[name], rows[: len(y), 2 * i + 1])
    np.testing.assert_array_equal(read["X_Value of late"], rows[:30, 2])
    assert found.series[1].role == "time"
    assert found.remarks == ["X_Value is not what Delta_X says in 2 of 3 columns: the instants are those of X_Value"]


@pytest.mark.parametrize("separator", ["Tab", "Comma"])
def test_one_column_of_x_that_is_uneven_is_kept(tmp_path, separator):
    x = np.cumsum(RNG.uniform(0.8, 1.2, size=40)) * 0.01
    channels = {"F": (x, RNG.normal(size=40)), "x": (x, RNG.normal(size=40))}
    text = file_of(channels, kind="One", step=0.01, separator=separator)
    found = opened("lvm", text.encode(), tmp_path)
    assert [(one.name, one.role, one.sample_rate) for one in found.series] == [
        ("X_Value", "time", None), ("F", "channel", None), ("x", "channel", None),
    ]  # fmt: skip
    np.testing.assert_array_equal(
        np.transpose(list(arrays(found).values())),
        lvm_read.read_str(text, separator={"Tab": "\t", "Comma": ","}[separator])[0]["data"][:, :3],
    )


def test_empty_cells_are_missing_and_the_end_of_shorter_channels(tmp_path):
    channels = {"long": (even(20, 0.5), RNG.normal(size=20)), "short": (even(12, 0.5), RNG.normal(size=12))}
    text = file_of(channels, kind="No", step=0.5)
    lines = text.split("\n")
    row = lines.index(next(line for line in lines if line.startswith("\t" + f"{channels['long'][1][4]:.6f}")))
    lines[row] = f"\t\t{channels['short'][1][4]:.6f}"
    text = "\n".join(lines)
    found = opened("lvm", text.encode(), tmp_path)
    assert [(one.name, one.count) for one in found.series] == [("long", 20), ("short", 12)]
    read, rows = arrays(found), beside(text)
    assert np.isnan(read["long"][4])
    np.testing.assert_array_equal(read["long"], rows[:, 0])
    np.testing.assert_array_equal(read["short"], rows[:12, 1])


def test_a_channel_without_a_sample_is_refused_by_name(tmp_path):
    channels = {"x": (even(9, 0.5), RNG.normal(size=9)), "empty": (even(0, 0.5), RNG.normal(size=0))}
    found = opened("lvm", file_of(channels, kind="Multi", step=0.5).encode(), tmp_path)
    assert [one.name for one in found.series] == ["x"]
    assert found.refused == {
        "empty": "it has no values, a channel must hold samples: nothing was written to it, leave it out"
    }


def test_a_cell_that_is_no_number_is_refused_with_its_place(tmp_path):
    channels = {name: (even(9, 0.5), RNG.normal(size=9)) for name in "ab"}
    text = file_of(channels, kind="Multi", step=0.5).replace("2.500000\t", "2.5_0\t", 1)
    with pytest.raises(FormatError, match=r"line 21, column 0 must be a number or empty, got '2\.5_0'"):
        arrays(opened("lvm", text.encode(), tmp_path))


def test_uneven_instants_that_begin_anew_in_a_second_table_are_refused_with_the_remedy(tmp_path):
    x = np.cumsum(RNG.uniform(0.8, 1.2, size=9))
    text = file_of({"F": (x, RNG.normal(size=9))}, kind="One", step=1.0)
    table = text[text.index("Channels") :]
    with pytest.raises(FormatError, match="begins anew in one of them: save each table in a file of its own"):
        opened("lvm", (text + "\n" + table).encode(), tmp_path)
