"""Schedules that follow the recordings: each run takes the newest one of a name in place of the one in its body."""

from __future__ import annotations

from typing import Any

from api.problems.documents import invalid
from api.services.operation.app_context import Installation
from storage.models import Schedule
from storage.repositories import DatasetRepository


def current_body(service: Installation, row: Schedule) -> dict[str, Any]:
    """Return the body of a schedule's job as it is to be run now.

    Raises
    ------
    Problem
        422 when there is no recording of the name that it waits for.
    """
    return with_newest(service, row.workspace_id, row.body, row.newest)


def with_newest(service: Installation, workspace: str, body: dict[str, Any], name: str | None) -> dict[str, Any]:
    """Return a body with the newest ready recording of a name as its ``dataset``; as it is without a name.

    Raises
    ------
    Problem
        422 when there is none.
    """
    if name is None:
        return body
    if "dataset" not in body:
        raise invalid("newest must be left out: the job's body has no dataset", "newest")
    with service.database.session() as session:
        found = DatasetRepository(session, workspace).newest(name)
    if found is None:
        raise invalid(f"newest must be the name of a recording that is ready, got {name!r}", "newest")
    return {**body, "dataset": found}
