"""Bounds on what one request may compute: how many at a time, how long, how large the reply."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field

from api.problems import Problem, invalid
from api.settings import Settings


class _OverdueError(Exception):
    """Raised inside a computation whose time is over."""


class RecalledError(Exception):
    """A computation was ended because nobody waits for it any more."""


class Recall:
    """Ends a computation from another thread, wherever it is."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._alarm: _Alarm | None = None
        self.asked = False

    def ask(self) -> None:
        """End it, or keep it from beginning."""
        with self._lock:
            self.asked = True
            if self._alarm is not None:
                self._alarm.fire()

    def wakes(self, alarm: _Alarm) -> None:
        """Ring this alarm when asked; at once where it has been."""
        with self._lock:
            self._alarm = alarm
            if self.asked:
                alarm.fire()


class _Alarm:
    """Raises :class:`_OverdueError` in the thread that made it, wherever that is computing when the time is over.

    The numerics know no clock, so the interpreter is asked to raise: between two bytecodes, after the compiled call
    that runs. The lock makes sure that nothing is raised once the computation has ended, or while that thread holds it.
    """

    def __init__(self, seconds: float) -> None:
        self._thread = ctypes.c_ulong(threading.get_ident())
        self.lock = threading.RLock()
        self._ended = self._fired = False
        self._timer = threading.Timer(seconds, self.fire)
        self._timer.daemon = True

    def start(self) -> None:
        """Begin to count."""
        self._timer.start()

    def fire(self) -> None:
        """Go off."""
        with self.lock:
            if not self._ended and not self._fired:
                self._fired = True
                ctypes.pythonapi.PyThreadState_SetAsyncExc(self._thread, ctypes.py_object(_OverdueError))

    def stop(self) -> None:
        """Stop counting; an alarm that has gone off, but was not heard yet, is raised here."""
        self._timer.cancel()
        with self.lock:
            self._ended = True
        if self._fired:
            ctypes.pythonapi.PyThreadState_SetAsyncExc(self._thread, None)
            raise _OverdueError


@dataclass(frozen=True)
class Computing:
    """The slots in which requests compute, and the limits of one request."""

    settings: Settings
    _slots: threading.BoundedSemaphore = field(init=False)
    _own: threading.local = field(init=False, default_factory=threading.local)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_slots", threading.BoundedSemaphore(self.settings.compute_slots))

    @contextmanager
    def slot(self, recall: Recall | None = None) -> Iterator[None]:
        """Wait for a free slot and hold it while something is computed, for as long as a request may take.

        Raises
        ------
        Problem
            422 when the computation takes longer, 503 when no slot becomes free.
        RecalledError
            When ``recall`` was asked meanwhile.
        """
        seconds = self.settings.request_seconds
        if not self._slots.acquire(timeout=seconds):
            raise Problem(503, "busy", "every computing slot is taken; try again later", headers={"Retry-After": "5"})
        alarm = _Alarm(seconds)
        try:
            alarm.start()
            self._own.alarm = alarm
            try:
                if recall is not None:
                    recall.wakes(alarm)
                yield
            finally:
                del self._own.alarm
                alarm.stop()
        except _OverdueError:
            if recall is not None and recall.asked:
                raise RecalledError from None
            detail = (
                f"a request must be computed within {seconds:g} s, got one that needs longer: ask for less at a time"
            )
            raise Problem(422, "too-long", detail) from None
        finally:
            self._slots.release()

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
