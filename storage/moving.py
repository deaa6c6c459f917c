"""Moves blobs between the database and the object store while both serve, and sweeps what nobody in the database names.

Chunk after chunk, some at a time: their bytes are written to the other side and read back, and then one transaction says where
they lie. Whenever it is cut off, each chunk lies where its row says, and what was written in vain is swept (an object) or was never
committed (a row); the next run goes on. Who reads a chunk that moves at that moment looks again (`storage.blobs.encoded`). An object
that was named is swept a day after nothing has named it any more, for backups name objects.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import Row, delete, func, select, tuple_, update
from sqlalchemy.orm import Session

from storage.blobs import PLACE
from storage.errors import CopyError
from storage.insertion import insert_if_absent
from storage.models import BlobChunk, UnnamedObject
from storage.models.base import utc_now
from storage.objects import ObjectStore
from storage.session import Database

#: Chunks that are moved together, up to 8 MiB each.
_BATCH = 8

Tell = Callable[[int, int], None]
"""Takes how many chunks and bytes have been moved."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Moved:
    """What has been moved, and the chunks that lie on the old side all the same: written there meanwhile."""

    chunks: int
    bytes: int
    left: int


def move(database: Database, *, to_objects: bool, tell: Tell = lambda _chunks, _bytes: None) -> Moved:
    """Move every chunk that lies in the database into the object store, or back.

    Raises
    ------
    CopyError
        When there is no object store.
    ObjectStoreError
        When it cannot do its work; what has been moved until then is.
    DamagedBlobError
        When an object is not what was kept.
    """
    store = _store_of(database)
    here = BlobChunk.object.is_(None) if to_objects else BlobChunk.object.is_not(None)
    bring = _to_objects if to_objects else _to_database
    chunks = size = 0
    after = ("", -1)
    while True:
        next_ones = (
            select(*PLACE)
            .where(here, tuple_(BlobChunk.sha256, BlobChunk.number) > after)
            .order_by(BlobChunk.sha256, BlobChunk.number)
            .limit(_BATCH)
        )
        with database.session() as session:
            rows = session.execute(next_ones).all()
        if not rows:
            break
        moved = bring(database, store, rows)
        chunks, size = chunks + len(moved), size + sum(moved)
        after = (rows[-1].sha256, rows[-1].number)
        tell(chunks, size)
    with database.session() as session:
        left = session.scalar(select(func.count()).select_from(BlobChunk).where(here)) or 0
    return Moved(chunks=chunks, bytes=size, left=left)


def forget_objects(database: Database, *, before: datetime) -> int:
    """Delete objects that no chunk names, written and first found unnamed before ``before``; return how many.

    Whoever wrote one must have committed or given up by now: give it more time than a transaction may take. What chunks named until
    lately, backups of that time still do: it is kept for as long.
    """
    store = database.objects
    if store is None:
        return 0
    count = 0
    for names in store.older(before):
        with database.session() as session:
            waste = _unnamed_since(session, names, before=before)
        store.delete(waste)
        count += len(waste)
    with database.session() as session:  # these are gone, by this way or another
        session.execute(delete(UnnamedObject).where(UnnamedObject.since < before))
    return count


def _unnamed_since(session: Session, names: Sequence[str], *, before: datetime) -> list[str]:
    """Note which of these objects no chunk names; return those that were found so before ``before``."""
    named = set(session.scalars(select(BlobChunk.object).where(BlobChunk.object.in_(names))))
    found = session.execute(select(UnnamedObject.object, UnnamedObject.since).where(UnnamedObject.object.in_(names)))
    known = {row.object: row.since for row in found}
    session.execute(delete(UnnamedObject).where(UnnamedObject.object.in_(named & known.keys())))
    now = utc_now()
    for name in names:
        if name not in named and name not in known:
            insert_if_absent(session, UnnamedObject, object=name, since=now)
    return [name for name in names if name not in named and known.get(name, now) < before]


def _to_objects(database: Database, store: ObjectStore, rows: Sequence[Row[*tuple[Any, ...]]]) -> list[int]:
    names = store.put([row.data for row in rows])
    store.get(names)  # each has the bytes that its name says
    with database.session() as session:
        taken = [
            _say(session, row, BlobChunk.object.is_(None), data=b"", object=name)
            for row, name in zip(rows, names, strict=True)
        ]
    store.delete([name for name, took in zip(names, taken, strict=True) if not took])
    return [len(row.data) for row, took in zip(rows, taken, strict=True) if took]


def _to_database(database: Database, store: ObjectStore, rows: Sequence[Row[*tuple[Any, ...]]]) -> list[int]:
    contents = store.get([row.object for row in rows])
    with database.session() as session:
        taken = [
            _say(session, row, BlobChunk.object == row.object, data=content, object=None)
            for row, content in zip(rows, contents, strict=True)
        ]
    # the objects stay until they are swept: backups that were made before name them
    return [len(content) for content, took in zip(contents, taken, strict=True) if took]


def _say(session: Session, row: Row[*tuple[Any, ...]], still_there: Any, **place: Any) -> bool:
    """Say where a chunk lies now; False when its blob was deleted, or somebody else has moved it."""
    written = (
        update(BlobChunk)
        .where(BlobChunk.sha256 == row.sha256, BlobChunk.number == row.number, still_there)
        .values(**place)
        .returning(BlobChunk.number)
        .execution_options(synchronize_session=False)
    )
    return session.scalar(written) is not None


def _store_of(database: Database) -> ObjectStore:
    if database.objects is None:
        raise CopyError("SERVOTUNE_OBJECT_STORE must name the object store, got none")
    return database.objects
