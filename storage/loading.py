"""Modules are loaded without looking for garbage among them: a process makes a million objects while it starts, and keeps them all."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def uncollected() -> Iterator[None]:
    """Collect nothing meanwhile, and what is there at the end never: a seventh of the time in which a service starts."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
