"""The format of a file that nobody named: found out when its first segment is there."""

from __future__ import annotations

from collections.abc import Sequence

from api.formats import FormatError
from api.formats.recognise import HEAD, recognised
from api.problems.documents import invalid
from storage.models import Dataset
from storage.repositories import DatasetRepository

UNKNOWN = "unknown"
"""The format of a file that nobody named, until its first bytes are looked at."""


def recognise(repository: DatasetRepository, row: Dataset, segments: Sequence[str]) -> None:
    """Find out the format of a file that nobody named; what tells it is said in the recording's document.

    Raises
    ------
    Problem
        422 with the formats to choose from where nothing tells it.
    """
    if row.format != UNKNOWN:
        return
    _, pieces = repository.received(row.id, segments)
    document = dict(row.description or {})
    try:
        found, by = recognised(next(pieces, b"")[:HEAD], str(document.get("file") or row.name))
    except FormatError as error:
        raise invalid(f"{error.message} (say it in format where the recording is opened)") from error
    row.format = found
    row.description = document | {"recognised": {"format": found, "by": by}}
