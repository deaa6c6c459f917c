"""What the processes of one service on one machine know of each other: a folder of small files that all of them map.

A file is locked for as long as a few of its bytes are read and written. A process that is stopped just then must not hold
up the others: they wait for it once, and then go on without the lock; at worst some request is not counted.
"""

from __future__ import annotations

import fcntl
import hashlib
import math
import mmap
import os
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

#: s for which a process waits for one that holds the lock.
_PATIENCE = 1.0
_NUMBER = struct.Struct("q")
#: A caller's digest, its tokens, and when they were counted (s, by the monotonic clock, which all processes share).
_BUCKET = struct.Struct("16sdd")
#: In how many places one caller's bucket may be.
_NEAR = 8


class Mapped:
    """A file of which every process sees what the others write.

    Parameters
    ----------
    path : Path
    size : int
        Bytes; zeros where nobody has written.
    """

    def __init__(self, path: Path, size: int) -> None:
        self._file = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
        os.ftruncate(self._file, size)
        self.bytes = mmap.mmap(self._file, size)
        self._threads = threading.Lock()
        self._patience = _PATIENCE

    @contextmanager
    def locked(self) -> Iterator[mmap.mmap]:
        """Give the bytes, which nobody else changes meanwhile."""
        with self._threads:
            held = self._lock()
            try:
                yield self.bytes
            finally:
                if held:
                    fcntl.lockf(self._file, fcntl.LOCK_UN)

    def _lock(self) -> bool:
        until = time.monotonic() + self._patience
        while True:
            try:
                fcntl.lockf(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                if time.monotonic() > until:
                    self._patience = 0.0
                    return False
                os.sched_yield()
            else:
                self._patience = _PATIENCE
                return True


class Number:
    """One integer."""

    def __init__(self, path: Path) -> None:
        self._file = Mapped(path, _NUMBER.size)

    def get(self) -> int:
        """Return it."""
        return int(_NUMBER.unpack_from(self._file.bytes)[0])

    def set(self, value: int) -> None:
        """Change it."""
        with self._file.locked() as held:
            _NUMBER.pack_into(held, 0, value)

    def count(self) -> None:
        """Add one."""
        with self._file.locked() as held:
            _NUMBER.pack_into(held, 0, _NUMBER.unpack_from(held)[0] + 1)


class SharedBuckets:
    """The buckets of tokens of `api.http.rate_limits`, one set for all processes: a caller has one bucket whoever answers it.

    Where all the places are taken in which a caller's may be, the one that was not used for longest is given up.

    Parameters
    ----------
    path : Path
    places : int
        Buckets in the file.
    """

    def __init__(self, path: Path, *, places: int = 1 << 14) -> None:
        self._places = places
        self._file = Mapped(path, places * _BUCKET.size)

    def change(self, caller: str, counted: Callable[[tuple[float, float] | None], tuple[float, float]]) -> None:
        """Put what ``counted`` makes of a caller's tokens and their time, None where there are none, in their place."""
        digest = hashlib.blake2b(caller.encode(errors="surrogatepass"), digest_size=16).digest()
        with self._file.locked() as held:
            at, known = self._place(held, digest)
            _BUCKET.pack_into(held, at, digest, *counted(known))

    def _place(self, held: mmap.mmap, digest: bytes) -> tuple[int, tuple[float, float] | None]:
        """Return where a caller's bucket is or will be, and what is in it."""
        first = int.from_bytes(digest[:4])
        oldest, since = 0, math.inf
        for number in range(first, first + _NEAR):
            at = number % self._places * _BUCKET.size
            owner, tokens, counted_at = _BUCKET.unpack_from(held, at)
            if owner == digest:
                return at, (tokens, counted_at)
            if counted_at < since:
                oldest, since = at, counted_at
        return oldest, None


class Siblings:
    """The processes of one service on this machine.

    Parameters
    ----------
    folder : Path
        Theirs alone, and there for as long as they are.
    count : int
        How many there are.
    """

    def __init__(self, folder: Path, count: int) -> None:
        self.count = count
        #: The worker beside them, 0 while there is none.
        self.worker = Number(folder / "worker")
        #: How often somebody was shut out: all of them then ask the database anew for everybody.
        self.revocations = Number(folder / "revocations")
        self.requests = SharedBuckets(folder / "requests")
        self.wrong_keys = SharedBuckets(folder / "wrong-keys")
        #: Where each of them counts for all (prometheus_client's multiprocess mode).
        self.numbers = folder / "numbers"
        self.numbers.mkdir(exist_ok=True)


class SiblingOfWorker:
    """The worker beside a service of several processes, as one of them sees it.

    Parameters
    ----------
    siblings : Siblings
    """

    def __init__(self, siblings: Siblings) -> None:
        self._siblings = siblings

    @property
    def pid(self) -> int:
        """The process of the worker, 0 while there is none."""
        return self._siblings.worker.get()

    def alive(self) -> bool:
        """Return whether the process is there."""
        return self.pid != 0
