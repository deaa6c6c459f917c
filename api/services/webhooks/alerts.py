"""Alerts: raised by a validation beyond its limit and by a schedule that cannot run, kept, and told to webhooks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sqlalchemy.orm import Session

from api.services.operation.app_context import Caller
from storage.models import Alert, Schedule, ScheduleRun
from storage.repositories import AlertRepository


def page(
    session: Session, caller: Caller, *, kind: str | None, source: str | None, cursor: str | None, limit: int
) -> dict[str, Any]:
    """Return one page of the alerts, newest first."""
    found = AlertRepository(session, caller.workspace).page(kind=kind, source=source, cursor=cursor, limit=limit)
    return {"items": [to_wire(row) for row in found.items], "next_cursor": found.next_cursor}


def get(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Return an alert."""
    return to_wire(AlertRepository(session, caller.workspace).get(identifier))


def on_validation(session: Session, workspace: str, *, job: str, result: Mapping[str, Any]) -> bool:
    """Raise an alert when a validation found more error than its limit; return whether it does now.

    Parameters
    ----------
    result : mapping
        What the validation replies: ``verdict``, ``limit_percent``, ``outputs[name].relative_error_percent``.
    """
    if result["verdict"] != "fail":
        return False
    errors = {name: output["relative_error_percent"] for name, output in result["outputs"].items()}
    limit = result["limit_percent"]
    beyond = [name for name, error in errors.items() if error is None or error > limit]
    told = ", ".join(
        f"{name} {'unknown' if errors[name] is None else format(errors[name], '.3g')} %" for name in beyond
    )
    return AlertRepository(session, workspace).raise_once(
        kind="validation",
        source=job,
        detail=f"relative error must be at most {limit:g} %, got {told}",
        data={
            "job": job,
            "system": result.get("system"),
            "dataset": result.get("dataset"),
            "limit_percent": limit,
            "relative_error_percent": errors,
        },
    )


def on_refusal(session: Session, schedule: Schedule, run: ScheduleRun) -> None:
    """Raise an alert for a run of a schedule whose job could not be started."""
    AlertRepository(session, schedule.workspace_id).raise_once(
        kind="schedule",
        source=run.id,
        detail=f"schedule {schedule.name!r} could not start its job: {run.detail}",
        data={"schedule": schedule.id, "run": run.id, "due_at": run.due_at.isoformat()},
    )


def to_wire(row: Alert) -> dict[str, Any]:
    """Return an alert."""
    return {
        "id": row.id,
        "kind": row.kind,
        "source": row.source,
        "detail": row.detail,
        "data": row.data,
        "created_at": row.created_at.isoformat(),
    }
