"""A system as matrices: for MATLAB, python-control, or anything else that takes a state space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy.orm import Session

from api.convert.studies import roots_to_wire, warnings_to_wire
from api.convert.values import opening, overrides_from_wire
from api.problems.documents import invalid
from api.problems.pointers import Place
from api.schemas.studies import StateSpaceRequest
from api.services.operation.app_context import Caller, Installation
from api.services.studies.studies import constants_from_wire
from api.services.systems.systems import compiled, subject_of
from engine.diagram.diagram import Diagram
from engine.interop.matlab import mat
from engine.interop.matrices import Matrices, realized
from engine.model.errors import EngineError
from storage.repositories import SystemRepository

Places = str | Sequence[str] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class StateSpace:
    """The realised matrices of a system, where they come from, and what there is to say of them."""

    reference: Mapping[str, Any] | None
    open_at: Places
    matrices: Matrices
    warnings: list[dict[str, str]]

    def document(self) -> dict[str, Any]:
        """Return names, matrices and poles as JSON values."""
        return {
            "system": None if self.reference is None else dict(self.reference),
            "open_at": self.open_at,
            **self.matrices.document(),
            "poles": roots_to_wire(self.matrices.poles),
            "warnings": self.warnings,
        }

    def file(self) -> bytes:
        """Return the matrices as a MATLAB file."""
        return mat(self.matrices)


def stored_state_space(session: Session, caller: Caller, identifier: str, *, open_at: Places) -> StateSpace:
    """Return the state space of a stored system, at the values that its current revision states.

    Raises
    ------
    Problem
        422 where the loop cannot be cut at ``open_at``.
    """
    stored = SystemRepository(session, caller.workspace).get(identifier)
    diagram = compiled(stored.document, place=())
    reference = {"id": stored.id, "revision": stored.revision}
    return _realized(diagram, reference, open_at, {}, place=())


def state_space(service: Installation, caller: Caller, request: StateSpaceRequest) -> StateSpace:
    """Return the state space of any system, stored or not, at values that may be given.

    Raises
    ------
    Problem
        422 where the loop cannot be cut, or a parameter does not exist.
    """
    subject = subject_of(service, caller, request.system)
    overrides = overrides_from_wire(request.parameters or {}, subject.diagram, place=("parameters",))
    diagram = subject.diagram
    if request.operating_point:
        diagram = diagram.about(constants_from_wire(request.operating_point, diagram))
    return service.computing.bounded(
        lambda: _realized(diagram, subject.reference, request.open_at, overrides, place=subject.place)
    )


def _realized(
    diagram: Diagram,
    reference: Mapping[str, Any] | None,
    open_at: Places,
    overrides: Mapping[str, float],
    *,
    place: Place | None,
) -> StateSpace:
    try:
        matrices = realized(diagram, overrides=overrides, open_at=opening(open_at))
    except EngineError as error:
        raise invalid(error.message, "open_at" if "open_at" in error.at else "parameters") from error
    warnings = warnings_to_wire((*diagram.warnings, *diagram.linearization), place=place)
    return StateSpace(reference=reference, open_at=open_at, matrices=matrices, warnings=warnings)
