"""Jobs that the service runs again and again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from servotune.replies.base import Reply
from servotune.transport import Transport


class ScheduleRun(Reply):
    """What became of one instant of a schedule."""

    id: str
    due_at: str
    outcome: str
    job: str | None
    detail: str | None
    created_at: str


class Schedule(Reply):
    """A schedule as the service keeps it."""

    id: str
    name: str
    revision: int
    created_at: str
    kind: str
    cron: str
    time_zone: str
    paused: bool
    next_at: str | None
    next_runs: list[str]
    document: dict[str, Any]


class Schedules:
    """The schedules of the key's workspace."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def create(
        self,
        name: str,
        *,
        cron: str,
        kind: str,
        body: Mapping[str, Any],
        time_zone: str = "UTC",
        overlap: str = "skip",
        missed: str = "one",
        paused: bool = False,
        newest: str | None = None,
    ) -> Schedule:
        """Run a job at every instant of a cron expression.

        Parameters
        ----------
        cron : str
            Minute, hour, day of month, month, day of week: `"30 2 * * mon-fri"`.
        kind, body : str, mapping
            `"optimization"`, `"identification"` or `"validation"`, and what is posted to start one.
        time_zone : str
            IANA name, `"Europe/Bucharest"`.
        overlap : {"skip", "queue", "cancel_previous"}
            What is done when the job before has not ended.
        missed : {"none", "one", "all"}
            Which instants are made up for at which the service was away.
        newest : str, optional
            Name of recordings: each run takes the newest one in place of the `dataset` of the body.
        """
        document = {
            "name": name,
            "cron": cron,
            "time_zone": time_zone,
            "job": {"kind": kind, "body": dict(body)},
            "overlap": overlap,
            "missed": missed,
            "paused": paused,
            "newest": newest,
        }
        return Schedule(self._transport.post("/v1/schedules", document, creates=True))

    def get(self, schedule: str) -> Schedule:
        """Return a schedule with its next instants."""
        return Schedule(self._transport.get(f"/v1/schedules/{schedule}"))

    def list(self) -> Iterator[Schedule]:
        """Yield the schedules, without the bodies of their jobs."""
        return self._transport.items("/v1/schedules", Schedule)

    def update(self, schedule: str, document: Mapping[str, Any], *, etag: str | None = None) -> Schedule:
        """Replace the `document` of a schedule; by default that of the version stored now, whoever wrote it."""
        headers = {"If-Match": etag or self._etag(schedule)}
        response = self._transport.send("PUT", f"/v1/schedules/{schedule}", json=document, headers=headers)
        return Schedule(self._transport.body(response))

    def delete(self, schedule: str) -> None:
        """Delete a schedule and its history; its jobs stay."""
        self._transport.send("DELETE", f"/v1/schedules/{schedule}", headers={"If-Match": "*"})

    def pause(self, schedule: str) -> Schedule:
        """Start nothing until it is resumed."""
        return Schedule(self._transport.post(f"/v1/schedules/{schedule}/pause", {}))

    def resume(self, schedule: str) -> Schedule:
        """Go on with the next instant."""
        return Schedule(self._transport.post(f"/v1/schedules/{schedule}/resume", {}))

    def trigger(self, schedule: str) -> ScheduleRun:
        """Run the job now; `job` of what is returned is its id."""
        return ScheduleRun(self._transport.post(f"/v1/schedules/{schedule}/trigger", {}, creates=True))

    def runs(self, schedule: str) -> Iterator[ScheduleRun]:
        """Yield what became of its instants, newest first."""
        return self._transport.items(f"/v1/schedules/{schedule}/runs", ScheduleRun)

    def _etag(self, schedule: str) -> str:
        return self._transport.send("GET", f"/v1/schedules/{schedule}").headers["ETag"]
