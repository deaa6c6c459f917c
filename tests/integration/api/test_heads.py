"""What a client may send before its request is known: refused in order beyond the bounds, and never within them, however it is cut."""

from __future__ import annotations

import asyncio
import json
import random
import socket
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

import pytest
import uvicorn
from starlette.types import Receive, Scope, Send
from uvicorn.server import ServerState

from api.http.limits import LONGEST_HEAD, MOST_HEADERS, PIECE, BoundedHead
from api.http.security_headers import ALWAYS
from api.processes.serving import configuration
from tests.integration.coroutines import run

PATIENCE = 60.0


async def echo(scope: Scope, receive: Receive, send: Send) -> None:
    """Answer with what was understood."""
    size, more = 0, True
    while more:
        message = await receive()
        if message["type"] == "http.disconnect":
            return
        size, more = size + len(message.get("body", b"")), message.get("more_body", False)
    if scope["path"] == "/late":
        await asyncio.sleep(0.05)
    known = {"path": scope["path"], "headers": len(scope["headers"]), "body": size}
    body = json.dumps(known).encode()
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"%d" % len(body))]})
    await send({"type": "http.response.body", "body": body})


@dataclass
class Connection:
    """A connection whose other end is a socket; `feed` decides itself what arrives together."""

    protocol: BoundedHead
    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter

    async def feed(self, *chunks: bytes) -> None:
        for chunk in chunks:
            self.protocol.data_received(chunk)
            await asyncio.sleep(0)

    async def answer(self) -> tuple[int, dict[str, str], dict[str, Any]]:
        """Return status, headers and document of the next answer."""
        head = (await asyncio.wait_for(self.reader.readuntil(b"\r\n\r\n"), PATIENCE)).decode().split("\r\n")
        headers = dict(line.split(": ", 1) for line in head[1:-2])
        body = await asyncio.wait_for(self.reader.readexactly(int(headers["content-length"])), PATIENCE)
        return int(head[0].split()[1]), headers, json.loads(body)

    async def refused(self, status: int, *words: str) -> None:
        """Hold that the next answer is this refusal, and the last one."""
        got, headers, problem = await self.answer()
        assert (got, problem["status"]) == (status, status)
        assert all(word in problem["detail"] for word in words), problem
        assert headers["content-type"] == "application/problem+json"
        assert {name: headers[name.lower()] for name in ALWAYS} == ALWAYS
        await self.ended()

    async def ended(self) -> None:
        assert await asyncio.wait_for(self.reader.read(), PATIENCE) == b""


def connected(check: Callable[[Connection], Awaitable[None]], *, head_seconds: float = 30.0) -> None:
    """Run a check on a connection of its own."""

    class Impatient(BoundedHead):
        pass

    Impatient.head_seconds = head_seconds

    async def both() -> None:
        loop = asyncio.get_running_loop()
        here, there = socket.socketpair()
        config = configuration(echo)
        config.load()
        made = Impatient(config, ServerState(), {})
        made.timeout_keep_alive = min(made.timeout_keep_alive, PATIENCE)
        await loop.connect_accepted_socket(lambda: made, there)
        reader, writer = await asyncio.open_connection(sock=here)
        try:
            await check(Connection(made, reader, writer))
        finally:
            writer.close()
            made.transport.abort()
            await asyncio.gather(*made.server_state.tasks, return_exceptions=True)
            await asyncio.sleep(0)

    run(both())


def request(path: str = "/", *headers: bytes, body: bytes | None = None, length: int | None = None) -> bytes:
    """Return a request; its head of so many bytes, filled up by one more header."""
    lines = [b"%s %s HTTP/1.1" % (b"GET" if body is None else b"POST", path.encode()), b"host: here", *headers]
    if body is not None:
        lines.append(b"content-length: %d" % len(body))
    if length is not None:
        lines.append(b"x: " + b"y" * (length - sum(len(line) + 2 for line in lines) - 7))
    head = b"\r\n".join(lines) + b"\r\n\r\n"
    assert length is None or len(head) == length
    return head + (body or b"")


def cut(data: bytes, *, seed: int) -> list[bytes]:
    """Return the data in pieces of any size from a byte to several thousand."""
    chance, found = random.Random(seed), []
    while data:
        size = int(2 ** chance.uniform(0, 13))
        found.append(data[:size])
        data = data[size:]
    return found


def test_the_longest_head_passes_however_it_is_cut() -> None:
    async def check(connection: Connection) -> None:
        whole = request("/long", length=LONGEST_HEAD)
        for seed in range(20):
            await connection.feed(*cut(whole, seed=seed) if seed else [whole])
            assert (await connection.answer())[2] == {"path": "/long", "headers": 2, "body": 0}

    connected(check)


def test_a_head_passes_that_begins_where_another_request_ends() -> None:
    async def check(connection: Connection) -> None:
        one, two = request("/one", body=b"b" * (2 * PIECE)), request("/two", length=LONGEST_HEAD)
        for share in (1, 7, PIECE - 1, PIECE, PIECE + 1, 3 * PIECE, LONGEST_HEAD - 1):
            await connection.feed(one + two[:share], two[share:])
            assert (await connection.answer())[2]["body"] == 2 * PIECE
            assert (await connection.answer())[2]["path"] == "/two"
        for seed in range(10):
            await connection.feed(*cut(one + two + request("/three"), seed=seed))
            assert [(await connection.answer())[2]["path"] for _ in range(3)] == ["/one", "/two", "/three"]

    connected(check)


def test_a_head_may_be_cut_anywhere() -> None:
    async def check(connection: Connection) -> None:
        whole = request("/a", b"accept: */*", body=b"body")
        for at in range(1, len(whole)):
            await connection.feed(whole[:at], whole[at:])
            assert (await connection.answer())[2] == {"path": "/a", "headers": 3, "body": 4}
        await connection.feed(*(whole[i : i + 1] for i in range(len(whole))))
        assert (await connection.answer())[0] == 200

    connected(check)


def test_many_requests_in_one_chunk_are_answered_in_their_order() -> None:
    async def check(connection: Connection) -> None:
        paths = [f"/{number}" for number in range(300)]
        await connection.feed(b"".join(request(path) for path in paths))
        assert len(connection.protocol.pipeline) <= PIECE // len(request("/0"))
        assert [(await connection.answer())[2]["path"] for _ in paths] == paths

    connected(check)


def test_one_connection_carries_any_number_of_requests() -> None:
    async def check(connection: Connection) -> None:
        for number in range(3 * LONGEST_HEAD // 1000):
            await connection.feed(request(f"/{number}", length=1000))
            assert (await connection.answer())[2]["path"] == f"/{number}"
        await connection.feed(*[b"\r\n" * 100, request("/", body=b"b" * (1 << 20))])
        assert (await connection.answer())[2]["body"] == 1 << 20

    connected(check)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(
    ("sent", "status", "word"),
    [
        (request("/", b"x: " + b"y" * (LONGEST_HEAD + 3 * PIECE)), 431, f"at most {LONGEST_HEAD} bytes"),
        (request("/" + "p" * (LONGEST_HEAD + 3 * PIECE)), 431, f"at most {LONGEST_HEAD} bytes"),
        (b"\r\n" * LONGEST_HEAD, 431, f"at most {LONGEST_HEAD} bytes"),
        (request("/", *[b"a: b"] * MOST_HEADERS), 431, f"at most {MOST_HEADERS} headers"),
        (request("/", b"x: y" * 20)[:-2] + b"no header\r\n\r\n", 400, "HTTP/1.1"),
        (b"nonsense\r\n\r\n", 400, "HTTP/1.1"),
        (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(300), 400, "HTTP/1.1"),
        (b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", 400, "HTTP/1.1"),
        (b"CONNECT there:80 HTTP/1.1\r\nhost: there\r\n\r\n", 400, "HTTP/1.1"),
        (b"GET /\xff HTTP/1.1\r\nhost: here\r\n\r\n", 400, "HTTP/1.1"),
        (b"GET / HTTP/1.1\r\n\r\n", 400, "one header Host, got 0"),
        (request("/", b"host: there"), 400, "one header Host, got 2"),
        (request("/", b"content-length: 1", b"content-length: 2"), 400, "got Content-Length several times"),
        (
            request("/", b"content-length: one"),
            400,
            "Content-Length must be a whole number of bytes, got something else",
        ),
        (request("/", b"content-length:"), 400, "Content-Length must be a whole number of bytes, got nothing"),
        (request("/", b"content-length: " + b"9" * 30), 400, "below 2^64, got a larger one"),
        (request("/", b"wrong name: 1"), 400, "well-formed HTTP/1.1 (RFC 9112), got another one: Invalid header token"),
        (
            request("/", b"content-length: 1", b"transfer-encoding: chunked"),
            400,
            "Content-Length or Transfer-Encoding, got both",
        ),
        (request("/", b"transfer-encoding: chunked") + b"nonsense\r\n", 400, "HTTP/1.1"),
        (
            request("/", b"transfer-encoding: chunked") + b"0\r\nx: " + b"y" * (LONGEST_HEAD + 3 * PIECE),
            431,
            f"at most {LONGEST_HEAD} bytes",
        ),
    ],
)
def test_what_is_refused(sent: bytes, status: int, word: str, seed: int) -> None:
    async def check(connection: Connection) -> None:
        await connection.feed(*cut(sent, seed=seed) if seed else [sent])
        await connection.refused(status, word)

    connected(check)


def test_as_many_headers_as_are_allowed_and_those_behind_a_body() -> None:
    async def check(connection: Connection) -> None:
        await connection.feed(request("/", *[b"a: b"] * (MOST_HEADERS - 1)))
        assert (await connection.answer())[2]["headers"] == MOST_HEADERS
        trailers = b"".join(b"authorization: %d\r\n" % number for number in range(2 * MOST_HEADERS))
        await connection.feed(request("/", b"transfer-encoding: chunked") + b"3\r\nabc\r\n0\r\n" + trailers + b"\r\n")
        assert (await connection.answer())[2] == {"path": "/", "headers": 2, "body": 3}

    connected(check)


def test_requests_in_front_of_nonsense_are_answered() -> None:
    async def check(connection: Connection) -> None:
        await connection.feed(request("/late") + request("/next") + b"nonsense\r\n\r\n" + request("/lost"))
        assert [(await connection.answer())[2]["path"] for _ in range(2)] == ["/late", "/next"]
        await connection.ended()

    connected(check)


def test_who_sends_on_and_on_without_waiting_is_not_kept_in_memory() -> None:
    async def check(connection: Connection) -> None:
        much = request("/") * (PIECE // 16)
        for _ in range(1000):  # as if nothing could make the network wait
            connection.protocol.data_received(much)
        assert not connection.protocol._pieces  # what came and is not to be answered
        while (await asyncio.wait_for(connection.reader.read(1 << 16), PATIENCE)) != b"":
            pass

    connected(check)


@pytest.mark.parametrize("begun", [request("/")[:-2], b"GET", b"\r\n"])
def test_a_head_that_does_not_come_to_an_end_is_not_waited_for(begun: bytes) -> None:
    async def check(connection: Connection) -> None:
        await connection.feed(request("/"))
        assert (await connection.answer())[0] == 200
        await connection.feed(begun)
        if begun.strip():
            await connection.refused(408, "within 0.1 s")
        else:  # nothing of a request
            await connection.ended()

    connected(check, head_seconds=0.1)


def test_uvicorn_serves_with_the_bounds() -> None:
    config = configuration(echo)
    config.load()
    assert isinstance(config, uvicorn.Config)
    assert config.http_protocol_class is BoundedHead
