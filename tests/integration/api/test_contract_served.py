"""The contract is served whole, and while others are answered: making it takes seconds the first time."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any

import httpx
import pytest

from api.app import main
from api.app.examples import add_examples
from api.settings import Settings
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


def test_nobody_sees_a_contract_that_is_half_made(monkeypatch: pytest.MonkeyPatch) -> None:
    app = main.create_app(Settings.model_construct())
    second: list[Future[dict[str, Any]]] = []
    with ThreadPoolExecutor(1) as beside:

        def while_another_asks(document: Mapping[str, Any]) -> None:
            second.append(beside.submit(app.openapi))
            assert not wait(second, timeout=0.5).done  # it waits for this one
            add_examples(document)

        monkeypatch.setattr(main, "add_examples", while_another_asks)
        assert app.openapi() == second[0].result(PATIENCE)
        assert len(second) == 1
