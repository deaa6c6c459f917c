"""Sends what webhooks are to be told: signed, tried again later and later, never to a private address.

The signature is that of the Standard Webhooks specification (https://www.standardwebhooks.com), version 1::

    webhook-signature: v1,base64(HMAC-SHA256(secret, "<webhook-id>.<webhook-timestamp>.<body>"))

A message that is tried again keeps its id, by which a receiver knows it; the timestamp, seconds of Unix time, is that of
the attempt, and keeps anybody from sending a message again that was overheard long ago.
"""

from __future__ import annotations

import asyncio
import base64
import hashlib
import hmac
import json
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from http import HTTPStatus
from importlib.metadata import version

import httpx

from api.services.operation.app_context import Installation
from api.services.webhooks.ssrf_guard import Address, ForbiddenUrlError, Lookup, checked_url, judged, look_up
from storage.errors import UNAVAILABLE, VaultError
from storage.models.base import utc_now
from storage.repositories import webhooks
from storage.repositories.webhooks import Parcel

INTERVAL = 1.0
"""s between two looks."""

#: How long a receiver may take, all in all.
TIMEOUT = timedelta(seconds=15)
#: The pauses after the first, the second, ... failure in a row; the last one is repeated.
PAUSES = tuple(timedelta(seconds=s) for s in (5, 30, 120, 600, 3600, 3 * 3600, 6 * 3600, 12 * 3600, 24 * 3600))
#: How often a message is tried, and how many failures in a row disable a webhook: with the pauses above two and four days.
MOST_ATTEMPTS, MOST_FAILURES = 10, 12

#: Messages under way at the same time, one for each webhook; what this process has taken it answers for so long.
_MOST_UNDER_WAY = 64
_LEASE = 4 * TIMEOUT

_log = logging.getLogger(__name__)


def signature(secret: str, *, message_id: str, timestamp: int, body: bytes) -> str:
    """Return the value of ``webhook-signature``."""
    key = base64.b64decode(secret.removeprefix("whsec_"))
    signed = f"{message_id}.{timestamp}.".encode() + body
    return "v1," + base64.b64encode(hmac.new(key, signed, hashlib.sha256).digest()).decode()


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What became of an attempt; ``error`` is None for one that arrived."""

    error: str | None
    response_status: int | None = None

    @property
    def gone(self) -> bool:
        """Whether the receiver wants nothing more (RFC 9110, 15.5.11)."""
        return self.response_status == HTTPStatus.GONE


class Courier:
    """One for each process of the service; of two that see the same message, one sends it.

    Parameters
    ----------
    lookup : callable
        The addresses of a name.
    clock : callable
        The time.
    """

    def __init__(
        self, service: Installation, *, lookup: Lookup = look_up, clock: Callable[[], datetime] = utc_now
    ) -> None:
        self._service = service
        self._lookup = lookup
        self._clock = clock
        self._under_way: dict[str, asyncio.Task[None]] = {}
        self._client = httpx.AsyncClient(
            timeout=TIMEOUT.total_seconds(),
            trust_env=False,  # a proxy would look the name up again
            follow_redirects=False,  # where to has not been judged
            verify=httpx.create_ssl_context(),
            limits=httpx.Limits(max_keepalive_connections=0),
            headers={"User-Agent": f"servotune/{version('servotune')}", "Content-Type": "application/json"},
        )

    async def run(self) -> None:
        """Look for messages until cancelled."""
        away = False
        while True:
            try:
                await self.start_due()
                away = False
            except UNAVAILABLE as error:
                if not away:  # say it once, not every second
                    _log.warning("the webhooks have to wait for the database: %s", error)
                away = True
            await asyncio.sleep(INTERVAL)

    async def start_due(self) -> int:
        """Start to send what is due; return how many messages that were.

        Raises
        ------
        storage.errors.UNAVAILABLE
            When the database does not answer.
        """
        busy = frozenset(self._under_way)
        parcels = await asyncio.to_thread(self._claim, busy)
        for parcel in parcels:
            self._under_way[parcel.webhook_id] = asyncio.create_task(self._deliver(parcel))
        return len(parcels)

    async def settle(self) -> None:
        """Wait until nothing is under way."""
        await asyncio.gather(*self._under_way.values(), return_exceptions=True)

    async def close(self) -> None:
        """Stop in the middle: what was under way is sent again when its lease is over."""
        for task in self._under_way.values():
            task.cancel()
        await self.settle()
        await self._client.aclose()

    def _claim(self, busy: frozenset[str]) -> list[Parcel]:
        with self._service.database.session() as session:
            room = _MOST_UNDER_WAY - len(busy)
            return webhooks.claim_due(session, now=self._clock(), lease=_LEASE, limit=room, busy=busy)

    async def _deliver(self, parcel: Parcel) -> None:
        try:
            outcome = await self._attempt(parcel)
            await asyncio.to_thread(self._write, parcel, outcome)
        except UNAVAILABLE as error:
            _log.warning("what became of message %s could not be written down: %s", parcel.id, error)
        finally:
            del self._under_way[parcel.webhook_id]

    async def _attempt(self, parcel: Parcel) -> Outcome:
        try:
            async with asyncio.timeout(TIMEOUT.total_seconds()):
                status = await self._send(parcel)
        except TimeoutError:
            return Outcome(error=f"the receiver must answer within {TIMEOUT.total_seconds():g} s")
        except ForbiddenUrlError as error:
            return Outcome(error=f"the url {error}")
        except VaultError as error:
            return Outcome(error=error.message)
        except (httpx.HTTPError, httpx.InvalidURL, OSError) as error:
            return Outcome(error=f"the receiver cannot be reached: {type(error).__name__}")
        if HTTPStatus(200) <= status < HTTPStatus(300):
            return Outcome(error=None, response_status=status)
        what = "a redirection, which is not followed" if status // 100 == 3 else "another"
        return Outcome(error=f"the receiver must answer with 2xx, got {what}", response_status=status)

    async def _send(self, parcel: Parcel) -> int:
        """Send a message to an address that was judged; return the status of the answer, whose body nobody reads."""
        secret = self._service.vault.open(parcel.secret)
        url = checked_url(parcel.url)
        allowed = self._service.settings.webhook_networks
        addresses = await asyncio.to_thread(judged, url, allowed=allowed, lookup=self._lookup)
        if not addresses:
            raise ForbiddenUrlError(f"must have a host whose name means an address, got {url.host}")
        body = json.dumps(parcel.payload, ensure_ascii=False, separators=(",", ":")).encode()
        timestamp = int(self._clock().timestamp())
        headers = {
            "Host": url.netloc.decode("ascii"),
            "webhook-id": parcel.id,
            "webhook-timestamp": str(timestamp),
            "webhook-signature": signature(secret, message_id=parcel.id, timestamp=timestamp, body=body),
        }
        *others, last = addresses
        for address in others:
            try:
                return await self._post(url, address, body, headers)
            except httpx.ConnectError:
                continue
        return await self._post(url, last, body, headers)

    async def _post(self, url: httpx.URL, address: Address, body: bytes, headers: Mapping[str, str]) -> int:
        request = self._client.build_request(
            "POST",
            url.copy_with(host=str(address)),
            content=body,
            headers=headers,
            extensions={"sni_hostname": url.raw_host.decode("ascii")},  # the certificate must be that of the name
        )
        answer = await self._client.send(request, stream=True)
        await answer.aclose()
        return answer.status_code

    def _write(self, parcel: Parcel, outcome: Outcome) -> None:
        with self._service.database.session() as session:
            if outcome.error is None:
                assert outcome.response_status is not None
                webhooks.delivered(session, parcel, response_status=outcome.response_status)
                return
            failures = parcel.failures + 1
            webhooks.failed(
                session,
                parcel,
                error=outcome.error,
                response_status=outcome.response_status,
                until=self._clock() + PAUSES[min(failures, len(PAUSES)) - 1],
                last=parcel.attempt >= MOST_ATTEMPTS or outcome.gone,
            )
            if outcome.gone:
                webhooks.disable(session, parcel, reason="the receiver answered 410 Gone")
            elif failures >= MOST_FAILURES:
                reason = f"{failures} attempts in a row failed, the last one because {outcome.error}"
                webhooks.disable(session, parcel, reason=reason)
