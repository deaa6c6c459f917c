"""Sign-in through an OpenID provider: the authorization code flow with PKCE and a nonce.

OpenID Connect Core 1.0, section 3.1; RFC 7636. What the provider says of a person, one of its claims, decides what they may do here: the
setting names the roles, and who has none of them stays outside. Signatures and claims are checked by `joserfc`.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import json
import secrets
import threading
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any
from urllib.parse import quote, urlencode

import httpx
from joserfc import jwt
from joserfc.errors import JoseError
from joserfc.jwk import KeySet

from api.problems.documents import Problem
from api.settings import Role, Settings

#: Signatures that only the provider can make; never one with a shared secret, and never none.
_ALGORITHMS = ("RS256", "PS256", "ES256", "RS384", "PS384", "ES384", "RS512", "PS512", "ES512", "EdDSA", "Ed25519")
#: How long (s) what a provider says of itself is believed, how long it may take to answer, how far its clock may be off.
_BELIEVED, _TIMEOUT, _LEEWAY = 3600.0, 10.0, 60


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempt:
    """What a browser keeps while its user is at the provider."""

    state: str
    nonce: str
    verifier: str

    def text(self) -> str:
        """Return it as the vault seals it."""
        return json.dumps(asdict(self))

    @classmethod
    def of(cls, text: str | None) -> Attempt:
        """Read what `text` wrote, as the vault has given it back.

        Raises
        ------
        Problem
            403 when it did not: nothing was sealed here in the last 10 minutes.
        """
        if text is None:
            raise _refused("the sign-in must have begun in this browser, within the last 10 minutes")
        return cls(**json.loads(text))


@dataclass(frozen=True, slots=True, kw_only=True)
class Person:
    """Who has signed in at the provider, and what they may do here."""

    name: str
    role: Role


class Provider:
    """The provider of the settings.

    Parameters
    ----------
    settings : Settings
        Those that begin with ``oidc_``, and ``public_url``.
    """

    def __init__(self, settings: Settings) -> None:
        assert settings.oidc_issuer is not None
        assert settings.oidc_client_id is not None
        assert settings.public_url is not None
        self._settings = settings
        self._issuer = settings.oidc_issuer
        self._client_id = settings.oidc_client_id
        self._redirect_uri = settings.public_url.rstrip("/") + "/sign-in/callback"
        self._lock = threading.Lock()
        self._found: tuple[float, Mapping[str, Any], KeySet] | None = None

    def begin(self) -> tuple[str, Attempt]:
        """Return where the browser is sent, and what it keeps meanwhile."""
        attempt = Attempt(
            state=secrets.token_urlsafe(24), nonce=secrets.token_urlsafe(24), verifier=secrets.token_urlsafe(48)
        )
        challenge = base64.urlsafe_b64encode(hashlib.sha256(attempt.verifier.encode()).digest()).decode().rstrip("=")
        query = {
            "response_type": "code",
            "client_id": self._client_id,
            "redirect_uri": self._redirect_uri,
            "scope": "openid profile email",
            "state": attempt.state,
            "nonce": attempt.nonce,
            "code_challenge": challenge,
            "code_challenge_method": "S256",
        }
        endpoint = str(self._look()[0]["authorization_endpoint"])
        return f"{endpoint}{'&' if '?' in endpoint else '?'}{urlencode(query)}", attempt

    def finish(self, attempt: Attempt, *, state: str, code: str) -> Person:
        """Return who came back with a code.

        Raises
        ------
        Problem
            403 when anything about it is wrong, 503 when the provider does not answer.
        """
        if not hmac.compare_digest(state.encode(), attempt.state.encode()):
            raise _refused("the sign-in must have begun in this browser, got another state")
        claims = self._claims(self._exchange(code, attempt), attempt)
        names = (claims.get(key) for key in ("email", "preferred_username", "name", "sub"))
        name = next(str(found) for found in names if found)
        groups = _at(claims, self._settings.oidc_claim)
        held = {str(group) for group in (groups if isinstance(groups, list) else [groups])}
        for group, role in self._settings.oidc_roles.items():
            if group in held:
                return Person(name=name[:200], role=role)
        raise _refused(f"the provider's claim {self._settings.oidc_claim} must name a role of this service, got others")

    def _exchange(self, code: str, attempt: Attempt) -> str:
        body = {
            "grant_type": "authorization_code",
            "code": code,
            "redirect_uri": self._redirect_uri,
            "code_verifier": attempt.verifier,
        }
        auth = None
        if self._settings.oidc_client_secret is None:
            body["client_id"] = self._client_id
        else:  # RFC 6749, 2.3.1: both are form-encoded first
            auth = (quote(self._client_id), quote(self._settings.oidc_client_secret.get_secret_value()))
        reply = self._ask("POST", str(self._look()[0]["token_endpoint"]), data=body, auth=auth)
        token = reply.get("id_token")
        if not isinstance(token, str):
            raise _refused("the provider must answer the code with an id_token, got none")
        return token

    def _claims(self, token: str, attempt: Attempt) -> Mapping[str, Any]:
        rules = jwt.JWTClaimsRegistry(
            leeway=_LEEWAY,
            iss={"essential": True, "value": self._issuer},
            aud={"essential": True, "value": self._client_id},
            sub={"essential": True},
            exp={"essential": True},
            iat={"essential": True},
            nonce={"essential": True, "value": attempt.nonce},
        )
        try:
            try:
                found = jwt.decode(token, self._look()[1], algorithms=list(_ALGORITHMS))
            except (JoseError, ValueError):  # signed with a key that the provider has since we last asked, perhaps
                found = jwt.decode(token, self._look(anew=True)[1], algorithms=list(_ALGORITHMS))
            rules.validate(found.claims)
            self._check_party(found.claims)
        except (JoseError, ValueError) as error:
            raise _refused(f"the provider's id_token must be valid, got: {type(error).__name__}") from error
        return found.claims

    def _check_party(self, claims: Mapping[str, Any]) -> None:
        """Refuse a token that was made for another client (OpenID Connect Core 1.0, section 3.1.3.7, points 4 and 5)."""
        party = claims.get("azp")
        several = isinstance(claims["aud"], list) and len(claims["aud"]) > 1
        if party != self._client_id and (several or party is not None):
            raise ValueError("azp")

    def _look(self, *, anew: bool = False) -> tuple[Mapping[str, Any], KeySet]:
        """Return what the provider says of itself, and its keys."""
        with self._lock:
            if anew or self._found is None or time.monotonic() - self._found[0] > _BELIEVED:
                metadata = self._ask("GET", self._issuer.rstrip("/") + "/.well-known/openid-configuration")
                if metadata.get("issuer") != self._issuer:
                    raise _unavailable(f"the OpenID provider must call itself {self._issuer}, got another name")
                found = self._ask("GET", str(metadata["jwks_uri"]))
                # a document from outside, which the library checks
                keys = KeySet.import_key_set(found)  # type: ignore[arg-type]
                self._found = (time.monotonic(), metadata, keys)
            return self._found[1], self._found[2]

    def _ask(self, method: str, url: str, **given: Any) -> dict[str, Any]:
        try:
            reply = httpx.request(method, url, timeout=_TIMEOUT, headers={"Accept": "application/json"}, **given)
            found = reply.json()
        except (httpx.HTTPError, ValueError) as error:
            raise _unavailable("the OpenID provider does not answer; try again") from error
        if reply.status_code in {400, 401, 403} and method == "POST":
            raise _refused("the OpenID provider refuses the code")
        if not reply.is_success or not isinstance(found, dict):
            raise _unavailable("the OpenID provider does not answer as one; try again")
        return found


def _at(claims: Mapping[str, Any], path: str) -> Any:
    """Return a claim, also one inside of another (``realm_access.roles``)."""
    node: Any = claims
    for part in path.split("."):
        node = node.get(part) if isinstance(node, Mapping) else None
    return node


def _refused(detail: str) -> Problem:
    return Problem(403, "sign-in-refused", detail)


def _unavailable(detail: str) -> Problem:
    return Problem(503, "unavailable", detail, headers={"Retry-After": "5"})
