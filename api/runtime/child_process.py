"""Processes beside one that must not end: each ends with it, and is started again when it dies."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from typing import Protocol

#: The pauses (s) before a process that died is started again: the first one, and the longest.
_PAUSE, _LONGEST_PAUSE = 1.0, 30.0
#: A process that lived so long (s) did not die of its start.
_LIVED = 60.0

_log = logging.getLogger(__name__)


class Beside(Protocol):
    """The worker beside the service, as whoever asks for its health sees it."""

    @property
    def pid(self) -> int:
        """The process of the worker, which may have died."""

    def alive(self) -> bool:
        """Return whether the process is there."""


class Kept:
    """Keeps one process running.

    The pipe to its standard input closes however this process dies, by which it must end.

    Parameters
    ----------
    what : str
        What the process is, for the log.
    code : str
        What its interpreter runs.
    environment : mapping, optional
        Variables besides those of this process.
    started, ended : callable, optional
        Called with the id of each process that begins, or that has died.
    """

    def __init__(
        self,
        what: str,
        code: str,
        *,
        environment: Mapping[str, str] | None = None,
        started: Callable[[int], object] = lambda _: None,
        ended: Callable[[int], object] = lambda _: None,
    ) -> None:
        self._what = what
        self._command = [sys.executable, "-c", code]
        self._environment = {**os.environ, **(environment or {})}
        self._started, self._ended = started, ended
        self._stopping = threading.Event()
        self._process = self._start()
        self._watch = threading.Thread(target=self._keep_running, name=what, daemon=True)
        self._watch.start()

    @property
    def pid(self) -> int:
        """The process, which may have died."""
        return self._process.pid

    def alive(self) -> bool:
        """Return whether the process is there."""
        return self._process.poll() is None

    def stop(self) -> None:
        """Let the process end what it does, and end it."""
        self._stopping.set()
        self._watch.join()
        process = self._process
        assert process.stdin is not None
        process.stdin.close()
        process.terminate()
        try:
            process.wait(timeout=15)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def _start(self) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(self._command, stdin=subprocess.PIPE, env=self._environment)  # noqa: S603 - our own code
        self._started(process.pid)
        return process

    def _keep_running(self) -> None:
        pause, lived = _PAUSE, 0.0
        while not self._stopping.wait(0.2):
            lived += 0.2
            code = self._process.poll()
            if code is None:
                continue
            self._ended(self._process.pid)
            pause = _PAUSE if lived > _LIVED else min(2 * pause, _LONGEST_PAUSE)
            _log.error("%s ended with code %d, and starts again in %.0f s", self._what, code, pause)
            if self._stopping.wait(pause):
                return
            assert self._process.stdin is not None
            self._process.stdin.close()
            try:
                self._process = self._start()
            except OSError as error:  # the machine has no memory, or no numbers left; perhaps later
                _log.error("%s cannot be started: %s", self._what, error)
            lived = 0.0


def worker_beside(
    *, started: Callable[[int], object] = lambda _: None, ended: Callable[[int], object] = lambda _: None
) -> Kept:
    """Start the worker beside the service, which gives its jobs back when it is stopped."""
    code = "import sys; from api.commands.service import worker; sys.exit(worker(['--with-parent']))"
    return Kept("the worker beside the service", code, started=started, ended=ended)
