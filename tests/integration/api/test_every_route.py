"""What every route of the contract does alike, walked operation by operation: a new one is walked, too.

What needs the things that a route is about (``If-Match``, ``Idempotency-Key``, 202 and ``Location``) is walked by
`tests.integration.api.test_story`; what another workspace gets, and what is not there, by `tests.integration.api.test_isolation`.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from api.http.calls import installation
from api.settings import Settings
from tests.integration.api.blunders import require_problem
from tests.integration.api.conftest import serving
from tests.integration.api.story import TARGET
from tests.support.contract import DOCUMENT, OPERATIONS

EXAMPLES: dict[str, dict[str, Any]] = json.loads(TARGET.read_text(encoding="utf-8"))
UNDER_V1 = [operation for operation in OPERATIONS if operation.partition(" ")[2].startswith("/v1")]
METHODS = {"get", "post", "put", "patch", "delete"}
#: What the software knows by itself, and what the key has told already.
NEED_NOTHING = {"GET /v1/session", *(operation for operation in OPERATIONS if "/v1/catalog/" in operation)}


def takes(operation: str, kind: str) -> bool:
    return kind in OPERATIONS[operation].get("requestBody", {}).get("content", {})


DOCUMENTS = [operation for operation in UNDER_V1 if takes(operation, "application/json")]


def address(operation: str) -> str:
    """Return the path with the names of the example in it, none of which is a thing of this service."""
    path = operation.partition(" ")[2]
    for name, value in EXAMPLES[operation]["parameters"].items():
        path = path.replace(f"{{{name}}}", str(value))
    return path


def ask(client: httpx.Client, operation: str, **options: Any) -> httpx.Response:
    return client.request(operation.partition(" ")[0], address(operation), **options)


@pytest.fixture(scope="module")
def own(sqlite_service) -> Iterator[httpx.Client]:
    with sqlite_service.client() as client:
        yield client


def test_nobody_gets_in_without_a_key(own) -> None:
    with httpx.Client(base_url=own.base_url, trust_env=False) as nobody:
        for operation in UNDER_V1:
            reply = ask(nobody, operation)
            require_problem(reply, 401, "unauthorized")
            assert reply.headers["WWW-Authenticate"].startswith("Bearer")


def test_every_path_says_which_methods_it_has(own) -> None:
    for path, operations in DOCUMENT["paths"].items():
        reply = own.request(min(METHODS - set(operations)), path)
        require_problem(reply, 405, "method-not-allowed")
        assert reply.headers["Allow"].lower().split(", ") == sorted(operations), path  # RFC 9110, 15.5.6


def test_what_lies_below_a_path_is_not_there(own) -> None:
    for path in DOCUMENT["paths"]:
        require_problem(own.get(f"{path}/no/such/thing"), 404, "not-found")


WRONG = {
    b'{"name": ': "the body must be JSON",
    b'{"name": NaN}': "numbers must be finite, got NaN",
    b"[]": "the body must be a JSON object",
}


def test_what_is_no_json_object_is_refused(own) -> None:
    for operation in DOCUMENTS:
        for content, says in WRONG.items():
            reply = ask(own, operation, content=content, headers={"Content-Type": "application/json"})
            assert says in require_problem(reply, 422, "invalid-document")["detail"], operation
        reply = ask(own, operation, content=b"name=x", headers={"Content-Type": "text/plain"})
        assert "sent with Content-Type: application/json" in require_problem(reply, 422)["detail"], operation


def test_a_field_that_nobody_knows_is_refused_by_its_name(own) -> None:
    for operation in DOCUMENTS:
        document = EXAMPLES[operation]["request"] | {"no/such~field": 1}
        errors = require_problem(ask(own, operation, json=document, headers={"If-Match": "*"}), 422)["errors"]
        # RFC 6901: ~ and / are written ~0 and ~1
        assert [entry["pointer"] for entry in errors] == ["/no~1such~0field"], operation
        assert errors[0]["detail"] == "no/such~field must be left out: it is no field here"


def test_a_document_that_is_too_large_is_refused(own) -> None:
    limit = Settings.model_fields["body_limit"].default
    for operation in DOCUMENTS:
        reply = ask(own, operation, content=b" " * (limit + 1), headers={"Content-Type": "application/json"})
        detail = require_problem(reply, 413)["detail"]
        assert detail == f"a document must be at most {limit} bytes, got {limit + 1}", operation


def test_every_list_says_what_a_page_must_be(own) -> None:
    for operation in UNDER_V1:
        if any(parameter["name"] == "cursor" for parameter in OPERATIONS[operation].get("parameters", ())):
            says = require_problem(ask(own, operation, params={"limit": 1001}), 422)["detail"]
            assert says == "query parameter limit must be <= 1000, got 1001", operation


def test_a_failure_of_the_software_tells_nothing(sqlite_service, own, caplog) -> None:
    app = sqlite_service.app

    def fail() -> None:
        raise RuntimeError("secret of the house")

    app.dependency_overrides[installation] = fail
    try:
        for operation in UNDER_V1:
            reply = ask(own, operation, json=EXAMPLES[operation].get("request"), headers={"If-Match": "*"})
            if operation not in NEED_NOTHING:
                assert reply.headers["X-Request-ID"] in require_problem(reply, 500, "internal-error")["detail"]
                assert "secret" not in reply.text
    finally:
        del app.dependency_overrides[installation]
    assert "secret of the house" in caplog.text  # it is in the log


def test_whoever_asks_too_often_is_told_when_to_come_again(sqlite_template, tmp_path) -> None:
    path = tmp_path / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    with serving(f"sqlite:///{path}", requests_per_minute=1) as service, service.client() as client:
        for operation in UNDER_V1:
            reply = ask(client, operation)
            if operation != UNDER_V1[0]:
                require_problem(reply, 429, "too-many-requests")
                assert 1 <= int(reply.headers["Retry-After"]) <= 60
                assert reply.headers["RateLimit-Policy"] == '"requests";q=1;w=60'
                assert reply.headers["RateLimit"].startswith('"requests";r=0;t=')
        assert client.get("/healthz").status_code == 200
