"""How many requests a caller may make: a bucket of tokens for each, refilled steadily.

A bucket holds ``quota`` tokens and gets ``quota / window`` of them back in a second; a request takes one. Each service counts
for itself, all of its processes together (`api.runtime.shared_memory`), so that no request waits for a database. The header fields are those
of draft-ietf-httpapi-ratelimit-headers.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

WINDOW = 60.0
"""s in which a whole quota comes back."""

_MOST_BUCKETS = 10_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Allowance:
    """What is left to a caller; ``wait`` is the time (s) until its next request is let through, 0 for one that was."""

    quota: int
    left: int
    wait: float

    def headers(self) -> dict[str, str]:
        """Return the header fields that tell it."""
        fields = {
            "RateLimit-Policy": f'"requests";q={self.quota};w={WINDOW:.0f}',
            "RateLimit": f'"requests";r={self.left};t={math.ceil((self.quota - self.left) * WINDOW / self.quota)}',
        }
        return fields if self.wait == 0.0 else fields | {"Retry-After": str(max(1, math.ceil(self.wait)))}


class Buckets(Protocol):
    """Tokens, and when they were counted, of every caller."""

    def change(self, caller: str, counted: Callable[[tuple[float, float] | None], tuple[float, float]]) -> None:
        """Put what ``counted`` makes of a caller's bucket, None where there is none, in its place."""


class OwnBuckets:
    """The buckets of one process."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._buckets: dict[str, tuple[float, float]] = {}  # in the order of the callers' last requests

    def change(self, caller: str, counted: Callable[[tuple[float, float] | None], tuple[float, float]]) -> None:
        """Put what ``counted`` makes of a caller's bucket, None where there is none, in its place."""
        with self._lock:
            self._buckets[caller] = counted(self._buckets.pop(caller, None))
            if len(self._buckets) > _MOST_BUCKETS:
                del self._buckets[next(iter(self._buckets))]


class Rates:
    """The buckets of all callers.

    Parameters
    ----------
    quota : int
        Requests of one caller in a minute; 0 lets everything through.
    clock : callable
        The time in s.
    buckets : Buckets, optional
        Those of this process by default.
    """

    def __init__(
        self, quota: int, *, clock: Callable[[], float] = time.monotonic, buckets: Buckets | None = None
    ) -> None:
        self._quota = quota
        self._clock = clock
        self._buckets = OwnBuckets() if buckets is None else buckets

    def take(self, caller: str) -> Allowance | None:
        """Take a token for one request; None where nothing is counted."""
        if self._quota == 0:
            return None
        rate = self._quota / WINDOW
        allowed, left = False, 0.0

        def counted(known: tuple[float, float] | None) -> tuple[float, float]:
            nonlocal allowed, left
            now = self._clock()
            tokens, counted_at = (float(self._quota), now) if known is None else known
            left = min(self._quota, tokens + (now - counted_at) * rate)
            allowed = left >= 1.0
            left -= allowed
            return left, now

        self._buckets.change(caller, counted)
        return Allowance(quota=self._quota, left=int(left), wait=0.0 if allowed else (1.0 - left) / rate)
