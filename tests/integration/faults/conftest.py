"""`make faults` (``SERVOTUNE_FAULTS=full``) does the same for longer and with more of everything."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator

import pytest

FULL = os.environ.get("SERVOTUNE_FAULTS") == "full"


@pytest.fixture(scope="session")
def seconds() -> float:
    """How long there is load while something goes wrong."""
    return 30.0 if FULL else 1.5


@pytest.fixture(scope="session")
def rounds() -> int:
    """How often the same goes wrong."""
    return 10 if FULL else 1


@pytest.fixture(autouse=True)
def _whose_connections_these_were() -> Iterator[None]:
    """Let a connection that was left open fail the test that left it, and no other one."""
    yield
    gc.collect()
