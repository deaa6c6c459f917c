"""Every MDF file of asammdf's own tests, those it keeps and those it writes: each channel as that library reads it.

They are LGPL and come with its sources, which pip fetches once into pytest's cache. Three archives that its tests take from the
web are not in them.
"""

from __future__ import annotations

import subprocess
import sys
import tarfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.recorded import arrays, closed_files, opened  # noqa: F401 - a fixture for all tests here

asammdf = pytest.importorskip("asammdf", reason="it comes with the extra `formats`")

_WRITING = Path(__file__).parents[2] / "support" / "written_by_asammdf.py"
_LONGEST = 240.0
"""Of the fetching, s: pip prepares the build of what it fetches."""


@pytest.fixture(scope="module")
def sources(request: pytest.FixtureRequest) -> Path:
    """Return the folder with the tests of the version of asammdf that is installed."""
    folder = Path(request.config.cache.mkdir("sources-of-asammdf"))  # type: ignore[union-attr]
    name = f"asammdf-{asammdf.__version__}"
    if not (folder / name).exists():
        asked = [
            sys.executable,
            "-m",
            "pip",
            "download",
            "--quiet",
            "--no-deps",
            "--no-binary",
            "asammdf",
            "--retries",
            "0",
            "--dest",
        ]
        try:
            subprocess.run(
                [*asked, str(folder), name.replace("-", "==")],
                check=True,
                capture_output=True,
                text=True,
                timeout=_LONGEST,
            )
        except (OSError, subprocess.SubprocessError) as error:
            said = (getattr(error, "stderr", None) or str(error)).strip().splitlines()
            pytest.skip(f"the sources of {name} are not reachable: {said[-1] if said else error}")
        with tarfile.open(folder / f"{name}.tar.gz") as archive:
            archive.extractall(
                folder, filter="data", members=[one for one in archive if one.name.startswith(f"{name}/test/")]
            )
    return folder / name / "test"


@pytest.fixture(scope="module")
def files(sources: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Return the files that come with the tests, and those that the tests write while they run."""
    written = tmp_path_factory.mktemp("written")
    subprocess.run(
        [sys.executable, "-W", "ignore", str(_WRITING), str(sources), str(written)],
        check=True,
        capture_output=True,
        timeout=_LONGEST,
    )
    return [*sorted(sources.rglob("*.mf4")), *sorted(sources.rglob("*.mdf")), *sorted(written.iterdir())]


def test_each_channel_is_the_one_that_asammdf_reads(files: list[Path], tmp_path: Path) -> None:
    assert len(files) >= 68
    seen = dict.fromkeys(("numbers", "arrays", "refused"), 0)
    for path in files:
        for what, count in compared(path, tmp_path).items():
            seen[what] += count
    assert seen["numbers"] >= 1000, seen
    assert seen["arrays"] >= 50, seen


def compared(path: Path, tmp_path: Path) -> dict[str, int]:
    """Compare all channels of a file, and return how many are numbers, arrays, or refused."""
    found = opened("mdf", path, tmp_path)
    read = arrays(found)
    assert len(read) == len(found.series)
    seen = dict.fromkeys(("numbers", "arrays", "refused"), 0)
    with asammdf.MDF(path) as theirs:
        for number, group in enumerate(theirs.groups):
            if not group.channel_group.cycles_nr:
                continue
            for index, channel in enumerate(group.channels):
                labels = [
                    f"{channel.name}{more}"
                    for more in ("", f" (group {number})", f" (group {number}, channel {index})")
                ]
                expected = _theirs(theirs, number, index)
                label = next((one for one in reversed(labels) if one in read), None)
                if label is not None:
                    np.testing.assert_array_equal(read[label], expected, err_msg=f"{path.name}: {label}")
                    seen["numbers"] += 1
                elif index == theirs.masters_db.get(number):
                    times = [read[one.name] for one in found.series if one.role == "time"]
                    assert any(np.array_equal(one, expected) for one in times), (path.name, channel.name)
                elif reason := next((found.refused[one] for one in labels if one in found.refused), None):
                    assert (
                        np.asarray(expected).dtype.kind in "SOU" or "bytes a sample" in reason or "structure" in reason
                    )
                    seen["refused"] += 1
                else:
                    _compare_elements(read, labels, expected, path.name)
                    seen["arrays"] += 1
    return seen


def _theirs(source: Any, group: int, index: int) -> Any:
    """Return the samples of a channel as asammdf has them: texts as the numbers that stand for them, invalid ones as NaN."""
    signal = source.get(group=group, index=index, ignore_invalidation_bits=True)
    if signal.samples.dtype.kind in "SOU":
        signal = source.get(group=group, index=index, raw=True, ignore_invalidation_bits=True)
    if signal.samples.dtype.kind not in "iufb" or signal.samples.ndim > 1:
        return signal.samples
    invalid = signal.invalidation_bits
    return np.where(False if invalid is None else np.asarray(invalid, dtype=bool), np.nan, signal.samples.astype(float))


def _compare_elements(read: dict[str, np.ndarray], labels: list[str], samples: Any, file: str) -> None:
    """Compare each member of an array, which is a channel of its own."""
    values = samples[labels[0]] if samples.dtype.names else samples
    for place in np.ndindex(*values.shape[1:]):
        ending = "".join(f"[{i}]" for i in place)
        label = next(
            name
            for name in (
                *(f"{one}{ending}" for one in labels),
                *(f"{labels[0]}{ending}{one.removeprefix(labels[0])}" for one in labels),
            )
            if name in read
        )
        np.testing.assert_array_equal(
            read[label], values[(slice(None), *place)].astype(float), err_msg=f"{file}: {label}"
        )
