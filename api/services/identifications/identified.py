"""What a finished identification found, for whoever goes on with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from api.problems.documents import invalid
from api.problems.pointers import Place
from engine.diagram.diagram import Diagram
from engine.model.between_samples import BetweenSamples
from storage.errors import NotFoundError
from storage.repositories import JobRepository, ResultRepository
from storage.session import Database

_PLACE: Place = ("identification",)


@dataclass(frozen=True, slots=True, kw_only=True)
class Adjusted:
    """Estimated parameters and offsets, SI; ``intervals`` are the 95 % ones, None where nothing limits them."""

    values: Mapping[str, float]
    intervals: Mapping[str, tuple[float | None, float | None]]
    offsets: Mapping[str, float]
    between: BetweenSamples | None
    """What inputs were found to do between their samples, None where it was known."""


def adjusted_by(identifier: str, diagram: Diagram, *, database: Database, workspace: str) -> Adjusted:
    """Return what a job estimated, for those parameters that a diagram has as numbers.

    Raises
    ------
    Problem
        422 for a job that is not there, no identification, not finished, or of another system.
    """
    with database.session() as session:
        try:
            job = JobRepository(session, workspace).get(identifier)
        except NotFoundError as error:
            raise invalid(f"identification must be a job that exists, got {identifier!r}", *_PLACE) from error
        if job.kind != "identification" or job.result_id is None:
            raise invalid(
                f"identification must be a finished identification, {identifier!r} is a {job.kind} that is {job.status}",
                *_PLACE,
            )
        results = ResultRepository(session, workspace)
        body = results.body(results.get(job.result_id))
    parameters = body.get("parameters")
    if not isinstance(parameters, Mapping) or not parameters:
        raise invalid(
            f"identification must be of a system's parameters, {identifier!r} made a model of its own", *_PLACE
        )
    for path in parameters:
        info = diagram.parameters.get(path)
        if info is None or info.bound:
            raise invalid(
                f"identification must be of this system's parameters, {identifier!r} estimated {path!r}", *_PLACE
            )
    return Adjusted(
        values={path: float(e["value"]) for path, e in parameters.items() if e["value"] is not None},
        intervals={path: (e.get("lower95"), e.get("upper95")) for path, e in parameters.items()},
        offsets={name: float(value) for name, value in body.get("offsets", {}).items() if value is not None},
        between=BetweenSamples(between["chosen"]) if (between := body.get("between_samples")) else None,
    )
