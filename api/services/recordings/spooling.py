"""The bytes of a recording as a file that readers can open, and what is wrong with it as the problem that its user reads."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import BinaryIO

from api.formats import FormatError
from api.problems.documents import Problem
from storage.repositories import DatasetRepository
from storage.session import Database

Progress = Callable[[float, str], None]


@contextmanager
def refusing() -> Iterator[None]:
    """Turn what is wrong with a file into the problem that its user reads."""
    try:
        yield
    except FormatError as error:
        raise Problem(422, "unreadable-file", error.message, extra=_where(error)) from error


def _where(error: FormatError) -> dict[str, int]:
    return {key: value for key, value in (("line", error.line), ("column", error.column)) if value is not None}


@contextmanager
def spooled(
    database: Database, workspace: str, identifier: str, segments: Sequence[str], progress: Progress
) -> Iterator[BinaryIO]:
    """Give the bytes as a file without a name, of which nothing is left even when this process is killed."""
    with tempfile.TemporaryFile() as file:
        with database.session() as session:
            size, pieces = DatasetRepository(session, workspace).received(identifier, segments)
            done = 0
            for piece in pieces:
                file.write(piece)
                done += len(piece)
                progress(0.1 * done / max(size, 1), f"{done / 1e6:.1f} of {size / 1e6:.1f} MB")
        file.flush()
        yield file
