"""A small share of `make bench`: every job runs and every contender that is right is right; no time is judged."""

from __future__ import annotations

import io
import warnings

import numpy as np
import pytest
from rich.console import Console

from bench import (
    batch,
    batched_numpy,
    cold_start,
    inner_velocity_loop,
    latency,
    loop,
    nonlinear_batch,
    nonlinear_loop,
    throughput,
)
from bench.table import Job, Row, markdown, render
from engine.batch.screening import Screening


@pytest.fixture(scope="module")
def jobs() -> list[Job]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the peers' own
        return [
            *loop.jobs(runs=1, sets=2),
            *batch.jobs(runs=1, candidates=2),
            *latency.jobs(runs=1),
        ]


def test_our_rows_come_first_and_are_exact_to_what_the_screening_promises(jobs):
    first = [job.rows[0] for job in jobs]
    assert all(row.who.startswith("this engine") for row in first)
    assert all(row.milliseconds is not None and row.milliseconds > 0 for row in first)
    errors = [row.error for row in first if row.error is not None]
    assert len(errors) >= 6
    assert max(errors) < 1e-6


def test_every_peer_solves_the_same_loop(jobs):
    """Grids and integrators cost the peers at most 2 % here; a different system would cost more."""
    names = {row.who.split()[0] for row in jobs[0].rows}
    assert {"this", "python-control", "casadi", "pathsim"} <= names
    for job in (jobs[0], jobs[2], jobs[3], jobs[4]):
        assert all(row.error < 0.02 for row in job.rows if row.error is not None), job


def test_threads_screen_every_candidate_and_a_new_process_starts():
    run = throughput.screen(20, 2)
    assert (run.count, run.threads) == (20, 2)
    assert min(run.wall, run.cpu, run.peak) > 0
    cold_start.in_new_process()


def test_the_nonlinear_loop_is_marched_both_ways_to_the_accuracy_asked_for():
    ways = {"generated": nonlinear_batch.Ours(generate=True), "interpreted": nonlinear_batch.Ours(generate=False)}
    sample = nonlinear_loop.sample(3, seed=1)
    found = {who: ours.march(sample, 16 * nonlinear_loop.STEPS) for who, ours in ways.items()}
    assert np.array_equal(found["generated"], found["interpreted"])
    peer = nonlinear_batch.integrated(sample[0], "LSODA", 1e-8)
    away = np.abs(found["generated"][:: (len(found["generated"]) - 1) // nonlinear_loop.STEPS, 0] - peer)
    assert away.max() < nonlinear_batch.REQUIRED * nonlinear_loop.STEP
    assert nonlinear_batch.new_structure(runs=1).rows[0].milliseconds > 0


def test_the_table_shows_ratios_to_the_first_row():
    job = Job(
        title="job",
        rows=[Row(who="a", milliseconds=2.0), Row(who="b", milliseconds=300.0), Row(who="c", remark="not installed")],
    )
    console = Console(width=120, file=io.StringIO())
    console.print(render([job], title=""))
    text = console.file.getvalue()
    assert "150x" in text
    assert "not installed" in text
    assert "| b | 300 | CPU | 150x | - |  |" in markdown([job], title="")


def test_batched_numpy_agrees_with_the_screening_on_stability_and_static_error():
    """Two independent ways to the same verdicts, on candidates of which a fifth is unstable."""
    candidates = inner_velocity_loop.wide(200, seed=5)
    names = [request.metric for request in inner_velocity_loop.requests()]
    found = Screening(inner_velocity_loop.diagram(), inner_velocity_loop.requests())(candidates)
    numpy = batched_numpy.evaluate(candidates)
    stable = found.growth < 0
    assert 0.1 < np.mean(~stable) < 0.35
    assert np.array_equal(stable, numpy["stable"] == 1.0)
    overshoot = found.values[stable, names.index("overshoot")]
    assert np.median(np.abs(overshoot - numpy["overshoot"][stable])) < 1e-4
