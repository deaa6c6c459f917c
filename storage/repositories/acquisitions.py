"""Measurements and their attempts.

::

    queued -> claimed -> running -> uploading -> done | failed
    queued -> cancelled,  claimed | running -> lost | cancelled     (the lease has ended, or the job was cancelled)

An attempt on the rig needs its lease. One that has lost it is never repeated by itself, because it may have moved
something: a person asks for the next attempt. Its samples, which may come days later, are kept under its number.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import delete, select, update
from sqlalchemy.orm import Session

from storage.audit import record
from storage.clock import jumps, shared_now
from storage.errors import CancelledError, LeaseLostError, NotFoundError, StateError
from storage.ids import new_id
from storage.models import Acquisition, AcquisitionAttempt, AcquisitionStatus, FollowUp, Job, JobEvent, JobStatus, Rig
from storage.models.acquisition import ON_THE_RIG
from storage.models.base import Document
from storage.pagination import Page, paginate
from storage.repositories import jobs
from storage.repositories.jobs import JobRepository
from storage.repositories.results import ResultRepository

KIND = "acquisition"
"""Kind of the job that stands for an attempt; no worker computes it, an agent does it."""

_ALIVE = (AcquisitionStatus.QUEUED, *ON_THE_RIG, AcquisitionStatus.UPLOADING)
#: What the job of an attempt becomes with it.
_JOB = {
    AcquisitionStatus.DONE: JobStatus.SUCCEEDED,
    AcquisitionStatus.FAILED: JobStatus.FAILED,
    AcquisitionStatus.LOST: JobStatus.FAILED,
    AcquisitionStatus.CANCELLED: JobStatus.CANCELLED,
}


class AcquisitionRepository:
    """The measurements of one workspace."""

    def __init__(self, session: Session, workspace_id: str) -> None:
        self._session = session
        self._workspace_id = workspace_id

    def create(self, rig: Rig, *, name: str, document: Document, follow_ups: Sequence[Document]) -> Acquisition:
        """Ask for a measurement; its first attempt waits for the rig's agent."""
        row = Acquisition(
            id=new_id("acq"), workspace_id=self._workspace_id, rig_id=rig.id, name=name, document=document, attempt=1
        )
        self._session.add(row)
        self._session.flush()
        self._add_attempt(row, follow_ups)
        record(self._session, self._workspace_id, "acquisition.create", row.id, rig=rig.id)
        return row

    def get(self, identifier: str) -> Acquisition:
        """Return a measurement as it is now; raise `NotFoundError` when it is not in this workspace."""
        row = self._session.get(Acquisition, identifier, populate_existing=True)
        if row is None or row.workspace_id != self._workspace_id:
            raise NotFoundError("acquisition", identifier)
        return row

    def page(
        self, *, status: str | None = None, rig_id: str | None = None, cursor: str | None = None, limit: int = 100
    ) -> Page[Acquisition]:
        """Return the measurements of the workspace, newest first."""
        rows = select(Acquisition).where(Acquisition.workspace_id == self._workspace_id)
        if status is not None:
            rows = rows.where(Acquisition.status == status)
        if rig_id is not None:
            rows = rows.where(Acquisition.rig_id == rig_id)
        return paginate(self._session, rows, Acquisition, cursor=cursor, limit=limit)

    def attempts(self, identifier: str) -> Sequence[AcquisitionAttempt]:
        """Return the attempts at a measurement, the first one first."""
        rows = select(AcquisitionAttempt).where(AcquisitionAttempt.acquisition_id == identifier)
        return self._session.scalars(
            rows.order_by(AcquisitionAttempt.number).execution_options(populate_existing=True)
        ).all()

    def attempt(self, identifier: str, number: int) -> AcquisitionAttempt:
        """Return one attempt; raise `NotFoundError` when there is none."""
        self.get(identifier)
        row = self._session.get(AcquisitionAttempt, (identifier, number), populate_existing=True)
        if row is None:
            raise NotFoundError("attempt", f"{identifier}/{number}")
        return row

    def follow_ups(self, identifier: str, number: int) -> Sequence[FollowUp]:
        """Return the chain of one attempt, in its order."""
        rows = select(FollowUp).where(FollowUp.acquisition_id == identifier, FollowUp.attempt == number)
        return self._session.scalars(rows.order_by(FollowUp.number).execution_options(populate_existing=True)).all()

    def retry(self, identifier: str) -> Acquisition:
        """Let the measurement be tried once more, because a person says so.

        Raises
        ------
        StateError
            Unless the latest attempt has failed, was lost or was cancelled.
        """
        row = self.get(identifier)
        taken = self._session.execute(
            update(Acquisition)
            .where(
                Acquisition.id == identifier,
                Acquisition.status.in_((AcquisitionStatus.FAILED, AcquisitionStatus.LOST, AcquisitionStatus.CANCELLED)),
            )
            .values(attempt=Acquisition.attempt + 1, status=AcquisitionStatus.QUEUED)
            .returning(Acquisition.id)
            .execution_options(synchronize_session=False)
        ).one_or_none()
        row = self.get(identifier)
        if taken is None:
            raise StateError(
                f"acquisition {identifier!r} must have failed, been lost or cancelled to be tried again, it is {row.status}"
            )
        chain = [{"kind": step.kind, "body": step.body} for step in self.follow_ups(identifier, row.attempt - 1)]
        self._add_attempt(row, chain)
        record(self._session, self._workspace_id, "acquisition.retry", identifier, attempt=row.attempt)
        return row

    def claim(self, rig: Rig, *, agent_id: str, lease: timedelta) -> AcquisitionAttempt | None:
        """Give the rig's agent the oldest waiting attempt; None when there is none, or the rig is busy."""
        # Writing to the rig's row makes two claims wait for each other.
        self._session.execute(
            update(Rig).where(Rig.id == rig.id).values(name=Rig.name).execution_options(synchronize_session=False)
        )
        mine = (
            select(AcquisitionAttempt)
            .join(Acquisition, Acquisition.id == AcquisitionAttempt.acquisition_id)
            .where(Acquisition.rig_id == rig.id)
        )
        if self._session.scalars(mine.where(AcquisitionAttempt.status.in_(ON_THE_RIG)).limit(1)).first() is not None:
            return None
        waiting = (
            mine.join(Job, Job.id == AcquisitionAttempt.job_id)
            .where(AcquisitionAttempt.status == AcquisitionStatus.QUEUED, Job.status == JobStatus.QUEUED)
            .order_by(AcquisitionAttempt.created_at, AcquisitionAttempt.acquisition_id)
            .limit(1)
        )
        row = self._session.scalars(waiting).first()
        if row is None or not jobs.lock(self._session, row.job_id, attempt=None):
            return None
        now = shared_now(self._session)
        started = {"status": JobStatus.RUNNING, "attempts": 1, "worker": agent_id, "started_at": now}
        jobs.append_event(self._session, row.job_id, "status", {"status": JobStatus.RUNNING, "attempt": 1}, **started)
        self._change(row, status=AcquisitionStatus.CLAIMED, agent_id=agent_id, claimed_at=now, lease_until=now + lease)
        return row

    def beat(
        self,
        row: AcquisitionAttempt,
        *,
        agent_id: str,
        lease: timedelta,
        status: AcquisitionStatus,
        progress: float | None,
        message: str | None,
        preview: Document | None,
        keep: bool,
    ) -> None:
        """Prolong the lease of an attempt and write down how far it is; previews before the last one are forgotten unless ``keep``.

        Raises
        ------
        LeaseLostError
            When the attempt is over for this agent: the lease has ended, or (`CancelledError`) the job was cancelled.
        """
        end_leases(self._session, only=row.acquisition_id)
        row = self.attempt(row.acquisition_id, row.number)
        if row.agent_id == agent_id and row.status == AcquisitionStatus.CANCELLED:
            raise CancelledError(f"attempt {row.number} of {row.acquisition_id!r} was cancelled")
        if row.agent_id != agent_id or row.status not in _ALIVE:
            raise LeaseLostError(
                f"attempt {row.number} of {row.acquisition_id!r} must be in the hands of {agent_id!r}, it is {row.status}"
            )
        on_the_rig = status in ON_THE_RIG
        if row.status == AcquisitionStatus.UPLOADING and on_the_rig:
            raise StateError(f"attempt {row.number} of {row.acquisition_id!r} uploads already, it cannot be {status}")
        self._change(row, status=status, lease_until=shared_now(self._session) + lease if on_the_rig else None)
        if progress is not None or message is not None:
            jobs.report(self._session, row.job_id, attempt=1, progress=progress, message=message)
        if preview is not None:
            if not keep:
                shown = (JobEvent.job_id == row.job_id, JobEvent.type == "preview")
                self._session.execute(delete(JobEvent).where(*shown))
            jobs.append_event(self._session, row.job_id, "preview", preview)

    def set_dataset(self, row: AcquisitionAttempt, dataset_id: str) -> None:
        """Remember which recording the samples of an attempt go into."""
        self._change(row, dataset_id=dataset_id, late=row.status not in _ALIVE)

    def finish(self, row: AcquisitionAttempt, *, facts: Document, error: Document | None) -> AcquisitionAttempt:
        """Bring an attempt to its end; one that was given up before stays so, and keeps what is now known of it.

        Said twice, it is the same.
        """
        if row.status in {AcquisitionStatus.DONE, AcquisitionStatus.FAILED}:
            return row
        if row.status not in _ALIVE:
            self._change(row, facts=facts, error=error or row.error, late=True)
            return row
        status = AcquisitionStatus.DONE if error is None else AcquisitionStatus.FAILED
        self._change(row, status=status, facts=facts, error=error, ended_at=shared_now(self._session), lease_until=None)
        result_id = None
        if status is AcquisitionStatus.DONE:
            body = {"acquisition": row.acquisition_id, "attempt": row.number, "dataset": row.dataset_id, "facts": facts}
            result = ResultRepository(self._session, self._workspace_id).create(
                kind=KIND, body=body, within_quota=False
            )
            result_id = result.id
        jobs.finish(self._session, row.job_id, status=_JOB[status], error=error, result_id=result_id)
        record(self._session, self._workspace_id, f"acquisition.{status}", row.acquisition_id, attempt=row.number)
        return row

    def _add_attempt(self, row: Acquisition, follow_ups: Sequence[Document]) -> None:
        body = {"acquisition": row.id, "attempt": row.attempt}
        job = JobRepository(self._session, self._workspace_id).create(kind=KIND, body=body)
        self._session.add(AcquisitionAttempt(acquisition_id=row.id, number=row.attempt, job_id=job.id))
        self._session.flush()
        for number, step in enumerate(follow_ups):
            self._session.add(FollowUp(acquisition_id=row.id, attempt=row.attempt, number=number, **step))
        self._session.flush()

    def _change(self, row: AcquisitionAttempt, **values: Any) -> None:
        change(self._session, row, **values)


def change(session: Session, row: AcquisitionAttempt, **values: Any) -> None:
    """Change an attempt, and the measurement's status with its latest one."""
    for name, value in values.items():
        setattr(row, name, value)
    session.flush()
    if "status" in values:
        session.execute(
            update(Acquisition)
            .where(Acquisition.id == row.acquisition_id, Acquisition.attempt == row.number)
            .values(status=values["status"])
            .execution_options(synchronize_session=False)
        )


def renew_leases(session: Session, *, lease: timedelta) -> datetime:
    """Let every lease begin anew where the clock was set since the last look, or nobody has looked; return the time of now.

    The caller notes that time when the transaction is committed (`storage.clock.jumps`).
    """
    now = shared_now(session)
    if not jumps(session).steady(now):
        held = update(AcquisitionAttempt).where(
            AcquisitionAttempt.status.in_(_ALIVE), AcquisitionAttempt.lease_until.is_not(None)
        )
        session.execute(held.values(lease_until=now + lease).execution_options(synchronize_session=False))
    return now


def end_leases(session: Session, *, only: str | None = None, limit: int = 100) -> int:
    """Give up attempts whose lease has ended, or whose job was cancelled; return how many those were.

    While the clock has jumped no lease ends: `renew_leases` comes first.

    Parameters
    ----------
    only : str, optional
        Look at one measurement alone.
    """
    now = shared_now(session)
    ended = Job.status == JobStatus.CANCELLED
    if jumps(session).steady(now):
        ended = ended | (AcquisitionAttempt.lease_until < now)
    over = (
        select(AcquisitionAttempt, Job.status, Job.workspace_id)
        .join(Job, Job.id == AcquisitionAttempt.job_id)
        .where(AcquisitionAttempt.status.in_(_ALIVE), ended)
        .limit(limit)
    )
    if only is not None:
        over = over.where(AcquisitionAttempt.acquisition_id == only)
    found = session.execute(over.execution_options(populate_existing=True)).all()
    for row, job_status, workspace in found:
        cancelled = job_status == JobStatus.CANCELLED
        status = AcquisitionStatus.CANCELLED if cancelled else AcquisitionStatus.LOST
        taken = session.execute(
            update(AcquisitionAttempt)
            .where(
                AcquisitionAttempt.acquisition_id == row.acquisition_id,
                AcquisitionAttempt.number == row.number,
                AcquisitionAttempt.status == row.status,
            )
            .values(status=status)
            .returning(AcquisitionAttempt.number)
            .execution_options(synchronize_session=False)
        ).one_or_none()
        if taken is None:
            continue
        error = None if cancelled else _lost(row)
        change(session, row, status=status, error=error, ended_at=now, lease_until=None)
        if not cancelled:
            jobs.finish(session, row.job_id, status=JobStatus.FAILED, error=error)
        record(session, workspace, f"acquisition.{status}", row.acquisition_id, attempt=row.number)
    return len(found)


def _lost(row: AcquisitionAttempt) -> Document:
    return {
        "type": "urn:servotune:problem:lost",
        "title": "Lost",
        "detail": f"nothing was heard of attempt {row.number} until its lease ended. It is not repeated by itself, because it "
        "may have moved something: look at the rig, then retry. Samples that still come are kept with this attempt",
    }
