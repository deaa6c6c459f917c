"""Where things come from: the graph around one, what depends on it, and what a model revision says it was derived from."""

from __future__ import annotations

from typing import Any

from sqlalchemy.orm import Session

from api.problems.documents import Problem, invalid
from api.services.operation.app_context import Caller
from storage.errors import NotFoundError
from storage.repositories import JobRepository, LineageRepository, ResultRepository
from storage.repositories.lineage import Direction, Graph, Node

_SHOWN = 3


def graph(session: Session, caller: Caller, identifier: str, *, direction: Direction) -> dict[str, Any]:
    """Return the lineage of a thing."""
    found = LineageRepository(session, caller.workspace).graph(identifier, direction=direction)
    return {"id": identifier, **graph_to_wire(found)}


def graph_to_wire(found: Graph) -> dict[str, Any]:
    """Return nodes and edges."""
    return {
        "nodes": [_node(node) for node in found.nodes],
        "edges": [{"from": source, "to": target, "role": role(source, target)} for source, target in found.edges],
        "truncated": found.truncated,
    }


def _node(node: Node) -> dict[str, Any]:
    return {
        "id": node.id,
        "kind": node.kind,
        "name": node.name,
        "exists": node.exists,
        "created_at": node.created_at.isoformat() if node.created_at else None,
        "facts": dict(node.facts),
    }


def role(source: str, target: str) -> str:
    """Return what the first is to the second.

    >>> role("job_1", "sys_1@2")
    'parameters'
    """
    kinds = source.partition("_")[0], target.partition("_")[0]
    if kinds == ("sys", "sys"):
        return "revision"
    if kinds[0] == "sys":
        return "model"
    if kinds[0] in {"job", "res"} and kinds[1] != "ds":
        return "parameters"
    return "data" if kinds[0] == "ds" and kinds[1] in {"job", "res"} else "source"


def check_free(session: Session, caller: Caller, identifier: str, *, force: bool) -> None:
    """Refuse to delete what others depend on, unless it is to be deleted all the same.

    Raises
    ------
    Problem
        409 with the list.
    """
    if force:
        return
    found = LineageRepository(session, caller.workspace).dependents(identifier)
    if not found:
        return
    named = ", ".join(f"{node.kind} {node.id!r}" for node in found[:_SHOWN])
    more = f" and {len(found) - _SHOWN} more" if len(found) > _SHOWN else ""
    raise Problem(
        409,
        "has-dependents",
        f"{identifier!r} must have nothing that depends on it to be deleted, got {named}{more} (force=true deletes it "
        "all the same: what was computed from it stays, and cannot be repeated)",
        extra={"dependents": [{"id": node.id, "kind": node.kind, "name": node.name} for node in found]},
    )


def check_origin(session: Session, caller: Caller, identifier: str | None) -> None:
    """Refuse an origin of a model that is no finished job and no kept study of this workspace.

    Raises
    ------
    Problem
        422.
    """
    if identifier is None:
        return
    wrong = f"derived_from must be a finished job or a kept study, got {identifier!r}"
    try:
        if identifier.startswith("res_"):
            ResultRepository(session, caller.workspace).get(identifier)
        elif JobRepository(session, caller.workspace).get(identifier).result_id is None:
            raise invalid(wrong)
    except NotFoundError as error:
        raise invalid(wrong) from error
