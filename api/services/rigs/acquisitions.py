"""Measurements as their users see them: asked for, followed, cancelled, tried again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date, timedelta
from typing import Any

from pydantic import ValidationError
from sqlalchemy.orm import Session

from api.convert.acquisitions import agent_request, check_against_rig, unknown_to_agent
from api.convert.triggers import agent_trigger
from api.problems.documents import invalid
from api.schemas.acquisitions import AcquisitionBody, AcquisitionRequest
from api.services.operation.app_context import Caller, Installation
from api.services.recordings.datasets import channel_reader
from api.services.rigs.agents import LEASE, silence
from api.services.rigs.chains import check_chain
from api.services.rigs.repetitions import joints
from storage.errors import NotFoundError
from storage.models import Acquisition, AcquisitionAttempt, AcquisitionStatus, Rig
from storage.models.base import utc_now
from storage.repositories import (
    AcquisitionRepository,
    AcquisitionTemplateRepository,
    AgentRepository,
    JobRepository,
)
from storage.repositories.acquisitions import end_leases

_MAY_BE_NONE = frozenset({"drive", "trigger"})
"""Of a template, what null takes away."""
_SOON = timedelta(days=30)
"""Before a calibration is due, measurements say so."""
_SAME_RATE = 0.01
"""Share of the rate that was asked for by which that of the hardware may differ without a word."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Prepared:
    """A measurement that makes sense on its rig, and what the agent will be told."""

    body: AcquisitionBody
    document: dict[str, Any]
    request: dict[str, Any]
    rig: Rig
    periodic: dict[str, float] | None
    """Of a drive that repeats by itself: its `period`, s, and the `fastest` of its sines, rad/s."""


def prepare(service: Installation, caller: Caller, request: AcquisitionRequest) -> Prepared:
    """Prove that a measurement can be made on its rig.

    Raises
    ------
    Problem
        422 with the place of what is wrong.
    """
    with service.database.session() as session:
        document = _complete(session, caller, request)
        try:
            body = AcquisitionBody.model_validate(document)
        except ValidationError as error:  # only what the template leaves open can be missing here
            first = error.errors()[0]
            raise invalid(f"{first['loc'][0]} must be given, here or in the template", *first["loc"]) from error
        try:
            rig = AgentRepository(session, caller.workspace).rig_named(body.rig)
        except NotFoundError as error:
            raise invalid(f"rig must be one that an agent has registered, got {body.rig!r}", "rig") from error
    told, wish = agent_request(body, rig.document, read_channel=channel_reader(service, caller))
    check_against_rig(body, told, rig.document, wish=wish)
    told["trigger"] = agent_trigger(body, told, rig.document)
    for name in unknown_to_agent(told, rig.document):
        raise invalid(
            f"{name} must be known to the agent of {rig.name}, it is not: update the agent",
            "channels" if name == "commanded" else name,
        )
    check_chain(service, caller, body, rig.document)
    periodic = None
    if wish is not None and wish.period is not None:
        periodic = {"period": wish.period, "fastest": wish.fastest}
    return Prepared(body=body, document=document, request=told, rig=rig, periodic=periodic)


def _complete(session: Session, caller: Caller, request: AcquisitionRequest) -> dict[str, Any]:
    given = request.model_dump(by_alias=True, exclude_unset=True, exclude={"template"}, mode="json")
    given = {key: value for key, value in given.items() if value is not None or key in _MAY_BE_NONE}
    if request.template is None:
        return given
    try:
        template = AcquisitionTemplateRepository(session, caller.workspace).get(request.template)
    except NotFoundError as error:
        raise invalid(f"template must be one that exists, got {request.template!r}", "template") from error
    return {**template.document, **given}


def submit(session: Session, caller: Caller, prepared: Prepared) -> dict[str, Any]:
    """Write a measurement down for its rig's agent."""
    repository = AcquisitionRepository(session, caller.workspace)
    row = repository.create(
        prepared.rig,
        name=prepared.body.name,
        document={"request": prepared.document, "told": prepared.request, "periodic": prepared.periodic},
        follow_ups=[{"kind": step.kind, "body": step.body} for step in prepared.body.then],
    )
    return to_wire(session, repository, repository.get(row.id))


def get(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Return a measurement with its attempts."""
    repository = AcquisitionRepository(session, caller.workspace)
    return to_wire(session, repository, repository.get(identifier))


def page(
    session: Session, caller: Caller, *, status: str | None, rig: str | None, cursor: str | None, limit: int
) -> dict[str, Any]:
    """Return one page of the measurements, newest first."""
    repository = AcquisitionRepository(session, caller.workspace)
    rigs = AgentRepository(session, caller.workspace)
    try:
        rig_id = None if rig is None else rigs.rig_named(rig).id
    except NotFoundError:
        return {"items": [], "next_cursor": None}
    found = repository.page(status=status, rig_id=rig_id, cursor=cursor, limit=limit)
    items = [_head(row, rigs.rig(row.rig_id), repository.attempt(row.id, row.attempt)) for row in found.items]
    return {"items": items, "next_cursor": found.next_cursor}


def cancel(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Cancel the latest attempt; the agent stops within seconds, what it has recorded still comes."""
    repository = AcquisitionRepository(session, caller.workspace)
    row = repository.get(identifier)
    JobRepository(session, caller.workspace).cancel(repository.attempt(identifier, row.attempt).job_id)
    end_leases(session, only=identifier)
    return get(session, caller, identifier)


def retry(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Let a person try a measurement once more."""
    repository = AcquisitionRepository(session, caller.workspace)
    return to_wire(session, repository, repository.retry(identifier))


def job_of(session: Session, caller: Caller, identifier: str) -> str:
    """Return the job of the latest attempt."""
    repository = AcquisitionRepository(session, caller.workspace)
    return repository.attempt(identifier, repository.get(identifier).attempt).job_id


def to_wire(session: Session, repository: AcquisitionRepository, row: Acquisition) -> dict[str, Any]:
    """Return a measurement with its attempts and what follows them."""
    attempts = repository.attempts(row.id)
    rig = session.get(Rig, row.rig_id)
    assert rig is not None
    document = row.document["request"]
    return {
        **_head(row, rig, attempts[-1]),
        "document": document,
        "job": attempts[-1].job_id,
        "attempts": [_attempt(repository, attempt) for attempt in attempts],
        "warnings": _away(session, row, rig)
        + _other_rate(attempts[-1].facts)
        + joints(row.document, attempts[-1].facts)
        + _due(document["channels"], rig.document)
        + _seen(document["channels"], attempts[-1].facts),
    }


def _head(row: Acquisition, rig: Rig, latest: AcquisitionAttempt) -> dict[str, Any]:
    return {
        "id": row.id,
        "name": row.name,
        "rig": rig.name,
        "status": str(row.status),
        "attempt": row.attempt,
        "created_at": row.created_at.isoformat(),
        "dataset": latest.dataset_id,
    }


def _attempt(repository: AcquisitionRepository, row: AcquisitionAttempt) -> dict[str, Any]:
    return {
        "number": row.number,
        "status": str(row.status),
        "job": row.job_id,
        "agent": row.agent_id,
        "dataset": row.dataset_id,
        "late": row.late,
        "claimed_at": row.claimed_at.isoformat() if row.claimed_at else None,
        "ended_at": row.ended_at.isoformat() if row.ended_at else None,
        "lease_until": row.lease_until.isoformat() if row.lease_until else None,
        "facts": row.facts,
        "error": row.error,
        "then": [
            {"kind": step.kind, "status": step.status, "job": step.job_id, "result": step.result, "detail": step.detail}
            for step in repository.follow_ups(row.acquisition_id, row.number)
        ],
    }


def _away(session: Session, row: Acquisition, rig: Rig) -> list[dict[str, Any]]:
    """Say of a measurement that waits that nobody is there to begin it."""
    silent = silence(session, rig)
    if row.status != AcquisitionStatus.QUEUED:
        return []
    if silent is not None and silent < LEASE:
        return _unrested(rig)
    told = "no agent has it" if silent is None else f"it was not for {silent.total_seconds():.0f} s"
    detail = f"the agent of {rig.name} must be heard of every {LEASE.total_seconds():g} s, {told}: the measurement waits until it is back"
    return [{"pointer": "/rig", "level": "warning", "detail": detail}]


def _unrested(rig: Rig) -> list[dict[str, Any]]:
    """Say of a measurement that waits that the rig's hardware keeps its agent from beginning any."""
    found = [entry for entry in rig.document.get("findings", ()) if entry.get("what") == "hardware"]
    return [
        {"pointer": "/rig", "level": "warning", "detail": f"{rig.name} measures nothing before this is mended: {told}"}
        for told in (f"{entry['told']} - {entry['remedy']}" for entry in found if entry.get("result") == "fails")
    ]


def _other_rate(facts: Mapping[str, Any] | None) -> list[dict[str, Any]]:
    """Say where the hardware took its samples at a rate that is not the one that was asked for."""
    asked, had = ((facts or {}).get(name) for name in ("requested_rate", "actual_rate"))
    if not (isinstance(asked, int | float) and isinstance(had, int | float) and abs(had - asked) > _SAME_RATE * asked):
        return []  # facts are an agent's own, of whatever version
    detail = f"sample_rate must be one that the hardware has: {asked:g} samples/s were asked for, it took {had:.6g}"
    return [{"pointer": "/sample_rate", "level": "warning", "detail": detail}]


def _due(channels: list[str], rig: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Say which calibrations are over, and which soon will be."""
    today = utc_now().date()
    inputs = {entry["name"]: entry for entry in rig.get("inputs", ())}
    found = []
    for i, name in enumerate(channels):
        entry = inputs.get(name, {})
        parts = [(name, entry)] + [(f"{s['model'] or 'a stage'} behind {name}", s) for s in entry.get("chain", ())]
        for what, part in parts:
            due = part.get("calibration", {}).get("due", "")
            day = _date(due)
            if day is not None and day < today + _SOON:
                was = "was" if day < today else "is"
                detail = f"calibration of {what} {was} due on {due}"
                found.append({"pointer": f"/channels/{i}", "level": "warning", "detail": detail})
    return found


def _seen(channels: list[str], facts: Mapping[str, Any] | None) -> list[dict[str, Any]]:
    """Say what the agent has seen of the channels that were recorded: overload, drop-out, a range that is too large."""
    told = (facts or {}).get("warnings")
    found = []
    for entry in told if isinstance(told, list) else []:  # facts are an agent's own, of whatever version
        name, level, detail = (
            (entry if isinstance(entry, dict) else {}).get(key) for key in ("channel", "level", "detail")
        )
        if name in channels and level in ("warning", "information") and detail:
            found.append({"pointer": f"/channels/{channels.index(name)}", "level": level, "detail": str(detail)})
    return found


def _date(text: str) -> date | None:
    try:
        return date.fromisoformat(text)
    except ValueError:
        return None
