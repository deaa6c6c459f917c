"""What every part of the API does alike: problems for every refusal, conditional reads, ends of streams."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import httpx
import pytest
from sqlalchemy import update
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from api.services.systems import systems
from storage import open_database
from storage.models import ApiKey
from storage.models.base import utc_now
from tests.integration.api.blunders import require_problem
from tests.integration.api.conftest import Service, serving
from tests.integration.api.documents import LAG, OPTIMIZATION
from tests.support.patience import PATIENCE


@pytest.mark.parametrize(
    ("request_", "status", "says"),
    [
        (("GET", "/v1/nothing", {}), 404, "no such path"),
        (("GET", "/nothing", {"headers": {"Accept": "application/json"}}), 404, "no such path"),
        (("GET", "/v1/systems/sys_none", {}), 404, "system 'sys_none' does not exist"),
        (("PATCH", "/v1/systems", {"json": {}}), 405, "the method must be one of GET, POST here, got PATCH"),
        (("DELETE", "/v1/simulations", {}), 405, "the method must be one of POST here, got DELETE"),
        (("POST", "/v1/systems", {"content": b"x" * (1 << 20) + b"x"}), 413, "must be at most 1048576 bytes"),
        (
            ("POST", "/v1/systems", {"content": b"{", "headers": {"Content-Type": "application/json"}}),
            422,
            "(character 1)",
        ),
        (("POST", "/v1/systems", {"json": LAG | {"block": {}}}), 422, "block must be left out"),
        (
            ("POST", "/v1/systems", {"json": LAG | {"blocks": {"a": {"kind": "integrater"}}}}),
            422,
            "in the catalogue, got 'integrater' (was 'integrator' meant?)",
        ),
        (
            ("POST", "/v1/systems", {"json": LAG | {"blocks": {"a": {"kind": "gain", "gain": 1, "gian": 2}}}}),
            422,
            "gian must be left out: it is no field here (was 'gain' meant?)",
        ),
        (
            ("POST", "/v1/systems", {"content": b'{"name": NaN}', "headers": {"Content-Type": "application/json"}}),
            422,
            "got NaN at /name",
        ),
        (("POST", "/v1/keys", {"json": {"name": "k", "scopes": ["root"]}}), 422, "scopes/0 must be 'read', 'write'"),
        (("GET", "/v1/systems?limit=0", {}), 422, "query parameter limit must be >= 1, got 0"),
        (("GET", "/v1/systems?limit=5&limit=6", {}), 422, "query parameter limit must stand once, got it 2 times"),
        (
            ("GET", "/v1/jobs/{job}/report?format=html&format=pdf", {}),
            422,
            "parameter format must stand once, got it 2",
        ),
        (
            ("POST", "/v1/identifications?dry_run=true&dry_run=false", {"json": {}}),
            422,
            "parameter dry_run must stand once",
        ),
        (("GET", "/v1/datasets/x/export?channel=a&channel=b", {}), 404, "dataset 'x' does not exist"),
        (("GET", "/v1/systems?cursor=x", {}), 422, "cursor must be a next_cursor of this list"),
        (("PUT", "/v1/systems/{system}", {"json": LAG}), 428, "If-Match must be sent"),
        (("PUT", "/v1/systems/{system}", {"json": LAG, "headers": {"If-Match": '"9"'}}), 412, "must be 1, got 9"),
        (("GET", "/v1/jobs/{job}/result", {}), 409, "must have succeeded"),
        (
            ("GET", "/v1/systems", {"headers": {"Authorization": "Bearer st_wrong"}}),
            401,
            "unknown, was revoked or has expired",
        ),
        (("GET", "/v1/systems", {"headers": {"Authorization": "Basic eDp5"}}), 401, "must be Bearer <key>"),
    ],
)
def test_every_refusal_is_a_problem(client, things, request_, status, says) -> None:
    method, path, options = request_
    reply = client.request(method, path.format(**things), **options)
    assert says in require_problem(reply, status)["detail"]


@pytest.fixture(scope="module")
def things(client) -> dict[str, str]:
    system = client.post("/v1/systems", json=LAG).json()["id"]
    job = client.post("/v1/optimizations", json=OPTIMIZATION | {"system": LAG}).json()["id"]
    return {"system": system, "job": job}


def test_what_nobody_foresaw_is_a_problem_too(sqlite_service, monkeypatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("secret of the house")

    monkeypatch.setattr(systems, "page", fail)
    with sqlite_service.client() as client:
        body = require_problem(client.get("/v1/systems"), 500)
    assert "secret" not in body["detail"]


def test_a_document_that_is_known_is_not_sent_again(client, things) -> None:
    path = f"/v1/systems/{things['system']}"
    tag = client.get(path).headers["ETag"]
    for known in (tag, f"W/{tag}", f'"7", {tag}', "*"):
        reply = client.get(path, headers={"If-None-Match": known})
        assert (reply.status_code, reply.content, reply.headers["ETag"]) == (304, b"", tag)
    assert client.get(path, headers={"If-None-Match": '"7"'}).status_code == 200
    changed = client.put(path, json=LAG | {"name": "new"}, headers={"If-Match": tag, "If-None-Match": tag})
    assert changed.status_code == 200
    assert client.get(path, headers={"If-None-Match": tag}).json()["document"]["name"] == "new"
    # Nobody learns from a tag whether a thing of others exists.
    assert client.get("/v1/systems/sys_none", headers={"If-None-Match": "*"}).status_code == 404


# Streams


@pytest.fixture
def lively(sqlite_template, tmp_path) -> Iterator[Service]:
    path = tmp_path / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    with serving(f"sqlite:///{path}") as running:
        yield running


@pytest.mark.parametrize("how", ["revoked", "expired", "signed out"])
def test_an_event_stream_ends_with_what_opened_it(lively, how) -> None:
    with lively.client() as admin, httpx.Client(base_url=lively.url, timeout=PATIENCE, trust_env=False) as follower:
        job = admin.post("/v1/optimizations", json=OPTIMIZATION | {"system": LAG}).json()["id"]
        key = admin.post("/v1/keys", json={"name": "f", "scopes": ["read"]}).json()
        headers = {"Authorization": f"Bearer {key['key']}"}
        if how == "signed out":
            token = follower.post("/v1/session", headers=headers).json()["csrf_token"]
            headers = {}
        first, lines = threading.Event(), []

        def follow() -> None:
            with follower.stream("GET", f"/v1/jobs/{job}/events", headers=headers) as stream:
                for line in stream.iter_lines():
                    lines.append(line)
                    first.set()

        thread = threading.Thread(target=follow)
        thread.start()
        assert first.wait(PATIENCE)
        if how == "revoked":
            admin.delete(f"/v1/keys/{key['id']}")
        elif how == "expired":
            database = open_database(lively.database_url)
            with database.session() as session:
                session.execute(update(ApiKey).where(ApiKey.id == key["id"]).values(expires_at=utc_now()))
            database.dispose()
        else:
            with httpx.Client(base_url=lively.url, cookies=follower.cookies, trust_env=False) as browser:
                assert browser.delete("/v1/session", headers={"X-CSRF-Token": token}).status_code == 204
        thread.join(timeout=PATIENCE)
        assert not thread.is_alive()
        assert not any("succeeded" in line or "cancelled" in line for line in lines)
        assert admin.get("/v1/systems").status_code == 200


def test_an_event_stream_goes_on_for_who_may_stay(lively) -> None:
    with lively.client() as client:
        job = client.post("/v1/optimizations", json=OPTIMIZATION | {"system": LAG}).json()["id"]
        events: list[str] = []

        def follow() -> None:
            with lively.client("read") as own, own.stream("GET", f"/v1/jobs/{job}/events") as stream:
                events.extend(stream.iter_lines())

        thread = threading.Thread(target=follow)
        thread.start()
        time.sleep(2.5)  # longer than two looks
        assert thread.is_alive()
        client.post(f"/v1/jobs/{job}/cancel")
        thread.join(timeout=PATIENCE)
    assert any("cancelled" in line for line in events)


def test_a_socket_closes_with_what_opened_it(lively) -> None:
    with lively.client() as admin:
        key = admin.post("/v1/keys", json={"name": "panel", "scopes": ["run"]}).json()
        holder = {"Authorization": f"Bearer {key['key']}"}
        ticket = httpx.post(f"{lively.url}/v1/tickets", headers=holder, trust_env=False).json()["ticket"]
        with connect(f"{lively.url.replace('http', 'ws')}/v1/live?ticket={ticket}", proxy=None) as socket:
            socket.send('{"type": "set", "seq": 1, "vectors": [[1.0]]}')
            assert "problem" in str(socket.recv(timeout=PATIENCE))
            admin.delete(f"/v1/keys/{key['id']}")
            with pytest.raises(ConnectionClosed) as closed:
                socket.recv(timeout=PATIENCE)
        assert closed.value.rcvd is not None
        assert (closed.value.rcvd.code, closed.value.rcvd.reason) == (
            1008,
            "the key or the sign-in does not open any more",
        )


# Wrong keys


def test_nobody_tries_many_keys_and_nobody_is_kept_out_by_that(sqlite_template, tmp_path) -> None:
    path = tmp_path / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    with (
        serving(f"sqlite:///{path}", wrong_keys_per_minute=5) as service,
        service.client("read") as known,
        httpx.Client(base_url=service.url, trust_env=False) as guesser,
    ):
        assert known.get("/v1/systems").status_code == 200

        def guess(key: str) -> httpx.Response:
            return guesser.get("/v1/systems", headers={"Authorization": f"Bearer {key}"})

        assert [guess(f"st_wrong_{number}").status_code for number in range(7)] == [401] * 5 + [429] * 2
        refused = guess("st_wrong_again")
        assert "at most 5 wrong keys in a minute" in require_problem(refused, 429)["detail"]
        assert 1 <= int(refused.headers["Retry-After"]) <= 12
        # Behind one proxy everybody has this address: right keys open, also those that were never seen.
        assert guess(service.keys["write"]).status_code == 200
        assert guess("st_wrong_still").status_code == 429
        assert known.get("/v1/systems").status_code == 200
        assert guesser.get("/v1/systems").status_code == 401  # showing nothing is no guess
        assert guesser.get("/healthz").status_code == 200


@pytest.mark.parametrize(("proxies", "other"), [([], 429), (["10.0.0.0/8"], 429), (["127.0.0.1", "10.0.0.0/8"], 401)])
def test_only_a_proxy_that_a_setting_names_tells_who_called(sqlite_template, tmp_path, proxies, other) -> None:
    path = tmp_path / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    with (
        serving(f"sqlite:///{path}", wrong_keys_per_minute=1, trusted_proxies=proxies) as service,
        httpx.Client(base_url=service.url, trust_env=False) as caller,
    ):

        def guess(address: str) -> int:
            headers = {"Authorization": "Bearer st_wrong", "X-Forwarded-For": address}
            return caller.get("/v1/systems", headers=headers).status_code

        assert guess("1.1.1.1, 10.2.3.4") == 401
        assert guess("1.1.1.1, 10.2.3.4") == 429
        assert guess("1.1.1.2, 10.2.3.4") == other
