"""The graph of what was made from what, read from any of its nodes in both directions.

::

    acquisition -> dataset -> identification -> model revision -> optimisation -> model revision -> validation

A dataset that a job wrote (an import, a processing) comes from that job, whatever the job's request names first.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Literal

from sqlalchemy import String, cast, select
from sqlalchemy.orm import Session

from storage.errors import NotFoundError
from storage.lineage import model_key
from storage.models import (
    Acquisition,
    Dataset,
    Job,
    JobStatus,
    ProcessingSource,
    Result,
    Schedule,
    System,
    SystemRevision,
)
from storage.models.base import MAX_INTEGER
from storage.models.lineage import LineageEdge

Direction = Literal["both", "up", "down"]
Edge = tuple[str, str]
"""(source, target)."""

MOST_NODES = 2000
_CHUNK = 500
"""Keys in one question: SQLite takes no more than some thousand values."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Node:
    """Something that was made, or what is known of it after it was deleted.

    Attributes
    ----------
    id : str
        Its identifier, of a model with the revision: ``sys_...@3``.
    kind : str
        ``dataset``, ``model``, ``acquisition``, ``schedule``, or that of the job or kept study.
    exists : bool
        False once it has been deleted.
    facts : mapping
        What tells it apart: checksums, formats, statuses, versions.
    """

    id: str
    kind: str
    name: str
    exists: bool
    created_at: datetime | None
    facts: Mapping[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Graph:
    """Nodes and edges around a node, ``truncated`` when there are more than `MOST_NODES`."""

    nodes: Sequence[Node]
    edges: Sequence[Edge]
    truncated: bool


class LineageRepository:
    """The lineage of one workspace."""

    def __init__(self, session: Session, workspace_id: str) -> None:
        self._session = session
        self._workspace_id = workspace_id

    def graph(self, identifier: str, *, direction: Direction = "both") -> Graph:
        """Return everything that a thing was made from, and everything that was made from it.

        Parameters
        ----------
        identifier : str
            Of a dataset, job, kept study, acquisition, system (all its revisions) or ``sys_...@3``.
        direction : {"both", "up", "down"}
            Only what it was made from, or only what was made from it.

        Raises
        ------
        NotFoundError
            When nothing in this workspace has or had that identifier.
        """
        starts = self._starts(identifier)
        seen: dict[str, None] = dict.fromkeys(starts)
        for upwards in (True, False):
            if direction == ("down" if upwards else "up"):
                continue
            walked, level = set(starts), starts
            while level and len(seen) <= MOST_NODES:
                found = self._edges(level, upwards=upwards)
                ends = dict.fromkeys(source if upwards else target for source, target in found)
                level = [key for key in ends if key not in walked]
                walked.update(level)
                seen |= dict.fromkeys(level)
        kept = dict.fromkeys(list(seen)[:MOST_NODES])
        return Graph(
            nodes=self.nodes(list(kept)),
            # also those between an ancestor and a descendant: the same recording may have validated what it made
            edges=[edge for edge in self._edges(kept, upwards=True) if edge[0] in kept],
            truncated=len(seen) > MOST_NODES,
        )

    def dependents(self, identifier: str) -> list[Node]:
        """Return what would lose its origin, or its work, with a dataset or system: not what failed anyway.

        Of a system its schedules alone: its revisions stay for everything that used them.
        """
        found: list[Node] = []
        if not identifier.startswith("sys_"):
            targets = [target for _, target in self._edges([identifier], upwards=False)]
            ended = (JobStatus.FAILED, JobStatus.CANCELLED)
            found = [node for node in self.nodes(targets) if node.exists and node.facts.get("status") not in ended]
        named = select(Schedule).where(
            Schedule.workspace_id == self._workspace_id, cast(Schedule.body, String).contains(f'"{identifier}"')
        )
        found += [
            Node(id=row.id, kind="schedule", name=row.name, exists=True, created_at=row.created_at, facts={})
            for row in self._session.scalars(named.order_by(Schedule.created_at).limit(_CHUNK))
        ]
        return found

    def nodes(self, keys: Sequence[str]) -> list[Node]:
        """Return what is known of each key, in their order."""
        known: dict[str, Node] = {}
        for part in _chunks(keys):
            known |= {node.id: node for node in self._datasets(part)}
            known |= {node.id: node for node in self._jobs(part)}
            known |= {node.id: node for node in self._results(part)}
            known |= {node.id: node for node in self._acquisitions(part)}
            known |= {node.id: node for node in self._models(part)}
        return [known.get(key) or _gone(key) for key in keys]

    def _starts(self, identifier: str) -> list[str]:
        if identifier.startswith("sys_") and "@" not in identifier:
            system = self._session.get(System, identifier)
            if system is None or system.workspace_id != self._workspace_id:
                raise NotFoundError("lineage of", identifier)
            return [model_key(identifier, number) for number in range(1, system.revision + 1)][-MOST_NODES:]
        node = self.nodes([identifier])[0]
        if node.exists and "job" in node.facts and node.facts["job"] is not None:
            return [str(node.facts["job"])]  # a job and its result are one node
        if not node.exists and not self._edges([identifier], upwards=False):
            raise NotFoundError("lineage of", identifier)
        return [identifier]

    def _edges(self, keys: Collection[str], *, upwards: bool) -> list[Edge]:
        """Return the edges that end (upwards) or begin at these keys."""
        column = LineageEdge.target if upwards else LineageEdge.source
        found: dict[Edge, None] = {}
        for part in _chunks(list(keys)):
            rows = self._session.execute(
                select(LineageEdge.source, LineageEdge.target)
                .where(LineageEdge.workspace_id == self._workspace_id, column.in_(part))
                .order_by(LineageEdge.created_at, LineageEdge.source)
            )
            found |= dict.fromkeys((row.source, row.target) for row in rows)
            written = select(Dataset.id, Dataset.job_id).where(Dataset.workspace_id == self._workspace_id)
            written = written.where((Dataset.id if upwards else Dataset.job_id).in_(part), Dataset.job_id.is_not(None))
            found |= dict.fromkeys((str(row.job_id), str(row.id)) for row in self._session.execute(written))
            found |= dict.fromkeys(self._processed(part, upwards=upwards))
        turned = self._reversed(found)
        return [edge for edge in found if edge not in turned]

    def _processed(self, keys: Sequence[str], *, upwards: bool) -> list[Edge]:
        column = ProcessingSource.dataset_id if upwards else ProcessingSource.source_id
        rows = (
            select(ProcessingSource.source_id, ProcessingSource.dataset_id)
            .join(Dataset, Dataset.id == ProcessingSource.dataset_id)
            .where(Dataset.workspace_id == self._workspace_id, column.in_(keys))
            .order_by(ProcessingSource.dataset_id, ProcessingSource.number)
        )
        return [(row.source_id, row.dataset_id) for row in self._session.execute(rows)]

    def _reversed(self, edges: Collection[Edge]) -> set[Edge]:
        """Return those edges dataset -> job whose job wrote the dataset."""
        recordings = [source for source, target in edges if source.startswith("ds_") and target.startswith("job_")]
        found: set[Edge] = set()
        for part in _chunks(recordings):
            rows = select(Dataset.id, Dataset.job_id).where(Dataset.id.in_(part), Dataset.job_id.is_not(None))
            found |= {(str(row.id), str(row.job_id)) for row in self._session.execute(rows)}
        return found

    def _datasets(self, keys: Sequence[str]) -> Iterator[Node]:
        rows = select(Dataset).where(Dataset.workspace_id == self._workspace_id, Dataset.id.in_(keys))
        for row in self._session.scalars(rows):
            facts = {
                "format": row.format,
                "status": row.status,
                "sha256": row.sha256,
                "sample_rate": row.sample_rate,
                "sample_count": row.sample_count,
            }
            yield Node(id=row.id, kind="dataset", name=row.name, exists=True, created_at=row.created_at, facts=facts)

    def _jobs(self, keys: Sequence[str]) -> Iterator[Node]:
        rows = select(Job, Result.versions).outerjoin(Result, Result.id == Job.result_id)
        rows = rows.where(Job.workspace_id == self._workspace_id, Job.id.in_(keys))
        for job, versions in self._session.execute(rows):
            facts = {"status": str(job.status), "result": job.result_id, "versions": versions or {}}
            yield Node(id=job.id, kind=job.kind, name=job.kind, exists=True, created_at=job.created_at, facts=facts)

    def _results(self, keys: Sequence[str]) -> Iterator[Node]:
        rows = select(Result, Job.id).outerjoin(Job, Job.result_id == Result.id)
        rows = rows.where(Result.workspace_id == self._workspace_id, Result.id.in_(keys))
        for row, job in self._session.execute(rows):
            facts = {"versions": row.versions, "job": job}
            yield Node(id=row.id, kind=row.kind, name=row.kind, exists=True, created_at=row.created_at, facts=facts)

    def _acquisitions(self, keys: Sequence[str]) -> Iterator[Node]:
        rows = select(Acquisition).where(Acquisition.workspace_id == self._workspace_id, Acquisition.id.in_(keys))
        for row in self._session.scalars(rows):
            facts = {"status": str(row.status), "rig": row.rig_id}
            yield Node(
                id=row.id, kind="acquisition", name=row.name, exists=True, created_at=row.created_at, facts=facts
            )

    def _models(self, keys: Sequence[str]) -> Iterator[Node]:
        asked = {key: key.partition("@") for key in keys if key.startswith("sys_") and "@" in key}
        if not asked:
            return
        rows = (
            select(SystemRevision.system_id, SystemRevision.number, SystemRevision.created_at, System)
            .join(System, System.id == SystemRevision.system_id)
            .where(
                System.workspace_id == self._workspace_id,
                SystemRevision.system_id.in_({system for system, _, _ in asked.values()}),
                SystemRevision.number.in_({_number(number) for _, _, number in asked.values()}),
            )
        )
        for system_id, number, created_at, system in self._session.execute(rows):
            key = model_key(system_id, number)
            facts = {"system": system_id, "revision": number, "deleted": system.deleted_at is not None}
            yield Node(id=key, kind="model", name=system.name, exists=True, created_at=created_at, facts=facts)


def _number(text: str) -> int:
    return min(int(text), MAX_INTEGER) if text.isascii() and text.isdigit() and len(text) < 20 else 0


def _chunks(keys: Sequence[str]) -> Iterator[Sequence[str]]:
    for start in range(0, len(keys), _CHUNK):
        yield keys[start : start + _CHUNK]


_KINDS = {"ds": "dataset", "sys": "model", "job": "job", "res": "result", "acq": "acquisition"}


def _gone(key: str) -> Node:
    kind = _KINDS.get(key.partition("_")[0], "unknown")
    return Node(id=key, kind=kind, name="", exists=False, created_at=None, facts={})
