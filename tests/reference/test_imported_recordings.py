"""The recordings among the examples, imported without a word about their layout: every number is that of the file.

Expected values are those that numpy's own text reader finds in the columns that the pages beside the files describe.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from api.formats import FormatError
from api.formats.text.guess import Known
from api.services.recordings.importing import options, settle
from api.services.recordings.sampling import TimeAxis
from tests.support.recorded import arrays, closed_files, opened  # noqa: F401 - a fixture for all tests here

DATA = Path(__file__).parents[2] / "examples" / "data"


def test_the_chirp_of_the_servo_hydraulic_actuator(tmp_path):
    """A DAQ program's text: seven lines of header, stamps with AM and PM, a word behind the first row; 1 kHz, 61.5 s."""
    path = DATA / "servo_hydraulic_actuator" / "0A.txt"
    found = opened("txt", path, tmp_path)
    plan = settle("txt", found, {})
    assert [channel["name"] for channel in plan.channels] == ["CHANNEL0", "CHANNEL1", "CHANNEL2"]
    assert (plan.sample_rate, plan.start_time.isoformat()) == (1000, "2022-06-29T16:05:36.674000+00:00")
    read = arrays(found)
    rows = np.loadtxt(path, delimiter=",", skiprows=7, usecols=(2, 3, 4))
    assert rows.shape == (61_500, 3)
    for i, name in enumerate(("CHANNEL0", "CHANNEL1", "CHANNEL2")):
        np.testing.assert_array_equal(read[name], rows[:, i])
    axis = TimeAxis(requested=plan.sample_rate)
    axis.add(read["Date/Time"])
    assert (axis.rate, axis.document()["gap_count"]) == (1000, 0)


@pytest.mark.parametrize("path", sorted((DATA / "mr_damper").glob("*.txt")), ids=lambda path: path.stem)
def test_the_sines_of_the_magnetorheological_damper(tmp_path, path):
    """Blanks between the cells, no header, time in s in the first column; 200 samples/s."""
    found = opened("csv", path, tmp_path)
    read = arrays(found)
    rows = np.loadtxt(path)
    for i in range(4):
        np.testing.assert_array_equal(read[f"column {i}"], rows[:, i])
    plan = settle("csv", found, {})
    assert plan.document["time"] == {"index": 0, "unit": "s"}
    axis = TimeAxis()
    axis.add(read["column 0"])
    assert axis.rate == 200


def test_what_the_contract_states_by_default_is_not_guessed():
    """A `txt` file whose columns are given by their indices: commas, points, no header."""
    said = options("txt", {"columns": [{"index": 2, "name": "x"}], "sample_rate": 5})
    assert said.known == Known(delimiter=",", decimal=".", thousands="", comment="", header_lines=0)
    assert said.columns == [2]
    assert options("csv", {"columns": [{"index": 2, "name": "x"}]}).known.delimiter is None
    assert options("txt", {"columns": [{"source": "x", "name": "x"}]}).known.delimiter is None


@pytest.mark.parametrize(("name", "rate"), [("HangingLoad.csv", 50), ("MotorRotation.csv", 50)])
def test_the_hydraulic_bench(tmp_path, name, rate):
    """Commas, CRLF, no header, time in s in the first column, 20 ms apart."""
    path = DATA / "hydraulic_bench" / name
    read = arrays(opened("csv", path, tmp_path))
    rows = np.loadtxt(path, delimiter=",")
    for i in range(rows.shape[1]):
        np.testing.assert_array_equal(read[f"column {i}"], rows[:, i])
    axis = TimeAxis()
    axis.add(read["column 0"])
    assert axis.rate == rate


def test_a_table_without_time_needs_a_sample_rate(tmp_path):
    """The robot arm of DaISy: its sampling time was not published."""
    path = DATA / "flexible_robot_arm" / "robot_arm.dat"
    found = opened("txt", path, tmp_path)
    read = arrays(found)
    rows = np.loadtxt(path)
    for i in range(2):
        np.testing.assert_array_equal(read[f"column {i}"], rows[:, i])
    with pytest.raises(FormatError, match="sample_rate must be given in import"):
        settle("txt", found, {})
    assert settle("txt", found, {"sample_rate": 100}).sample_rate == 100


def test_a_matlab_file_of_many_variables(tmp_path):
    """Those of the shaking table: vectors, matrices, numbers and a text, as scipy reads them."""
    (path,) = (DATA / "mr_damper_dahl").glob("*.mat")
    found = opened("mat", path, tmp_path)
    expected = scipy.io.loadmat(path)
    read = arrays(found)
    assert len(read) >= 10
    for name, values in read.items():
        variable, _, place = name.partition("(")
        whole = expected[variable]
        if place.startswith(":"):
            whole = whole[:, int(place[2:-1]) - 1]
        elif place:
            whole = whole[int(place.split(",")[0]) - 1]
        np.testing.assert_array_equal(values, np.ravel(whole))
    assert found.scalars["Ts"] == 0.01


#: Recordings that may not be copied into the project, or are too large for it: (file, format, channel, samples).
ELSEWHERE = [
    ("emps/DATA_EMPS.mat", "mat", "vir", 24_841),
    ("kuka_kr300/run_A.mat", "mat", "ref_kin.phi_r_all(:,1)", 2501),
    ("pneumatic_friction_tudelft/O-ring257_1bar.csv", "csv", "column 6", 5828),
    ("mr_damper_mts/raw/ME25mm0x25Hz.txt", "txt", "CHANNEL1", 31_200),
]


@pytest.mark.parametrize(("name", "format_", "channel", "count"), ELSEWHERE)
def test_recordings_that_are_kept_elsewhere(tmp_path, name, format_, channel, count):
    folder = os.environ.get("SERVOTUNE_RECORDINGS", "")
    if not folder or not (Path(folder) / name).is_file():
        pytest.skip(f"{name} is not in the folder that SERVOTUNE_RECORDINGS names: its licence or size keeps it out")
    path = Path(folder) / name
    values = arrays(opened(format_, path, tmp_path), [channel])[channel]
    assert values.size == count
    if format_ == "mat" and "." not in channel:
        np.testing.assert_array_equal(values, scipy.io.loadmat(path)[channel].ravel())
    elif format_ == "csv":
        np.testing.assert_array_equal(values, np.loadtxt(path, usecols=6))
    elif format_ == "txt":
        np.testing.assert_array_equal(values, np.loadtxt(path, delimiter=",", skiprows=7, usecols=3))
