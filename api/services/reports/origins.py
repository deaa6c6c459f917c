"""Who asked for a study, when, and what it was made from: all that a report reads of the database."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy.orm import Session

from engine.diagram.diagram import Diagram
from storage.audit import entries
from storage.models import ApiKey, Schedule, SignIn
from storage.repositories import JobRepository, LineageRepository, ResultRepository, SystemRepository
from storage.repositories.lineage import Graph


@dataclass(frozen=True, slots=True, kw_only=True)
class Told:
    """A job with its result, or a kept study, and where it comes from.

    ``status`` is empty of a kept study, which was answered at once; ``reference`` is the stored system and its revision, and
    ``system`` the document as it was then, None where there was none; ``author`` is empty where the audit log does not reach
    back so far; ``warned`` is what the service warned of before it computed. ``lineage`` is everything that it was made from.
    """

    id: str
    kind: str
    status: str
    created_at: datetime
    started_at: datetime | None
    finished_at: datetime | None
    request: Mapping[str, Any]
    result: Mapping[str, Any]
    versions: Mapping[str, str]
    author: str
    reference: Mapping[str, Any] | None
    system: Mapping[str, Any] | None
    warned: Sequence[Mapping[str, Any]]
    lineage: Graph


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What is reported of: what is told of it, and the checked diagram of its system, None where it had none."""

    told: Told
    diagram: Diagram | None

    @property
    def request(self) -> Mapping[str, Any]:
        """The body that asked for it."""
        return self.told.request

    @property
    def result(self) -> Mapping[str, Any]:
        """The body that came out."""
        return self.told.result


def of_a_job(session: Session, workspace: str, identifier: str) -> Told:
    """Return what is known of a job that has a result; raises `NotFoundError` where there is none."""
    job = JobRepository(session, workspace).get(identifier)
    results = ResultRepository(session, workspace)
    row = results.get(str(job.result_id))
    request, reference = job.body.get("request") or {}, job.body.get("system_reference")
    return Told(
        id=job.id,
        kind=job.kind,
        status=job.status,
        created_at=job.created_at,
        started_at=job.started_at,
        finished_at=job.finished_at,
        request=request,
        result=results.body(row),
        versions=row.versions,
        author=_author(session, workspace, "job.create", identifier),
        reference=reference,
        system=_system(session, workspace, request, reference),
        warned=job.body.get("warnings", []),
        lineage=LineageRepository(session, workspace).graph(identifier, direction="up"),
    )


def of_a_kept_study(session: Session, workspace: str, identifier: str) -> Told:
    """Return what is known of a study that was asked to be kept; raises `NotFoundError` where there is none."""
    results = ResultRepository(session, workspace)
    row = results.get(identifier)
    request = row.request or {}
    reference = {"id": row.system_id, "revision": row.system_revision} if row.system_id else None
    return Told(
        id=row.id,
        kind=row.kind,
        status="",
        created_at=row.created_at,
        started_at=None,
        finished_at=None,
        request=request,
        result=results.body(row),
        versions=row.versions,
        author=_author(session, workspace, "result.create", identifier),
        reference=reference,
        system=_system(session, workspace, request, reference),
        warned=(),
        lineage=LineageRepository(session, workspace).graph(identifier, direction="up"),
    )


def _system(
    session: Session, workspace: str, request: Mapping[str, Any], reference: Mapping[str, Any] | None
) -> Mapping[str, Any] | None:
    """Return the document that was asked about, also of a system that was deleted since."""
    written = request.get("system")
    if isinstance(written, dict):
        return written
    if reference is None:
        return None
    return SystemRepository(session, workspace).kept_revision(reference["id"], reference["revision"])


def _author(session: Session, workspace: str, action: str, identifier: str) -> str:
    """Return the name of the key, the person or the schedule that asked for it."""
    entry = next(iter(entries(session, workspace, action=action, target=identifier, limit=1).items), None)
    if entry is None:
        return ""
    key, visitor = session.get(ApiKey, entry.principal), session.get(SignIn, entry.principal)
    rows = (key, visitor, session.get(Schedule, entry.principal))
    return next((row.name for row in rows if row is not None and row.workspace_id == workspace), entry.principal)
