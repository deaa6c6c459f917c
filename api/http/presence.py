"""What lasts longer than a moment ends when its caller may not come in any more: event streams, and WebSockets."""

from __future__ import annotations

import asyncio
import logging
from contextlib import suppress

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.services.access.principal_cache import Callers
from api.services.operation.app_context import Caller
from storage.errors import UNAVAILABLE

#: s between two looks at a caller's key or sign-in.
INTERVAL = 1.0
#: Close code of a WebSocket whose opener may not stay (RFC 6455, 7.4.1: policy violation).
POLICY_VIOLATION = 1008

_log = logging.getLogger("servotune.api")


class Stay:
    """One request of a caller, cut off when its key is revoked, expires, or its browser signs out."""

    def __init__(self, callers: Callers, caller: Caller, send: Send) -> None:
        self._callers = callers
        self._caller = caller
        self._send = send
        self._over = False
        self._watching: asyncio.Task[None] | None = None

    async def serve(self, app: ASGIApp, scope: Scope, receive: Receive) -> None:
        """Let the application answer; end the answer when the caller is out."""
        own = asyncio.current_task()
        assert own is not None

        async def send(message: Message) -> None:
            if self._watching is None and _lasts(message):
                self._watching = asyncio.create_task(self._watch(own))
            await self._send(message)

        try:
            await app(scope, receive, send)
        except asyncio.CancelledError:
            if not self._over:
                raise
            own.uncancel()
            if scope["type"] == "websocket":
                reason = "the key or the sign-in does not open any more"
                await self._send({"type": "websocket.close", "code": POLICY_VIOLATION, "reason": reason})
            else:
                await self._send({"type": "http.response.body", "body": b"", "more_body": False})
        finally:
            if self._watching is not None:
                self._watching.cancel()
                with suppress(asyncio.CancelledError):
                    await self._watching

    async def _watch(self, served: asyncio.Task[object]) -> None:
        while True:
            await asyncio.sleep(INTERVAL)
            try:
                if await self._callers.opens(self._caller.principal):
                    continue
            except UNAVAILABLE as error:  # whoever was let in stays while nobody can be asked
                _log.debug("whether %s may stay cannot be asked: %s", self._caller.principal, error)
                continue
            self._over = True
            served.cancel()
            return


def _lasts(message: Message) -> bool:
    if message["type"] == "websocket.accept":
        return True
    return message["type"] == "http.response.start" and Headers(raw=message["headers"]).get(
        "content-type", ""
    ).startswith("text/event-stream")
