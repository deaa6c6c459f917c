"""A column that is called a time and cannot be one says why, in place of a sentence that there is none."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from api.formats import FormatError
from api.formats.catalogue import open_file
from api.services.recordings.importing import options, settle

BACK = [number / 1000 for number in range(400)]
BACK[300] = 0.29
REMEDY = "or say sample_rate in import, and the instants are not looked at"


def plan(path, format_="csv", **given):
    with path.open("rb") as file:
        found = open_file(format_, file, options(format_, given))
        try:
            return settle(format_, found, given)
        finally:
            found.close()


def table(path, rows, head="t [s],x [mm]"):
    path.write_text(head + "\n" + "".join(f"{time},{value}\n" for time, value in rows))
    return path


CASES = {
    "back once": ([(time, 1.5 * i) for i, time in enumerate(BACK)], "column t cannot be the time: it must not run backwards, got a step of -0.009 s at sample 300"),
    "one row": ([(0, 1)], "column t cannot be the time: it must have at least 2 instants, got 1"),
    "always the same": ([(0, 1), (0, 2), (0, 3)], "column t cannot be the time: it must rise, got 3 equal instants"),
    "a missing one": ([(0, 1), ("", 2), (0.2, 3)], "column t cannot be the time: it must be given for every sample, got none at sample 1"),
    "words": ([("10 min", 1), ("11 min", 2), ("12 min", 3)], "column t must hold numbers or dates to be the time, got '10 min'"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_time_that_cannot_be_one_says_why(tmp_path, case):
    rows, said = CASES[case]
    path = table(tmp_path / "bench.csv", rows)
    with pytest.raises(FormatError) as caught:
        plan(path)
    assert caught.value.message.startswith(said)
    assert caught.value.message.endswith(REMEDY)
    # whoever gives a rate all the same is told what the column was taken for
    taken = plan(path, sample_rate=1000.0)
    assert (taken.time, taken.sample_rate) == (None, 1000.0)
    assert any(remark.startswith(said) for remark in taken.remarks)


def test_two_rows_are_enough_for_a_time_that_is_called_so(tmp_path):
    assert plan(table(tmp_path / "two.csv", [(0, 1), (0.001, 2)])).document["time"] == {"index": 0, "unit": "s"}


def test_a_temperature_is_no_time_and_no_column_is_called_one(tmp_path):
    for head in ("T [degC],x", "force [N],x"):
        with pytest.raises(FormatError, match="the file states none and has no column of time"):
            plan(table(tmp_path / "bench.csv", [(20, 1), (20, 2), (19, 4)], head))


def test_a_time_of_another_length_is_named(tmp_path):
    with h5py.File(tmp_path / "bench.h5", "w") as file:
        file["t"], file["x"] = np.arange(101.0), np.arange(100.0)
    with pytest.raises(
        FormatError, match="its time t must have as many instants as there are samples, got 101 for the 100 of x"
    ):
        plan(tmp_path / "bench.h5", "hdf5")
