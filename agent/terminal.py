"""Whoever sits at the rig's terminal is asked whether it may move."""

from __future__ import annotations

import sys
import threading
from collections.abc import Sequence
from contextlib import ExitStack

from agent.waking import WakingEvent


class Terminal:
    """Asks whoever sits at the rig's terminal; nobody there is no.

    Parameters
    ----------
    seconds : float
        How long to wait for an answer.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._lines: list[str] = []
        self._came = threading.Condition()
        self._closed = False
        self._thread: threading.Thread | None = None

    def __call__(self, question: str, ends: Sequence[WakingEvent] = ()) -> bool:
        """Ask a question; it is withdrawn, and not agreed to, as soon as one of some events is set."""
        with self._came:
            self._lines.clear()  # what was typed before the question answers nothing
        sys.stdout.write(f"{question} Type yes within {self._seconds:g} s: ")
        sys.stdout.flush()
        if self._thread is None:
            self._thread = threading.Thread(target=self._listen, daemon=True)
            self._thread.start()
        with ExitStack() as stack:
            for end in ends:
                stack.enter_context(end.waking(self._wake))
            with self._came:
                self._came.wait_for(lambda: self._closed or bool(self._lines) or _any(ends), self._seconds)
                agreed = bool(self._lines) and self._lines[-1].strip().lower() == "yes"
        if _any(ends):
            sys.stdout.write("\nThe question is withdrawn.\n")
            sys.stdout.flush()
            return False
        return agreed

    def _wake(self) -> None:
        with self._came:
            self._came.notify_all()

    def _listen(self) -> None:
        # not sys.stdin, whose lock this thread would hold when the interpreter ends, which is fatal
        for line in open(0, closefd=False):  # noqa: SIM115 - for as long as this process lives
            with self._came:
                self._lines.append(line)
                self._came.notify_all()
        with self._came:  # nobody can be asked: a service has no terminal
            self._closed = True
            self._came.notify_all()


def _any(ends: Sequence[WakingEvent]) -> bool:
    return any(end.is_set() for end in ends)
