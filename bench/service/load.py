"""Clients that each ask once a second, as people with a browser open do: how long reads take, and whether anything fails.

They share the machine with the service, so they must cost little beside it: each is a connection of its own that writes
requests which are made once, and reads answers with a compiled parser. Every answer's status and document are looked at.
"""

from __future__ import annotations

import asyncio
import json
import random
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

import httptools

#: The longest time that an answer is waited for, s.
_PATIENCE = 30.0

SYSTEM = {
    "name": "lag",
    "blocks": {
        "u": {"kind": "input"},
        "lag": {"kind": "transfer_function", "numerator": [1], "denominator": [0.5, 1]},
    },
    "connections": [{"from": "u", "to": "lag"}],
    "outputs": {"y": "lag"},
}


@dataclass
class Outcome:
    """What came of a load: statuses, and the times (s) of reads and of writes."""

    statuses: Counter[int] = field(default_factory=Counter)
    reads: list[float] = field(default_factory=list)
    writes: list[float] = field(default_factory=list)
    failures: Counter[str] = field(default_factory=Counter)

    def percentile(self, share: float) -> float:
        """Return the time below which this share of the reads was."""
        ordered = sorted(self.reads)
        return ordered[min(int(share * len(ordered)), len(ordered) - 1)]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Question:
    """A request as it is sent, the status that its answer must have, and what its document must be."""

    sent: bytes
    status: int
    fits: Callable[[Any], bool]
    writes: bool = False


class _AnswerError(Exception):
    """The connection was closed, or the answer was no document of the kind that was asked for."""


class _Connection(asyncio.Protocol):
    """One client's connection: a question at a time."""

    def __init__(self) -> None:
        self._parser = httptools.HttpResponseParser(self)
        self._answer: asyncio.Future[tuple[int, bytes, bytes]] | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport

    def connection_lost(self, exc: Exception | None) -> None:
        self._fail(exc or _AnswerError("the connection was closed"))

    def data_received(self, data: bytes) -> None:
        try:
            self._parser.feed_data(data)
        except httptools.HttpParserError as error:
            self._fail(error)
            self.transport.close()

    def on_message_begin(self) -> None:
        self._kind, self._body = b"", bytearray()

    def on_header(self, name: bytes, value: bytes) -> None:
        if name.lower() == b"content-type":
            self._kind = value

    def on_body(self, body: bytes) -> None:
        self._body += body

    def on_message_complete(self) -> None:
        if self._answer is not None and not self._answer.done():
            self._answer.set_result((self._parser.get_status_code(), self._kind, bytes(self._body)))

    def _fail(self, error: Exception) -> None:
        if self._answer is not None and not self._answer.done():
            self._answer.set_exception(error)

    async def ask(self, question: _Question) -> tuple[int, Any]:
        """Return the status and the document of the answer.

        Raises
        ------
        OSError, TimeoutError, _AnswerError, httptools.HttpParserError
            When there is none, or another one than was asked for.
        """
        if self.transport.is_closing():
            raise _AnswerError("the connection was closed")
        self._answer = asyncio.get_running_loop().create_future()
        self.transport.write(question.sent)
        async with asyncio.timeout(_PATIENCE):
            status, kind, body = await self._answer
        try:
            document = json.loads(body)
            fits = status != question.status or question.fits(document)
        except (KeyError, TypeError, ValueError):
            fits = False
        if not fits:
            raise _AnswerError(f"{status}, {kind.decode()}, {len(body)} bytes")
        return status, document


@dataclass(frozen=True, slots=True)
class _Questions:
    """What the clients ask: nine times in ten one of the reads, else the write."""

    host: str
    key: str

    def reads(self, known: str) -> list[_Question]:
        return [
            self._read(f"/v1/systems/{known}", lambda document: document["id"] == known),
            self._read("/v1/systems?limit=20", lambda document: 1 <= len(document["items"]) <= 20),
            self._read("/v1/jobs?limit=20", lambda document: document["items"] == []),
        ]

    def write(self) -> _Question:
        body = json.dumps(SYSTEM).encode()
        head = self._head("POST /v1/systems", f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n")
        return _Question(
            sent=head + body, status=201, fits=lambda document: document["document"] == SYSTEM, writes=True
        )

    def _read(self, target: str, fits: Callable[[Any], bool]) -> _Question:
        return _Question(sent=self._head(f"GET {target}"), status=200, fits=fits)

    def _head(self, what: str, more: str = "") -> bytes:
        return (
            f"{what} HTTP/1.1\r\nHost: {self.host}\r\nUser-Agent: bench\r\nAccept: */*\r\n"
            f"Authorization: Bearer {self.key}\r\n{more}\r\n"
        ).encode()


async def load(url: str, key: str, *, clients: int, seconds: float, seed: int = 0) -> Outcome:
    """Let clients ask once a second each: nine reads for one system that is written."""
    outcome, address = Outcome(), urlsplit(url)
    loop, questions = asyncio.get_running_loop(), _Questions(address.netloc, key)
    people = [(await loop.create_connection(_Connection, address.hostname, address.port))[1] for _ in range(clients)]
    try:
        write = questions.write()
        _, first = await people[0].ask(write)
        reads = questions.reads(first["id"])
        begun = loop.time()
        await asyncio.gather(
            *(
                _client(
                    client,
                    outcome,
                    reads=reads,
                    write=write,
                    begun=begun,
                    seconds=seconds,
                    chance=random.Random(seed + n),  # noqa: S311 - no secret
                )
                for n, client in enumerate(people)
            )
        )
    finally:
        for client in people:
            client.transport.close()
        await asyncio.sleep(0)  # in which they are closed
    return outcome


async def _client(
    client: _Connection,
    outcome: Outcome,
    *,
    reads: list[_Question],
    write: _Question,
    begun: float,
    seconds: float,
    chance: random.Random,
) -> None:
    clock = asyncio.get_running_loop().time
    first = chance.random()
    for turn in range(int(seconds)):
        await asyncio.sleep(max(begun + first + turn - clock(), 0.0))
        writes = chance.random() < 0.1
        question = write if writes else chance.choice(reads)
        sent = time.perf_counter()
        try:
            status, _ = await client.ask(question)
        except (OSError, TimeoutError, _AnswerError, httptools.HttpParserError) as error:
            outcome.failures[f"{type(error).__name__}: {error}"] += 1
            continue
        (outcome.writes if writes else outcome.reads).append(time.perf_counter() - sent)
        outcome.statuses[status] += 1
