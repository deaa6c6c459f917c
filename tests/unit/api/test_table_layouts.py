"""Text tables whose layout nobody said: separator, decimals, header, names, units, time, sample numbers."""

from __future__ import annotations

from datetime import UTC, date, datetime

import numpy as np
import pytest

from api.formats import FormatError
from api.formats.text.clock import Clock, clock_for, is_stamp
from api.services.recordings.importing import settle
from tests.support.recorded import arrays, closed_files, opened  # noqa: F401 - a fixture for all tests here

DAQ = b"""Header Size:  7\r
Version:  2\r
Sampling Interval:  0.001\r
Sampling Rate:  1000\r
Sample Count:  4\r
Device Serial Number:  0\r
Sample Number, Date/Time, CHANNEL0, CHANNEL1, Events\r
         1,   06/29/2022 11:59:59.999 AM, -0.0209, -0.0166, DAQ Start\r
         2,   06/29/2022 12:00:00.000 PM, -0.0221, -0.0167\r
         3,   06/29/2022 12:00:00.001 PM, -0.0221, -0.0176\r
         4,   06/29/2022 12:00:00.002 PM, -0.0221, -0.0164\r
"""


def test_the_text_of_a_daq_program(tmp_path):
    found = opened("csv", DAQ, tmp_path)
    assert found.layout == {
        "delimiter": ",",
        "decimal": ".",
        "header_lines": 7,
        "missing": ["", "NaN"],
        "sample_rate": 1000.0,
    }
    assert found.refused == {
        "Events": "it is a text such as 'DAQ Start', a channel must hold numbers: write what it stands for as numbers "
        "(cells that stand for a missing sample are named in missing)"
    }
    assert [(one.name, one.index, one.role) for one in found.series] == [
        ("Sample Number", 0, "counter"),
        ("Date/Time", 1, "time"),
        ("CHANNEL0", 2, "channel"),
        ("CHANNEL1", 3, "channel"),
    ]
    assert found.series[1].start_time == datetime.fromisoformat("2022-06-29T11:59:59.999")
    read = arrays(found, ["Date/Time", "CHANNEL1"])
    np.testing.assert_allclose(read["Date/Time"], [43199.999, 43200.0, 43200.001, 43200.002], rtol=0, atol=1e-9)
    assert read["CHANNEL1"].tolist() == [-0.0166, -0.0167, -0.0176, -0.0164]


TABLES = {
    "semicolons, decimal commas": ("t [s];x [mm];F (kN)\n0,0;1,25;-3\n0,1;2,5;4e-1\n0,2;3;5\n", ";", ",", 1),
    "tabs, decimal commas": ("t [s]\tx [mm]\tF (kN)\n0,0\t1,25\t-3\n0,1\t2,5\t4e-1\n0,2\t3,0\t5\n", "\t", ",", 1),
    "commas": ("t [s],x [mm],F (kN)\n0.0,1.25,-3\n0.1,2.5,4e-1\n0.2,3,5\n", ",", ".", 1),
    "blanks": ("made by hand\n t[s]  x[mm]   F(kN)\n 0.0  1.25   -3\n 0.1 2.5 4e-1\n 0.2  3.0  5\n", " ", ".", 2),
    "units in a line of their own": ("t;x;F\n[s];[mm];[kN]\n0;1,25;-3\n0,1;2,5;0,4\n0,2;3;5\n", ";", ",", 2),
    "quotes": ('"t [s]";"x [mm]";"F (kN)"\n"0,0";"1,25";"-3"\n"0,1";"2,5";"0,4"\n"0,2";"3";"5"\n', ";", ",", 1),
}


@pytest.mark.parametrize("case", TABLES)
def test_tables_are_understood(tmp_path, case):
    text, delimiter, decimal, header = TABLES[case]
    found = opened("csv", text.encode(), tmp_path)
    assert found.layout == {
        "delimiter": delimiter, "decimal": decimal, "header_lines": header, "missing": ["", "NaN"]
    }  # fmt: skip
    assert [(one.name, one.unit, one.role) for one in found.series] == [
        ("t", "s", "time"),
        ("x", "mm", "channel"),
        ("F", "kN", "channel"),
    ]
    read = arrays(found)
    assert read["t"].tolist() == [0.0, 0.1, 0.2]
    assert read["x"].tolist() == [1.25, 2.5, 3.0]
    assert read["F"].tolist() == [-3.0, 0.4, 5.0]


def test_without_a_header_columns_have_numbers_and_the_time_is_a_guess(tmp_path):
    found = opened("csv", b"0.00,0.5,7\r\n0.02,0.5,7\r\n0.04,0.25,8\r\n", tmp_path)
    assert [(one.name, one.role) for one in found.series] == [
        ("column 0", "time"),
        ("column 1", "channel"),
        ("column 2", "channel"),
    ]
    assert "taken as the time in s" in found.remarks[0]


def test_words_for_missing_samples_are_those_of_the_beginning(tmp_path):
    found = opened("csv", b"t,x\n0,1\n1,nan\n2,3\n3,n/a\n", tmp_path)
    assert found.layout["missing"] == ["", "NaN", "n/a", "nan"]
    np.testing.assert_array_equal(arrays(found)["x"], [1.0, np.nan, 3.0, np.nan])
    late = b"t,x\n" + b"".join(b"%d,1.0\n" % i for i in range(60_000)) + b"60000,%s\n"
    with pytest.raises(FormatError, match=r"line 60002, column 1 must be a finite number, got 'OVL' .* in missing"):
        arrays(opened("csv", late % b"OVL", tmp_path))
    assert np.isnan(arrays(opened("csv", late % b"OVL", tmp_path, missing=["OVL"]))["x"][-1])
    # an empty cell and NaN are missing samples wherever they are, unless the policy says otherwise
    for cell in (b"", b"NaN"):
        assert np.isnan(arrays(opened("csv", late % cell, tmp_path))["x"][-1])
        with pytest.raises(FormatError, match="line 60002, column 1 must be a finite number"):
            arrays(opened("csv", late % cell, tmp_path, missing=[]))


def test_two_columns_of_one_name_are_told_apart(tmp_path):
    found = opened("csv", b"x,x\n1,2\n3,4\n", tmp_path)
    assert [one.name for one in found.series] == ["x", "x (column 1)"]


@pytest.mark.parametrize("text", [b"", b"\n\n", b"nothing\nbut\nwords\n", bytes(4096), b"\x89PNG\r\n\x1a\n" * 40])
def test_what_is_no_table_is_refused(tmp_path, text):
    with pytest.raises(FormatError, match="file must hold rows of numbers"):
        opened("csv", text, tmp_path)


def test_what_is_said_overrules_what_is_found(tmp_path):
    # one column with decimal commas, or two of whole numbers: only its author knows
    assert len(opened("csv", b"1,5\n2,5\n3,0\n", tmp_path).series) == 2
    found = opened("csv", b"1,5\n2,5\n3,0\n", tmp_path, delimiter=";", decimal=",")
    assert arrays(found)["column 0"].tolist() == [1.5, 2.5, 3.0]


@pytest.mark.parametrize(
    ("stamps", "order", "seconds"),
    [
        (["2022-06-29 16:05:36.674", "2022-06-30T00:00:00"], "ymd", [57936.674, 86400.0]),
        (["13.02.2013 09:51:39,25", "13.02.2013 09:51:40,5"], "dmy", [35499.25, 35500.5]),
        (["02/13/2013 9:51:39 AM", "02/13/2013 1:51:39 PM"], "mdy", [35499.0, 49899.0]),
        (["12:00:00 AM", "12:00:01 PM"], "ymd", [0.0, 43201.0]),
    ],
)
def test_clocks(stamps, order, seconds):
    clock = clock_for(stamps)
    assert (clock.order, clock.doubt) == (order, "")
    np.testing.assert_allclose(clock.seconds(stamps), seconds, rtol=0, atol=1e-9)
    # the way of stamps that all look alike, and that of others
    assert clock.seconds([stamps[0]] * 3).tolist() == clock._one_by_one([stamps[0]] * 3).tolist()


def test_a_date_that_may_be_read_in_two_ways_is_refused_until_it_is_said(tmp_path):
    for stamp in ("04/05/2022 10:00:00 AM", "04-05-2022 10:00:00"):
        assert clock_for([stamp]).doubt == (
            "the date 04/05/2022 may begin with the day or the month: say dmy or mdy in time.order of import"
        )
        said = clock_for([stamp], "mdy")
        assert (said, said.doubt) == (Clock(order="mdy", first=date(2022, 4, 5)), "")
    points = clock_for(["04.05.2022 10:00:00"])  # nobody writes the month first and points between
    assert (points.first, points.doubt) == (date(2022, 5, 4), "")
    table = b"Time,x\n04/05/2022 10:00:00,1\n04/05/2022 10:00:01,2\n04/05/2022 10:00:02,3\n"
    with pytest.raises(FormatError, match=r"say dmy or mdy in time.order"):
        settle("csv", opened("csv", table, tmp_path), {})
    given = {"time": {"index": 0, "order": "mdy"}}
    plan = settle("csv", opened("csv", table, tmp_path, time=0, order="mdy"), given)
    assert plan.start_time == datetime(2022, 4, 5, 10, tzinfo=UTC)
    with pytest.raises(FormatError, match="in the order mdy"):
        Clock(order="mdy").seconds(["30/05/2022 10:00:00"])
    assert not is_stamp("10")
    with pytest.raises(FormatError, match="must be a date and time of day, got 'soon'"):
        Clock().seconds(["10:00:00", "soon"])


def test_the_zone_of_stamps_is_theirs_and_may_change():
    """Summer time ends: the clock goes back, the instants do not."""
    stamps = ["2024-10-27T02:59:59+02:00", "2024-10-27T02:00:00+01:00", "2024-10-27T02:00:01+01:00"]
    clock = clock_for(stamps)
    seconds = clock.seconds(stamps)
    truth = [datetime.fromisoformat(stamp) for stamp in stamps]
    assert [clock.instant(second) for second in seconds.tolist()] == truth
    assert clock.seconds(stamps[1:]).tolist() == seconds[1:].tolist()
    utc = clock_for(["2024-01-05T10:00:00.5Z"])
    assert utc.instant(36000.5) == datetime(2024, 1, 5, 10, 0, 0, 500_000, tzinfo=UTC)
