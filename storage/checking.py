"""Looks for what must not be: pages that SQLite cannot read, references that lead nowhere, blobs that are not what they claim."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from sqlalchemy import Connection, Engine, func, select
from sqlalchemy.exc import DatabaseError

from storage.blobs import CHUNK_SIZE, PLACE, fetched
from storage.copying import snapshot
from storage.errors import DamagedBlobError, is_damage
from storage.models import Blob, BlobChunk
from storage.objects import ObjectStore
from storage.packing import DAMAGED, decode

#: Faults that are told one by one; the rest is counted.
MOST_TOLD = 100

Tell = Callable[[int, int], None]
"""Takes how many blobs have been read, and how many there are."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """What was looked at and what is wrong with it, a sentence for each fault."""

    blobs: int
    bytes: int
    faults: tuple[str, ...]


def check(engine: Engine, *, objects: ObjectStore | None = None, tell: Tell = lambda _done, _all: None) -> Findings:
    """Read everything once, also what lies in the object store; the database may be in use."""
    faults: list[str] = []
    count = read = 0
    try:
        with snapshot(engine) as connection:
            if engine.dialect.name == "sqlite":
                faults.extend(_pages(connection))
            if faults:  # what cannot be read cannot be checked further
                return Findings(blobs=0, bytes=0, faults=tuple(faults[:MOST_TOLD]))
            count = connection.scalar(select(func.count()).select_from(Blob)) or 0
            heads = connection.execute(select(Blob.sha256, Blob.size).order_by(Blob.sha256)).all()
            for number, head in enumerate(heads, start=1):
                faults.extend(_blob(connection, head.sha256, head.size, objects))
                read += head.size
                tell(number, count)
    except (DatabaseError, UnicodeDecodeError) as error:
        if not is_damage(error):
            raise
        faults.append(f"SQLite finds the file damaged, and cannot read it any further: {getattr(error, 'orig', error)}")
    if len(faults) > MOST_TOLD:
        faults = [*faults[:MOST_TOLD], f"and {len(faults) - MOST_TOLD} more"]
    return Findings(blobs=count, bytes=read, faults=tuple(faults))


def _pages(connection: Connection) -> Iterator[str]:
    for (line,) in connection.exec_driver_sql("PRAGMA integrity_check(20)").all():
        for part in line.splitlines():  # several faults of one page come as one text, under a heading
            if part != "ok" and not part.startswith("***"):
                yield f"SQLite finds the file damaged: {part}"
    for table, row, parent, _number in connection.exec_driver_sql("PRAGMA foreign_key_check").all():
        yield f"row {row} of table {table} refers to a row of {parent} that is not there"


def _blob(connection: Connection, sha256: str, size: int, objects: ObjectStore | None) -> Iterator[str]:
    chunks = select(*PLACE).where(BlobChunk.sha256 == sha256).order_by(BlobChunk.number)
    whole, length = hashlib.sha256(), 0
    try:
        with connection.execution_options(yield_per=1).execute(chunks) as rows:
            for row in rows:
                (data,) = (row.data,) if row.object is None else fetched(objects, [row.object])
                piece = decode(row.encoding, data, min(CHUNK_SIZE, size - row.number * CHUNK_SIZE))
                whole.update(piece)
                length += len(piece)
    except DamagedBlobError as error:
        yield f"blob {sha256} cannot be read: {error}"
        return
    except DAMAGED as error:
        yield f"blob {sha256} cannot be unpacked: {error}"
        return
    if length != size:
        yield f"blob {sha256} must have {size} bytes, got {length}"
    elif whole.hexdigest() != sha256:
        yield f"sha256 of blob {sha256} must be that, got {whole.hexdigest()}"
