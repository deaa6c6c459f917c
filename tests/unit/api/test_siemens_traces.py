"""Traces of TIA Portal (Siemens) as CSV, in the two layouts that are publicly described: times of day, and ms since 1970.

Sample numbers and instants come first, then the signals by their tags; no file of the maker is among these: all are written here.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from api.formats import FormatError
from api.formats.recognise import recognised
from api.services.recordings.importing import settle
from tests.support.recorded import arrays, closed_files, opened  # noqa: F401 - a fixture for all tests here

RNG = np.random.default_rng(1500)
COUNT = 120
POSITION = np.round(RNG.normal(size=COUNT), 4)
SWITCH = RNG.random(COUNT) > 0.5
BEGIN = datetime(2023, 11, 14, 22, 13, 20, 500_000, tzinfo=UTC)


def trace(
    *,
    mark: str = ";",
    decimal: str = ".",
    dated: bool = False,
    words: bool = True,
    quoted: bool = False,
    every: int = 1,
) -> bytes:
    """Return a trace of a position and a switch at 4 ms; ``every``: the position is recorded at each of so many cycles."""
    tag = '"""Axis_1"".ActualPosition"' if quoted else '"Axis_1".ActualPosition'
    head = ["Sample Number", "Timestamp"] if dated else ["Timestamp", "Sample Number"]
    lines = [mark.join([*head, tag, '"Machine".bRun'])]
    for i in range(COUNT):
        now = BEGIN + i * timedelta(milliseconds=4)
        ms = (now - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(milliseconds=1)
        first = [str(i + 1), str(ms)] if dated else [f"{now:%H:%M:%S.%f}", str(i)]
        position = "" if i % every else f"{POSITION[i]:.4f}".replace(".", decimal)
        lines.append(mark.join([*first, position, str(bool(SWITCH[i])).upper() if words else str(int(SWITCH[i]))]))
    return ("\r\n".join(lines) + "\r\n").encode("utf-8-sig")


@pytest.mark.parametrize("words", [True, False], ids=["TRUE", "1"])
@pytest.mark.parametrize("dated", [True, False], ids=["since 1970", "time of day"])
@pytest.mark.parametrize(("mark", "decimal"), [(";", ","), (";", "."), (",", "."), ("\t", ",")])
def test_a_trace_is_read_with_its_instants_and_said_to_be_one(tmp_path, mark, decimal, dated, words):
    found = opened("csv", trace(mark=mark, decimal=decimal, dated=dated, words=words), tmp_path)
    read = arrays(found)
    np.testing.assert_array_equal(read["Axis_1.ActualPosition"], POSITION)
    np.testing.assert_array_equal(read["Machine.bRun"], SWITCH)
    assert [one.role for one in found.series].count("channel") == 2
    assert "as TIA Portal (Siemens) exports a trace" in found.remarks[0]
    plan = settle("csv", found, {})
    seconds = read["Timestamp"] * plan.time_scale
    np.testing.assert_allclose(seconds - seconds[0], np.arange(COUNT) * 4e-3, atol=1e-9 if not dated else 1e-6)
    assert plan.start_time == (BEGIN if dated else None)


def test_tags_in_doubled_quotes_and_signals_of_slower_cycles_are_read(tmp_path):
    read = arrays(opened("csv", trace(quoted=True, every=5), tmp_path))
    expected = np.where(np.arange(COUNT) % 5, np.nan, POSITION)
    np.testing.assert_array_equal(read['"Axis_1".ActualPosition'], expected)


def test_other_tables_are_not_said_to_be_traces(tmp_path):
    for text in (b"t;x\n0;1\n1;2\n2;1\n", b"n;t;x\n1;0.1;5\n2;0.2;6\n3;0.3;7\n"):
        assert not any("Siemens" in said for said in opened("csv", text, tmp_path).remarks)


@pytest.mark.parametrize(("unit", "per_second"), [("s", 1), ("ms", 10**3), ("us", 10**6)])
def test_instants_since_1970_tell_their_unit_by_their_size(tmp_path, unit, per_second):
    seconds = [1_700_000_000 + i for i in range(20)]
    text = "timestamp,x\n" + "".join(f"{t * per_second},{i}.5\n" for i, t in enumerate(seconds))
    plan = settle("csv", opened("csv", text.encode(), tmp_path), {})
    assert (plan.document["time"]["unit"], plan.start_time) == (unit, datetime.fromtimestamp(seconds[0], UTC))
    assert any("since 1970" in remark for remark in plan.remarks)


def test_a_measurement_that_was_not_exported_as_csv_says_the_remedy():
    with pytest.raises(FormatError, match=r"TIA exports a measurement, \.ttrecx, as CSV"):
        recognised(b"PK\x03\x04" + bytes(60), "Trace_1.ttrecx")
