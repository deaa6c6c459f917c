"""Long work on the service: watch it, wait for it, cancel it."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from datetime import datetime
from itertools import takewhile
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar, cast

from servotune.documents import given
from servotune.errors import JobCancelledError, JobFailedError, WaitTimeoutError
from servotune.events import Event, parse
from servotune.progress import Observer, ProgressBar
from servotune.replies import JobState
from servotune.replies.results import result_of
from servotune.results import report_of
from servotune.transport import Transport, pause

ResultT = TypeVar("ResultT")

FINAL = frozenset({"succeeded", "failed", "cancelled"})
_SILENCE = 15.0
"""Seconds without an event after which the job's state is asked for: a stream can die without a word."""


class Job(Generic[ResultT]):
    """One piece of long work on the service.

    Examples
    --------
    ::

        job = client.optimize(system=system, variables=..., goals=..., method={"kind": "gradient"})
        result = job.wait()
    """

    def __init__(self, transport: Transport, state: JobState) -> None:
        self._transport = transport
        self.state = JobState(state)

    def __repr__(self) -> str:
        return f"<Job {self.id} {self.kind} {self.status} {self.progress:.0%}>"

    @property
    def id(self) -> str:
        """The job's id."""
        return self.state.id

    @property
    def kind(self) -> str:
        """What it does: `identification`, `optimization` ..."""
        return self.state.kind

    @property
    def status(self) -> str:
        """`queued`, `running`, `succeeded`, `failed` or `cancelled`, as last known."""
        return self.state.status

    @property
    def progress(self) -> float:
        """The fraction done (0 to 1), as last known."""
        return self.state.get("progress") or 0.0

    @property
    def done(self) -> bool:
        """Whether the last known state is final; `refresh` asks again."""
        return self.status in FINAL

    def refresh(self) -> Job[ResultT]:
        """Ask the service for the present state."""
        self.state = JobState(self._transport.get(f"/v1/jobs/{self.id}"))
        return self

    def pause(self) -> Job[ResultT]:
        """Take the job from whoever computes it; it keeps its place until `resume`."""
        self._transport.send("POST", f"/v1/jobs/{self.id}/pause")
        return self.refresh()

    def resume(self) -> Job[ResultT]:
        """Let a paused job go on from where it was."""
        self._transport.send("POST", f"/v1/jobs/{self.id}/resume")
        return self.refresh()

    def cancel(self) -> Job[ResultT]:
        """Stop the computation. A job that has already ended stays as it is."""
        self._transport.send("POST", f"/v1/jobs/{self.id}/cancel")
        return self.refresh()

    def events(self, *, deadline: float | None = None) -> Iterator[Event]:
        """Yield the job's events until it ends, reconnecting with `Last-Event-ID` wherever the stream breaks off.

        Parameters
        ----------
        deadline : float, optional
            Reading of `time.monotonic` at which to give up.

        Raises
        ------
        WaitTimeoutError
            The deadline passed first.
        ServiceUnreachableError
            The stream broke off and the service does not answer any more.
        """
        import httpx  # noqa: PLC0415 - loaded with the connection, not with the client

        last_id, breaks = "", 0
        while not self.refresh().done:
            left = float("inf") if deadline is None else deadline - time.monotonic()
            if left <= 0:
                message = f"job {self.id} is still {self.status} ({self.progress:.0%} done); it goes on running"
                raise WaitTimeoutError(message)
            headers = {"Accept": "text/event-stream"} | ({"Last-Event-ID": last_id} if last_id else {})
            try:
                path = f"/v1/jobs/{self.id}/events"
                with self._transport.stream(path, headers=headers, silence=min(_SILENCE, left)) as response:
                    # Checked line by line: a stream that only says that it is alive must not outlive the deadline.
                    lines = takewhile(lambda _: deadline is None or time.monotonic() < deadline, response.iter_lines())
                    for event in parse(lines):
                        last_id, breaks = event.id or last_id, 0
                        self._take(event)
                        yield event
                        if self.done:
                            break
            except httpx.TransportError:
                # The stream is a convenience: the truth is asked for at the top of the loop, which also tells a dead service.
                breaks += 1
                time.sleep(min(pause(breaks), max(left, 0.0)))

    def wait(self, *, progress: bool | Observer = True, timeout: float | None = None) -> ResultT:
        """Wait for the end and return the result.

        Parameters
        ----------
        progress : bool or callable, optional
            True shows a progress bar on a terminal when it takes more than a second; a callable is told the fraction
            done (0 to 1) and a message instead.
        timeout : float, optional
            Longest time to wait (s).

        Raises
        ------
        JobFailedError
            The job ended without a result.
        JobCancelledError
            Somebody cancelled it.
        WaitTimeoutError
            `timeout` seconds passed first; the job goes on running.
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        with ProgressBar(self.kind) if progress is True else nullcontext(progress or None) as observer:
            for _ in self.events(deadline=deadline):
                if observer is not None:
                    observer(self.progress, self.state.get("message") or "")
        return self.refresh().result()

    def result(self) -> ResultT:
        """Return the result of a job that has succeeded, or the best point of a search that was cancelled.

        A cancelled search needs some seconds to prove its best point; until then it has none.

        Raises
        ------
        JobFailedError, JobCancelledError
            It has none.
        """
        if self.status == "cancelled" and not self.refresh().state.get("result"):
            message = f"job {self.id} ({self.kind}) was cancelled and has no result"
            raise JobCancelledError(message)
        if self.status == "failed":
            problem = self.state.get("error") or {}
            raise JobFailedError(status=int(problem.get("status") or 500), problem=problem, request=f"job {self.id}")
        return cast(
            "ResultT",
            result_of(self.kind, self._transport.get(self.state.get("result") or f"/v1/jobs/{self.id}/result")),
        )

    def request(self) -> dict[str, Any]:
        """Return what was asked for, the system written out as it was then."""
        return cast("dict[str, Any]", self._transport.get(f"/v1/jobs/{self.id}/request"))

    def script(self) -> str:
        """Return a standalone Python script that repeats an optimisation, and compares what it finds with the result."""
        return self._transport.send("GET", f"/v1/jobs/{self.id}/script").text

    def report(
        self,
        form: Literal["html", "pdf"] = "html",
        path: Path | str | None = None,
        *,
        language: Literal["en", "ro"] = "en",
    ) -> bytes:
        """Return a report of the job that needs no other file: one HTML page, or a PDF.

        It says who asked for what, what came out with figures, certificate and warnings, and what it was made from.

        Parameters
        ----------
        form : {"html", "pdf"}, optional
        path : pathlib.Path or str, optional
            Where it is written, too.
        language : {"en", "ro"}, optional
            English or Romanian; what people wrote and the service advised stays as it is.

        Raises
        ------
        ApiError
            The job has no result (yet), or is of a kind that has no report.
        ValueError
            Nothing can be written at ``path``; nothing is asked of the service then.
        """
        return report_of(self._transport, f"/v1/jobs/{self.id}", form, path, language)

    def _take(self, event: Event) -> None:
        """Take an event into the state: its data is the bare value or an object that holds it."""
        if event.name not in ("status", "progress", "message"):
            return
        news = event.data if isinstance(event.data, Mapping) else {event.name: event.data}
        known: Mapping[str, type | tuple[type, ...]] = {"status": str, "progress": (int, float), "message": str}
        changed = {name: news[name] for name, kind in known.items() if isinstance(news.get(name), kind)}
        self.state = JobState({**self.state, **changed})


class Jobs:
    """The jobs of the service."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def get(self, job: str) -> Job[Any]:
        """Return the job with this id, to wait for it or to fetch its result."""
        return Job(self._transport, JobState(self._transport.get(f"/v1/jobs/{job}")))

    def start(self, kind: Literal["optimization", "identification"], request: Mapping[str, Any]) -> Job[Any]:
        """Start a job from its whole request, `job.request()` of another one say."""
        path = {"optimization": "/v1/optimizations", "identification": "/v1/identifications"}[kind]
        return Job(self._transport, JobState(self._transport.post(path, request, creates=True)))

    def list(
        self,
        *,
        kind: str | None = None,
        status: str | None = None,
        schedule: str | None = None,
        since: datetime | None = None,
    ) -> Iterator[Job[Any]]:
        """Yield the jobs, newest first.

        Parameters
        ----------
        kind, status : str, optional
            Only these.
        schedule : str, optional
            Only those that this schedule has asked for.
        since : datetime.datetime, optional
            Only those that were asked for at this instant or later; without a time zone it is local time.
        """
        earliest = None if since is None else since.astimezone()
        params = given(kind=kind, status=status, schedule=schedule)
        for state in self._transport.items("/v1/jobs", JobState, params=params):
            if earliest is not None and state.created_at and datetime.fromisoformat(state.created_at) < earliest:
                return
            yield Job(self._transport, state)
