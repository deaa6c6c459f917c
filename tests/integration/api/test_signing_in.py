"""Browsers that sign in, their cookies and tokens, and the tickets of their WebSockets, on a real server."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta

import httpx
from starlette.websockets import WebSocket

from api.app.main import create_app
from api.settings import Settings
from tests.integration.api.conftest import serving
from tests.integration.api.documents import LAG
from tests.integration.api.test_access import made
from tests.integration.coroutines import run


@contextmanager
def browser(service) -> Iterator[tuple[httpx.Client, str]]:
    """Give a browser that has signed in, and its CSRF token."""
    with httpx.Client(base_url=service.url, timeout=60, trust_env=False) as own:
        reply = own.post("/v1/session", headers={"Authorization": f"Bearer {service.keys['write']}"})
        assert reply.status_code == 201
        yield own, reply.json()["csrf_token"]


def test_a_browser_signs_in_with_a_cookie_that_scripts_do_not_see(service) -> None:
    with browser(service) as (own, _token):
        reply = own.post("/v1/session", headers={"Authorization": f"Bearer {service.keys['read']}"})
        cookie = reply.headers["Set-Cookie"]
        assert re.fullmatch(r"servotune_sign_in=[\w-]{43}; HttpOnly; Max-Age=43200; Path=/; SameSite=lax", cookie), (
            cookie
        )
        assert service.keys["read"] not in cookie
        who = own.get("/v1/session").json()
        assert (who["scopes"], who["name"]) == (["read"], "read")
        assert who["csrf_token"] == reply.json()["csrf_token"]
        assert who["expires_at"] == reply.json()["expires_at"]


def test_what_changes_something_needs_the_token_of_a_page(service) -> None:
    with browser(service) as (own, token):
        assert own.get("/v1/systems").status_code == 200
        for header in ({}, {"X-CSRF-Token": "x"}, {"X-CSRF-Token": own.cookies["servotune_sign_in"]}):
            refused = own.post("/v1/systems", json=LAG, headers=header)
            assert refused.status_code == 403
            assert refused.json()["type"].endswith("csrf")
        assert own.post("/v1/systems", json=LAG, headers={"X-CSRF-Token": token}).status_code == 201
        assert own.delete("/v1/session").status_code == 403
        stolen = dict(own.cookies)
        assert own.delete("/v1/session", headers={"X-CSRF-Token": token}).status_code == 204
        assert not own.cookies
    # Signed out is signed out, wherever the cookie has got to.
    assert httpx.get(service.url + "/v1/systems", cookies=stolen, trust_env=False).status_code == 401


def test_a_browser_is_out_when_its_key_is(service, client) -> None:
    key = made(client, "/v1/keys", name="guest", scopes=["read"])
    with httpx.Client(base_url=service.url, trust_env=False) as own:
        own.post("/v1/session", headers={"Authorization": f"Bearer {key['key']}"})
        assert own.get("/v1/systems").status_code == 200
        assert own.post("/v1/session", headers={"X-CSRF-Token": own.get("/v1/session").json()["csrf_token"]}
                        ).status_code == 409  # fmt: skip
        client.delete(f"/v1/keys/{key['id']}")
        assert own.get("/v1/systems").status_code == 401


def test_behind_https_cookies_and_browsers_stay_there(database_url) -> None:
    settings = {"public_url": "https://servotune.example", "requests_per_minute": 4}
    with serving(database_url, **settings) as service, service.client("read") as client:
        reply = client.post("/v1/session")
        cookie = reply.headers["Set-Cookie"]
        assert re.fullmatch(r"__Host-servotune_sign_in=[\w-]{43}; HttpOnly; .*; Path=/; SameSite=lax; Secure", cookie)
        # Another host of the domain cannot set that name, so no other name counts.
        token = cookie.partition("=")[2].partition(";")[0]
        for name, status in (("servotune_sign_in", 401), ("__Host-servotune_sign_in", 200)):
            with httpx.Client(base_url=service.url, headers={"Cookie": f"{name}={token}"}, trust_env=False) as page:
                assert page.get("/v1/session").status_code == status
        assert reply.headers["Strict-Transport-Security"] == "max-age=31536000"
        # And four requests in a minute are enough.
        assert reply.headers["RateLimit-Policy"] == '"requests";q=4;w=60'
        assert reply.headers["RateLimit"] == '"requests";r=3;t=15'
        assert [client.get("/v1/systems").status_code for _ in range(4)] == [200, 200, 200, 429]
        refused = client.get("/v1/systems")
        assert refused.headers["Content-Type"] == "application/problem+json"
        assert 10 <= int(refused.headers["Retry-After"]) <= 15
        assert refused.json()["detail"] == "a caller must make at most 4 requests in a minute, got more"
        with service.client("write") as other:
            assert other.get("/v1/systems").status_code == 200
        assert client.get("/healthz").status_code == 200


async def connect(app, path: str, headers: dict[str, str]) -> list[dict]:
    """Open a WebSocket as a server would, return what the application says to it."""
    sent: list[dict] = []
    messages = [{"type": "websocket.connect"}, {"type": "websocket.disconnect", "code": 1000}]

    async def receive() -> dict:
        return messages.pop(0)

    async def send(message: dict) -> None:
        sent.append(message)

    bare, _, query = path.partition("?")
    scope = {
        "type": "websocket", "asgi": {"version": "3.0"}, "path": bare, "raw_path": bare.encode(), "root_path": "",
        "query_string": query.encode(), "scheme": "ws", "subprotocols": [], "state": {}, "app": app,
        "headers": [(name.lower().encode(), value.encode()) for name, value in headers.items()],
    }  # fmt: skip
    await app(scope, receive, send)
    return sent


async def _websockets(database_url: str, ticket: str, cookie: str, key: str) -> list[str]:
    app = create_app(Settings(database_url=database_url))

    @app.websocket("/v1/echo")
    async def echo(websocket: WebSocket) -> None:  # the live route comes later; the door to it is this one
        await websocket.accept()
        await websocket.send_text(websocket.state.caller.workspace)

    del echo
    async with app.router.lifespan_context(app):
        attempts = [
            ("/v1/echo", {}),
            ("/v1/echo?ticket=wrong", {}),
            ("/v1/echo", {"Cookie": f"servotune_sign_in={cookie}"}),
            (f"/v1/echo?ticket={ticket}", {}),
            (f"/v1/echo?ticket={ticket}", {}),
            ("/v1/echo", {"Authorization": f"Bearer {key}"}),
        ]
        said = [await connect(app, path, headers) for path, headers in attempts]
    return [messages[-1].get("text") or f"closed {messages[-1]['code']}" for messages in said]


def test_a_ticket_opens_one_websocket_and_a_cookie_none(service) -> None:
    with browser(service) as (own, token):
        reply = own.post("/v1/tickets", headers={"X-CSRF-Token": token})
        cookie = own.cookies["servotune_sign_in"]
    assert reply.status_code == 201
    left = datetime.fromisoformat(reply.json()["expires_at"]) - datetime.now(UTC)
    assert timedelta(seconds=20) < left <= timedelta(seconds=30)
    said = run(_websockets(service.database_url, reply.json()["ticket"], cookie, service.keys["read"]))
    assert said == ["closed 1008", "closed 1008", "closed 1008", "ws_default", "closed 1008", "ws_default"]
