"""A stored system as matrices: for MATLAB, python-control, or anything else that takes a state space."""

from __future__ import annotations

from typing import Any

from sqlalchemy.orm import Session

from api.convert.studies import warnings_to_wire
from api.problems import invalid
from api.services.installation import Caller
from api.services.systems import compiled
from engine.errors import EngineError
from engine.interop.matlab import mat
from engine.interop.matrices import Matrices, realized
from storage.repositories import SystemRepository
from storage.repositories.systems import StoredSystem


def state_space(session: Session, caller: Caller, identifier: str, *, open_at: str | None) -> dict[str, Any]:
    """Return the realised matrices of a system as a document, at the values that its current revision states.

    Raises
    ------
    Problem
        422 where the loop cannot be cut at ``open_at``.
    """
    stored, matrices, warnings = _realized(session, caller, identifier, open_at)
    return {
        "system": {"id": stored.id, "revision": stored.revision},
        "open_at": open_at,
        **matrices.document(),
        "warnings": warnings,
    }


def state_space_file(session: Session, caller: Caller, identifier: str, *, open_at: str | None) -> bytes:
    """Return the same as a MATLAB file."""
    _, matrices, _ = _realized(session, caller, identifier, open_at)
    return mat(matrices)


def _realized(
    session: Session, caller: Caller, identifier: str, open_at: str | None
) -> tuple[StoredSystem, Matrices, list[dict[str, str]]]:
    stored = SystemRepository(session, caller.workspace).get(identifier)
    diagram = compiled(stored.document, place=())
    try:
        matrices = realized(diagram, open_at=open_at)
    except EngineError as error:
        raise invalid(error.message, "open_at") from error
    return stored, matrices, warnings_to_wire((*diagram.warnings, *diagram.linearization), place=())
