"""The examples of the reference work: every operation is used once, on a running service with a worker.

Whoever uses them gets everything wrong first: see `tests.integration.api.blunders`.
"""

from __future__ import annotations

import json

from tests.integration.api.blunders import Blunderer
from tests.integration.api.story import TARGET, operations, told
from tests.support.contract import OPERATIONS


def taking(header: str) -> set[str]:
    """Return the operations that take a header, by the contract."""
    return {
        operation
        for operation, described in OPERATIONS.items()
        if any(parameter["name"] == header for parameter in described.get("parameters", ()))
    }


def test_every_operation_works_as_its_example_says(sqlite_service, sqlite_worker) -> None:
    with sqlite_service.client() as plain:
        client = Blunderer(base_url=plain.base_url, headers=plain.headers, timeout=plain.timeout, trust_env=False)
    with client:
        now = told(client)
    assert sorted(now) == sorted(operations())
    recorded = json.loads(TARGET.read_text(encoding="utf-8"))
    assert {name: example["status"] for name, example in now.items()} == {
        name: example["status"] for name, example in recorded.items()
    }, "record the examples anew: python -m tests.integration.api.story"
    assert set(client.conditional) == taking("If-Match")
    assert set(client.repeated) == taking("Idempotency-Key")
