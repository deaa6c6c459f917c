"""The examples of the reference work: every operation is used once, on a running service with a worker."""

from __future__ import annotations

import json

from tests.integration.api.story import TARGET, operations, told


def test_every_operation_works_as_its_example_says(sqlite_service, sqlite_worker) -> None:
    now = told(sqlite_service)
    assert sorted(now) == sorted(operations())
    recorded = json.loads(TARGET.read_text(encoding="utf-8"))
    assert {name: example["status"] for name, example in now.items()} == {
        name: example["status"] for name, example in recorded.items()
    }, "record the examples anew: python -m tests.integration.api.story"
