"""Being told when something ends: webhooks, alerts, and how a receiver knows that a message is genuine."""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import json
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, cast

from servotune.documents import given
from servotune.errors import ServotuneError
from servotune.replies.base import Reply
from servotune.transport import Transport


class Webhook(Reply):
    """A webhook as the service keeps it."""

    id: str
    name: str
    revision: int
    created_at: str
    url: str
    events: list[str]
    active: bool
    disabled_reason: str | None
    failures: int
    retry_at: str | None
    document: dict[str, Any]


class MadeWebhook(Webhook):
    """A new webhook; nobody can read its secret again."""

    secret: str | None


class Delivery(Reply):
    """A message to a webhook and what became of it."""

    id: str
    event: str
    status: str
    attempts: int
    next_at: str | None
    response_status: int | None
    error: str | None
    created_at: str
    finished_at: str | None
    payload: dict[str, Any]


class Alert(Reply):
    """Something that somebody should look at."""

    id: str
    kind: str
    source: str
    detail: str
    data: dict[str, Any]
    created_at: str


class SignatureError(ServotuneError):
    """A message that is not from the service, or is too old to be believed."""


class Webhooks:
    """The webhooks of the key's workspace; an admin key is needed."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def create(self, name: str, *, url: str, events: Sequence[str], active: bool = True) -> MadeWebhook:
        """Tell an address of events; keep the `secret` of what is returned for `verify`.

        Parameters
        ----------
        events : sequence of str
            `"job.succeeded"`, `"job.failed"`, `"job.cancelled"`, `"alert.validation"`, `"alert.schedule"`.
        """
        document = {"name": name, "url": url, "events": list(events), "active": active}
        return MadeWebhook(self._transport.post("/v1/webhooks", document, creates=True))

    def get(self, webhook: str) -> Webhook:
        """Return a webhook."""
        return Webhook(self._transport.get(f"/v1/webhooks/{webhook}"))

    def list(self) -> Iterator[Webhook]:
        """Yield the webhooks."""
        return self._transport.items("/v1/webhooks", Webhook)

    def update(self, webhook: str, document: Mapping[str, Any], *, etag: str | None = None) -> Webhook:
        """Replace the `document` of a webhook; by default that of the version stored now, whoever wrote it."""
        tag = etag or self._transport.send("GET", f"/v1/webhooks/{webhook}").headers["ETag"]
        response = self._transport.send("PUT", f"/v1/webhooks/{webhook}", json=document, headers={"If-Match": tag})
        return Webhook(self._transport.body(response))

    def delete(self, webhook: str) -> None:
        """Delete a webhook and its log."""
        self._transport.send("DELETE", f"/v1/webhooks/{webhook}", headers={"If-Match": "*"})

    def test(self, webhook: str) -> Delivery:
        """Send a message of the event `webhook.test`."""
        return Delivery(self._transport.post(f"/v1/webhooks/{webhook}/test", {}, creates=True))

    def deliveries(self, webhook: str, *, status: str | None = None) -> Iterator[Delivery]:
        """Yield what was sent, newest first; `status` is `"pending"`, `"delivered"` or `"failed"`."""
        return self._transport.items(f"/v1/webhooks/{webhook}/deliveries", Delivery, params=given(status=status))


class Alerts:
    """The alerts of the key's workspace."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def get(self, alert: str) -> Alert:
        """Return an alert."""
        return Alert(self._transport.get(f"/v1/alerts/{alert}"))

    def list(self, *, kind: str | None = None, source: str | None = None) -> Iterator[Alert]:
        """Yield the alerts, newest first; `kind` is `"validation"` or `"schedule"`, `source` the id of what raised them."""
        return self._transport.items("/v1/alerts", Alert, params=given(kind=kind, source=source))


def verify(
    secret: str, headers: Mapping[str, str], body: bytes, *, tolerance: float = 300.0, now: float | None = None
) -> dict[str, Any]:
    """Return the message that a receiver was sent, when it is genuine.

    The signature is `v1,base64(HMAC-SHA256(secret, "<webhook-id>.<webhook-timestamp>.<body>"))`, as
    https://www.standardwebhooks.com has it.

    Parameters
    ----------
    secret : str
        What `Webhooks.create` returned.
    headers : mapping
        Of the request; upper and lower case are the same.
    body : bytes
        As it was received.
    tolerance : float
        How far the sender's clock may be from `now` (s).
    now : float, optional
        Unix time (s); that of this machine by default.

    Raises
    ------
    SignatureError
        When it is not.
    """
    fields = {name.lower(): value for name, value in headers.items()}
    try:
        identifier, timestamp = fields["webhook-id"], int(fields["webhook-timestamp"])
        signatures = fields["webhook-signature"].split()
        key = base64.b64decode(secret.removeprefix("whsec_"), validate=True)
    except (KeyError, ValueError, binascii.Error) as error:
        message = f"a message must have an id, a timestamp and a signature, and the secret must be whole: {error}"
        raise SignatureError(message) from error
    age = (time.time() if now is None else now) - timestamp
    if abs(age) > tolerance:
        raise SignatureError(f"the age of a message must be at most {tolerance:g} s, got {age:.0f} s")
    digest = hmac.new(key, f"{identifier}.{timestamp}.".encode() + body, hashlib.sha256).digest()
    expected = b"v1," + base64.b64encode(digest)
    if not any(hmac.compare_digest(expected, signature.encode()) for signature in signatures):
        raise SignatureError("the signature must be that of the secret, got another")
    return cast("dict[str, Any]", json.loads(body))
