"""How many requests a caller may make: a bucket of tokens for each, refilled steadily.

A bucket holds ``quota`` tokens and gets ``quota / window`` of them back in a second; a request takes one. Each process of the
service counts for itself, so that no request waits for a database. The header fields are those of
draft-ietf-httpapi-ratelimit-headers.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

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


class Rates:
    """The buckets of all callers.

    Parameters
    ----------
    quota : int
        Requests of one caller in a minute; 0 lets everything through.
    clock : callable
        The time in s.
    """

    def __init__(self, quota: int, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._quota = quota
        self._clock = clock
        self._lock = threading.Lock()
        self._buckets: dict[str, tuple[float, float]] = {}  # caller -> tokens, and when they were counted

    def take(self, caller: str) -> Allowance | None:
        """Take a token for one request; None where nothing is counted."""
        return self._count(caller, 1.0)

    def look(self, caller: str) -> Allowance | None:
        """Tell what `take` would, and take nothing."""
        return self._count(caller, 0.0)

    def _count(self, caller: str, cost: float) -> Allowance | None:
        if self._quota == 0:
            return None
        rate = self._quota / WINDOW
        with self._lock:
            now = self._clock()
            tokens, counted_at = self._buckets.pop(caller, (float(self._quota), now))
            tokens = min(self._quota, tokens + (now - counted_at) * rate)
            allowed = tokens >= 1.0
            tokens -= cost * allowed
            self._buckets[caller] = (tokens, now)  # the callers stand in the order of their last request
            if len(self._buckets) > _MOST_BUCKETS:
                del self._buckets[next(iter(self._buckets))]
        return Allowance(quota=self._quota, left=int(tokens), wait=0.0 if allowed else (1.0 - tokens) / rate)
