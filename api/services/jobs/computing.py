"""Bounds on what one request may compute: how many at a time, how long, how large the reply.

What is quick runs in a thread of this process, what is large in a process of its own (`api.processes.large_request`), each on a lane of its own:
a small simulation never waits for a large one. The cost is estimated before anything is computed (`api.services.jobs.costs`); what was
taken for quick and is not begins again as large.
"""

from __future__ import annotations

import ctypes
import importlib
import logging
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cache
from typing import Any, TypeVar

from anyio import to_thread

from api.problems.documents import Problem, invalid
from api.problems.exceptions import RecalledError
from api.services.jobs.lanes import Lane
from api.settings import Settings
from storage.jobs.children import ChildDied, Zygote
from storage.jobs.compute import ComputeJob, Crashed, Done

#: What a process of its own calls, and in its answer the place of a refusal.
CHILD, REFUSED = "api.processes.large_request:run", "refused"
#: How often (s) the thread that waits for a process looks whether anybody still waits for that.
_LOOK_INTERVAL = 0.05
#: How soon (s) an alarm that met an import goes off again.
_AFTER_IMPORT = 0.01
#: How many times as long as it may compute a process may take on the clock: a busy machine, or a slow database, lets it wait.
_PATIENCE = 5
#: How soon (s) an alarm that nobody has heard goes off again.
_UNHEARD = 0.5

_log = logging.getLogger("servotune.api")
T = TypeVar("T")


class LargeError(Exception):
    """What is to be computed is too large for a thread of the service."""


class _OverdueError(Exception):
    """Raised inside a computation whose time is over."""


class Recall:
    """Ends a computation from another thread, wherever it is: in a queue, in a thread, in a process."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._wake: Callable[[], object] | None = None
        self.asked = False

    def ask(self) -> None:
        """End it, or keep it from beginning."""
        with self._lock:
            self.asked = True
            if self._wake is not None:
                self._wake()

    def wakes(self, wake: Callable[[], object]) -> None:
        """Call this when asked; at once where it has been."""
        with self._lock:
            self._wake = wake
            if self.asked:
                wake()


@dataclass(frozen=True, slots=True)
class _Work:
    """How a thread computes: until it is recalled, perhaps only what is quick, or nothing at all."""

    recall: Recall
    quick: bool
    proves: bool = False


_WORK: ContextVar[_Work | None] = ContextVar("work", default=None)


class _Alarm:
    """Raises :class:`_OverdueError` in the thread that made it, wherever that is computing when the time is over.

    The numerics know no clock, so the interpreter is asked to raise: between two bytecodes, after the compiled call
    that runs. Nothing is raised once the computation is ``over``, or while that thread holds the lock.
    Nothing is raised within an import: a module that was left half-loaded would fail for everybody until the service ends.
    What is raised within a callback of a weak reference or a finalizer is dropped by the interpreter: it is raised again.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds, self._thread = seconds, threading.get_ident()
        self.lock = threading.RLock()
        self.over = self.fired = False

    def start(self) -> None:
        """Begin to count."""
        self._fire_in(self._seconds)

    def _fire_in(self, seconds: float) -> None:
        self._timer = threading.Timer(seconds, self.fire)
        self._timer.daemon = True
        self._timer.start()

    def fire(self) -> None:
        """Go off, now or as soon as no import runs, until the computation is over."""
        with self.lock:
            if self.over:
                return
            self._timer.cancel()
            if _imports(self._thread):
                self._fire_in(_AFTER_IMPORT)
                return
            self.fired = True
            ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(self._thread), ctypes.py_object(_OverdueError))
            self._fire_in(_UNHEARD)

    def stop(self) -> None:
        """Stop counting, when the computation is over."""
        self._timer.cancel()


@cache
def _report_no_lost_alarms() -> None:
    """Leave alarms that a callback has dropped out of what the interpreter reports: they go off again."""
    report = sys.unraisablehook

    def reported(unraisable: sys.UnraisableHookArgs) -> None:
        if not issubclass(unraisable.exc_type, _OverdueError):
            report(unraisable)

    sys.unraisablehook = reported


def _imports(thread: int) -> bool:
    """Whether that thread is loading a module: it owns the lock of that then.

    Its frames are not walked: those of compiled modules that are just being loaded have no code yet, and whoever asks for it takes the
    interpreter down (CPython 3.11, its issues 100536 and 111363).
    """
    locks = [lock() for lock in importlib._bootstrap._module_locks.copy().values()]  # type: ignore[attr-defined] # noqa: SLF001
    return any(lock is not None and lock.owner == thread for lock in locks)


@dataclass(frozen=True)
class Computing:
    """The lanes on which requests compute, and the limits of one request."""

    settings: Settings
    #: What is quick; what is large; what computes in a thread for longer: panels, processed recordings, matrices.
    quick: Lane = field(init=False)
    large: Lane = field(init=False)
    threads: Lane = field(init=False)
    _children: Zygote = field(init=False)
    _own: threading.local = field(init=False, default_factory=threading.local)

    def __post_init__(self) -> None:
        for name in ("quick", "large", "threads"):
            object.__setattr__(self, name, Lane(self.settings.compute_slots, self.settings.waiting_requests))
        object.__setattr__(self, "_children", Zygote(CHILD))
        _report_no_lost_alarms()

    def warm_up(self) -> None:
        """Begin to load what large studies and reports are computed with, in a process of its own; returns at once."""
        self._children.warm_up()

    def close(self) -> None:
        """End every process that computes."""
        self._children.close()

    async def in_thread(
        self,
        lane: Lane,
        workspace: str,
        principal: str,
        work: Callable[[], T],
        *,
        recall: Recall | None = None,
        proves: bool = False,
    ) -> T:
        """Return what ``work`` returns, computed in a thread when it is this caller's turn.

        With ``proves`` nothing is computed: all that is checked before is, and then there is a `LargeError`.

        Raises
        ------
        LargeError
            When that takes more than what is quick, on the lane of what is.
        Problem
            429 when too much of this caller waits.
        RecalledError
            When ``recall`` was asked.
        """
        recall = Recall() if recall is None else recall
        async with lane.place(workspace, principal, wakes=recall.wakes):
            token = _WORK.set(_Work(recall, quick=lane is self.quick, proves=proves))
            try:
                return await to_thread.run_sync(work, limiter=lane.threads)
            finally:
                _WORK.reset(token)

    async def in_child(self, job: ComputeJob, principal: str, *, recall: Recall) -> Mapping[str, Any]:
        """Return what a process of its own computes when it is this caller's turn.

        Raises
        ------
        Problem
            422 for what takes too long or too much memory, and whatever the computation refuses; 429 as above.
        RecalledError
            When ``recall`` was asked.
        """
        async with self.large.place(job.workspace_id, principal, wakes=recall.wakes):
            return await to_thread.run_sync(self._follow, job, recall, limiter=self.large.threads)

    def _follow(self, job: ComputeJob, recall: Recall) -> Mapping[str, Any]:
        self._children.warm_up()
        while not self._children.settled(_LOOK_INTERVAL):  # loading is no time of the request's
            if recall.asked:
                raise RecalledError
        child = self._children.start(job)
        # It counts its own computing (`api.processes.large_request`); this is for whoever waits.
        ends_at = time.monotonic() + _PATIENCE * self.settings.request_seconds
        try:
            while not recall.asked:
                if time.monotonic() >= ends_at:
                    raise self._too_long()
                match child.receive(_LOOK_INTERVAL):
                    case Done(result):
                        assert isinstance(result, Mapping)
                        if REFUSED in result:
                            raise result[REFUSED]
                        return result
                    case Crashed(kind, traceback):
                        _log.error("request %s (%s) failed:\n%s", job.id, job.kind, traceback)
                        detail = f"the computation met an internal error ({kind}); the log tells more under {job.id}"
                        raise Problem(500, "internal-error", detail)
        except ChildDied as death:
            if death.signal == signal.SIGPROF:
                raise self._too_long() from None
            _log.warning("request %s (%s): %s", job.id, job.kind, death)
            detail = f"{death}; try again later, or ask for less at a time"
            raise Problem(503, "process-died", detail, headers={"Retry-After": "5"}) from death
        finally:
            child.kill()
        raise RecalledError

    def bounded(self, compute: Callable[[], T], cost: float = 0.0) -> T:
        """Return what ``compute`` returns, within the time of a request; ``cost`` is what it is expected to take (`costs`).

        Raises
        ------
        LargeError
            In a thread for what is quick, when the cost or the time is more than that.
        Problem
            422 when the computation takes longer than a request may.
        RecalledError
            When the computation was recalled meanwhile.
        """
        work = _WORK.get()
        quick = work is not None and work.quick
        if work is not None and work.proves:
            raise LargeError
        if quick and cost > self.settings.quick_seconds:
            raise LargeError
        alarm = self._own.alarm = _Alarm(self.settings.quick_seconds if quick else self.settings.request_seconds)
        try:
            try:
                alarm.start()
                if work is not None:
                    work.recall.wakes(alarm.fire)
                return compute()
            finally:
                # Here, and not in a function or a context manager: what is raised as such a one begins ends it before it has
                # said that the computation is over, and the alarm would go off for ever, in whatever the thread does next.
                # Between these two lines nothing is raised; what is still to be raised comes as the lock is left.
                with alarm.lock:
                    alarm.over = True
                alarm.stop()
                if alarm.fired:  # and was lost
                    raise _OverdueError
        except _OverdueError:
            alarm.stop()
            if work is not None and work.recall.asked:
                raise RecalledError from None
            raise (LargeError() if quick else self._too_long()) from None

    def _too_long(self) -> Problem:
        seconds = self.settings.request_seconds
        detail = (
            f"a request must be computed within {seconds:g} s, got one that needs longer: ask for less at a time, and give a "
            "`duration`, where there is one, to what is simulated until it settles"
        )
        return Problem(422, "too-long", detail)

    def quiet(self) -> AbstractContextManager[object]:
        """Let what runs inside end although the time of this thread's computation is over: a connection is in use."""
        alarm: _Alarm | None = getattr(self._own, "alarm", None)
        return nullcontext() if alarm is None else alarm.lock

    def check_size(self, *, samples: int, curves: int, variants: int) -> None:
        """Raise the 422 for a reply that would be too large, naming the count and the limit."""
        limits = self.settings
        if samples > limits.max_samples:
            raise invalid(f"samples must be <= {limits.max_samples}, got {samples}", "samples")
        if variants > limits.max_variants:
            raise invalid(f"variants must be <= {limits.max_variants}, got {variants}", "variants")
        total = samples * curves * variants
        if total > limits.max_numbers:
            raise invalid(
                f"samples x curves x variants must be <= {limits.max_numbers}, "
                f"got {samples} x {curves} x {variants} = {total}",
                "samples",
            )
