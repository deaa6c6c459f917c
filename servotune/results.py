"""Studies that were asked to be kept, and reports of them and of jobs."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

from servotune.documents import given
from servotune.replies.base import Reply
from servotune.replies.results import result_of
from servotune.targets import room_at, target_of
from servotune.transport import Transport

Form = Literal["html", "pdf"]
Language = Literal["en", "ro"]


class KeptResult(Reply):
    """What was asked, what was answered, and the revision and the software behind it; of a list without both bodies."""

    id: str
    kind: str
    created_at: str
    system: dict[str, Any] | None
    versions: dict[str, str]
    request: dict[str, Any] | None
    result: dict[str, Any] | None

    def reply(self) -> Reply:
        """Return the answer as the object that it was: a `Simulation`, a `Spectrum` ..."""
        if self.result is None:
            raise ValueError(f"result {self.id!r} must be fetched by client.results.get to have a reply")
        return result_of(self.kind, self.result)


class Results:
    """What studies with ``keep=True`` have left."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def get(self, result: str) -> KeptResult:
        """Return a kept result with its request and its reply."""
        return KeptResult(self._transport.get(f"/v1/results/{result}"))

    def list(
        self, *, kind: str | None = None, after: datetime | None = None, before: datetime | None = None
    ) -> Iterator[KeptResult]:
        """Yield the kept results, or those of one kind ("simulation", "spectrum", "frf" ...) and time, newest first, without their bodies."""
        return self._transport.items("/v1/results", KeptResult, params=given(kind=kind, after=after, before=before))

    def report(
        self, result: str, form: Form = "html", path: Path | str | None = None, *, language: Language = "en"
    ) -> bytes:
        """Return a report of a kept result that needs no other file, as `Job.report` does."""
        return report_of(self._transport, f"/v1/results/{result}", form, path, language)


def report_of(transport: Transport, place: str, form: Form, path: Path | str | None, language: Language) -> bytes:
    """Return the report of what is at this place of the service, and write it where that is wanted.

    Raises
    ------
    ApiError
        There is no result (yet), or it is of a kind that has no report.
    ValueError
        Nothing can be written at ``path``; nothing is asked of the service then.
    """
    target = None if path is None else target_of(path, "path")
    found = transport.send("GET", f"{place}/report", params={"format": form, "language": language}).content
    if target is not None:
        with room_at(target):
            target.write_bytes(found)
    return found
