"""How long a search took: every second belongs to one stage, and their sum is what is told."""

from __future__ import annotations

import pytest

from optimizers.evaluation import effort
from optimizers.evaluation.effort import Stage, during, metered, seconds_of
from optimizers.problem import Uncertain
from optimizers.solving.solve import solve
from tests.unit.optimizers.oscillator import problem


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [0.0]
    monkeypatch.setattr(effort.time, "perf_counter", lambda: now[0])
    monkeypatch.setattr(effort.time, "process_time", lambda: 2 * now[0])
    return now


def test_a_stage_inside_another_one_does_not_count_for_that(clock) -> None:
    with metered() as found:
        clock[0] = 1.0
        with during(Stage.CERTIFICATE):
            clock[0] = 3.0
            with metered() as inner, during(Stage.SCREENING):
                clock[0] = 7.0
            clock[0] = 8.0
    assert inner is found
    assert {stage: spent["seconds"] for stage, spent in found.spent().items()} == {
        "other": 1.0, "certificate": 3.0, "screening": 4.0, "refining": 0.0,
    }  # fmt: skip
    assert seconds_of(found.spent()) == 8.0
    assert sum(spent["cpu_seconds"] for spent in found.spent().values()) == 16.0


def test_a_result_tells_the_time_of_everything_that_led_to_it() -> None:
    with metered() as whole:
        found = solve(
            "gradient", problem(uncertain=(Uncertain(parameter="m", lower=0.5, upper=2.0),)), {"starts": 2}, samples=10
        )
    assert found.seconds == pytest.approx(sum(spent["seconds"] for spent in found.effort.values()))
    assert 0 < found.seconds <= seconds_of(whole.spent())
    assert all(found.effort[stage]["seconds"] > 0 for stage in ("screening", "refining", "certificate"))
