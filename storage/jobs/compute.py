"""The contract of the function that computes jobs, and its side of the pipe to the worker.

The function runs in a process of its own, which may be killed at any time::

    def run(job: ComputeJob, reporter: Reporter) -> Mapping[str, Any]: ...

Its return value, JSON with numpy arrays anywhere in it, becomes the result of the job.
"""

from __future__ import annotations

import json
import os
import pickle
import select
import socket
import struct
import time
import traceback
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any

#: The id of the job that this thread sees through, or that this process computes.
CURRENT_JOB: ContextVar[str | None] = ContextVar("current_job", default=None)
#: The id of the request that asked for that job.
ASKED_BY: ContextVar[str | None] = ContextVar("asked_by", default=None)

#: The shortest time (s) between two reports of progress, and between two messages once the first ones are spent.
REPORT_INTERVAL = 0.1
#: The shortest time (s) between two states that are kept.
KEEP_INTERVAL = 1.0
#: The largest state (characters of JSON) that is kept; a search whose state is larger goes on from an earlier one.
_LARGEST_STATE = 4 << 20
#: Messages that may follow each other at once.
_BURST = 20

#: In front of every frame: its length (bytes).
HEADER = struct.Struct("<Q")


@dataclass(frozen=True, slots=True, kw_only=True)
class ComputeJob:
    """What is to be computed; ``database_url`` is for those kinds that read recordings.

    ``state`` is what the computation last kept (`Reporter.keep`) before it was cut off. ``request_id`` is the request that asked
    for it, for the log. After ``seconds`` it is cut off and has failed: whoever has anything to show ends before.
    """

    id: str
    kind: str
    body: dict[str, Any]
    workspace_id: str
    database_url: str = field(repr=False)
    state: dict[str, Any] | None = None
    request_id: str | None = None
    seconds: float | None = None


class Refusal(Exception):  # noqa: N818 - it is no error of the software
    """Raised by the compute function to end a job as ``failed`` with a problem that its user should read."""

    def __init__(self, *, type: str, title: str, detail: str, **more: Any) -> None:  # noqa: A002 - RFC 9457's word
        super().__init__(detail)
        self.problem: dict[str, Any] = {"type": type, "title": title, "detail": detail, **more}


Compute = Callable[[ComputeJob, "Reporter"], Mapping[str, Any]]


# What a child tells its worker.
@dataclass(frozen=True, slots=True)
class Progress:
    """How far the job is, from 0 to 1, and what it does."""

    fraction: float
    message: str


@dataclass(frozen=True, slots=True)
class Message:
    """A line for the job's log."""

    text: str


@dataclass(frozen=True, slots=True)
class Kept:
    """Where the computation is: what it goes on from when it is cut off."""

    state: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Done:
    """The result."""

    result: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Refused:
    """The problem that the compute function raised."""

    problem: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Crashed:
    """An error of the software: its kind for the user, its traceback for the log."""

    kind: str
    traceback: str


@dataclass(frozen=True, slots=True)
class Listening:
    """The computation looks whether it is to end: when its job is cancelled it hands over what it has."""


Frame = Progress | Message | Kept | Listening | Done | Refused | Crashed


class Reporter:
    """Tells the worker how far a job is; calls are cheap, and what comes too fast is dropped."""

    def __init__(self, pipe: socket.socket) -> None:
        self._pipe = pipe
        self._next_progress = 0.0
        self._next_keep = 0.0
        self._messages = float(_BURST)
        self._counted_at = time.monotonic()

    def listen(self) -> None:
        """Say that this computation asks `ending` now and then, and then has a result soon."""
        send(self._pipe, Listening())

    def ending(self) -> bool:
        """Return whether the job was cancelled, so that what there is should be handed over."""
        return bool(select.select([self._pipe], [], [], 0)[0])

    def progress(self, fraction: float, message: str = "") -> None:
        """Report the done fraction, 0 ... 1, at most every `REPORT_INTERVAL`."""
        now = time.monotonic()
        if now >= self._next_progress:
            self._next_progress = now + REPORT_INTERVAL
            send(self._pipe, Progress(min(max(float(fraction), 0.0), 1.0), message))

    def message(self, text: str) -> None:
        """Add a line to the job's log."""
        now = time.monotonic()
        self._messages = min(_BURST, self._messages + (now - self._counted_at) / REPORT_INTERVAL)
        self._counted_at = now
        if self._messages >= 1:
            self._messages -= 1
            send(self._pipe, Message(text))

    def keep(self, state: Mapping[str, Any]) -> None:
        """Keep a state, JSON, to go on from when this process dies; at most every `KEEP_INTERVAL`."""
        now = time.monotonic()
        if now < self._next_keep:
            return
        self._next_keep = now + KEEP_INTERVAL
        # Proven to be JSON here, where a search that keeps anything else can be told from one that is at fault itself.
        text = json.dumps(state, allow_nan=False)
        if len(text) <= _LARGEST_STATE:
            send(self._pipe, Kept(json.loads(text)))


def send(pipe: socket.socket, frame: ComputeJob | Frame) -> None:
    """Write a frame; pickle is safe here, because both ends of the pipe are the same software."""
    data = pickle.dumps(frame, protocol=pickle.HIGHEST_PROTOCOL)
    pipe.sendall(HEADER.pack(len(data)))
    pipe.sendall(data)


def compute_one(compute: Compute, pipe: socket.socket) -> None:
    """Be a child: read one job from the pipe, compute it, write what came out."""
    with pipe.makefile("rb") as reader:
        (length,) = HEADER.unpack(reader.read(HEADER.size))
        job = pickle.loads(reader.read(length))  # noqa: S301 - from our own worker
    token, asked = CURRENT_JOB.set(job.id), ASKED_BY.set(job.request_id)
    try:
        send(pipe, Done(compute(job, Reporter(pipe))))
    except Refusal as refusal:
        send(pipe, Refused(refusal.problem))
    except BrokenPipeError:
        # The worker is gone, and with it everybody who wants to know.
        os._exit(1)
    except Exception as error:  # noqa: BLE001 - the boundary of the process: whatever happens becomes the job's error
        send(pipe, Crashed(type(error).__name__, traceback.format_exc()))
    finally:
        ASKED_BY.reset(asked)
        CURRENT_JOB.reset(token)
