"""Rigs and their agents: an agent takes its rig, says what is on it, and asks for work."""

from __future__ import annotations

from datetime import timedelta
from functools import partial
from typing import Any

from sqlalchemy.orm import Session

from api.convert.drives import UNITS
from api.convert.values import check_unit
from api.problems.documents import Fault, Problem, invalid, invalid_document
from api.problems.pointers import Place
from api.schemas.rigs import AgentRequest, RigInputDocument, RigOutputDocument
from api.services.operation.app_context import Caller
from api.units.conversion import UnitError, factor, to_si
from storage.clock import shared_now
from storage.models import Agent, Rig
from storage.models.base import utc_now
from storage.repositories import AgentRepository

LEASE = timedelta(seconds=30)
"""How long a rig may move without a word from its agent."""
_SENSORS = {"acceleration": "m/s**2", "force": "N", "velocity": "m/s", "thermocouple": "K"}
"""Kind of an input -> the SI unit of what its sensor measures; a voltage, a current or a bridge may stand for anything."""


def register(session: Session, caller: Caller, request: AgentRequest) -> dict[str, Any]:
    """Give a rig to an agent."""
    check(request)
    repository = AgentRepository(session, caller.workspace)
    agent = repository.register(
        rig_name=request.rig,
        instance=request.instance,
        name=request.name,
        version=request.version,
        document=request.document.model_dump(mode="json"),
        alive_within=LEASE,
    )
    return agent_to_wire(agent, repository.rig(agent.rig_id))


def check(request: AgentRequest) -> None:
    """Make sure that a rig makes sense.

    Raises
    ------
    Problem
        422 with all channels that do not.
    """
    rig = request.document
    _check_names("inputs", [entry.name for entry in rig.inputs])
    _check_names("outputs", [entry.name for entry in rig.outputs])
    found: list[Fault] = []
    parts = [partial(_check_input, entry, i) for i, entry in enumerate(rig.inputs)]
    for part in [*parts, *(partial(_check_output, entry, i) for i, entry in enumerate(rig.outputs))]:
        try:
            part()
        except Problem as problem:
            found += problem.faults
    if found:
        raise invalid_document(found)


def _check_input(entry: RigInputDocument, number: int) -> None:
    place = ("document", "inputs", number)
    check_unit(entry.unit, name=f"unit of {entry.name}", place=(*place, "unit"))
    _check_kind(entry, place=(*place, "unit"))
    try:
        factor(entry.unit, "")
    except UnitError as error:  # a recording could have it, but nothing is computed from it
        raise invalid(f"unit of {entry.name}: {error}", *place, "unit") from error
    if entry.sensitivity == 0.0:
        raise invalid(f"sensitivity of {entry.name} must not be 0, got 0", *place, "sensitivity")
    for k, stage in enumerate(entry.chain):
        if stage.gain == 0.0:
            raise invalid(f"gain in the chain of {entry.name} must not be 0, got 0", *place, "chain", k, "gain")


def _check_output(output: RigOutputDocument, number: int) -> None:
    if abs(output.safe) > output.amplitude:
        limit = f"{output.amplitude:g} {UNITS[output.kind]}".strip()
        detail = f"safe of {output.name} must be within its amplitude of {limit}, got {output.safe:g}"
        raise invalid(detail, "document", "outputs", number, "safe")


def _check_kind(entry: RigInputDocument, *, place: Place) -> None:
    """Refuse a sensor in a unit of something else; volts are what is left of one that nobody has calibrated."""
    expected = _SENSORS.get(entry.kind)
    if expected is None or entry.unit == "V":
        return
    try:
        to_si(1.0, entry.unit, expected)
    except UnitError as error:
        raise invalid(
            f"unit of {entry.name} must be one of {entry.kind} ({expected}) or V, got {entry.unit!r}", *place
        ) from error


def _check_names(key: str, names: list[str]) -> None:
    for i, name in enumerate(names):
        if name in names[:i]:
            raise invalid(f"name must be different for each channel, got {name!r} twice", *("document", key, i, "name"))


def get(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Return an agent."""
    repository = AgentRepository(session, caller.workspace)
    agent = repository.get(identifier)
    return agent_to_wire(agent, repository.rig(agent.rig_id))


def page(session: Session, caller: Caller, *, cursor: str | None, limit: int) -> dict[str, Any]:
    """Return one page of the agents, newest first."""
    repository = AgentRepository(session, caller.workspace)
    found = repository.page(cursor=cursor, limit=limit)
    items = [agent_to_wire(row, repository.rig(row.rig_id)) for row in found.items]
    return {"items": items, "next_cursor": found.next_cursor}


def get_rig(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Return a rig."""
    repository = AgentRepository(session, caller.workspace)
    return rig_to_wire(session, repository.rig(identifier))


def rigs(session: Session, caller: Caller, *, cursor: str | None, limit: int) -> dict[str, Any]:
    """Return one page of the rigs, newest first."""
    repository = AgentRepository(session, caller.workspace)
    found = repository.rigs(cursor=cursor, limit=limit)
    return {"items": [rig_to_wire(session, row) for row in found.items], "next_cursor": found.next_cursor}


def agent_to_wire(row: Agent, rig: Rig) -> dict[str, Any]:
    """Return an agent with what it must know of the service."""
    return {
        "id": row.id,
        "name": row.name,
        "version": row.version,
        "rig": rig.name,
        "rig_id": rig.id,
        "has_rig": rig.agent_id == row.id,
        "seen_at": row.seen_at.isoformat(),
        "created_at": row.created_at.isoformat(),
        "lease_seconds": LEASE.total_seconds(),
        "time": utc_now().isoformat(),
    }


def silence(session: Session, rig: Rig) -> timedelta | None:
    """Return for how long nothing was heard of a rig's agent; None for a rig that no agent has."""
    agent = session.get(Agent, rig.agent_id, populate_existing=True) if rig.agent_id else None
    return None if agent is None else abs(shared_now(session) - agent.seen_at)


def rig_to_wire(session: Session, row: Rig) -> dict[str, Any]:
    """Return a rig as it was registered last."""
    agent = session.get(Agent, row.agent_id, populate_existing=True) if row.agent_id else None
    silent = silence(session, row)
    return {
        "id": row.id,
        "name": row.name,
        "agent": row.agent_id,
        "seen_at": agent.seen_at.isoformat() if agent else None,
        "present": silent is not None and silent < LEASE,
        "created_at": row.created_at.isoformat(),
        "document": row.document,
    }
