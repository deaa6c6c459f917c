"""The stored benchmark of the optimisers: the page is made from it, and it says that every published optimum is reached."""

from __future__ import annotations

import pytest

from bench.optimizers.__main__ import jobs
from bench.optimizers.report import PAGE, Benchmark

STORED = Benchmark.stored()


def test_the_page_is_made_from_what_is_stored() -> None:
    assert PAGE.read_text() == STORED.page()


def test_every_case_is_there() -> None:
    assert {(one.case, one.method) for one in STORED.outcomes} == {(case.name, method) for case, method in jobs()}


@pytest.mark.parametrize("outcome", STORED.outcomes, ids=lambda one: f"{one.method}: {one.case}")
def test_every_published_optimum_is_reached(outcome) -> None:
    assert outcome.met
    assert outcome.gap <= outcome.tolerance
    assert outcome.violation <= 1e-6


def test_the_servo_job_is_solved_from_nine_seeds_of_ten_and_better_than_by_the_peer() -> None:
    gradient, _, peer = STORED.servo
    assert gradient.runs == 10
    assert gradient.within is not None
    assert gradient.within >= 9
    assert gradient.settling_time < peer.settling_time
    assert peer.cpu_seconds > gradient.cpu_seconds
