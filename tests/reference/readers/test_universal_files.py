"""Universal files as pyuff writes and reads them: every kind, layout and precision, channel by channel."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
import pyuff

from api.formats.uff import FUNCTIONS
from tests.support.recorded import arrays, closed_files, opened  # noqa: F401 - a fixture for all tests here

# pyuff leaves the files open that it writes in binary
pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")

RNG = np.random.default_rng(29)
KINDS = [0, 1, 2, 3, 4, 6, 9]
"""What pyuff writes."""
OVER_FREQUENCY = {2, 3, 4, 6, 9}


def written(path: Path, functions: list[dict[str, object]], *, double: bool) -> list[dict[str, object]]:
    """Write some functions; return what pyuff reads."""
    common = {
        "func_id": 1, "ver_num": 1, "load_case_id": 0, "rsp_ent_name": "tip", "ref_ent_name": "hammer", "ref_node": 3,
        "ref_dir": 3, "rsp_dir": -1, "z_axis_value": 0, "ordinate_axis_units_lab": "m/s^2", "ordinate_spec_data_type": 12,
        "orddenom_axis_units_lab": "N", "orddenom_spec_data_type": 13,
    }  # fmt: skip
    pyuff.UFF(str(path)).write_sets(
        [{"type": 58, **common, "ord_data_type": 5 if np.iscomplexobj(one["data"]) else 2, **one} for one in functions],
        mode="add",
        force_double=double,
    )
    found = pyuff.UFF(str(path)).read_sets()
    return found if isinstance(found, list) else [found]


@pytest.mark.parametrize(
    "case",
    [
        case
        for case in product(KINDS, (0, 1), (True, False), (True, False), (True, False))
        # binary files of pyuff are double, and it writes no uneven single numbers that are complex
        if (case[4] or not case[1]) and not (not case[4] and not case[2] and case[3])
    ],
)
def test_what_pyuff_reads(case: tuple[int, int, bool, bool, bool], tmp_path: Path) -> None:
    kind, binary, even, is_complex, double = case
    path = tmp_path / "file.uff"
    functions = []
    for node, count in ((1, 64), (2, 41)):
        x = np.arange(count) * 0.5 if even else np.cumsum(RNG.uniform(0.5, 1.5, size=count))
        data = RNG.normal(size=count) + (1j * RNG.normal(size=count) if is_complex else 0)
        axis = 18 if kind in OVER_FREQUENCY else 17
        functions.append(
            {"func_type": kind, "binary": binary, "rsp_node": node, "x": x, "data": data, "abscissa_spec_data_type": axis,
             "abscissa_spacing": int(even), "abscissa_inc": 0.5 if even else 0.0}
        )  # fmt: skip
    theirs = written(path, functions, double=double)
    found = opened("uff", path.read_bytes(), tmp_path)
    assert not found.refused
    if kind in OVER_FREQUENCY:
        assert not found.series
        for one, other in zip(found.functions, theirs, strict=True):
            frequency, values = one.read()
            np.testing.assert_allclose(frequency, other["x"], rtol=1e-12)
            np.testing.assert_array_equal(values, other["data"])
            assert one.kind == FUNCTIONS[kind]
            assert (one.response, one.reference) == (f"tip {other['rsp_node']}-X", "hammer 3+Z")
            assert (one.response_unit, one.reference_unit) == ("m/s^2", "N")
        return
    read = arrays(found)
    for other in theirs:
        name = f"tip {other['rsp_node']}-X"
        if is_complex:
            np.testing.assert_array_equal(read[f"{name} (real)"], other["data"].real)
            np.testing.assert_array_equal(read[f"{name} (imaginary)"], other["data"].imag)
        else:
            np.testing.assert_array_equal(read[name], other["data"])
        if even:
            (rate,) = {one.sample_rate for one in found.series if one.name.startswith(name)}
            assert rate == 1 / other["abscissa_inc"]
        else:
            np.testing.assert_array_equal(read[f"time of {name}"], other["x"])
            assert {one.role for one in found.series if one.name == f"time of {name}"} == {"time"}


def test_the_same_uneven_instants_are_one_group(tmp_path: Path) -> None:
    x = np.cumsum(RNG.uniform(0.5, 1.5, size=30))
    functions = [
        {"func_type": 1, "binary": 1, "rsp_node": node, "x": x if node < 3 else x + 0.25, "data": RNG.normal(size=30),
         "abscissa_spec_data_type": 17, "abscissa_spacing": 0}
        for node in (1, 2, 3)
    ]  # fmt: skip
    written(tmp_path / "file.uff", functions, double=True)
    found = opened("uff", (tmp_path / "file.uff").read_bytes(), tmp_path)
    assert [(one.name, one.role, one.group) for one in found.series] == [
        ("time of tip 1-X", "time", "tip 1-X"), ("tip 1-X", "channel", "tip 1-X"), ("tip 2-X", "channel", "tip 1-X"),
        ("time of tip 3-X", "time", "tip 3-X"), ("tip 3-X", "channel", "tip 3-X"),
    ]  # fmt: skip
