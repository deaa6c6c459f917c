from __future__ import annotations

import doctest

import numpy as np
import pytest

import api.formats.text.txt
from api.formats import FormatError
from api.formats.text.cells import Marks
from api.formats.text.txt import TextLayout, read

DAQ = (
    b"Header Size:  3\r\nSampling Rate:  1000\r\nSample Number, Date/Time, CHANNEL0, CHANNEL1, Events\r\n"
    b"         1,   06/29/2022 04:05:36.674 PM, -0.0209, -1.66e-2, DAQ Start\r\n"
    b"         2,   06/29/2022 04:05:36.675 PM, -0.0221, .5\r\n"
    b"         3,   06/29/2022 04:05:36.676 PM, +4, 5., DAQ Pause, DAQ Stop\r\n"
)


def parse(data, size=None, **layout):
    size = size or len(data)
    chunks = [data[i : i + size] for i in range(0, len(data), size)]
    return np.concatenate(list(read(chunks, TextLayout(**{"columns": (2, 3), "header_lines": 3, **layout}))))


@pytest.mark.parametrize("size", [1, 2, 3, 7, 64, None])
def test_a_daq_text_is_read_however_it_is_cut(size):
    expected = [[-0.0209, -0.0166], [-0.0221, 0.5], [4, 5]]
    assert parse(DAQ, size).tolist() == expected
    assert parse(DAQ.replace(b"\r\n", b"\n"), size).tolist() == expected
    assert parse(DAQ.replace(b"\r\n", b"\r"), size).tolist() == expected


def test_columns_come_in_the_order_asked_for():
    assert parse(DAQ, columns=(3, 0)).tolist() == [[-0.0166, 1], [0.5, 2], [5, 3]]


def test_decimal_commas_and_other_delimiters():
    assert parse(
        b"1;2,5;-3,25e1\n", delimiter=";", marks=Marks(decimal=","), header_lines=0, columns=(1, 2)
    ).tolist() == [[2.5, -32.5]]
    assert parse(b"1\t2.5\n", delimiter="\t", header_lines=0, columns=(1,)).tolist() == [[2.5]]
    assert parse(b"  1   2.5\t 7\n", delimiter=" ", header_lines=0, columns=(1, 2)).tolist() == [[2.5, 7]]
    assert parse(b'"1","2.5"\n', header_lines=0, columns=(1,)).tolist() == [[2.5]]


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_encodings_of_the_header_do_not_matter(encoding):
    text = "Temperatur in °C\n1, 2\n3, 4\n"
    assert parse(text.encode(encoding), 3, header_lines=1, columns=(0, 1)).tolist() == [[1, 2], [3, 4]]


def test_the_last_line_needs_no_end_and_blank_lines_may_follow():
    assert parse(DAQ.rstrip(b"\r\n")).shape == (3, 2)
    assert parse(DAQ + b"\r\n  \r\n").shape == (3, 2)


@pytest.mark.parametrize("cell", [b"nan", b"inf", b"1e999", b"", b"1_000", b"0x10", b"1,5", b"OVERLOAD", b"1.2.3"])
def test_a_cell_that_is_no_number_is_named_by_line_and_column(cell):
    with pytest.raises(FormatError, match="line 5, column 2 must be a finite number") as caught:
        parse(DAQ.replace(b" -0.0221", b' "' + cell + b'"' if b"," not in cell else b" OVERLOAD"))
    assert (caught.value.line, caught.value.column) == (5, 2)


def test_a_decimal_point_is_no_number_where_commas_mark_decimals():
    with pytest.raises(FormatError, match=r"line 1, column 0 must be a finite number, got '1.5'"):
        parse(b"1.5;2\n", delimiter=";", marks=Marks(decimal=","), header_lines=0, columns=(0,))


def test_a_row_with_too_few_cells_is_refused():
    with pytest.raises(FormatError, match=r"line 7 must have a column 2 \(counted from 0\), got 1 columns") as caught:
        parse(DAQ + b"4\n")
    assert (caught.value.line, caught.value.column) == (7, 2)


def test_a_hole_in_the_recording_is_refused():
    with pytest.raises(FormatError, match="line 5 must hold a row of numbers, got a blank line"):
        parse(DAQ.replace(b"         2,", b"\r\n         2,"))


@pytest.mark.parametrize("data", [b"", b"only\na\nheader\n", b"short"])
def test_a_file_without_a_row_is_refused(data):
    with pytest.raises(FormatError, match="at least one row after 3 header lines, got none"):
        parse(data or b"", 64)


def test_a_binary_file_is_refused_before_it_fills_the_memory():
    def endless():
        while True:
            yield bytes(1 << 16)

    with pytest.raises(FormatError, match="is this a text file"):
        list(read(endless(), TextLayout(columns=(0,))))


def test_blocks_are_bounded():
    blocks = list(read([b"1\n"] * 20_000, TextLayout(columns=(0,))))
    assert [len(block) for block in blocks] == [8192, 8192, 3616]


@pytest.mark.parametrize(
    ("layout", "message"),
    [
        ({"columns": ()}, "at least one column"),
        ({"columns": (-1,)}, "index must be at least 0"),
        ({"delimiter": ""}, "delimiter must be text"),
        ({"delimiter": "\n"}, "delimiter must be text"),
        ({"header_lines": -1}, "header_lines must be at least 0"),
    ],
)
def test_layouts_that_no_file_has_are_refused(layout, message):
    with pytest.raises(FormatError, match=message):
        TextLayout(**{"columns": (0,), **layout})


def test_the_example_in_the_documentation_runs():
    assert doctest.testmod(api.formats.text.txt).failed == 0
