"""The ten tasks of every day, against a service with a worker: what the textbook and the recording's maker say comes out."""

from __future__ import annotations

import re

import matplotlib as mpl
import pytest

from examples import ten_tasks
from tests.integration.api.conftest import serving, working


@pytest.fixture
def busy(sqlite_template, tmp_path):
    """A service with a worker."""
    path = tmp_path / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    url = f"sqlite:///{path}"
    with working(url), serving(url) as running:
        yield running


def test_ten_tasks(busy, capsys) -> None:
    mpl.use("agg")
    assert ten_tasks.main(["--url", busy.url, "--key", busy.keys["admin"]]) == 0
    said = capsys.readouterr().out
    told = dict(re.findall(r"^ *(\d+)\. .*: \d+ lines, [\d.]+ s\n    (.*)$", said, flags=re.MULTILINE))
    assert list(told) == [str(number) for number in range(1, 11)]
    # K. Ogata, Modern Control Engineering, 5th ed., example 5-2: K = 12.5 N m, Kh = 0.178 s
    for number in ("2", "10"):
        found = {name: float(value) for name, value in re.findall(r"\b(Kh?) = ([\d.]+)", told[number])}
        assert found == pytest.approx({"K": 12.5, "Kh": 0.178}, rel=5e-3)
    identified = {name: float(value) for name, value in re.findall(r"\b([JB]) = ([\d.]+)", told["4"])}
    assert identified == pytest.approx({"J": 1.0, "B": 1.0}, rel=0.02)
    assert told["5"].startswith("pass")
