"""`WS /v1/live`: a system is opened once, then every vector of values is answered with its curves; the newest wins.

Texts are JSON (`api.schemas.live`); curves come as one binary frame (`api.services.studies.live.curves`). While curves are computed the
socket goes on reading, and of several vectors that came meanwhile only the last is answered. When none has come for a
moment, metrics and elasticities follow; what is being measured when one comes is given up.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Coroutine
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

from fastapi import APIRouter, WebSocket, WebSocketDisconnect
from pydantic import TypeAdapter, ValidationError

from api.http.bodies import parse_beside
from api.problems.documents import Problem, invalid
from api.problems.exceptions import KNOWN, RecalledError, problem_of
from api.problems.faults import validation_problem
from api.schemas.live import LiveMessage, LiveOpen, LiveSet
from api.services.jobs.computing import Recall
from api.services.operation.app_context import Caller, Installation
from api.services.studies.live import Panel, curves, measured, open_panel

#: How long values must rest before they are measured, s: longer than a frame of the screen, shorter than a thought.
REST = 0.06
_MESSAGES: TypeAdapter[LiveOpen | LiveSet] = TypeAdapter(LiveMessage)
T = TypeVar("T")
_POLICY_VIOLATION = 1008
_TOO_BIG = 1009

router = APIRouter()


@dataclass
class _Letterbox:
    """What the page said last: a system to open, values to compute; the newest of each."""

    opening: LiveOpen | Problem | None = None
    values: LiveSet | None = None
    closed: bool = False
    #: Ends what is being computed.
    recall: Recall | None = None
    arrived: asyncio.Event = field(default_factory=asyncio.Event)

    @property
    def empty(self) -> bool:
        return self.opening is None and self.values is None and not self.closed

    async def wait(self) -> None:
        """Wait for anything new."""
        while self.empty:
            self.arrived.clear()
            await self.arrived.wait()

    def close(self) -> None:
        """Tell that the page is gone: what is computed for it ends."""
        self.closed = True
        self.arrived.set()
        if self.recall is not None:
            self.recall.ask()

    async def rests(self, seconds: float) -> bool:
        """Say whether nothing new comes for some time."""
        with suppress(TimeoutError):
            await asyncio.wait_for(self.wait(), seconds)
        return self.empty


@dataclass(frozen=True)
class _Page:
    """One front panel."""

    socket: WebSocket
    box: _Letterbox
    service: Installation
    caller: Caller


@router.websocket("/v1/live")
async def live(socket: WebSocket) -> None:
    """Serve one front panel until it goes away."""
    caller: Caller = socket.state.caller
    service: Installation = socket.app.state.installation
    if not caller.may("run"):
        await socket.close(_POLICY_VIOLATION, "the key must have the scope run")
        return
    await socket.accept()
    box = _Letterbox()
    reading = asyncio.create_task(_read(socket, box, service.settings.body_limit))
    try:
        with suppress(WebSocketDisconnect):
            await _answer(_Page(socket, box, service, caller))
    finally:
        reading.cancel()
        await asyncio.gather(reading, return_exceptions=True)


async def _read(socket: WebSocket, box: _Letterbox, limit: int) -> None:
    """Put what the page says into the box, whatever is being computed."""
    try:
        while True:
            text = await socket.receive_text()
            if len(text) > limit:
                await socket.close(_TOO_BIG, f"a message must be at most {limit} bytes")
                return
            message = await _parsed(text)
            if isinstance(message, LiveSet):
                box.values = message
            else:
                # Values that were meant for the system before are not for this one.
                box.opening, box.values = message, None
            box.arrived.set()
    except (WebSocketDisconnect, KeyError):  # KeyError: a binary frame, where only texts make sense
        return
    finally:
        box.close()


async def _parsed(text: str) -> LiveOpen | LiveSet | Problem:
    """Return what a message says, or what is wrong with it."""
    try:
        body = await parse_beside(text.encode(errors="replace"))
    except json.JSONDecodeError as error:
        return invalid(f"a message must be JSON: {error.msg}")
    try:
        return _MESSAGES.validate_json(text)
    except ValidationError as error:
        return validation_problem([{**found, "loc": ("body", *found["loc"])} for found in error.errors()], body)


async def _answer(page: _Page) -> None:
    box = page.box
    panel: Panel | None = None
    while True:
        await box.wait()
        if box.closed:
            return
        if box.opening is not None:
            opening, box.opening = box.opening, None
            panel = await _opened(page, opening, panel)
        elif box.values is not None:
            asked, box.values = box.values, None
            if panel is None:
                await _refuse(
                    page.socket, Problem(409, "conflict", "a system must be opened before values are set"), asked.seq
                )
            else:
                await _computed(page, panel, asked)


async def _opened(page: _Page, opening: LiveOpen | Problem, before: Panel | None) -> Panel | None:
    """Open a system; where that is not possible, what was open stays."""
    if isinstance(opening, Problem):
        await _refuse(page.socket, opening, None)
        return before
    found = await _try(page, None, partial(open_panel, page.service, page.caller, opening))
    if found is None:
        return before
    panel, told = found
    await page.socket.send_json(told)
    return panel


async def _computed(page: _Page, panel: Panel, asked: LiveSet) -> None:
    socket, box, service = page.socket, page.box, page.service
    frame = await _try(page, asked.seq, partial(curves, service, panel, asked.seq, asked.vectors))
    if frame is None:
        return
    await socket.send_bytes(frame)
    for variant, vector in enumerate(asked.vectors[: asked.measure] if panel.metrics else ()):
        if not await box.rests(REST if variant == 0 else 0.0):
            return
        work = partial(measured, service, panel, asked.seq, variant, vector)
        told = await _unless_newer(box, _try(page, asked.seq, work))
        if told is not None:
            await socket.send_json(told)


async def _unless_newer(box: _Letterbox, work: Coroutine[Any, Any, T | None]) -> T | None:
    """Return what ``work`` returns; it is recalled, and None returned, when the page says anything new meanwhile.

    A nonlinear system is measured for seconds: its curves are not to wait for that.
    """
    working, news = asyncio.create_task(work), asyncio.create_task(box.wait())
    try:
        await asyncio.wait({working, news}, return_when=asyncio.FIRST_COMPLETED)
    finally:
        news.cancel()
        if not working.done() and box.recall is not None:
            box.recall.ask()
    return await working


async def _try(page: _Page, seq: int | None, work: Callable[[], T]) -> T | None:
    """Return what ``work`` returns, or tell the page why there is nothing and return None."""
    computing, caller = page.service.computing, page.caller
    recall = page.box.recall = Recall()
    try:
        return await computing.in_thread(computing.threads, caller.workspace, caller.principal, work, recall=recall)
    except RecalledError:
        return None
    except KNOWN as error:
        problem = problem_of(error)
        assert problem is not None
        await _refuse(page.socket, problem, seq)
        return None
    finally:
        page.box.recall = None


async def _refuse(socket: WebSocket, problem: Problem, seq: int | None) -> None:
    await socket.send_json({"type": "problem", "seq": seq, "problem": problem.document()})
