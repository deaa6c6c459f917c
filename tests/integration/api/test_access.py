"""Keys, workspaces, quotas and the audit log, on a real server."""

from __future__ import annotations

import json
import re
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from importlib.metadata import version

import httpx
import pytest
from sqlalchemy import text

from api.app.main import create_app
from api.settings import Settings
from storage import open_database
from tests.integration.api.conftest import serving
from tests.integration.api.documents import LAG, OPTIMIZATION, RAW, lag_recording, sha256, upload
from tests.integration.coroutines import run


def with_key(service, key: str) -> httpx.Client:
    return httpx.Client(base_url=service.url, headers={"Authorization": f"Bearer {key}"}, timeout=60, trust_env=False)


def made(client, path: str, **body):
    reply = client.post(path, json=body)
    assert reply.status_code == 201, reply.text
    assert reply.headers["Location"] == f"{path}/{reply.json()['id']}"
    return reply.json()


def test_a_key_is_shown_once_and_opens_what_it_says(service, client) -> None:
    key = made(client, "/v1/keys", name="lab", scopes=["run", "read", "run"])
    assert key["scopes"] == ["read", "run"]
    assert key["key"].startswith(key["prefix"])
    again = client.get(f"/v1/keys/{key['id']}").json()
    assert "key" not in again
    assert key["key"] not in client.get("/v1/keys").text
    with with_key(service, key["key"]) as lab:
        assert lab.get("/v1/systems").status_code == 200
        assert lab.post("/v1/systems", json=LAG).status_code == 403
        assert lab.get("/v1/keys").status_code == 403  # nobody but an admin sees keys
        assert lab.get("/v1/session").json() == {
            "principal": key["id"], "name": "lab", "workspace": "ws_default", "scopes": ["read", "run"],
            "expires_at": None, "csrf_token": None,
        }  # fmt: skip
        used = client.get(f"/v1/keys/{key['id']}").json()["last_used_at"]
        assert datetime.now(UTC) - datetime.fromisoformat(used) < timedelta(minutes=1)
        assert client.delete(f"/v1/keys/{key['id']}").status_code == 204
        assert lab.get("/v1/systems").status_code == 401
    assert client.get(f"/v1/keys/{key['id']}").json()["revoked_at"]
    assert client.delete("/v1/keys/key_none").status_code == 404


def test_no_token_is_kept_not_even_for_a_repetition(service, client) -> None:
    headers = {"Idempotency-Key": "a key, once"}
    first = client.post("/v1/keys", json={"name": "once", "scopes": ["read"]}, headers=headers)
    second = client.post("/v1/keys", json={"name": "once", "scopes": ["read"]}, headers=headers)
    assert second.headers["Idempotency-Replayed"] == "true"
    assert second.json() == first.json() | {"key": None}
    token = first.json()["key"]
    database = open_database(service.database_url)
    with database.session() as session:
        rows = session.execute(text("SELECT body, headers FROM idempotency")).all()
    database.dispose()
    assert rows
    assert token not in str(rows)


def test_a_key_ends_when_it_says(service, client) -> None:
    life, early = timedelta(seconds=0.75), None
    # A busy machine may not answer as long as a key lives: then one that lives twice as long is asked for.
    while early is None:
        life *= 2
        ends = datetime.now(UTC) + life
        key = made(client, "/v1/keys", name="short", scopes=["read"], expires_at=ends.isoformat())
        with with_key(service, key["key"]) as short:
            reply = short.get("/v1/systems")
        early = reply if datetime.now(UTC) < ends else None
    assert early.status_code == 200
    time.sleep(max(0.0, (ends - datetime.now(UTC)).total_seconds()) + 0.05)
    with with_key(service, key["key"]) as late:
        reply = late.get("/v1/systems")
        assert reply.status_code == 401
        assert "expired" in reply.json()["detail"]


def test_a_rotated_key_opens_until_its_overlap_is_over(service, client) -> None:
    old = made(client, "/v1/keys", name="rig", scopes=["acquire"])
    new = client.post(f"/v1/keys/{old['id']}/rotate", json={"overlap": 60})
    assert new.status_code == 201
    assert new.json()["replaces"] == old["id"]
    assert (new.json()["name"], new.json()["scopes"]) == ("rig", ["acquire"])
    with with_key(service, old["key"]) as before, with_key(service, new.json()["key"]) as after:
        assert before.get("/v1/systems").status_code == after.get("/v1/systems").status_code == 200
    newest = client.post(f"/v1/keys/{new.json()['id']}/rotate", json={}).json()
    with with_key(service, new.json()["key"]) as before, with_key(service, newest["key"]) as after:
        assert before.get("/v1/systems").status_code == 401
        assert after.get("/v1/systems").status_code == 200
    assert client.post(f"/v1/keys/{new.json()['id']}/rotate", json={}).status_code == 409


@pytest.mark.parametrize(
    ("body", "pointer"),
    [
        ({"name": "x"}, "/scopes"),
        ({"name": "x", "scopes": []}, "/scopes"),
        ({"name": "x", "scopes": ["root"]}, "/scopes/0"),
        ({"name": "", "scopes": ["read"]}, "/name"),
        ({"name": "x", "scopes": ["read"], "expires_at": "2020-01-01T00:00:00Z"}, "/expires_at"),
        ({"name": "x", "scopes": ["read"], "expires_at": "tomorrow"}, "/expires_at"),
        ({"name": "x", "scopes": ["read"], "expires_at": "2999-01-01T00:00:00"}, "/expires_at"),
        ({"name": "x", "scopes": ["read"], "workspace": "ws_none"}, "/workspace"),
        ({"name": "x", "scopes": ["read"], "key": "chosen"}, "/key"),
    ],
)
def test_a_wrong_key_is_refused_at_its_place(client, body, pointer) -> None:
    reply = client.post("/v1/keys", json=body)
    assert reply.status_code == 422
    assert [entry["pointer"] for entry in reply.json()["errors"]] == [pointer]


def test_only_who_runs_the_installation_makes_workspaces(service, client) -> None:
    room = made(client, "/v1/workspaces", name="test bench", limits={"systems": 1})
    assert room["limits"] == {
        "systems": 1, "schedules": 10_000, "webhooks": 20, "stored_bytes": 100 * 2**30, "jobs": 1000,
        "running_jobs": 1000,
    }  # fmt: skip
    assert room["used"] == dict.fromkeys(room["limits"], 0)
    assert client.post("/v1/workspaces", json={"name": "test bench"}).status_code == 409
    key = made(client, "/v1/keys", name="bench", scopes=["admin"], workspace=room["id"])["key"]
    with with_key(service, key) as bench:
        assert [item["id"] for item in bench.get("/v1/workspaces").json()["items"]] == [room["id"]]
        assert bench.post("/v1/workspaces", json={"name": "mine"}).status_code == 403
        assert bench.put(f"/v1/workspaces/{room['id']}", json={"name": "mine"}).status_code == 403
        # Another workspace and none at all are the same to it.
        for other in ("ws_default", "ws_none"):
            reply = bench.post("/v1/keys", json={"name": "x", "scopes": ["read"], "workspace": other})
            assert reply.status_code == 422
            assert reply.json()["detail"] == f"workspace must be one that exists, got '{other}'"
        # Its own admin makes keys in it.
        assert made(bench, "/v1/keys", name="x", scopes=["read"])["workspace"] == room["id"]
        assert bench.post("/v1/systems", json=LAG).status_code == 201
        refused = bench.post("/v1/systems", json=LAG)
        assert refused.status_code == 403
        assert refused.json()["type"].endswith("quota-exceeded")
        assert (refused.json()["quota"], refused.json()["limit"], refused.json()["used"]) == ("systems", 1, 1)
        assert refused.headers["RateLimit-Policy"] == '"systems";q=1'
        where = f"/v1/workspaces/{room['id']}"
        assert client.put(where, json={"name": "bench 1"}).status_code == 428
        changed = client.put(where, json={"name": "bench 1"}, headers={"If-Match": '"1"'})
        assert (changed.status_code, changed.headers["ETag"]) == (200, '"2"')
        assert client.put(where, json={"name": "bench 2"}, headers={"If-Match": '"1"'}).status_code == 412
        assert client.put(where, json={"name": "default"}, headers={"If-Match": '"2"'}).status_code == 409
        assert bench.post("/v1/systems", json=LAG).status_code == 201  # the limit is gone
        assert bench.get(where).json()["used"]["systems"] == 2


def test_of_many_at_once_no_more_get_in_than_the_quota_has_room_for(service, client) -> None:
    room = made(client, "/v1/workspaces", name="crowded", limits={"systems": 3})
    key = made(client, "/v1/keys", name="crowd", scopes=["admin"], workspace=room["id"])["key"]

    def ask(_number: int) -> int:
        with with_key(service, key) as own:
            return own.post("/v1/systems", json=LAG).status_code

    with ThreadPoolExecutor(8) as threads:
        assert sorted(threads.map(ask, range(8))) == [201] * 3 + [403] * 5


def test_storage_and_unfinished_jobs_have_quotas(service, client) -> None:
    room = made(client, "/v1/workspaces", name="small", limits={"stored_bytes": 40_000, "jobs": 1})
    key = made(client, "/v1/keys", name="small", scopes=["admin"], workspace=room["id"])["key"]
    data = lag_recording(samples=2000)  # 32 000 bytes
    with with_key(service, key) as small:
        assert upload(small, RAW, data).status_code == 200
        before = small.get(f"/v1/workspaces/{room['id']}").json()["used"]["stored_bytes"]
        assert before == 32_000
        second = made(small, "/v1/datasets", **RAW)
        other = data[16:] + data[:16]
        refused = small.put(f"/v1/datasets/{second['id']}/segments/{sha256(other)}", content=other)
        assert refused.status_code == 403
        assert refused.json()["quota"] == "stored_bytes"
        assert small.get(f"/v1/datasets/{second['id']}/segments").json()["items"] == []
        first = small.get("/v1/datasets").json()["items"][-1]["id"]
        assert small.delete(f"/v1/datasets/{first}", headers={"If-Match": "*"}).status_code == 204
        assert small.get(f"/v1/workspaces/{room['id']}").json()["used"]["stored_bytes"] == 0
        # There is no worker here: the job stays queued until it is cancelled.
        job = small.post("/v1/optimizations", json=OPTIMIZATION | {"system": LAG})
        assert job.status_code == 202, job.text
        refused = small.post("/v1/optimizations", json=OPTIMIZATION | {"system": LAG})
        assert refused.status_code == 429
        assert refused.headers["Retry-After"] == "10"
        assert refused.headers["RateLimit"] == '"jobs";r=0'
        assert small.post(f"/v1/jobs/{job.json()['id']}/cancel").status_code == 200
        assert small.post("/v1/optimizations", json=OPTIMIZATION | {"system": LAG}).status_code == 202


def test_the_audit_log_says_who_did_what_in_which_request(service, client) -> None:
    me = client.get("/v1/session").json()["principal"]
    created = client.post("/v1/systems", json=LAG, headers={"X-Request-ID": "mine-1"})
    assert created.headers["X-Request-ID"] == "mine-1"
    assert created.headers["Servotune-Version"] == version("servotune")
    where = created.headers["Location"]
    client.put(where, json=LAG | {"name": "renamed"}, headers={"If-Match": '"1"'})
    client.delete(where, headers={"If-Match": '"2"'})
    client.delete(where, headers={"If-Match": '"2"'})  # 404: no change, no entry
    client.post("/v1/systems", json=LAG | {"outputs": {"y": "nothing"}})  # 422: the same
    found = client.get("/v1/audit", params={"target": created.json()["id"]}).json()["items"]
    assert [(entry["action"], entry["principal"], entry["detail"]) for entry in found] == [
        ("system.delete", me, {"revision": 2}),
        ("system.update", me, {"revision": 2}),
        ("system.create", me, {"revision": 1}),
    ]
    assert found[-1]["request_id"] == "mine-1"
    assert [entry["action"] for entry in client.get("/v1/audit?action=key.create&limit=1").json()["items"]] == [
        "key.create"
    ]
    with service.client("write") as writer:
        assert writer.get("/v1/audit").status_code == 403
    assert service.keys["admin"] not in client.get("/v1/audit?limit=1000").text


HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
}


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/v1/systems", 200),
        ("GET", "/v1/systems/sys_none", 404),
        ("GET", "/v1/nothing", 404),
        ("GET", "/nothing", 404),
        ("PATCH", "/v1/systems", 405),
        ("POST", "/v1/systems", 422),
        ("GET", "/healthz", 200),
    ],
)
def test_every_reply_carries_the_headers_that_browsers_obey(client, method, path, status) -> None:
    reply = client.request(method, path)
    assert reply.status_code == status
    assert {name: reply.headers.get(name) for name in HEADERS} == HEADERS
    assert re.fullmatch("[0-9a-f]{16}", reply.headers["X-Request-ID"])
    assert reply.headers.get("Cache-Control") == ("no-store" if path.startswith("/v1") else None)
    assert "Strict-Transport-Security" not in reply.headers
    if status == 405:
        assert reply.headers["Allow"] == "GET, POST" or set(reply.headers["Allow"].split(", ")) <= {"GET", "POST"}


def test_a_request_id_of_a_client_is_used_only_when_it_is_a_word(client) -> None:
    assert client.get("/healthz", headers={"X-Request-ID": "job-7_a.b"}).headers["X-Request-ID"] == "job-7_a.b"
    for wrong in ("a b", "x" * 65, "<script>", ""):
        assert client.get("/healthz", headers={"X-Request-ID": wrong}).headers["X-Request-ID"] != wrong


def test_the_reference_page_asks_no_other_host(client) -> None:
    reply = client.get("/docs/api", headers={"Accept": "text/html"})
    policy = reply.headers["Content-Security-Policy"]
    # 404 where the pages have not been built: a service without them still has its contract.
    assert (reply.status_code == 200 and "script-src 'self';" in policy) or "/openapi.json" in reply.json()["detail"]
    assert "http" not in policy


async def _failing(database_url: str, key: str) -> httpx.Response:
    app = create_app(Settings(database_url=database_url))
    app.state.marker = "a secret of the implementation"

    @app.get("/v1/broken")
    def broken() -> None:
        raise ZeroDivisionError(app.state.marker)

    del broken
    transport = httpx.ASGITransport(app, raise_app_exceptions=False)
    async with (
        app.router.lifespan_context(app),
        httpx.AsyncClient(transport=transport, base_url="http://service") as client,
    ):
        return await client.get("/v1/broken", headers={"Authorization": f"Bearer {key}", "X-Request-ID": "r-1"})


def test_an_error_of_the_software_is_a_problem_too_and_tells_nothing(service, caplog) -> None:
    reply = run(_failing(service.database_url, service.keys["admin"]))
    assert reply.status_code == 500
    assert reply.headers["Content-Type"] == "application/problem+json"
    assert {name: reply.headers.get(name) for name in HEADERS} == HEADERS
    assert "secret" not in reply.text
    assert "r-1" in reply.json()["detail"]
    assert "request r-1, GET /v1/broken, failed" in caplog.text


def test_a_body_that_does_not_arrive_is_given_up(sqlite_template, tmp_path) -> None:
    path = tmp_path / "slow.db"
    path.write_bytes(sqlite_template.read_bytes())
    with serving(f"sqlite:///{path}", body_seconds=0.3) as service:
        host, port = service.url.removeprefix("http://").split(":")
        for target in ("POST /v1/systems", f"PUT /v1/datasets/ds_x/segments/{'0' * 64}"):
            with socket.create_connection((host, int(port)), timeout=20) as slow:
                slow.sendall(
                    f"{target} HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {service.keys['admin']}\r\n"
                    "Content-Type: application/json\r\nContent-Length: 1000\r\n\r\n{".encode()
                )
                head, _, body = slow.makefile("rb").read().partition(b"\r\n\r\n")
            assert head.startswith(b"HTTP/1.1 408"), head
            assert json.loads(body)["status"] == 408
            assert "0.3 s" in json.loads(body)["detail"]
