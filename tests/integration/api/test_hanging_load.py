"""The study of the hanging load as a script: what it prints beside what was computed from the recording before it existed."""

from __future__ import annotations

import re

import pytest

from examples import hanging_load
from tests.integration.api.conftest import Service


@pytest.fixture(scope="module")
def said(
    sqlite_service: Service, sqlite_worker: None, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, list[float]]:
    """Return the numbers of each row: time constants in s with their intervals, fits in %."""
    figure = tmp_path_factory.mktemp("figure") / "figure.png"
    with pytest.MonkeyPatch.context() as patch:
        lines: list[str] = []
        patch.setattr("builtins.print", lambda *parts, **_: lines.append(" ".join(map(str, parts))))
        key = sqlite_service.keys["admin"]
        assert hanging_load.main(["--url", sqlite_service.url, "--key", key, "--figure", str(figure)]) == 0
    assert figure.read_bytes().startswith(b"\x89PNG")
    rows = [re.split(r"  +", line.strip()) for line in "\n".join(lines).splitlines()]
    return {row[0]: [float(x) for x in re.findall(r"\d+\.\d+", " ".join(row[1:]))] for row in rows if len(row) > 1}


def test_one_lag_does_not_explain_both_directions(said) -> None:
    assert said["one lag, up and down"][-1] == pytest.approx(97.07, abs=0.3)


def test_each_direction_has_a_time_constant_of_its_own(said) -> None:
    up, down = said["one lag, up alone"], said["one lag, down alone"]
    # 0.380 s and 0.620 s with FIT 98.4 each were computed with slightly other ends of the staircases
    assert up[0] == pytest.approx(0.380, rel=0.05)
    assert down[0] == pytest.approx(0.620, rel=0.05)
    assert up[3] == pytest.approx(98.4, abs=0.3)
    assert down[3] == pytest.approx(98.4, abs=0.3)
    assert up[2] < down[1]  # the intervals do not even touch
    assert max(up[4], down[4]) < 96  # nor does the model of one direction serve in the other


def test_a_valve_that_differs_by_direction_explains_both(said) -> None:
    up, _, _, down, _, _, fit = said["by direction"]
    assert (up, down) == pytest.approx((0.36, 0.61), abs=0.03)
    assert fit >= 98.1
