"""Documents of earlier versions are read as those of this one."""

from __future__ import annotations

from typing import Any

import pytest

from storage.errors import StateError
from storage.upcasting import CURRENT, STEPS, upcast


def renamed(document: dict[str, Any]) -> dict[str, Any]:
    document["gain"] = document.pop("kp")
    return document


def in_seconds(document: dict[str, Any]) -> dict[str, Any]:
    return document | {"delay": document["delay"] / 1000.0}


@pytest.mark.parametrize(
    ("version", "document"),
    [(1, {"kp": 2.0, "delay": 500.0}), (2, {"gain": 2.0, "delay": 500.0}), (3, {"gain": 2.0, "delay": 0.5})],
)
def test_each_step_is_taken_from_the_version_on(version: int, document: dict[str, Any]) -> None:
    before = dict(document)
    found = upcast(document, version, steps={1: renamed, 2: in_seconds}, current=3)
    assert found == {"gain": 2.0, "delay": 0.5}
    assert document == before


def test_what_a_later_version_wrote_is_refused() -> None:
    with pytest.raises(StateError, match=f"schema_version <= {CURRENT}, got {CURRENT + 1}"):
        upcast({}, CURRENT + 1)


def test_there_is_a_step_from_every_version_that_ever_was() -> None:
    assert set(STEPS) == set(range(1, CURRENT))
