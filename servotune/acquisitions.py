"""Measurements on rigs: asked for, followed, tried again; and who is there to make them."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from enum import Enum
from typing import Any

from servotune.errors import JobFailedError, WaitTimeoutError
from servotune.jobs import Job
from servotune.replies.base import Reply
from servotune.transport import Transport


class Unset(Enum):
    """What was not said: of a template, that it stays."""

    UNSET = "unset"


UNSET = Unset.UNSET
FINAL = frozenset({"done", "failed", "lost", "cancelled"})


class FollowUp(Reply):
    """How a step goes that follows a recording."""

    kind: str
    status: str
    job: str | None
    result: dict[str, Any] | None
    detail: str | None


class Attempt(Reply):
    """One go at a measurement."""

    number: int
    status: str
    job: str
    agent: str | None
    dataset: str | None
    late: bool
    facts: dict[str, Any] | None
    error: dict[str, Any] | None
    then: list[FollowUp]


class Acquisition(Reply):
    """A measurement with its attempts, the latest one last."""

    id: str
    name: str
    rig: str
    status: str
    attempt: int
    job: str
    dataset: str | None
    document: dict[str, Any]
    attempts: list[Attempt]
    warnings: list[dict[str, Any]]


class Acquisitions:
    """The measurements of the key's workspace."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def start(
        self,
        name: str | None = None,
        *,
        template: str | None = None,
        rig: str | None = None,
        channels: Sequence[str] | None = None,
        sample_rate: float | None = None,
        duration: float | Mapping[str, Any] | None = None,
        drive: Mapping[str, Any] | Unset | None = UNSET,
        pre_trigger: float | Mapping[str, Any] | None = None,
        trigger: Mapping[str, Any] | Unset | None = UNSET,
        averages: int | None = None,
        confirm: bool | None = None,
        record: bool | None = None,
        then: Sequence[Mapping[str, Any]] | None = None,
    ) -> Acquisition:
        """Ask for a measurement; the rig's agent makes it as soon as it can.

        Parameters
        ----------
        template : str, optional
            Id of a template; what is given beside it counts more.
        channels : sequence of str, optional
            Inputs of the rig; beside them the output of the drive, to keep what it was told to play as a channel, too.
        drive : mapping, optional
            `{"output": "valve", "signal": {"kind": "chirp", ...}}`, in V. None takes that of the template away.
        trigger : mapping, optional
            What the recording waits for: `{"channel": "position", "edge": "rising", "level": 2}`, in the unit of the channel,
            or `{"channel": "position", "window": [1, 3], "when": "leaves"}`. It begins `pre_trigger` before.
            None takes that of the template away.
        record : bool, optional
            False: nothing is kept. Sweeps of `pre_trigger` and `duration` are shown in the events of the job until it is
            cancelled, for 10 minutes at most.
        then : sequence of mappings, optional
            Steps that follow: `{"kind": "identification", "body": {...}}`, without `dataset`.
        """
        given = {
            "name": name,
            "template": template,
            "rig": rig,
            "channels": None if channels is None else list(channels),
            "sample_rate": sample_rate,
            "duration": duration,
            "drive": drive,
            "pre_trigger": pre_trigger,
            "trigger": trigger,
            "averages": averages,
            "confirm": confirm,
            "record": record,
            "then": None if then is None else [dict(step) for step in then],
        }
        may_be_none = {"drive", "trigger"}
        document = {
            key: value
            for key, value in given.items()
            if value is not UNSET and (value is not None or key in may_be_none)
        }
        return Acquisition(self._transport.post("/v1/acquisitions", document, creates=True))

    def get(self, acquisition: str) -> Acquisition:
        """Return a measurement as it is now."""
        return Acquisition(self._transport.get(f"/v1/acquisitions/{acquisition}"))

    def list(self, *, rig: str | None = None, status: str | None = None) -> Iterator[Acquisition]:
        """Yield the measurements, newest first."""
        query = {key: value for key, value in {"rig": rig, "status": status}.items() if value is not None}
        return self._transport.items("/v1/acquisitions", Acquisition, params=query)

    def cancel(self, acquisition: str) -> Acquisition:
        """Let the agent stop; what it has recorded still comes."""
        return Acquisition(self._transport.post(f"/v1/acquisitions/{acquisition}/cancel", {}))

    def retry(self, acquisition: str) -> Acquisition:
        """Try once more: nothing that moves a rig is repeated unless a person asks."""
        return Acquisition(self._transport.post(f"/v1/acquisitions/{acquisition}/retry", {}, creates=True))

    def job(self, acquisition: str) -> Job[dict[str, Any]]:
        """Return the job of the latest attempt; its events tell status and progress, and show the samples as they come."""
        return Job(self._transport, self._transport.get(f"/v1/jobs/{self.get(acquisition)['job']}"))

    def wait(self, acquisition: str, *, steps: bool = True, timeout: float | None = None) -> Acquisition:
        """Wait for the recording, and for the steps that follow it.

        Parameters
        ----------
        steps : bool
            Whether to wait for them too.
        timeout : float, optional
            s.

        Raises
        ------
        JobFailedError
            It failed, was lost or cancelled; a failed step is no error, and is found in the attempt.
        WaitTimeoutError
            It takes longer; it goes on.
        """
        give_up_at = float("inf") if timeout is None else time.monotonic() + timeout
        while True:
            found = self.get(acquisition)
            attempt = found["attempts"][-1]
            if found["status"] in FINAL and found["status"] != "done":
                problem = attempt["error"] or {"title": found["status"]}
                raise JobFailedError(status=0, problem=problem, request=f"acquisition {acquisition}")
            waiting = [step for step in attempt["then"] if step["status"] in {"waiting", "running"}]
            if found["status"] == "done" and not (steps and waiting):
                return found
            if time.monotonic() > give_up_at:
                message = f"acquisition {acquisition} is still {found['status']}; it goes on"
                raise WaitTimeoutError(message)
            time.sleep(0.2)

    def templates(self) -> Iterator[dict[str, Any]]:
        """Yield the templates, newest first."""
        return self._transport.items("/v1/acquisition-templates")

    def keep_template(self, document: Mapping[str, Any]) -> dict[str, Any]:
        """Keep a measurement to be asked for again; what differs each time may be left out."""
        kept: dict[str, Any] = self._transport.post("/v1/acquisition-templates", document, creates=True)
        return kept

    def rigs(self) -> Iterator[dict[str, Any]]:
        """Yield the rigs, with their inputs, sensors, calibration, and the limits of their outputs."""
        return self._transport.items("/v1/rigs")

    def agents(self) -> Iterator[dict[str, Any]]:
        """Yield the agents, and when they were heard of."""
        return self._transport.items("/v1/agents")
