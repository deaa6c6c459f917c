"""LabVIEW text and universal files: made here by their published formats, and the real ones among the examples."""

from __future__ import annotations

from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from api.formats import FormatError
from api.formats.writing.uff import FrequencyResponse, write
from tests.support.recorded import arrays, closed_files, opened  # noqa: F401 - a fixture for all tests here

DATA = Path(__file__).parents[3] / "examples" / "data"
TEXT = DATA / "uff_vibration" / "Sample_UFF58_ascii.uff"
BINARY = DATA / "uff_vibration" / "Sample_UFF58b_bin.uff"
LONG = DATA / "lvm_labview" / "long_single_header_multi_ch.lvm"
SHORT = DATA / "lvm_labview" / "short.lvm"


@pytest.mark.parametrize("path", [TEXT, BINARY, LONG, SHORT])
def test_the_recordings_are_those_of_their_authors(path):
    source = (path.parent / "SOURCE.md").read_text()
    assert f"`{path.name}` | `{sha256(path.read_bytes()).hexdigest()}`" in source


def test_a_long_labview_file(tmp_path):
    """Means over each column as numpy's own reader finds them in the rows of the file."""
    found = opened("lvm", LONG, tmp_path)
    assert [(one.name, one.unit, one.count) for one in found.series] == [
        ("F", "g", 16_384),
        ("m_1", "m/s^2", 16_384),
        ("m_2", "m/s^2", 16_384),
    ]
    assert found.series[0].sample_rate == 1 / 0.000977
    assert found.series[0].start_time == datetime.fromisoformat("2013-08-30T09:18:17.725441")
    read = arrays(found)
    rows = np.genfromtxt(LONG, skip_header=22, delimiter="\t", usecols=(1, 2, 3))
    for i, (name, mean) in enumerate({"F": 0.052415, "m_1": 0.230589, "m_2": 0.243345}.items()):
        np.testing.assert_array_equal(read[name], rows[:, i])
        assert read[name].mean() == pytest.approx(mean, abs=5e-7)


def test_a_labview_file_with_decimal_commas(tmp_path):
    found = opened("lvm", SHORT, tmp_path)
    assert [(one.name, one.unit, one.count, one.sample_rate) for one in found.series] == [
        ("Excitation (Trigger)", "Newtons", 10, 1 / 3.906250e-5),
        ("Response (Trigger)", "m/s^2", 10, 1 / 3.906250e-5),
    ]
    read = arrays(found)
    assert read["Excitation (Trigger)"][0] == 0.914018
    assert read["Response (Trigger)"][0] == 1.204792


LVM = """LabVIEW Measurement\t
Writer_Version\t2
Separator\tTab
Decimal_Separator\t.
X_Columns\tNo
***End_of_Header***\t
\t
Channels\t2\t\t
Samples\t2\t2\t
Date\t2026/01/02\t2026/01/02\t
Time\t10:00:00\t10:00:00\t
Y_Unit_Label\tN\tmm\t
X0\t0\t0\t
Delta_X\t0.5\t0.5\t
***End_of_Header***\t\t\t
X_Value\tforce\tx\tComment
\t1\t2
\t3\t4
"""


def test_labview_tables_that_follow_each_other_are_joined(tmp_path):
    second = LVM[LVM.index("Channels") :].replace("\t1\t2\n", "\t5\t6\n").replace("10:00:00", "10:00:01")
    found = opened("lvm", (LVM + "\n" + second).encode(), tmp_path)
    assert arrays(found)["force"].tolist() == [1, 3, 5, 3]
    assert "2 tables were joined" in found.remarks[0]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (LVM.replace("LabVIEW", "MATLAB"), "must begin with 'LabVIEW Measurement'"),
        (LVM[: LVM.index("***End")], "the header must end with"),
        (LVM[: LVM.index("\t1\t2")], "must hold a table with rows"),
        (LVM.replace("Channels\t2", "Channels\tmany"), "Channels must be 1 ... 500, got 'many'"),
        (LVM.replace("Delta_X\t0.5", "Delta_X\tfast"), "Delta_X must be a finite number, got 'fast'"),
        (LVM.replace("\t3\t4", "\t3\tx"), "line 18, column 2 must be a number or empty, got 'x'"),
        (LVM.replace("Decimal_Separator\t.", "Decimal_Separator\t;"), 'Decimal_Separator must be "." or ","'),
        (LVM.replace("\t3\t4\n", "\t3"), "its last line is cut"),
        (LVM.replace("X_Columns\tNo", "X_Columns\tMulti"), "must hold samples, got none in its rows"),
    ],
)
def test_damaged_labview_files_are_refused(tmp_path, content, message):
    with pytest.raises(FormatError, match=message):
        arrays(opened("lvm", content.encode(), tmp_path))


def test_a_labview_file_that_is_cut_within_its_last_row_is_refused_or_loses_it(tmp_path):
    values = np.round(np.random.default_rng(8).normal(size=(20, 2)), 6)
    rows = [f"\t{a:.6f}\t{b:.6f}\n" for a, b in values]
    whole = LVM[: LVM.index("\t1\t2")] + "".join(rows)
    for cut in range(2, len(rows[-1]) - 1):
        with pytest.raises(FormatError, match="its last line is cut"):
            opened("lvm", whole[:-cut].encode(), tmp_path)
        read = arrays(opened("lvm", whole[:-cut].encode(), tmp_path, allow_truncated=True))
        np.testing.assert_array_equal(np.transpose([read["force"], read["x"]]), values[:-1])
    np.testing.assert_array_equal(arrays(opened("lvm", whole[:-1].encode(), tmp_path))["x"], values[:, 1])


def test_a_separator_that_is_not_named_is_a_tab(tmp_path):
    assert arrays(opened("lvm", LVM.replace("Separator\tTab", "Separator").encode(), tmp_path))["x"].tolist() == [2, 4]


def test_universal_files_as_text_and_binary_hold_the_same(tmp_path):
    text, binary = opened("uff", TEXT, tmp_path), opened("uff", BINARY, tmp_path)
    for found in (text, binary):
        (one,) = found.series
        assert (one.count, one.unit, one.quantity) == (79_292, "Pa", "pressure")
        assert one.sample_rate == 1 / 1.52588e-5
        assert one.start_time == datetime.fromisoformat("2016-04-18T13:49:58")
    (a,), (b,) = arrays(text).values(), arrays(binary).values()
    assert np.abs(a).max() == 0.141304
    np.testing.assert_allclose(a, b, rtol=6e-6, atol=1e-12)  # six digits in the text
    # the binary ordinates are single-precision numbers behind thirteen lines
    data = BINARY.read_bytes().split(b"\n", 13)[13]
    np.testing.assert_array_equal(b, np.frombuffer(data, "<f4", count=79_292).astype(float))


def head(*, kind="    58", count=6, type_=1, ordinate=2, spacing=1, step="1.00000E-03"):
    return "\n".join(
        [
            "    -1", kind, "a signal", "NONE", "18-Apr-16 13:49:58", "NONE", "NONE",
            f"{type_:5d}         0    0         0 P                  7   3 NONE               0   0",
            f"{ordinate:10d}{count:10d}{spacing:10d}  0.00000E+00  {step}  0.00000E+00",
            "        17    0    0    0 time                 s                   ",
            "        12    0    0    0 Acceleration         m/s^2               ",
            "         0    0    0    0 NONE                 NONE                ",
            "         0    0    0    0 NONE                 NONE                ", "",
        ]
    )  # fmt: skip


ROW = "".join(f"{value:13.5E}" for value in (-1.0, -2.0, -3.0, -4.0, -5.0, -6.0)) + "\n"
END = "    -1\n"


def test_numbers_that_touch_are_told_apart_by_their_columns(tmp_path):
    tight = "-1.00000E+000-2.00000E+000-3.00000E+000-4.00000E+000-5.00000E+000-6.00000E+000\n"
    found = opened("uff", (head() + tight + END).encode(), tmp_path)
    assert arrays(found) == {"P 7+Z": pytest.approx([-1, -2, -3, -4, -5, -6])}
    assert found.series[0].sample_rate == 1000.0


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (head() + ROW, "must end with -1 after 'P 7\\+Z', got its end .*: it is cut off"),
        (head(count=12) + ROW + END, "must have 12 ordinates, got 6|must fit into"),
        (head(count=10**9) + ROW + END, "must fit into the .* bytes that are there, got 1000000000 values"),
        (head(ordinate=3) + ROW + END, "data type must be 2, 4, 5 or 6, got 3"),
        (head().replace("         6", "         x") + ROW + END, "must have its numbers in their columns"),
        (
            head(kind="    58b     1     2          11        9999999") + ROW + END,
            "must end with -1 after .*: it is cut off",
        ),
        (head(kind="    58b     1     1          11        24") + ROW + END, "in the format of IEEE 754"),
        ("    -1\nwhat\n    -1\n", "must begin with its number"),
        ("nothing\n" * 5, "between lines of -1, got none"),
    ],
)
def test_damaged_universal_files_are_refused(tmp_path, content, message):
    with pytest.raises(FormatError, match=message):
        arrays(opened("uff", content.encode(), tmp_path))


def truncated(content: bytes, tmp_path):
    """Return a cut file as it is read where that is allowed."""
    found = opened("uff", content, tmp_path, allow_truncated=True)
    return found, arrays(found)


@pytest.mark.parametrize("cut", [1, 13, 30, 60])
def test_the_whole_points_of_a_cut_file_are_read_where_that_is_allowed(tmp_path, cut):
    """A line without an end may lack its last digits, so it does not count."""
    whole = (head(count=18) + ROW * 3).encode()
    found, read = truncated(whole[:-cut], tmp_path)
    np.testing.assert_array_equal(read["P 7+Z"], [-1, -2, -3, -4, -5, -6] * 2)
    assert found.remarks[0] == "the file is cut off: 12 of the 18 points of 'P 7+Z' are there"


def test_a_cut_binary_file_keeps_its_whole_points(tmp_path):
    data = BINARY.read_bytes()
    whole = arrays(opened("uff", data, tmp_path))
    found, read = truncated(data[: 3 * len(data) // 4 + 1], tmp_path)
    *others, last = read
    for name in others:
        np.testing.assert_array_equal(read[name], whole[name])
    np.testing.assert_array_equal(read[last], whole[last][: read[last].size])
    assert f"{read[last].size} of the {whole[last].size} points" in found.remarks[0]


def test_a_function_with_fewer_points_than_it_says_is_read_as_far_as_it_goes(tmp_path):
    """As programs leave them that shorten a file by hand, or end while they measure."""
    content = (head(count=18) + ROW * 2 + END + head(count=6) + ROW + END).encode()
    with pytest.raises(FormatError, match="must fit into the 158 bytes that are there, got 18 values"):
        arrays(opened("uff", content, tmp_path))
    found, read = truncated(content, tmp_path)
    assert [len(one) for one in read.values()] == [12, 6]
    assert found.remarks[0] == "the file is cut off: 12 of the 18 points of 'P 7+Z' are there"
    assert len(found.remarks) == 2


def test_a_file_cut_before_its_second_point_is_refused(tmp_path):
    with pytest.raises(FormatError, match="must have at least 2 points, got 0"):
        truncated((head() + ROW[:30]).encode(), tmp_path)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        (
            {"type_": 4, "ordinate": 5},
            r"it is a frequency response \(type 4\), neither over time nor over frequency: export time .*",
        ),
        (
            {"type_": 11},
            r"it is a probability density \(type 11\), neither over time nor over frequency: export time .*",
        ),
        ({"step": "0.00000E+00"}, "its time step must be > 0 s, got 0: write it anew .*"),
    ],
)
def test_functions_that_are_no_recordings_are_refused_by_name(tmp_path, changes, reason):
    import re

    changes = {"count": 3} | changes if changes.get("type_") == 4 else changes
    found = opened("uff", (head(**changes) + ROW + END).encode(), tmp_path)
    assert not found.series
    assert re.fullmatch(reason, found.refused["P 7+Z"])


def test_frequency_responses_are_written_as_the_format_says():
    """Columns of 80 characters, 4E20.12 for complex numbers in double precision, function type 4."""
    frequency = np.arange(5) * 0.25
    values = np.array([1 + 2j, -3.5e-7 + 0j, 1e12 - 1e-12j, 0.1 - 0.2j, 5j])
    response = FrequencyResponse(
        frequency=frequency,
        values=values,
        name="arm, accelerance",
        response="tip",
        reference="hammer",
        response_quantity="acceleration",
        reference_quantity="force",
        response_unit="m/s^2",
        reference_unit="N",
        coherence=np.ones(5),
    )
    lines = b"".join(write([response], recorded=datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC))).decode().split("\n")
    assert lines[:3] == ["    -1", "    58", "arm, accelerance"]
    assert lines[4] == "02-Jan-26 03:04:05"
    assert lines[7][:5] == "    4"
    assert (lines[7][31:41].strip(), lines[7][56:66].strip()) == ("tip", "hammer")
    assert lines[8] == "         6         5         1  0.00000E+00  2.50000E-01  0.00000E+00"
    assert lines[9][:10] == "        18"  # frequency
    assert (lines[10][:10], lines[10][46:66].strip()) == ("        12", "m/s^2")
    assert (lines[11][:10], lines[11][46:66].strip()) == ("        13", "N")
    assert lines[13] == "  1.000000000000E+00  2.000000000000E+00 -3.500000000000E-07  0.000000000000E+00"
    numbers = [float(line[i : i + 20]) for line in lines[13:16] for i in range(0, len(line), 20)]
    assert (np.array(numbers[::2]) + 1j * np.array(numbers[1::2])).tolist() == values.tolist()
    assert lines[16] == "    -1"
    assert lines[17:19] == ["    -1", "    58"]
    assert lines[24][:5] == "    6"  # coherence
    assert lines[25][:10] == "         4"
    assert max(map(len, lines)) <= 80


@pytest.mark.parametrize("frequency", [[0.0, 1.0, 3.0], [1.0, 1.0, 1.0], [1.0], [2.0, 1.0, 0.0]])
def test_frequencies_that_the_format_cannot_hold_are_refused(frequency):
    response = FrequencyResponse(frequency=np.array(frequency), values=np.zeros(len(frequency), complex))
    with pytest.raises(FormatError, match="must be"):
        b"".join(write([response], recorded=datetime(2026, 1, 2, tzinfo=UTC)))
