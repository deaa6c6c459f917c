"""HTTP/1.1 read by a compiled parser, with a bound on everything that a client may send before a request is known.

The parser (llhttp, through httptools) keeps what is incomplete for as long as it is let, and tells of requests as fast as
they come. So it is fed in pieces: bytes from which nothing follows are counted, the time of a head is, and of the requests
that a client sends without waiting only those of one piece are read ahead.
"""

from __future__ import annotations

import json
import sys
from asyncio import TimerHandle, Transport
from collections import deque
from enum import Enum, auto
from http import HTTPStatus

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from api.http.security_headers import ALWAYS, NO_PAGE
from api.problems.documents import MEDIA_TYPE, Problem

#: A request line with its headers may be so long, bytes; what is longer by more than two pieces is refused.
LONGEST_HEAD = 1 << 16
#: Headers of a request.
MOST_HEADERS = 200
#: What the parser is fed at a time, bytes.
PIECE = 1 << 12
#: Pieces that are kept while requests before them are answered; a client that is told to wait has no reason to send more.
_MOST_KEPT = 256
_ONE_LENGTH = "a request must have either one header Content-Length or Transfer-Encoding, got"
#: What the parser says, in words of ours, where it may be somebody's mistake and not another protocol.
_REFUSED = {
    "Duplicate Content-Length": f"{_ONE_LENGTH} Content-Length several times",
    "Content-Length can't be present with Transfer-Encoding": f"{_ONE_LENGTH} both",
    "Transfer-Encoding can't be present with Content-Length": f"{_ONE_LENGTH} both",
    "Invalid character in Content-Length": "Content-Length must be a whole number of bytes, got something else",
    "Empty Content-Length": "Content-Length must be a whole number of bytes, got nothing",
    "Content-Length overflow": "Content-Length must be a number of bytes below 2^64, got a larger one",
}
#: How long a client that was refused is still listened to, s: one that finds its connection closed while it sends reads no answer.
_LINGER = 2.0


class _Reading(Enum):
    NOTHING = auto()
    HEAD = auto()
    BODY = auto()


class BoundedHead(HttpToolsProtocol):
    """One connection."""

    #: Time in which a head arrives, s.
    head_seconds = 30.0
    _reading = _Reading.NOTHING
    _untold = 0  # bytes since the parser last told anything
    _why: tuple[HTTPStatus, str] | None = None
    _over = False  # what still comes is not read
    _late: TimerHandle | None = None

    def connection_made(self, transport: Transport) -> None:  # type: ignore[override]  # as in uvicorn
        """Begin; who sends nothing is not waited for longer than between two requests."""
        super().connection_made(transport)
        self._pieces: deque[bytes] = deque()
        self.timeout_keep_alive_task = self.loop.call_later(self.timeout_keep_alive, self.timeout_keep_alive_handler)

    def connection_lost(self, exc: Exception | None) -> None:
        """End."""
        self._stop_reading()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Read on."""
        if self._over:
            return
        self._unset_keepalive_if_required()
        self._pieces.extend(data[at : at + PIECE] for at in range(0, len(data), PIECE))
        self._read()

    def on_response_complete(self) -> None:
        """Go on to the next request, and read no further while there is one."""
        super().on_response_complete()
        if self.transport.is_closing():
            return
        if self.pipeline:
            self.flow.pause_reading()
        elif self._pieces:
            self._read()

    def _read(self) -> None:
        while self._pieces and not self.pipeline:
            piece = self._pieces.popleft()
            self._untold += len(piece)
            super().data_received(piece)
            if not self._over and self._untold > LONGEST_HEAD:
                self._refuse(
                    HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE,
                    f"the head of a request must be at most {LONGEST_HEAD} bytes, got more",
                )
        if len(self._pieces) > _MOST_KEPT:
            self._refuse(HTTPStatus.BAD_REQUEST, "a client must wait for the answers to its requests")
        if self._late is None and not (self._over or self._answering):
            self._late = self.loop.call_later(self.head_seconds, self._too_late)

    @property
    def _answering(self) -> bool:
        return self.cycle is not None and not self.cycle.response_complete

    def on_message_begin(self) -> None:
        """Read a head."""
        self._reading = _Reading.HEAD
        super().on_message_begin()

    def on_header(self, name: bytes, value: bytes) -> None:
        """Take a header; those behind a body are nobody's."""
        if self._reading is not _Reading.HEAD:
            return
        super().on_header(name, value)
        if len(self.headers) > MOST_HEADERS:
            self._why = (
                HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE,
                f"a request must have at most {MOST_HEADERS} headers, got more",
            )
            raise ValueError(self._why[1])

    def on_headers_complete(self) -> None:
        """Let the request be answered."""
        hosts = sum(name == b"host" for name, _ in self.headers)
        if hosts > 1 or (hosts == 0 and self.parser.get_http_version() == "1.1"):  # RFC 9112, 3.2
            self._why = (HTTPStatus.BAD_REQUEST, f"a request must have one header Host, got {hosts}")
            raise ValueError(self._why[1])
        super().on_headers_complete()
        self._told(_Reading.BODY)

    def on_body(self, body: bytes) -> None:
        """Hand a part of the body on: who reads it has a limit for it."""
        self._untold = 0
        super().on_body(body)

    def on_message_complete(self) -> None:
        """Wait for the next request."""
        self._told(_Reading.NOTHING)
        super().on_message_complete()

    def handle_websocket_upgrade(self) -> None:
        """Leave the connection to the protocol of WebSockets."""
        self._stop_reading()
        super().handle_websocket_upgrade()

    def send_400_response(self, _msg: str) -> None:
        """Refuse what the parser does not take, with what it says of it; that holds nothing of the request."""
        told = str(sys.exception() or "") or "it cannot be read"
        detail = _REFUSED.get(told, f"a request must be well-formed HTTP/1.1 (RFC 9112), got another one: {told}")
        self._refuse(*(self._why or (HTTPStatus.BAD_REQUEST, detail)))

    def _told(self, reading: _Reading) -> None:
        self._reading, self._untold = reading, 0
        self._stop_waiting()

    def _too_late(self) -> None:
        self._late = None
        if self._reading is _Reading.HEAD:
            self._refuse(
                HTTPStatus.REQUEST_TIMEOUT,
                f"the head of a request must arrive within {self.head_seconds:g} s, got a part of it",
            )
        else:
            self._stop_reading()
            self.transport.close()

    def _refuse(self, status: HTTPStatus, detail: str) -> None:
        """Answer instead of the application, where it has not begun to answer; read nothing more."""
        in_body = self._reading is _Reading.BODY
        self._stop_reading()
        if self.transport.is_closing():
            return
        if self._answering and not in_body:
            self.cycle.keep_alive = False  # requests that came whole are answered, and that is the end
            return
        begun = self._answering and (self.cycle.response_started or bool(self.pipeline))
        if not begun:
            self.transport.write(_answer(status, detail, self.server_state.default_headers))
        if in_body and self.cycle is not None:
            self.cycle.disconnected = True
            self.cycle.message_event.set()
        if begun or not self.transport.can_write_eof():
            self.transport.close()
            return
        self.flow.resume_reading()
        self.transport.write_eof()
        self.loop.call_later(_LINGER, self.transport.close)

    def _stop_reading(self) -> None:
        self._over = True
        self._pieces.clear()
        self._stop_waiting()

    def _stop_waiting(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None


def _answer(status: HTTPStatus, detail: str, default: list[tuple[bytes, bytes]]) -> bytes:
    kind = status.phrase.lower().replace(" ", "-")
    body = json.dumps(Problem(status, kind, detail).document()).encode()
    headers = {
        **ALWAYS,
        "Content-Security-Policy": NO_PAGE,
        "Content-Type": MEDIA_TYPE,
        "Content-Length": str(len(body)),
        "Connection": "close",
    }
    lines = [*default, *((name.lower().encode(), value.encode()) for name, value in headers.items())]
    first = f"HTTP/1.1 {status.value} {status.phrase}\r\n".encode()
    return b"".join([first, *(b"%s: %s\r\n" % line for line in lines), b"\r\n", body])
