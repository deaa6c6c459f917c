"""Candidates, or starts of a search, computed by other processes, of this machine or of a cluster, behind one seam: `concurrent.futures.Executor`.

    chunk = g ⌈min(CHUNK max(1, w / SERVED) / t, B / w) / g⌉ candidates,   where B t > CALL and all calls before took SEARCH

for B candidates of t s each, as measured, and w workers; g is how many of them are neighbours (`Evaluator.together`), so that a
candidate has the same number to the bit wherever it is cut. What does not come back, for whatever reason, is computed here: who
is asked may be killed, frozen or cut off, and the answer is the same. A problem travels as what it was made from, its documents,
and is compiled once by each worker.
"""

from __future__ import annotations

import hashlib
import logging
import pickle
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from engine.model.interruption import look
from optimizers.evaluation.effort import elsewhere

if TYPE_CHECKING:
    from optimizers.evaluation.evaluate import Evaluator
    from optimizers.problem import Problem
    from optimizers.recorded.recording import Identification

Matrix = npt.NDArray[np.float64]
T = TypeVar("T")

CHUNK: Final = 0.5
"""s of work of a chunk, long beside the milliseconds that its way takes."""
SERVED: Final = 100
"""Workers that a scheduler can serve with such chunks, 200 in a second; for more of them chunks are longer."""
CALL: Final = 0.25
"""s of work of a call below which it stays in this process."""
SEARCH: Final = 2.0
"""s that a search has to compute here before anything leaves this process: to start or to reach others takes as long."""
PATIENCE: Final = 60.0
"""s after the last answer, or as many times the length of a chunk as `_SLOWER`, after which nothing more is waited for."""
_SLOWER: Final = 20.0
_ROUNDS: Final = 4
"""Chunks of a call for each worker, where there are as many."""
_LOOK: Final = 0.1
_SMALL: Final = 1 << 16
"""Bytes of a problem that goes with every chunk; a larger one is sent to those who ask for it."""
_KNOWN: Final = 4
"""Problems that a worker keeps: an identification brings its recordings."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class Workers:
    """Who computes: ``count`` of them behind an executor; ``threaded`` ones bring no more than the threads of this process."""

    executor: Executor
    count: int
    threaded: bool


class Provider(Protocol):
    """Where workers come from."""

    def open(self) -> Workers | None:
        """Return the workers there are now, None for none; within seconds."""
        ...

    def lost(self) -> None:
        """Take note that they left something undone."""
        ...

    def close(self) -> None:
        """Let them go."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Values:
    """What screening and measuring say of B candidates: ``values`` (B, S, G), ``growth`` (B, S), ``doubtful`` (B, S, G).

    ``seconds`` and ``cpu_seconds`` are what it took.
    """

    values: Matrix
    growth: Matrix
    doubtful: npt.NDArray[np.bool_]
    seconds: float = 0.0
    cpu_seconds: float = 0.0


def joined(parts: Sequence[Values]) -> Values:
    """Return what was found of all candidates, part by part."""
    return Values(
        values=np.concatenate([part.values for part in parts]),
        growth=np.concatenate([part.growth for part in parts]),
        doubtful=np.concatenate([part.doubtful for part in parts]),
        seconds=sum(part.seconds for part in parts),
        cpu_seconds=sum(part.cpu_seconds for part in parts),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Parcel:
    """A problem on its way: ``key`` is the digest of its ``content``, which may be left out where it is known."""

    key: str
    content: bytes | None

    @staticmethod
    def of(problem: Problem | Identification) -> Parcel:
        """Return a problem as it travels."""
        content = pickle.dumps(problem, protocol=pickle.HIGHEST_PROTOCOL)
        return Parcel(key=hashlib.sha256(content).hexdigest(), content=content)

    @property
    def light(self) -> Parcel:
        """The same without its content, where that is much."""
        assert self.content is not None
        return self if len(self.content) <= _SMALL else Parcel(key=self.key, content=None)


class Spread:
    """The calls of one search, each computed here or by others.

    Parameters
    ----------
    provider : Provider
    patience : float
        s, see `PATIENCE`.
    search, call, chunk : float
        s, see `SEARCH`, `CALL` and `CHUNK`.
    """

    def __init__(
        self,
        provider: Provider,
        *,
        patience: float = PATIENCE,
        search: float = SEARCH,
        call: float = CALL,
        chunk: float = CHUNK,
    ) -> None:
        self._provider, self._patience, self._search = provider, patience, search
        self._call, self._chunk = call, chunk
        self._spent = 0.0
        #: How many chunks others have computed, and how many they left to this process.
        self.sent = self.left = 0

    def values(self, evaluator: Evaluator, positions: Matrix, *, roughly: bool) -> Values:
        """Return what `Evaluator.values` finds, computed by whoever makes that fastest."""
        chunks, workers = self._cut(evaluator, len(positions))
        if workers is None:
            begun = time.perf_counter()
            found = evaluator.values(positions, roughly=roughly, frame=evaluator.frame)
            taken = time.perf_counter() - begun
            self._spent += taken
            evaluator.seconds_each = taken / max(len(positions), 1)
            return found
        tasks = [(positions[rows], roughly, evaluator.frame) for rows in chunks]

        def here(part: Matrix, roughly: bool, frame: int | None) -> Values:  # noqa: FBT001 - as it is sent
            begun = time.perf_counter()
            return replace(evaluator.values(part, roughly=roughly, frame=frame), seconds=time.perf_counter() - begun)

        expected = len(tasks[0][0]) * (evaluator.seconds_each or 0.0)
        found = joined(
            list(self._each(evaluator.parcel, evaluated, tasks, here=here, workers=workers, expected=expected))
        )
        self._spent += found.seconds
        evaluator.seconds_each = found.seconds / len(positions)
        elsewhere(found.cpu_seconds)
        return found

    def fitting(self, evaluator: Evaluator, count: int) -> int | None:
        """Return how many of so many candidates make a call that keeps everybody busy, None where nobody else computes them."""
        chunks, workers = self._cut(evaluator, count)
        return None if workers is None else _ROUNDS * workers.count * (chunks[0].stop - chunks[0].start)

    def _cut(self, evaluator: Evaluator, count: int) -> tuple[list[slice], Workers | None]:
        """Return the chunks of a call and who computes them, nobody where it had better stay here."""
        each = evaluator.seconds_each
        if each is None or count * each <= self._call or self._spent + count * each <= self._search:
            return [], None
        if count <= evaluator.together:
            return [], None
        workers = self._provider.open()
        if workers is None or (workers.threaded and evaluator.batched):
            return [], None
        chunk = self._chunk * max(1.0, workers.count / SERVED)
        size = min(chunk / each, count / workers.count) / evaluator.together
        size = evaluator.together * max(1, int(np.ceil(size)))
        chunks = [slice(first, min(first + size, count)) for first in range(0, count, size)]
        return (chunks, workers) if len(chunks) > 1 else ([], None)

    def each(
        self,
        problem: Problem | Identification,
        work: Callable[..., T | None],
        tasks: Sequence[Any],
        *,
        here: Callable[..., T],
        seconds: float,
        longest: float,
    ) -> Iterator[T] | None:
        """Return what becomes of tasks of so many seconds each, one after the other; None where they had better stay here.

        Parameters
        ----------
        problem : Problem or Identification
            What all of them are about.
        work : callable
            Is called elsewhere, with the problem as a parcel and the task's arguments; None where it does not know the problem.
        tasks : sequence of tuple
            Arguments.
        here : callable
            Does the same here, for those that do not come back.
        seconds, longest : float
            As long as one took here, and as long as one may take, s.
        """
        self._spent += seconds
        work_left = len(tasks) * seconds
        if len(tasks) < 2 or work_left <= self._call or self._spent + work_left <= self._search:
            return None
        workers = self._provider.open()
        if workers is None:
            return None
        return self._each(Parcel.of(problem), work, tasks, here=here, workers=workers, expected=longest)

    def _each(
        self,
        parcel: Parcel,
        work: Callable[..., T | None],
        tasks: Sequence[Any],
        *,
        here: Callable[..., T],
        workers: Workers,
        expected: float,
    ) -> Iterator[T]:
        found: dict[int, T] = {}
        pending: dict[Future[T | None], int] = {}
        number = 0

        def send(number: int, problem: Parcel) -> Future[T | None]:
            return workers.executor.submit(work, problem, *tasks[number])

        try:
            for index in range(len(tasks)):
                pending[send(index, parcel.light)] = index
            for _ in self._answers(pending, found, again=lambda index: send(index, parcel), expected=expected):
                while number in found:
                    yield found[number]
                    number += 1
        except (OSError, RuntimeError) as error:  # whoever was asked is there no more
            _log.warning("chunks cannot be sent: %s", error)
        finally:
            for future in pending:
                future.cancel()
            self.sent += len(found)
        missing = len(tasks) - len(found)
        if missing:
            _log.warning("%d of %d chunks did not come back: they are computed here", missing, len(tasks))
            self.left += missing
            self._provider.lost()
        for index in range(number, len(tasks)):
            if index not in found:
                look()
            yield found[index] if index in found else here(*tasks[index])

    def _answers(
        self,
        pending: dict[Future[T | None], int],
        found: dict[int, T],
        *,
        again: Callable[[int], Future[T | None]],
        expected: float,
    ) -> Iterator[None]:
        """Wait for answers until all are there, or none comes any more; ask whether to go on meanwhile."""
        last = time.monotonic()
        while pending and time.monotonic() - last <= max(self._patience, _SLOWER * expected):
            done, _ = wait(pending, timeout=_LOOK, return_when=FIRST_COMPLETED)
            look()
            for future in done:
                number = pending.pop(future)
                try:
                    answer = future.result()
                except (Exception, CancelledError) as error:  # noqa: BLE001 - it is computed here, where an error of its own shows
                    _log.warning("a chunk failed elsewhere: %s: %s", type(error).__name__, error)
                    continue
                last = time.monotonic()
                if answer is None:
                    pending[again(number)] = number
                else:
                    found[number] = answer
            yield


_CURRENT: ContextVar[Spread | None] = ContextVar("spread", default=None)


def current() -> Spread | None:
    """Return who spreads the calls that are made now, None where they stay in this process."""
    return _CURRENT.get()


def fitting(evaluator: Evaluator, count: int) -> int | None:
    """Return what `Spread.fitting` does, None where nobody spreads."""
    others = current()
    return None if others is None else others.fitting(evaluator, count)


@contextmanager
def spread(provider: Provider, **seconds: float) -> Iterator[Spread]:
    """Let every evaluator inside have its calls computed by workers of a provider, which is closed at the end.

    ``seconds`` are those of `Spread`.
    """
    made = Spread(provider, **seconds)
    token = _CURRENT.set(made)
    try:
        yield made
    finally:
        _CURRENT.reset(token)
        provider.close()


# What is made of a problem is no matter of several threads, and made once.
_ONE = threading.Lock()


@lru_cache(maxsize=_KNOWN)
def _kept(key: str) -> list[Any]:
    """Return where what was made of a problem is kept."""
    del key
    return []


@contextmanager
def known(problem: Parcel, make: Callable[[Any], T]) -> Iterator[T | None]:
    """Give a worker what ``make`` has made of a problem; None where it is not known here and did not come along."""
    with _ONE:
        kept = _kept(problem.key)
        if not kept and problem.content is not None:
            kept.append(make(pickle.loads(problem.content)))  # noqa: S301 - from our own process, in a private network
        yield kept[0] if kept else None


def evaluated(problem: Parcel, positions: Matrix, roughly: bool, frame: int | None) -> Values | None:  # noqa: FBT001 - as it is sent
    """Return what is found of a chunk, in a worker; None where the problem is not known here and did not come along."""
    from optimizers.evaluation.evaluate import Evaluator  # noqa: PLC0415 - each of the two modules needs the other

    with known(problem, lambda made: Evaluator(made, threads=1)) as evaluator:
        if evaluator is None:
            return None
        begun, cpu = time.perf_counter(), time.process_time()
        found = evaluator.values(positions, roughly=roughly, frame=frame)
        return replace(found, seconds=time.perf_counter() - begun, cpu_seconds=time.process_time() - cpu)
