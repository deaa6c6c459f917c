"""Recordings made from others, with the steps that made them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from storage import quotas
from storage.audit import record
from storage.ids import new_id
from storage.imports import PROCESSED
from storage.models import Dataset, DatasetStatus, Processing, ProcessingSource
from storage.models.base import Document
from storage.repositories.datasets import DatasetRepository

FORMAT = PROCESSED
"""The format of a recording that was computed: it has no original."""


class ProcessingRepository:
    """The processed recordings of one workspace."""

    def __init__(self, session: Session, workspace_id: str) -> None:
        self._session = session
        self._workspace_id = workspace_id

    def create(
        self,
        *,
        name: str,
        sources: Sequence[str],
        steps: Sequence[Document],
        combine: str | None,
        description: Document,
        versions: Mapping[str, str],
        start_time: datetime | None,
    ) -> Dataset:
        """Open a recording for the samples that are computed; its status is ``parsing``.

        Raises
        ------
        NotFoundError
            For a source that is not in this workspace.
        """
        for source in sources:
            DatasetRepository(self._session, self._workspace_id).get(source)
        dataset = Dataset(
            id=new_id("ds"),
            workspace_id=self._workspace_id,
            name=name,
            format=FORMAT,
            status=DatasetStatus.PARSING,
            channels=[],
            start_time=start_time,
            description=description,
        )
        self._session.add(dataset)
        self._session.flush()
        self._session.add(
            Processing(dataset_id=dataset.id, steps=list(steps), combine=combine, versions=dict(versions))
        )
        self._session.add_all(
            ProcessingSource(dataset_id=dataset.id, number=number, source_id=source)
            for number, source in enumerate(sources)
        )
        self._session.flush()
        record(self._session, self._workspace_id, "dataset.process", dataset.id)
        return dataset

    def assign(self, identifier: str, job_id: str) -> None:
        """Say which job computes the samples: if it fails, the recording has failed."""
        self._session.execute(update(Dataset).where(Dataset.id == identifier).values(job_id=job_id))

    def computed(self, identifier: str, *, experiments: Sequence[int], size: int) -> None:
        """Remember the samples of each experiment, and count ``size`` bytes as stored, once for all attempts.

        Raises
        ------
        QuotaExceededError
            When the workspace may not store that much.
        """
        self._session.execute(
            update(Processing).where(Processing.dataset_id == identifier).values(experiments=list(experiments))
        )
        before = self._session.scalar(select(Dataset.size).where(Dataset.id == identifier)) or 0
        self._session.execute(update(Dataset).where(Dataset.id == identifier).values(size=size))
        quotas.add_bytes(self._session, self._workspace_id, size - before)

    def experiments(self, identifier: str) -> tuple[int, ...] | None:
        """Return the samples of each experiment of a recording, None for one that was recorded as it is."""
        counts = self._session.scalar(select(Processing.experiments).where(Processing.dataset_id == identifier))
        return tuple(counts) if counts else None

    def described(self, identifier: str) -> Document | None:
        """Return how a recording was made, None for one that was recorded as it is."""
        row = self._session.get(Processing, identifier, populate_existing=True)
        if row is None:
            return None
        return {
            "sources": list(self.sources(identifier)),
            "combine": row.combine,
            "steps": row.steps,
            "experiments": row.experiments,
            "versions": row.versions,
        }

    def sources(self, identifier: str) -> tuple[str, ...]:
        """Return the recordings that a recording was made from, in order; none for one that was recorded."""
        rows = (
            select(ProcessingSource.source_id)
            .where(ProcessingSource.dataset_id == identifier)
            .order_by(ProcessingSource.number)
        )
        return tuple(self._session.scalars(rows))
