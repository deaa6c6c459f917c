"""People sign in through an OpenID provider: a small one of the test's own, which signs with a real key."""

from __future__ import annotations

import base64
import hashlib
import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

import httpx
import pytest
from cryptography.fernet import Fernet
from joserfc import jwt
from joserfc.jwk import OctKey, RSAKey
from pydantic import ValidationError

from api.settings import Settings
from tests.integration.api.conftest import Service, serving

ROLES = {
    "lab": {"workspace": "ws_other", "scopes": ["read", "acquire"]},
    "engineers": {"scopes": ["read", "write", "run"]},
    "lost": {"workspace": "ws_none", "scopes": ["read"]},
}
SECRET = "the secret of this service"


class Provider(ThreadingHTTPServer):
    """An OpenID provider whose only user is ``claims``."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.issuer = f"http://127.0.0.1:{self.server_port}/realm"
        self.key = RSAKey.generate_key(2048, parameters={"kid": "first"})
        self.claims: dict[str, Any] = {}
        self.header: dict[str, Any] = {}
        self.codes: dict[str, dict[str, str]] = {}

    def token(self, nonce: str) -> str:
        now = int(time.time())
        standard = {"iss": self.issuer, "aud": "servotune", "sub": "4711", "nonce": nonce, "iat": now, "exp": now + 60}
        return jwt.encode({"alg": "RS256", "kid": self.key.kid, **self.header}, standard | self.claims, self.key)


class Handler(BaseHTTPRequestHandler):
    server: Provider

    def do_GET(self) -> None:
        if self.path == "/realm/.well-known/openid-configuration":
            issuer = self.server.issuer
            self.say({"issuer": issuer, "authorization_endpoint": f"{issuer}/authorize",
                      "token_endpoint": f"{issuer}/token", "jwks_uri": f"{issuer}/keys"})  # fmt: skip
        elif self.path == "/realm/keys":
            self.say({"keys": [self.server.key.as_dict(private=False)]})

    def do_POST(self) -> None:
        body = parse_qs(self.rfile.read(int(self.headers["Content-Length"])).decode())
        asked = self.server.codes.pop(body["code"][0], None)
        basic = base64.b64decode(self.headers["Authorization"].removeprefix("Basic ")).decode()
        challenge = base64.urlsafe_b64encode(hashlib.sha256(body["code_verifier"][0].encode()).digest())
        right = (
            asked is not None
            and basic == "servotune:the%20secret%20of%20this%20service"
            and challenge.decode().rstrip("=") == asked["code_challenge"]
            and body["redirect_uri"] == [asked["redirect_uri"]]
        )
        self.say(
            {"id_token": self.server.token(asked["nonce"])} if right else {"error": "invalid_grant"},
            200 if right else 400,
        )

    def say(self, body: Any, status: int = 200) -> None:
        data = json.dumps(body).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture(scope="module")
def provider() -> Iterator[Provider]:
    with Provider() as own:
        thread = threading.Thread(target=own.serve_forever, daemon=True)
        thread.start()
        yield own
        own.shutdown()
        thread.join()


@pytest.fixture(scope="module")
def openid_service(provider, module_database_url) -> Iterator[Service]:
    with serving(
        module_database_url,
        public_url="http://servotune.example",
        oidc_issuer=provider.issuer,
        oidc_client_id="servotune",
        oidc_client_secret=SECRET,
        oidc_roles=ROLES,
    ) as running:
        yield running


@pytest.fixture(autouse=True)
def person(provider) -> None:
    provider.claims = {"email": "ana@example.com", "groups": ["everybody", "engineers"]}
    provider.header = {}


@contextmanager
def browser(service: Service) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=service.url, trust_env=False) as own:
        yield own


def begun(own: httpx.Client, provider: Provider) -> dict[str, str]:
    """Begin to sign in; return what the provider is asked."""
    reply = own.get("/sign-in")
    assert reply.status_code == 303
    target = urlsplit(reply.headers["Location"])
    assert f"{target.scheme}://{target.netloc}{target.path}" == f"{provider.issuer}/authorize"
    asked = {name: values[0] for name, values in parse_qs(target.query).items()}
    provider.codes["a code"] = asked
    return asked


def signed_in(own: httpx.Client, provider: Provider) -> httpx.Response:
    asked = begun(own, provider)
    return own.get("/sign-in/callback", params={"state": asked["state"], "code": "a code"})


def test_who_has_a_role_gets_in(openid_service, provider) -> None:
    with browser(openid_service) as own:
        asked = begun(own, provider)
        assert asked["redirect_uri"] == "http://servotune.example/sign-in/callback"
        assert (asked["client_id"], asked["response_type"], asked["code_challenge_method"]) == (
            "servotune",
            "code",
            "S256",
        )
        assert asked["scope"].split()[0] == "openid"
        reply = own.get("/sign-in/callback", params={"state": asked["state"], "code": "a code"})
        assert (reply.status_code, reply.headers["Location"]) == (303, "/"), reply.text
        who = own.get("/v1/session").json()
        assert (who["name"], who["workspace"], who["scopes"]) == (
            "ana@example.com",
            "ws_default",
            ["read", "run", "write"],
        )
        assert own.post("/v1/systems", json={}).status_code == 403  # CSRF counts for them, too
        assert own.post("/v1/systems", json={}, headers={"X-CSRF-Token": who["csrf_token"]}).status_code == 422
        # The code and the state have served.
        assert own.get("/sign-in/callback", params={"state": asked["state"], "code": "a code"}).status_code == 403


def test_the_first_role_of_the_settings_counts(openid_service, provider) -> None:
    provider.claims["groups"] = ["engineers", "lab"]
    with browser(openid_service) as own:
        signed_in(own, provider)
        assert own.get("/v1/session").json()["workspace"] == "ws_other"


WRONG: dict[str, dict[str, Any]] = {
    "no role": {"groups": ["everybody"]},
    "no groups": {"groups": None},
    "a role nowhere": {"groups": "lost"},
    "for another service": {"aud": "other"},
    "for another service too, and for its use": {"aud": ["servotune", "other"], "azp": "other"},
    "for several services, for whose use it does not say": {"aud": ["servotune", "other"]},
    "for the use of another": {"azp": "other"},
    "of another provider": {"iss": "https://evil.example"},
    "of another sign-in": {"nonce": "n"},
    "expired": {"exp": 1},
    "nobody": {"sub": None},
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_token_lets_nobody_in(openid_service, provider, case) -> None:
    provider.claims |= WRONG[case]
    with browser(openid_service) as own:
        reply = signed_in(own, provider)
        assert reply.status_code == 403
        assert reply.json()["type"].endswith("sign-in-refused")
        assert own.get("/v1/session").status_code == 401


def test_a_token_that_the_provider_has_not_signed_lets_nobody_in(openid_service, provider) -> None:
    real = provider.key
    forged = RSAKey.generate_key(2048, parameters={"kid": "first"})
    original = Provider.token

    def by_forger(self: Provider, nonce: str) -> str:
        self.key = forged
        try:
            return original(self, nonce)
        finally:
            self.key = real

    def by_shared_secret(self: Provider, nonce: str) -> str:
        now = int(time.time())
        claims = {"iss": self.issuer, "aud": "servotune", "sub": "1", "nonce": nonce, "iat": now, "exp": now + 60}
        key = OctKey.import_key(SECRET + SECRET)
        return jwt.encode({"alg": "HS256"}, claims | {"groups": ["engineers"]}, key)

    for attack in (by_forger, by_shared_secret):
        Provider.token = attack
        try:
            with browser(openid_service) as own:
                assert signed_in(own, provider).status_code == 403
        finally:
            Provider.token = original


def test_a_provider_may_change_its_key(openid_service, provider) -> None:
    provider.key = RSAKey.generate_key(2048, parameters={"kid": "second"})
    with browser(openid_service) as own:
        assert signed_in(own, provider).status_code == 303


def test_a_sign_in_belongs_to_the_browser_that_began_it(openid_service, provider) -> None:
    with browser(openid_service) as own, browser(openid_service) as other:
        asked = begun(own, provider)
        query = {"state": asked["state"], "code": "a code"}
        assert other.get("/sign-in/callback", params=query).status_code == 403  # no cookie
        begun(other, provider)
        assert other.get("/sign-in/callback", params=query).status_code == 403  # another state
        refused = own.get("/sign-in/callback", params={"state": asked["state"], "error": "access_denied"})
        assert "access_denied" in refused.json()["detail"]
        # What this service has not sealed, or has sealed too long ago, is no beginning.
        made = json.dumps({"state": asked["state"], "nonce": asked["nonce"], "verifier": "x" * 64})
        late = Fernet(base64.b64encode(bytes(32))).encrypt_at_time(made.encode(), int(time.time()) - 601).decode()
        for forged in (base64.urlsafe_b64encode(made.encode()).decode(), late, "nonsense"):
            other.cookies.clear()
            other.cookies.set("servotune_openid", forged)
            refused = other.get("/sign-in/callback", params=query)
            assert (refused.status_code, "have begun in this browser" in refused.text) == (403, True)


def test_without_a_key_nobody_is_sent_to_the_provider(sqlite_template, tmp_path, provider) -> None:
    path = tmp_path / "without.db"
    path.write_bytes(sqlite_template.read_bytes())
    settings = {"public_url": "http://x.example", "oidc_client_id": "x", "oidc_roles": ROLES, "secret_key": None}
    with serving(f"sqlite:///{path}", oidc_issuer=provider.issuer, **settings) as service:
        reply = httpx.get(service.url + "/sign-in", trust_env=False)
        assert (reply.status_code, "set SERVOTUNE_SECRET_KEY" in reply.text) == (409, True)


def test_a_provider_that_is_away_is_said_to_be(sqlite_template, tmp_path) -> None:
    path = tmp_path / "away.db"
    path.write_bytes(sqlite_template.read_bytes())
    settings = {"public_url": "http://x.example", "oidc_client_id": "x", "oidc_roles": ROLES}
    with serving(f"sqlite:///{path}", oidc_issuer="http://127.0.0.1:1/none", **settings) as service:
        reply = httpx.get(service.url + "/sign-in", trust_env=False)
        assert (reply.status_code, reply.headers["Retry-After"]) == (503, "5")
        assert reply.headers["Content-Type"] == "application/problem+json"


def test_without_a_provider_there_is_no_such_door(sqlite_service) -> None:
    assert httpx.get(sqlite_service.url + "/sign-in", trust_env=False).status_code == 404
    assert httpx.get(sqlite_service.url + "/sign-in/callback", trust_env=False).status_code == 404


@pytest.mark.parametrize(
    ("missing", "says"),
    [
        ("public_url", "SERVOTUNE_PUBLIC_URL"),
        ("oidc_client_id", "SERVOTUNE_OIDC_CLIENT_ID"),
        ("oidc_roles", "roles must be given"),
    ],
)
def test_what_belongs_together_is_asked_for(missing, says) -> None:
    given = {
        "public_url": "https://x.example", "oidc_issuer": "https://y.example", "oidc_client_id": "x",
        "oidc_client_secret": SECRET, "oidc_roles": ROLES,
    }  # fmt: skip
    assert SECRET not in repr(Settings(**given))
    del given[missing]
    with pytest.raises(ValidationError, match=says):
        Settings(**given)
