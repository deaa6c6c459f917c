"""300 identifications of plants that are known: each ends soon, in little memory, its intervals hold, and bad data is named.

`make proof` identifies all of them, each in a process of its own whose processor time and memory are measured; a few short
recordings are identified everywhere, where evaluations are counted instead.
"""

from __future__ import annotations

import multiprocessing
import resource
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection

import numpy as np
import pytest
from hypothesis import settings
from scipy.stats import binom

from engine.exact.time.sampled import simulate_sampled
from engine.model.between_samples import BetweenSamples
from engine.model.errors import EngineError
from optimizers.black_box import black_box
from optimizers.identification import expected, identify
from optimizers.search.result import Status
from tests.property.recorded_plants import CASES, Case, case, experiment, problem, structure

WHOLE = settings().max_examples >= 1000
"""The profile of `make proof` has thousands of examples."""
SHARE = (0, 22, 25, 30, 78, 83, 96, 111, 116, 200, 236, 247, 264)
"""Short recordings of every order, signal, fault and method."""
LONGEST, LARGEST = 20.0, 1e9
"""Processor time (s) and memory (bytes) that one of them may take."""
NAMED = {"outliers": "lie apart", "saturation": "clipped", "sign": "sign", "unit": "unit"}


@dataclass(frozen=True, kw_only=True)
class Ended:
    """How an identification ended; ``inside`` says which intervals hold the truth."""

    number: int
    status: str
    warnings: tuple[str, ...]
    inside: tuple[bool, ...] = ()
    refused: str = ""
    evaluations: int = 0
    seconds: float = 0.0
    room: float = 0.0


def ended(one: Case) -> Ended:
    """Identify one."""
    try:
        if one.way == "transfer_function":
            late = 2 * one.truth.get("L", 0.0)
            model = black_box(experiment(one), method="transfer_function", largest_delay=late)
            return Ended(number=one.number, status=str(model.status), warnings=model.warnings)
        found = identify(problem(one), rng=np.random.default_rng(0))
    except EngineError as error:
        return Ended(number=one.number, status="", warnings=(), refused=str(error))
    inside = tuple(
        e.lower95 is not None and e.upper95 is not None and e.lower95 <= one.truth[name] <= e.upper95
        for name, e in found.parameters.items()
    )
    return Ended(
        number=one.number, status=str(found.status), warnings=found.warnings, inside=inside, evaluations=found.evaluations
    )  # fmt: skip


def measured(number: int, out: Connection) -> None:
    """Identify one in a process that does nothing else."""
    one = case(number)
    began = time.process_time()
    found = ended(one)
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024.0
    out.send(Ended(**{**found.__dict__, "seconds": time.process_time() - began, "room": used}))


def apart(number: int) -> Ended:
    """Identify one in a process of its own."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__])
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=measured, args=(number, sender))
    process.start()
    sender.close()
    found = receiver.recv()
    process.join()
    assert isinstance(found, Ended)
    return found


@pytest.fixture(scope="module")
def all_ended() -> list[Ended]:
    return [apart(number) for number in range(CASES)] if WHOLE else [ended(case(number)) for number in SHARE]


def test_every_one_ends_soon_with_an_answer_or_a_named_refusal(all_ended: list[Ended]) -> None:
    for one in all_ended:
        # one that is spoilt may find no rest within its evaluations, and says so
        ends = {str(Status.CONVERGED), *([str(Status.BUDGET)] if case(one.number).fault else [])}
        assert one.status in ends or one.refused, one
        assert one.seconds <= LONGEST, one
        assert one.room <= LARGEST, one
        assert WHOLE or one.evaluations <= 200, one


def test_intervals_hold_the_truth_where_nothing_is_doubted(all_ended: list[Ended]) -> None:
    """One step tells little, and two ways between the samples may fit alike: intervals are wide enough for that."""
    known = "moves once", "reach over both"
    undoubted = [one for one in all_ended if all(any(w in sentence for w in known) for sentence in one.warnings)]
    held = [inside for one in undoubted for inside in one.inside]
    assert len(held) > (150 if WHOLE else 8)
    assert binom.ppf(1e-3, len(held), 0.95) <= sum(held)
    if WHOLE:
        # neither too narrow nor so wide that they tell nothing
        assert 0.90 * len(held) <= sum(held) <= 0.99 * len(held), (sum(held), len(held))


def test_what_is_bad_about_a_recording_is_named(all_ended: list[Ended]) -> None:
    spoilt = [(one, fault) for one in all_ended if (fault := case(one.number).fault)]
    said = [any(NAMED[fault] in sentence for sentence in one.warnings) or bool(one.refused) for one, fault in spoilt]
    assert len(said) >= (150 if WHOLE else 4)
    assert sum(said) >= 0.95 * len(said), [one for (one, _), named in zip(spoilt, said, strict=True) if not named]


@pytest.mark.parametrize("number", [12, 102, 158, 266])
def test_the_engine_simulates_what_the_modes_do(number: int) -> None:
    """Two ways that share nothing: exact step responses with delays, and the modes from sample to sample."""
    one = case(number)
    clean = simulate_sampled(
        structure(one.order, one.truth).realize(), one.u[None], one.sample_time, between=BetweenSamples.HOLD
    )[0]
    noise = one.y - clean
    if one.fault == "":
        assert abs(noise.mean()) < 5 * noise.std() / np.sqrt(noise.size)
    np.testing.assert_allclose(clean, one.clean, atol=1e-9 * np.abs(one.clean).max())


@pytest.mark.parametrize("number", range(0, CASES, 50))
def test_what_it_takes_is_known_before(number: int) -> None:
    one = case(number)
    if one.way != "transfer_function":
        cost = expected(problem(one))
        assert cost.bytes < LARGEST
        assert cost.seconds < 3 * LONGEST
