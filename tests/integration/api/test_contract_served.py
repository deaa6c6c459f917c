"""The contract is served while others are answered: making it takes seconds the first time."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import pytest

from tests.integration.api.conftest import Service
from tests.support.patience import PATIENCE


def test_others_are_answered_while_the_contract_is_made(
    sqlite_service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    app = sqlite_service.app
    assert app is not None
    begun, answered, make = threading.Event(), threading.Event(), app.openapi

    def slowly() -> dict[str, Any]:
        begun.set()
        assert answered.wait(PATIENCE)
        return make()

    monkeypatch.setattr(app, "openapi", slowly)
    with sqlite_service.client() as client, ThreadPoolExecutor(1) as beside:
        contract = beside.submit(httpx.get, f"{sqlite_service.url}/openapi.json", timeout=PATIENCE, trust_env=False)
        assert begun.wait(PATIENCE)
        assert client.get("/v1/systems").status_code == 200
        answered.set()
        assert contract.result().json() == make()
