"""Nothing under /v1 answers without a key; each key may do what its scopes say."""

from __future__ import annotations

import httpx
import pytest

from tests.integration.api.documents import LAG
from tests.support import contract

ROUTES = [
    (method, path)
    for method, _, path in (operation.partition(" ") for operation in contract.OPERATIONS)
    if path.startswith("/v1")
]


def test_the_walk_has_found_the_routes() -> None:
    assert len(ROUTES) >= 25


@pytest.mark.parametrize(("method", "path"), ROUTES)
def test_every_route_asks_for_a_key(service, method, path) -> None:
    reply = httpx.request(method, service.url + path.replace("{", "").replace("}", ""), content=b"{", trust_env=False)
    assert reply.status_code == 401
    assert reply.headers["WWW-Authenticate"] == "Bearer"
    assert reply.headers["Content-Type"] == "application/problem+json"
    assert reply.json()["status"] == 401


@pytest.mark.parametrize(
    "authorization", ["", "Bearer", "Bearer nonsense", "Basic YTpi", "{key}", "Token {key}", "Bearer {key}x"]
)
def test_a_wrong_key_opens_nothing(service, authorization) -> None:
    headers = {"Authorization": authorization.format(key=service.keys["admin"])}
    assert httpx.get(service.url + "/v1/systems", headers=headers, trust_env=False).status_code == 401


def test_a_revoked_key_opens_nothing(service) -> None:
    with service.client("revoked") as client:
        assert client.get("/v1/systems").status_code == 401


def test_unknown_paths_below_v1_ask_for_a_key_too(service) -> None:
    assert httpx.get(service.url + "/v1/nothing", trust_env=False).status_code == 401
    assert httpx.get(service.url + "/v1", trust_env=False).status_code == 401


def test_nothing_is_stored_without_a_key(service, client) -> None:
    before = client.get("/v1/datasets").json()["items"]
    httpx.post(service.url + "/v1/datasets", json={"name": "x", "format": "raw"}, trust_env=False)
    assert client.get("/v1/datasets").json()["items"] == before


@pytest.mark.parametrize(
    ("scope", "method", "path", "status"),
    [
        ("read", "GET", "/v1/systems", 200),
        ("read", "POST", "/v1/systems", 403),
        ("read", "POST", "/v1/simulations", 403),
        ("read", "POST", "/v1/datasets", 403),
        ("write", "POST", "/v1/systems", 201),
        ("write", "POST", "/v1/optimizations", 403),
        ("run", "POST", "/v1/systems", 403),
        ("run", "POST", "/v1/simulations", 422),
        ("acquire", "POST", "/v1/datasets", 422),
        ("acquire", "POST", "/v1/systems", 403),
        ("admin", "POST", "/v1/systems", 201),
    ],
)
def test_a_key_may_do_what_its_scopes_say(service, scope, method, path, status) -> None:
    with service.client(scope) as client:
        reply = client.request(method, path, json=LAG if method == "POST" else None)
    assert reply.status_code == status, reply.text
    if status == 403:
        assert f"got {scope}" in reply.json()["detail"]


#: Beside admin, which may everything: whose keys may what is not open to every key. A new operation stands here, or only reads.
NOBODY: frozenset[str] = frozenset()
ALLOWED = {
    "GET /v1/audit": NOBODY,
    "* /v1/keys": NOBODY,
    "* /v1/webhooks": NOBODY,
    "POST /v1/workspaces": NOBODY,
    "PUT /v1/workspaces": NOBODY,
    "GET *": {"read", "write", "run", "acquire"},
    "* /v1/session": {"read", "write", "run", "acquire"},
    "* /v1/tickets": {"read", "write", "run", "acquire"},
    "* /v1/systems": {"write"},
    "* /v1/comments": {"write"},
    "DELETE /v1/datasets": {"write"},
    "* /v1/datasets": {"write", "acquire"},
    "POST /v1/agents": {"acquire"},
    "POST /v1/acquisitions/{identifier}/attempts": {"acquire"},
    "* /v1/acquisitions": {"run"},
    "* /v1/acquisition-templates": {"run"},
    "* /v1/jobs": {"run"},
    "* /v1/schedules": {"run"},
    **{
        f"POST /v1/{computed}": {"run"}
        for computed in (
            "simulations", "frequency-responses", "state-space", "influence", "spectra", "frfs", "processings",
            "validations", "identifications", "optimizations",
        )
    },
}  # fmt: skip


def allowed(operation: str) -> set[str] | frozenset[str]:
    """Return the scopes that the first rule says which an operation is under."""
    method, _, path = operation.partition(" ")
    for rule, scopes in ALLOWED.items():
        its_method, _, prefix = rule.partition(" ")
        if its_method in {"*", method} and (prefix in {"*", path} or path.startswith(prefix + "/")):
            return scopes
    raise AssertionError(f"{operation} has no rule")


@pytest.mark.parametrize("scope", ["read", "write", "run", "acquire"])
def test_every_operation_is_open_to_its_scopes_alone(sqlite_service, scope) -> None:
    """Nothing is sent, so that what is let through is refused for another reason than the key."""
    with sqlite_service.client(scope) as client:
        for method, path in ROUTES:
            reply = client.request(method, path.replace("{", "").replace("}", ""))
            refused = reply.status_code == 403 and reply.json()["type"].endswith(":forbidden")
            assert refused is (scope not in allowed(f"{method} {path}")), (method, path, reply.text)


def test_workspaces_do_not_see_each_other(service, client) -> None:
    created = client.post("/v1/systems", json=LAG).json()
    with service.client("stranger") as stranger:
        assert stranger.get(f"/v1/systems/{created['id']}").status_code == 404
        assert stranger.get("/v1/systems").json()["items"] == []
        body = {"system": created["id"], "input": {"port": "u", "signal": {"kind": "step"}}}
        assert stranger.post("/v1/simulations", json=body).status_code == 422


def test_health_needs_no_key(service) -> None:
    assert httpx.get(service.url + "/healthz", trust_env=False).json() == {"status": "ok"}
    ready = httpx.get(service.url + "/readyz", trust_env=False)
    assert ready.status_code == 200  # no worker is expected beside this service
    assert ready.json()["checks"] == {"database": "ok", "migrations": "ok", "worker": "absent"}
