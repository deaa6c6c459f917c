"""Bounds on what one request may compute: how many at a time, how long, how large the reply."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from api.errors import Problem, invalid
from api.settings import Settings


@dataclass(frozen=True, slots=True)
class Deadline:
    """The moment after which a request gives up."""

    at: float
    seconds: float
    clock: Callable[[], float]

    def check(self, done: int, total: int, what: str) -> None:
        """Raise the 422 that says how far the computation came, once the time is over."""
        if self.clock() > self.at:
            raise Problem(
                422,
                "too-long",
                f"a request must be computed within {self.seconds:g} s, got {done} of {total} {what} done; ask for fewer",
            )


@dataclass(frozen=True)
class Computing:
    """The slots in which requests compute, and the limits of one request."""

    settings: Settings
    clock: Callable[[], float] = time.monotonic
    _slots: threading.BoundedSemaphore = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_slots", threading.BoundedSemaphore(self.settings.compute_slots))

    @contextmanager
    def slot(self) -> Iterator[Deadline]:
        """Wait for a free slot, hold it, and give the deadline of what is computed in it."""
        seconds = self.settings.request_seconds
        if not self._slots.acquire(timeout=seconds):
            raise Problem(503, "busy", "every computing slot is taken; try again later", headers={"Retry-After": "5"})
        try:
            yield Deadline(at=self.clock() + seconds, seconds=seconds, clock=self.clock)
        finally:
            self._slots.release()

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
