"""Every file that the tests of npTDMS build: each channel as that library reads it, or refused by name."""

from __future__ import annotations

import io
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from nptdms import TdmsFile

from api.formats import FormatError
from tests.support.recorded import arrays, closed_files, opened  # noqa: F401 - a fixture for all tests here

if find_spec("nptdms.test") is None:
    pytest.skip("this build of npTDMS comes without its tests", allow_module_level=True)

from nptdms.test.scenarios import get_scenarios


def _bytes(built: object) -> bytes:
    with built.get_tempfile() as file:  # type: ignore[attr-defined]  # of the library's tests
        return Path(file.name).read_bytes()


@pytest.mark.parametrize(("built", "expected"), get_scenarios())
def test_a_file_of_the_tests_of_nptdms(
    built: object, expected: dict[tuple[str, str], np.ndarray], tmp_path: Path
) -> None:
    content = _bytes(built)
    theirs = {
        (group.name, channel.name): channel[:]
        for group in TdmsFile.read(io.BytesIO(content)).groups()
        for channel in group.channels()
    }
    for name, values in expected.items():
        np.testing.assert_array_equal(theirs[name], values)
    found = opened("tdms", content, tmp_path)
    read = arrays(found)
    for (group, channel), values in theirs.items():
        label = next((one for one in (channel, f"{group}/{channel}") if one in read), None)
        if label is None:
            reasons = {one: found.refused[one] for one in (channel, f"{group}/{channel}") if one in found.refused}
            assert reasons, (group, channel)
            # there are no samples to lose, or none that are numbers over time
            assert len(values) == 0 or np.asarray(values).dtype.kind in "OMSUc", (reasons, values.dtype)
        else:
            np.testing.assert_array_equal(read[label], np.asarray(values, dtype=np.float64))


def test_another_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="must begin with TDSm"):
        opened("tdms", b"no such file", tmp_path)
