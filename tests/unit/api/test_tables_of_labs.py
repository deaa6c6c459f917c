"""Tables as programs and people of labs write them: units, thousands, empty cells, comments, quotes, cut ends.

The truth is the array that was written, or what pandas reads where it is told the layout that we have to find.
"""

from __future__ import annotations

import io

import numpy as np
import pandas as pd
import pytest

from api.formats import FormatError
from tests.support.recorded import arrays, closed_files, opened  # noqa: F401 - a fixture for all tests here

RNG = np.random.default_rng(29)
TIME = np.arange(40) / 500
FORCE = np.round(RNG.normal(scale=4e5, size=40), 2)
FORCE[3] = 12.5  # no group of thousands


def written(number, thousands, decimal):
    return f"{number:,.3f}".translate(str.maketrans({",": thousands, ".": decimal}))


@pytest.mark.parametrize("delimiter", [";", "\t", ",", "|"])
@pytest.mark.parametrize(("thousands", "decimal"), [(".", ","), (",", "."), (" ", ","), ("\u202f", ","), ("'", ".")])
def test_separated_thousands_are_the_numbers_that_were_written(tmp_path, delimiter, thousands, decimal):
    quote = '"' if delimiter in (thousands, decimal) else ""
    rows = [
        delimiter.join(f"{quote}{written(x, thousands, decimal)}{quote}" for x in row)
        for row in zip(TIME, FORCE, strict=True)
    ]
    found = opened("csv", "\n".join(["t" + delimiter + "F", *rows, ""]).encode(), tmp_path)
    read = arrays(found)
    np.testing.assert_array_equal(read["t"], TIME)
    np.testing.assert_array_equal(read["F"], FORCE)
    assert found.layout["thousands"] == (" " if thousands == "\u202f" else thousands)


def test_thousands_that_are_first_met_late_are_refused_by_line_until_they_are_said(tmp_path):
    text = "t;F\n" + "".join(f"{i};0,5\n" for i in range(40_000)) + "40000;1.000,5\n"
    with pytest.raises(FormatError, match=r"line 40002, column 1 must be a finite number, got '1.000,5'"):
        arrays(opened("csv", text.encode(), tmp_path))
    assert arrays(opened("csv", text.encode(), tmp_path, thousands="."))["F"][-1] == 1000.5


def test_what_may_be_thousands_or_decimals_is_said(tmp_path):
    found = opened("csv", b"n;F\n0;1.234\n1;2.345\n2;3.456\n", tmp_path)
    assert arrays(found)["F"].tolist() == [1.234, 2.345, 3.456]
    assert "1.234 is read with '.' as the decimal mark; where it separates thousands" in found.remarks[0]
    said = opened("csv", b"n;F\n0;1.234\n1;2.345\n2;3.456\n", tmp_path, decimal=",")
    assert arrays(said)["F"].tolist() == [1234.0, 2345.0, 3456.0]
    assert not opened("csv", b"n;F\n0;1.234\n1;0.345\n2;3.456\n", tmp_path).remarks  # no group begins with 0
    with pytest.raises(FormatError, match="thousands must be separated in one way"):
        opened("csv", b"t;F\n0.5;1,234.5\n1;2'345.5\n2;1,000.5\n", tmp_path)


HEADERS = {
    "a row of bare units": ("Zeit;Kraft;Weg\ns;N;mm\n", 1),
    "units, then a row of words": ("Zeit;Kraft;Weg\ns;N;mm\nKanal 1;Kanal 2;Kanal 3\n", 1),
    "units in brackets": ("Zeit;Kraft;Weg\n[s];[N];[mm]\n", 1),
    "a preamble, then units": ("Prüfstand;3\nBediener;Maier\n\nZeit;Kraft;Weg\ns;N;mm\n", 1),
    "units behind the names": ("Zeit [s];Kraft [N];Weg (mm)\n", 0),
    "units under a line": ("Zeit/s;Kraft/N;Weg/mm\n", 0),
    "units in words": ("Zeit in s;Kraft in N;Weg in mm\n", 0),
    "quotes": ('"Zeit [s]";"Kraft [N]";"Weg [mm]"\n', 0),
    "comments": ("# Prüfstand 3\n# Zeit [s];Kraft [N];Weg [mm]\n", 0),
    "a line for spreadsheets": ("sep=;\nZeit [s];Kraft [N];Weg [mm]\n", 0),
}


@pytest.mark.parametrize("encoding", ["utf-8", "cp1252", "utf-16"])
@pytest.mark.parametrize("case", HEADERS)
def test_names_and_units_are_found_in_headers(tmp_path, case, encoding):
    head, remarks = HEADERS[case]
    text = head + "0,0;1,5;7\n0,1;2,5;7\n0,2;1,5;8\n0,3;0,5;9\n"
    found = opened("csv", text.encode(encoding), tmp_path)
    assert [(one.name, one.unit, one.role) for one in found.series] == [
        ("Zeit", "s", "time"),
        ("Kraft", "N", "channel"),
        ("Weg", "mm", "channel"),
    ]
    assert found.layout["header_lines"] == head.count("\n")
    assert len(found.remarks) == remarks
    read = arrays(found)
    truth = pd.read_csv(io.StringIO(text[len(head) :]), sep=";", decimal=",", header=None).to_numpy(float)
    for i, name in enumerate(("Zeit", "Kraft", "Weg")):
        np.testing.assert_array_equal(read[name], truth[:, i])


def test_names_that_look_like_units_are_names(tmp_path):
    """t is a tonne and F a farad: below two words that name no time they are the names."""
    found = opened("csv", b"Operator;Smith\nt;F\n0;1,5\n1;2,5\n2;1,5\n", tmp_path)
    assert [(one.name, one.unit, one.role) for one in found.series] == [("t", "", "time"), ("F", "", "channel")]


def test_a_degree_of_a_western_code_page_is_a_degree(tmp_path):
    found = opened("csv", "t;Winkel;Öl\ns;°;µm\n0;1,5;1\n1;2,5;2\n2;3,5;1\n".encode("cp1252"), tmp_path)
    assert [(one.name, one.unit) for one in found.series] == [("t", "s"), ("Winkel", "°"), ("Öl", "µm")]


@pytest.mark.parametrize("share", [0.05, 0.6])
@pytest.mark.parametrize("delimiter", [";", ","])
def test_empty_cells_are_missing_samples(tmp_path, share, delimiter):
    text = pd.DataFrame(
        {"t": np.arange(300) / 8, "x": np.where(RNG.random(300) < share, np.nan, 1.25), "y": np.arange(300.0)}
    ).to_csv(index=False, sep=delimiter)
    read = arrays(opened("csv", text.encode(), tmp_path))
    truth = pd.read_csv(io.StringIO(text), sep=delimiter)
    assert np.isnan(truth["x"]).sum() > 5
    for name in ("t", "x", "y"):
        np.testing.assert_array_equal(read[name], truth[name])


def test_a_first_row_of_empty_cells_is_a_row(tmp_path):
    read = arrays(opened("csv", b"t;x;y;z\n0,0;;;\n0,1;;;2\n0,2;1;2;3\n0,3;1;2;3\n0,4;1;2;3\n0,5;1;2;3\n", tmp_path))
    np.testing.assert_array_equal(read["t"], [0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
    np.testing.assert_array_equal(read["x"], [np.nan, np.nan, 1.0, 1.0, 1.0, 1.0])


def test_columns_of_text_and_comments_between_rows_are_no_samples(tmp_path):
    text = b't,note,x\n# warm\n0.0,"a, b",1.5\n# pause\n0.1,"c",2.5\n0.2,"d ""e""",3.5\n'
    found = opened("csv", text, tmp_path)
    assert arrays(found)["x"].tolist() == [1.5, 2.5, 3.5]
    assert found.refused == {
        "note": "it is a text such as 'a, b', a channel must hold numbers: write what it stands for as numbers "
        "(cells that stand for a missing sample are named in missing)"
    }
    assert found.layout["comment"] == "#"


def rows_of(format_, count=100):
    return "t,x\n" + "".join(f"{i / 500:.3f},{format_(x)}\n" for i, x in enumerate(RNG.normal(size=count)))


@pytest.mark.parametrize("format_", ["{:.6f}".format, "{:.5e}".format, repr], ids=["fixed", "scientific", "shortest"])
def test_no_cut_goes_unsaid(tmp_path, format_):
    """Cut anywhere within the last row: refused, or all values are those of the whole, or a remark says that one may not be."""
    whole = rows_of(lambda x: format_(float(x)))
    truth = np.genfromtxt(io.StringIO(whole), delimiter=",", skip_header=1)
    last = whole.rstrip().rindex("\n") + 1
    refused = said = 0
    for end in range(last, len(whole) + 1):
        found = None
        try:
            found = opened("csv", whole[:end].encode(), tmp_path)
        except FormatError as error:
            assert "its last line is cut" in error.message  # noqa: PT017 - not every cut is refused
            refused += 1
            allowed = opened("csv", whole[:end].encode(), tmp_path, allow_truncated=True)
            assert arrays(allowed)["x"].tolist() == truth[:-1, 1].tolist()
            assert "is left out" in allowed.remarks[-1]
            continue
        x = arrays(found)["x"]
        said += bool(found.remarks)
        assert found.remarks or x.tolist() == truth[: x.size, 1].tolist()
    assert refused >= 5  # within the time at least
    assert said <= 2 or format_ is repr


def test_a_last_line_without_an_end_is_read_where_it_is_whole(tmp_path):
    whole = rows_of("{:.6f}".format).rstrip()
    found = opened("csv", whole.encode(), tmp_path)
    assert (arrays(found)["x"].size, found.remarks) == (100, ())
    assert arrays(opened("csv", whole.encode(), tmp_path, allow_truncated=True))["x"].size == 100


@pytest.mark.parametrize(
    ("line", "count"),
    [
        ("Sample Count:  4", 4),
        ("Number of samples = 1000;", 1000),
        ("Anzahl Werte;61500", 61500),
        ("Samples per second: 1000", None),
        ("sample_count,7,", 7),
    ],
)
def test_the_samples_that_a_header_claims(tmp_path, line, count):
    assert opened("csv", f"{line}\nt,x\n0,1.5\n1,2.5\n2,1.5\n3,2.5\n".encode(), tmp_path).stated_count == count


def test_a_shorter_last_row_is_whole_where_all_digits_are_there(tmp_path):
    """A cooling curve that passes 10 at its last sample, without a line end."""
    text = "t,x\n" + "".join(f"{i / 10:.1f},{20 - i:.2f}\n" for i in range(10)) + "1.0,9.99"
    assert arrays(opened("csv", text.encode(), tmp_path))["x"][-1] == 9.99
    with pytest.raises(FormatError, match="its last line is cut"):
        opened("csv", text[:-1].encode(), tmp_path)


@pytest.mark.parametrize("row", ["{0}.5,1,23{0}.56", "0,{0},1,5"])
def test_commas_in_numbers_and_between_them_are_refused(tmp_path, row):
    text = ("t,F\n" + "".join(row.format(i % 10) + "\n" for i in range(20))).encode()
    with pytest.raises(
        FormatError, match=r"line 1 names 2 columns, the rows have . of numbers: commas stand in the numbers"
    ):
        opened("csv", text, tmp_path)
    assert len(opened("csv", text, tmp_path, delimiter=",").series) > 2
    unnamed = opened("csv", b"t;F\n0,5;1,5;7\n0,6;2,5;7\n0,7;1,5;8\n", tmp_path)
    assert "names 2 columns, the rows have 3 of numbers: is ';' what separates them?" in unnamed.remarks[0]


@pytest.mark.parametrize("before", [20, 40_000])
def test_a_comma_of_thousands_that_makes_another_cell_is_refused_wherever_it_is(tmp_path, before):
    text = "t,F\n" + "".join(f"{i},999.5\n" for i in range(before)) + f"{before},1,000.5\n"
    with pytest.raises(
        FormatError, match=rf"line {before + 2} has more cells than the others: .*1,000\.5 may be two cells"
    ):
        arrays(opened("csv", text.encode(), tmp_path))
    assert arrays(opened("csv", text.encode(), tmp_path, delimiter=","))["F"][-1] == 1.0  # whoever says it means it
    quoted = b't,a,F\n1,12,345\n2,13,"345"\n3,14,"1,345"\n4,15,340\n'
    assert arrays(opened("csv", quoted, tmp_path))["F"].tolist() == [345, 345, 1345, 340]
