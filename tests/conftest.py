"""The directory of a test decides its marker; hypothesis runs the same examples everywhere but in `make proof`."""

from __future__ import annotations

import gc
import logging
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, settings

# Read when numpy is loaded: for small matrices several threads of linear algebra wait for one another, above all on a busy machine.
os.environ.setdefault("OMP_NUM_THREADS", "1")

TIERS = ("unit", "property", "reference", "contract", "integration", "browser")

_quiet = [HealthCheck.too_slow, HealthCheck.filter_too_much]
# Without shrinking: a failing example is the same on every machine, and `make proof` makes it small.
_straight = [Phase.explicit, Phase.generate]
settings.register_profile(
    "share", max_examples=25, deadline=None, derandomize=True, phases=_straight, suppress_health_check=_quiet
)
settings.register_profile("proof", max_examples=2000, deadline=None, suppress_health_check=_quiet)
settings.load_profile("share")


@pytest.fixture(autouse=True)
def _own_log() -> Iterator[None]:
    """Commands and the job engine set up their logs when they first run; with the test the stream ends to which they write."""
    root = logging.getLogger()
    level = root.level
    yield
    for logger in (root, logging.getLogger("dbos")):
        logger.handlers = [handler for handler in logger.handlers if type(handler) is not logging.StreamHandler]
    root.setLevel(level)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark every test by the first directory below tests/."""
    root = Path(__file__).parent
    for item in items:
        tier = item.path.relative_to(root).parts[0]
        if tier not in TIERS:
            raise pytest.UsageError(f"{item.path} must be in one of {', '.join(TIERS)} below tests/, got {tier}")
        item.add_marker(tier)


def pytest_collection_finish() -> None:
    """Leave what is loaded by now out of every later collection: some million objects, none of which is garbage."""
    gc.collect()
    gc.freeze()
