"""Memory that a load has needed is given back to the system when the load is over.

Two things would keep it: objects that hold each other, which only a full collection finds, and that may be large though few;
and the C library, which keeps what was freed for the threads that freed it.
"""

from __future__ import annotations

import ctypes
import gc
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

#: How often (s) somebody looks.
_INTERVAL = 10.0
#: Growth that is left alone: a share, and bytes.
_SHARE, _LITTLE = 1.1, 16 << 20
_STATM = Path("/proc/self/statm")


def resident() -> int:
    """Return the bytes of this process that lie in memory; 0 on a system that does not tell (anything but Linux)."""
    try:
        return int(_STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0


def give_back() -> None:
    """Find what nobody needs, and hand what is free to the system."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # glibc has it
    if trim is not None:
        trim(0)


class Memory:
    """Gives memory back when there is more than the least that the process has got along with."""

    def __init__(self, *, measure: Callable[[], int] = resident, give_back: Callable[[], None] = give_back) -> None:
        self._measure, self._give_back = measure, give_back
        self._least = measure()

    def look(self) -> None:
        """Look once."""
        if self._measure() > _SHARE * self._least + _LITTLE:
            self._give_back()
        self._least = min(self._least, self._measure())

    def keep_small(self) -> None:
        """Look now and then, in a thread, for as long as the process lives."""

        def watch() -> None:
            while True:
                time.sleep(_INTERVAL)
                self.look()

        threading.Thread(target=watch, name="memory", daemon=True).start()
