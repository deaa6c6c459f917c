"""What an agent does with an attempt: takes it, says that it lives, opens the recording, ends it."""

from __future__ import annotations

from typing import Any

from sqlalchemy.orm import Session

from api.convert.acquisitions import unknown_to_agent
from api.problems.documents import Problem
from api.schemas.acquisitions import AttemptDatasetRequest, AttemptFault, FinishRequest, HeartbeatRequest
from api.schemas.datasets import DatasetRequest
from api.services.operation.app_context import Caller
from api.services.recordings import datasets
from api.services.rigs.agents import LEASE
from storage.clock import shared_now
from storage.errors import NotFoundError
from storage.models import AcquisitionAttempt, AcquisitionStatus, Agent, DatasetStatus, Rig
from storage.models.base import utc_now
from storage.repositories import AcquisitionRepository, AgentRepository, DatasetRepository
from storage.repositories.acquisitions import end_leases


def claim(session: Session, caller: Caller, agent_id: str) -> dict[str, Any] | None:
    """Give an agent the oldest attempt that waits for its rig; None when there is none."""
    agents = AgentRepository(session, caller.workspace)
    rig = agents.see(agent_id)
    end_leases(session)
    repository = AcquisitionRepository(session, caller.workspace)
    row = repository.claim(rig, agent_id=agent_id, lease=LEASE)
    if row is None:
        return None
    acquisition = repository.get(row.acquisition_id)
    told = acquisition.document["told"]
    unknown = unknown_to_agent(told, rig.document)
    if unknown:  # it was asked for when the rig had a newer agent
        detail = f"{', '.join(unknown)} must be known to the agent of {rig.name}, this one is older: update it"
        repository.finish(row, facts={}, error=_problem(AttemptFault(code="agent_too_old", detail=detail)))
        return None
    return {
        "acquisition": row.acquisition_id,
        "attempt": row.number,
        "job": row.job_id,
        "name": acquisition.name,
        **_lease(),
        "request": told,
    }


def heartbeat(
    session: Session, caller: Caller, identifier: str, number: int, request: HeartbeatRequest
) -> dict[str, Any]:
    """Prolong the lease of an attempt."""
    repository, row, agent, _ = _of(session, caller, identifier, number, request.agent)
    agent.seen_at = shared_now(session)
    repository.beat(
        row,
        agent_id=agent.id,
        lease=LEASE,
        status=AcquisitionStatus(request.status),
        progress=request.progress,
        message=request.message,
        preview=None if request.preview is None else request.preview.model_dump(mode="json", exclude_none=True),
        keep=_recorded(repository, identifier),
    )
    return _lease()


def open_dataset(
    session: Session, caller: Caller, identifier: str, number: int, request: AttemptDatasetRequest
) -> dict[str, Any]:
    """Open the recording of an attempt, or return it where it is open already."""
    repository, row, agent, rig = _of(session, caller, identifier, number, request.agent)
    if row.dataset_id is not None:
        return datasets.get(session, caller, row.dataset_id)
    acquisition = repository.get(identifier)
    origin = {
        "acquisition": identifier,
        "attempt": number,
        "agent": {"id": agent.id, "name": agent.name, "version": agent.version},
        "rig": {"id": rig.id, "name": rig.name, **rig.document},
        "requested": acquisition.document["request"],
        "facts": request.facts,
    }
    document = DatasetRequest(
        name=acquisition.name if number == 1 else f"{acquisition.name}, attempt {number}",
        format="raw",
        start_time=request.start_time,
        sample_rate=request.sample_rate,
        channels=request.channels,
        origin=origin,
    )
    created = datasets.create(session, caller, document)
    repository.set_dataset(row, created["id"])
    return created


def finish(session: Session, caller: Caller, identifier: str, number: int, request: FinishRequest) -> dict[str, Any]:
    """Bring an attempt to its end.

    Raises
    ------
    Problem
        409 for one that is said to have succeeded, or has recorded something, before its recording is committed.
    """
    repository, row, _, _ = _of(session, caller, identifier, number, request.agent)
    if row.dataset_id is not None:
        dataset = DatasetRepository(session, caller.workspace).get(row.dataset_id)
        if dataset.status != DatasetStatus.READY and not (dataset.status == DatasetStatus.OPEN and request.error):
            raise Problem(409, "conflict", f"dataset {dataset.id!r} must be ready first, it is {dataset.status}")
        dataset.origin = {**(dataset.origin or {}), "facts": request.facts}
        session.flush()
    elif request.error is None and _recorded(repository, identifier):
        raise Problem(
            409, "conflict", f"attempt {number} of {identifier!r} must have a dataset to be done, it has none"
        )
    error = None if request.error is None else _problem(request.error)
    row = repository.finish(row, facts=request.facts, error=error)
    return {"status": str(row.status), "dataset": row.dataset_id, "late": row.late}


def _recorded(repository: AcquisitionRepository, identifier: str) -> bool:
    """Say whether the samples of a measurement are kept; older ones are."""
    return bool(repository.get(identifier).document["told"].get("record", True))


def _problem(fault: AttemptFault) -> dict[str, Any]:
    return {
        "type": f"urn:servotune:problem:{fault.code}",
        "title": fault.code.replace("_", " ").capitalize(),
        "detail": fault.detail,
    }


def _of(
    session: Session, caller: Caller, identifier: str, number: int, agent_id: str
) -> tuple[AcquisitionRepository, AcquisitionAttempt, Agent, Rig]:
    """Return an attempt and the agent that speaks of it: its own, or, of one that is over, any of the same rig."""
    repository = AcquisitionRepository(session, caller.workspace)
    agents = AgentRepository(session, caller.workspace)
    row = repository.attempt(identifier, number)
    rig = agents.rig(repository.get(identifier).rig_id)
    try:
        agent = agents.get(agent_id)
    except NotFoundError as error:
        raise Problem(409, "conflict", f"agent must be one of the rig {rig.name!r}, got {agent_id!r}") from error
    over = AcquisitionStatus(row.status).final
    if agent.rig_id != rig.id or row.agent_id is None or (row.agent_id != agent.id and not over):
        raise Problem(409, "conflict", f"attempt {number} of {identifier!r} must be the agent's own, it is not")
    return repository, row, agent, rig


def _lease() -> dict[str, Any]:
    return {"lease_seconds": LEASE.total_seconds(), "time": utc_now().isoformat()}
