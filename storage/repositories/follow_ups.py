"""What follows a recording, step by step: a step waits for the one before it, and two processes never begin it twice."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import select, update
from sqlalchemy.orm import Session, aliased

from storage.models import Acquisition, AcquisitionAttempt, AcquisitionStatus, FollowUp, Job, JobStatus
from storage.models.base import Document

_FINAL = (JobStatus.SUCCEEDED, JobStatus.FAILED, JobStatus.CANCELLED)


def ready(session: Session, *, limit: int) -> Sequence[tuple[FollowUp, AcquisitionAttempt, str]]:
    """Return steps that can begin, with the attempt and its workspace: the recording and every step before are there."""
    before = aliased(FollowUp)
    held = (
        select(before.number)
        .where(
            before.acquisition_id == FollowUp.acquisition_id,
            before.attempt == FollowUp.attempt,
            before.number < FollowUp.number,
            before.status != "done",
        )
        .exists()
    )
    rows = (
        select(FollowUp, AcquisitionAttempt, Acquisition.workspace_id)
        .join(
            AcquisitionAttempt,
            (AcquisitionAttempt.acquisition_id == FollowUp.acquisition_id)
            & (AcquisitionAttempt.number == FollowUp.attempt),
        )
        .join(Acquisition, Acquisition.id == FollowUp.acquisition_id)
        .where(FollowUp.status == "waiting", AcquisitionAttempt.status == AcquisitionStatus.DONE, ~held)
        .limit(limit)
    )
    return [(step, attempt, workspace) for step, attempt, workspace in session.execute(rows)]


def ended(session: Session, *, limit: int) -> Sequence[tuple[FollowUp, Job]]:
    """Return steps whose job has ended."""
    rows = select(FollowUp, Job).join(Job, Job.id == FollowUp.job_id)
    found = session.execute(rows.where(FollowUp.status == "running", Job.status.in_(_FINAL)).limit(limit))
    return [(step, job) for step, job in found]


def before(session: Session, step: FollowUp) -> Sequence[FollowUp]:
    """Return the steps before one, the last of them first."""
    rows = select(FollowUp).where(
        FollowUp.acquisition_id == step.acquisition_id,
        FollowUp.attempt == step.attempt,
        FollowUp.number < step.number,
    )
    return session.scalars(rows.order_by(FollowUp.number.desc())).all()


def move(
    session: Session,
    step: FollowUp,
    *,
    came_from: str,
    status: str,
    job_id: str | None = None,
    result: Document | None = None,
    detail: str | None = None,
) -> bool:
    """Give a step its next status; False when another process has. A failed step lets the later ones be skipped."""
    mine = (FollowUp.acquisition_id == step.acquisition_id) & (FollowUp.attempt == step.attempt)
    values = {"status": status, "result": result, "detail": detail, "job_id": job_id or step.job_id}
    taken = session.execute(
        update(FollowUp)
        .where(mine, FollowUp.number == step.number, FollowUp.status == came_from)
        .values(**values)
        .returning(FollowUp.number)
        .execution_options(synchronize_session=False)
    ).one_or_none()
    if taken is not None and status == "failed":
        session.execute(
            update(FollowUp)
            .where(mine, FollowUp.number > step.number)
            .values(status="skipped", detail=f"step {step.number + 1} ({step.kind}) has failed")
            .execution_options(synchronize_session=False)
        )
    return taken is not None


def set_job(session: Session, step: FollowUp, job_id: str) -> None:
    """Remember the job of a step that was begun in this transaction."""
    session.execute(
        update(FollowUp)
        .where(
            FollowUp.acquisition_id == step.acquisition_id,
            FollowUp.attempt == step.attempt,
            FollowUp.number == step.number,
        )
        .values(job_id=job_id)
        .execution_options(synchronize_session=False)
    )
