"""Who asked for a job, when, and what it was made from: all that a report reads of the database."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy.orm import Session

from engine.diagram.diagram import Diagram
from storage.audit import entries
from storage.models import ApiKey, Job, Schedule, SignIn
from storage.repositories import JobRepository, LineageRepository, ResultRepository, SystemRepository
from storage.repositories.lineage import Graph


@dataclass(frozen=True, slots=True, kw_only=True)
class Told:
    """A job with its result, and where it comes from.

    ``system`` is the document as it was then, None where the job had none; ``author`` is empty where the audit log does not
    reach back so far. ``lineage`` is everything that the job was made from.
    """

    job: Job
    request: Mapping[str, Any]
    result: Mapping[str, Any]
    versions: Mapping[str, str]
    author: str
    system: Mapping[str, Any] | None
    lineage: Graph


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What is reported of: the job with its result, and the checked diagram of its system, None where it had none."""

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


def tell(session: Session, workspace: str, identifier: str) -> Told:
    """Return what is known of a job that has a result; raises `NotFoundError` where there is none."""
    job = JobRepository(session, workspace).get(identifier)
    results = ResultRepository(session, workspace)
    row = results.get(str(job.result_id))
    found = Told(
        job=job,
        request=job.body.get("request") or {},
        result=results.body(row),
        versions=row.versions,
        author=_author(session, workspace, identifier),
        system=_system(session, workspace, job),
        lineage=LineageRepository(session, workspace).graph(identifier, direction="up"),
    )
    session.expunge(job)  # read later, when the connection is given back
    return found


def _system(session: Session, workspace: str, job: Job) -> Mapping[str, Any] | None:
    """Return the document that was asked about, also of a system that was deleted since."""
    written = (job.body.get("request") or {}).get("system")
    if isinstance(written, dict):
        return written
    reference = job.body.get("system_reference")
    if reference is None:
        return None
    return SystemRepository(session, workspace).kept_revision(reference["id"], reference["revision"])


def _author(session: Session, workspace: str, identifier: str) -> str:
    """Return the name of the key, the person or the schedule that asked for a job."""
    entry = next(iter(entries(session, workspace, action="job.create", target=identifier, limit=1).items), None)
    if entry is None:
        return ""
    key, visitor = session.get(ApiKey, entry.principal), session.get(SignIn, entry.principal)
    rows = (key, visitor, session.get(Schedule, entry.principal))
    return next((row.name for row in rows if row is not None and row.workspace_id == workspace), entry.principal)
