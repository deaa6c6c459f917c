"""Parsing of uploaded files (by a worker): from the bytes as received to channels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from api.errors import Problem
from api.formats import FormatError, txt
from storage.repositories import DatasetRepository
from storage.session import Database

Progress = Callable[[float, str], None]


def run(body: Mapping[str, Any], *, database: Database, workspace: str, progress: Progress) -> dict[str, Any]:
    """Read the channels of a committed file.

    Raises
    ------
    Problem
        422 that says where the file is not what its description says; the dataset is ``failed`` then.
    """
    identifier = str(body["dataset"])
    try:
        with database.session() as session:
            repository = DatasetRepository(session, workspace)
            row = repository.get(identifier)
            description = (row.description or {})["import"]
            layout = txt.TextLayout(
                columns=tuple(column["index"] for column in description["columns"]),
                delimiter=description.get("delimiter", ","),
                decimal=description.get("decimal", "."),
                header_lines=description.get("header_lines", 0),
            )
            pieces = _counted(repository.original(identifier), row.size or 1, progress)
            done = repository.write_channels(
                identifier,
                txt.read(pieces, layout),
                channels=[_channel(column) for column in description["columns"]],
                sample_rate=description["sample_rate"],
            )
            return {"dataset": identifier, "sample_count": done.sample_count}
    except FormatError as error:
        problem = Problem(422, "unreadable-file", error.message, extra=_where(error))
        with database.session() as session:
            DatasetRepository(session, workspace).fail(identifier, problem.document())
        raise problem from error


def _channel(column: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in column.items() if key != "index"}


def _where(error: FormatError) -> dict[str, int]:
    return {key: value for key, value in (("line", error.line), ("column", error.column)) if value is not None}


def _counted(pieces: Iterator[bytes], size: int, progress: Progress) -> Iterator[bytes]:
    done = 0
    for piece in pieces:
        yield piece
        done += len(piece)
        progress(min(done / size, 1.0), f"{done / 1e6:.1f} of {size / 1e6:.1f} MB")
