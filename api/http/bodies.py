"""Reading a JSON body strictly: finite numbers, no key twice, bounded depth, bounded numbers of keys and of numbers.

The standard parser takes NaN and Infinity, and keeps the last of two equal keys; a document that says two things
about one block must not silently lose one of them.
"""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any

from anyio import CapacityLimiter, to_thread
from fastapi import HTTPException, Request, Response
from fastapi.routing import APIRoute

from api.settings import Settings

_DEEPEST = 128
_LONGEST_INTEGER = 300
#: In one document, whatever its size may be; one of a megabyte, the usual limit, holds fewer.
_MOST_KEYS = 200_000
_MOST_NUMBERS = 1_000_000
#: Bytes above which a document is read beside the event loop, where a millisecond is much; and how many at a time, so that
#: large ones wait for each other and not everybody for them.
_LARGE = 16 << 10
_LARGE_ONES = CapacityLimiter(2)


class _RefusedError(ValueError):
    """The text is JSON, but not what a document may hold."""


@dataclass(frozen=True, slots=True)
class _NoNumber:
    """Stands where a number is that no document may hold; its place is told when all has been read."""

    rule: str


class _Reading:
    """Reads the numbers and objects of one document, counts them, and notes whether a number was met that no document may hold."""

    def __init__(self) -> None:
        self.refused = False
        self._keys = 0
        self._numbers = 0

    def _refuse(self, rule: str) -> _NoNumber:
        self.refused = True
        return _NoNumber(rule)

    def _count_number(self) -> None:
        self._numbers += 1
        if self._numbers > _MOST_NUMBERS:
            raise _RefusedError(f"a document must have at most {_MOST_NUMBERS} numbers, got more")

    def constant(self, text: str) -> Any:
        return self._refuse(f"numbers must be finite, got {text}")

    def real(self, text: str) -> Any:
        self._count_number()
        value = float(text)
        return value if math.isfinite(value) else self._refuse(f"numbers must be below 1.8e308, got {text[:40]}")

    def whole(self, text: str) -> Any:
        self._count_number()
        long = len(text) > _LONGEST_INTEGER
        return self._refuse(f"numbers must be below 1.8e308, got {len(text)} digits") if long else int(text)

    def members(self, pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        self._keys += len(pairs)
        if self._keys > _MOST_KEYS:
            raise _RefusedError(f"a document must have at most {_MOST_KEYS} keys, got more")
        document = dict(pairs)
        if len(document) < len(pairs):
            seen: set[str] = set()
            for key, _ in pairs:
                if key in seen:
                    raise _RefusedError(f"a key must stand once in an object, got {key[:80]!r} twice")
                seen.add(key)
        return document


def _check_numbers(document: Any) -> None:
    """Refuse a number that no document may hold, with its place."""
    pending: list[tuple[str, Any]] = [("", document)]
    while pending:
        place, node = pending.pop()
        if isinstance(node, _NoNumber):
            raise _RefusedError(f"{node.rule} at {place or 'the top'}")
        if isinstance(node, dict):
            pending += [(f"{place}/{key[:80]}", child) for key, child in node.items()]
        elif isinstance(node, list):
            pending += [(f"{place}/{i}", child) for i, child in enumerate(node)]


def _check_depth(document: Any) -> None:
    level = [document]
    for _ in range(_DEEPEST):
        level = [
            child
            for node in level
            for child in (node.values() if isinstance(node, dict) else node if isinstance(node, list) else ())
            if isinstance(child, dict | list)
        ]
        if not level:
            return
    raise _RefusedError(f"a document must be at most {_DEEPEST} levels deep")


def _check_text(document: Any) -> None:
    """Refuse what an escape sequence can say and no database keeps: NUL, and half of a surrogate pair."""
    pending = [document]
    while pending:
        node = pending.pop()
        if isinstance(node, dict):
            pending += node
            pending += node.values()
        elif isinstance(node, list):
            pending += node
        elif isinstance(node, str) and ("\0" in node or node != node.encode(errors="replace").decode()):
            raise _RefusedError(f"text must be Unicode without NUL, got {node[:40]!a}")


def parse(body: bytes) -> Any:
    """Return the JSON document in ``body``.

    Raises
    ------
    json.JSONDecodeError
        When it is malformed, not UTF-8, or holds NaN, an infinity, a key twice, or too many levels, keys or numbers.
    """
    try:
        text = body.decode("utf-8")
        read = _Reading()
        document = json.loads(
            text,
            parse_constant=read.constant,
            parse_float=read.real,
            parse_int=read.whole,
            object_pairs_hook=read.members,
        )
        _check_depth(document)
        if read.refused:
            _check_numbers(document)
        if "\\u" in text:
            _check_text(document)
    except json.JSONDecodeError:
        raise
    except RecursionError:
        raise json.JSONDecodeError(f"a document must be at most {_DEEPEST} levels deep", "", 0) from None
    except UnicodeDecodeError as error:
        raise json.JSONDecodeError("the body must be UTF-8", "", error.start) from None
    except _RefusedError as error:
        raise json.JSONDecodeError(str(error), "", 0) from None
    return document


async def parse_beside(body: bytes) -> Any:
    """Return the JSON document in ``body``, a large one without holding the event loop up; raises as `parse` does."""
    if len(body) <= _LARGE:
        return parse(body)
    return await to_thread.run_sync(parse, body, limiter=_LARGE_ONES)


class _StrictRequest(Request):
    async def body(self) -> bytes:
        if not hasattr(self, "_body"):
            settings: Settings = self.app.state.installation.settings
            self._body = await read_limited(self, settings.body_limit, "a document", seconds=settings.body_seconds)
        return self._body

    async def json(self) -> Any:
        return await parse_beside(await self.body())


async def read_limited(request: Request, limit: int, what: str, *, seconds: float) -> bytes:
    """Return the body of a request, read no further than the limit, and no longer than some seconds.

    Raises
    ------
    HTTPException
        413 naming the limit, 408 naming the time.
    """
    told = request.headers.get("content-length", "")
    if not (told.isdigit() and int(told[:20]) > limit):
        try:
            async with asyncio.timeout(seconds):
                data = await _read(request, limit)
        except TimeoutError:
            detail = f"{what} must arrive within {seconds:g} s, got a part of it"
            raise HTTPException(408, detail, headers={"Connection": "close"}) from None
        if data is not None:
            return data
    raise HTTPException(413, f"{what} must be at most {limit} bytes, got {told or 'more'}")


async def _read(request: Request, limit: int) -> bytes | None:
    """Return the body, None for one that is longer than the limit."""
    data = bytearray()
    async for chunk in request.stream():
        data += chunk
        if len(data) > limit:
            return None
    return bytes(data)


class DocumentRoute(APIRoute):
    """A route whose JSON body is read by :func:`parse`, and whose answer is not sent to somebody who has it."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Return the handler that sees a strict request."""
        handle = super().get_route_handler()

        async def strict(request: Request) -> Response:
            response = await handle(_StrictRequest(request.scope, request.receive))
            return _unless_known(request, response)

        return strict


def _unless_known(request: Request, response: Response) -> Response:
    """Return 304 in place of a document whose tag the caller names in ``If-None-Match`` (RFC 9110, 13.1.2)."""
    tag, known = response.headers.get("ETag"), request.headers.get("If-None-Match")
    if request.method != "GET" or tag is None or known is None:
        return response
    tags = {part.strip().removeprefix("W/") for part in known.split(",")}
    if not tags & {tag, "*"}:
        return response
    return Response(status_code=HTTPStatus.NOT_MODIFIED, headers={"ETag": tag})
