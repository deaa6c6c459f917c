"""The processes of this machine as workers of a search: copies of this one, one for each processor that it may use.

They are copied while no other thread runs here, which is what makes that safe, and end with this process, however it ends.
Compiled code uses all processors by itself: what is sent to them are candidates that are simulated one by one.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
from concurrent.futures import ProcessPoolExecutor
from typing import Final

from optimizers.evaluation.spreading import Workers

_MOST_LOSSES: Final = 2
"""Whoever kills them so often kills them again: then nothing leaves this process."""
_PR_SET_PDEATHSIG: Final = 1


class Processes:
    """Processes of this machine.

    Parameters
    ----------
    count : int
        How many, at most; one is none beside this process.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._pool: ProcessPoolExecutor | None = None
        self._losses = 0

    def open(self) -> Workers | None:
        """Return the processes, started when they are needed for the first time."""
        if self._pool is None:
            if self._count < 2 or self._losses > _MOST_LOSSES or threading.active_count() > 1:
                return None
            self._pool = ProcessPoolExecutor(
                self._count, multiprocessing.get_context("fork"), initializer=_end_with, initargs=(os.getpid(),)
            )
        return Workers(executor=self._pool, count=self._count, threaded=True)

    def lost(self) -> None:
        """Let them go: others are started when they are needed."""
        self._losses += 1
        self.close()

    def close(self) -> None:
        """Let them go, whatever they do."""
        pool, self._pool = self._pool, None
        if pool is not None:
            processes = list((pool._processes or {}).values())  # noqa: SLF001 - one that hangs has to be killed
            for process in processes:
                process.kill()
            pool.shutdown(cancel_futures=True)


def _end_with(parent: int) -> None:
    """Let this process end when the one does that it is a copy of, and leave an interruption to that one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)
