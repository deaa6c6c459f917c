"""Bytes and arrays kept once, under the SHA-256 of their content: the one door to them, wherever they lie.

Content is cut into chunks of at most 8 MiB, each compressed as `storage.packing` says. Heads and places of chunks are rows of the
database; the bytes lie in these rows, or in the object store of the session (`storage.objects`). Either is read whatever is preferred.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import CursorResult, Row, Table, delete, exists, func, select, update
from sqlalchemy.orm import Session

from storage.errors import ChecksumError, DamagedBlobError, NotFoundError, ObjectStoreError
from storage.insertion import insert_if_absent
from storage.models import Blob, BlobChunk
from storage.models.base import Base, utc_now
from storage.objects import ObjectStore
from storage.packing import decode, encode

#: The most bytes of content in one chunk.
CHUNK_SIZE = 8 * 1024 * 1024

Array = NDArray[Any]


def sha256_of(data: bytes) -> str:
    """Return the SHA-256 of ``data`` as 64 hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def put_bytes(session: Session, data: bytes, *, expected_sha256: str | None = None, itemsize: int = 1) -> str:
    """Keep ``data`` unless the same bytes are there already; return their SHA-256.

    Parameters
    ----------
    expected_sha256 : str, optional
        What the sender says the SHA-256 is.
    itemsize : int
        Size (bytes) of the numbers that ``data`` consists of; 8 makes float64 samples compress better.

    Raises
    ------
    ChecksumError
        When ``data`` does not have the expected SHA-256; nothing is kept then.
    """
    sha256 = sha256_of(data)
    if expected_sha256 is not None and sha256 != expected_sha256:
        raise ChecksumError("the content", expected=expected_sha256, actual=sha256)
    content = packed(data, itemsize=itemsize, sha256=sha256)
    put_packed(session, without_those_kept(session, [content]))
    return sha256


@dataclass(frozen=True, slots=True, kw_only=True)
class Chunk:
    """A piece as it is kept: how it was compressed, and its bytes or the name under which they lie in the object store."""

    encoding: str
    data: bytes
    object: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Packed:
    """Content ready to be kept: compressed, under its SHA-256. Made without a database, in any thread."""

    sha256: str
    size: int
    chunks: Sequence[Chunk]


def packed(data: bytes, *, itemsize: int = 1, sha256: str | None = None) -> Packed:
    """Compress ``data``, whose SHA-256 may be known."""
    pieces = (data[start : start + CHUNK_SIZE] for start in range(0, len(data), CHUNK_SIZE))
    chunks = [Chunk(encoding=encoding, data=encoded) for encoding, encoded in (encode(it, itemsize) for it in pieces)]
    return Packed(sha256=sha256 or sha256_of(data), size=len(data), chunks=chunks)


def packed_array(array: Array) -> Packed:
    """Compress an array of numbers in numpy's own format (no pickle).

    Raises
    ------
    ValueError
        When the array holds Python objects.
    """
    buffer = io.BytesIO()
    np.save(buffer, np.ascontiguousarray(array) if array.ndim else array, allow_pickle=False)
    return packed(buffer.getvalue(), itemsize=array.itemsize)


def brought(store: ObjectStore | None, contents: Sequence[Packed]) -> list[Packed]:
    """Return contents with what is to lie in the object store brought there, side by side; to be done before a transaction begins.

    Raises
    ------
    ObjectStoreError
        When the store cannot take them.
    """
    if store is None or not store.preferred:
        return list(contents)
    names = iter(store.put([chunk.data for content in contents for chunk in content.chunks if chunk.object is None]))
    return [
        replace(
            content,
            chunks=[
                chunk if chunk.object else replace(chunk, data=b"", object=next(names)) for chunk in content.chunks
            ],
        )
        for content in contents
    ]


def without_those_kept(session: Session, contents: Sequence[Packed]) -> list[Packed]:
    """Return contents, each once, as `brought` does, those that are kept already as they are: nobody asks for their chunks."""
    store = store_of(session)
    if store is None or not store.preferred or not contents:
        return list(contents)
    there = set(session.scalars(select(Blob.sha256).where(Blob.sha256.in_([content.sha256 for content in contents]))))
    once = {content.sha256: content for content in contents}
    new = brought(store, [content for content in once.values() if content.sha256 not in there])
    return [content for content in once.values() if content.sha256 in there] + new


def store_of(session: Session) -> ObjectStore | None:
    """Return the object store beside the database of a session, if there is one."""
    store: ObjectStore | None = session.info.get("objects")
    return store


def put_packed(session: Session, contents: Sequence[Packed]) -> None:
    """Keep several contents, each unless it is there already; in one order, so that two writers never wait in a ring."""
    ordered = sorted({content.sha256: content for content in contents}.values(), key=lambda content: content.sha256)
    new = [content for content in ordered if _is_new(session, content.sha256, content.size)]
    rows = [
        {
            "sha256": content.sha256,
            "number": number,
            "encoding": chunk.encoding,
            "data": chunk.data,
            "object": chunk.object,
        }
        for content in brought(store_of(session), new)
        for number, chunk in enumerate(content.chunks)
    ]
    if rows:
        session.execute(cast("Table", BlobChunk.__table__).insert(), rows)


def _is_new(session: Session, sha256: str, size: int) -> bool:
    """Write the head of a blob; False when it is there, which is then marked as used now and so not swept."""
    while True:
        if insert_if_absent(session, Blob, sha256=sha256, size=size):
            return True
        touched = session.execute(
            update(Blob)
            .where(Blob.sha256 == sha256)
            .values(created_at=utc_now())
            .execution_options(synchronize_session=False)
        )
        if cast("CursorResult[Any]", touched).rowcount:
            return False


def forget_unused(session: Session, *, before: datetime, after: str = "", limit: int = 1000) -> tuple[int, str | None]:
    """Delete blobs that nothing refers to and that nobody has put since ``before``, of the next ``limit`` ones.

    Parameters
    ----------
    after : str
        SHA-256 behind which to begin, in their order.

    Returns
    -------
    count : int
        How many were deleted.
    last : str or None
        SHA-256 of the last one that was looked at; None when there was none.
    """
    looked_at = select(Blob.sha256).where(Blob.sha256 > after).order_by(Blob.sha256).limit(limit).subquery()
    last = session.scalar(select(func.max(looked_at.c.sha256)))
    if last is None:
        return 0, None
    head = cast("Table", Blob.__table__)
    references = (
        key.parent
        for table in Base.metadata.tables.values()
        for key in table.foreign_keys
        if key.references(head) and table is not BlobChunk.__table__
    )
    unused = [~exists().where(column == Blob.sha256) for column in references]
    gone = session.execute(
        delete(Blob)
        .where(Blob.sha256 > after, Blob.sha256 <= last, Blob.created_at < before, *unused)
        .execution_options(synchronize_session=False)
    )
    return int(cast("CursorResult[Any]", gone).rowcount), last


def iterate_bytes(session: Session, sha256: str) -> Iterator[bytes]:
    """Give the content of a blob chunk by chunk, one in memory at a time.

    Raises
    ------
    NotFoundError
        When there is no such blob.
    """
    size = session.scalar(select(Blob.size).where(Blob.sha256 == sha256))
    if size is None:
        raise NotFoundError("blob", sha256)
    for number in range(-(-size // CHUNK_SIZE)):
        row = session.execute(select(*PLACE).where(BlobChunk.sha256 == sha256, BlobChunk.number == number)).one()
        (data,) = encoded(session, [row])
        yield decode(row.encoding, data, min(CHUNK_SIZE, size - number * CHUNK_SIZE))


#: What `encoded` must know of a chunk.
PLACE = (BlobChunk.sha256, BlobChunk.number, BlobChunk.encoding, BlobChunk.data, BlobChunk.object)


def encoded(session: Session, rows: Sequence[Row[*tuple[Any, ...]]]) -> list[bytes]:
    """Return the bytes of chunks as they are kept, from wherever they lie, those of the object store side by side.

    Parameters
    ----------
    rows : sequence of Row
        With the columns of `PLACE`.

    Raises
    ------
    ObjectStoreError
        When the store does not answer, or is not known here.
    DamagedBlobError
        When it has lost one of them, or gives other bytes than were kept.
    """
    names = [row.object for row in rows if row.object is not None]
    try:
        found = iter(fetched(store_of(session), names))
        return [row.data if row.object is None else next(found) for row in rows]
    except DamagedBlobError:
        again = _looked_up(session, rows)
        if [row.object for row in again] == [row.object for row in rows]:
            raise
        return encoded(session, again)  # they were moved meanwhile


def _looked_up(session: Session, rows: Sequence[Row[*tuple[Any, ...]]]) -> list[Row[*tuple[Any, ...]]]:
    """Return rows of chunks as they are now, past this session: on SQLite it sees what was there when it began to read."""
    with Session(session.get_bind()) as now:
        return [
            now.execute(
                select(*PLACE).where(BlobChunk.sha256 == row.sha256, BlobChunk.number == row.number)
            ).one_or_none()
            or row
            for row in rows
        ]


def fetched(store: ObjectStore | None, names: Sequence[str]) -> list[bytes]:
    """Return what lies under these names in the object store; raises as `encoded` does."""
    if names and store is None:
        raise ObjectStoreError("the blob lies in an object store: SERVOTUNE_OBJECT_STORE must name it, got none")
    return store.get(names) if store is not None and names else []


def get_bytes(session: Session, sha256: str) -> bytes:
    """Return the content of a blob.

    Raises
    ------
    NotFoundError
        When there is no such blob.
    """
    return b"".join(iterate_bytes(session, sha256))


def put_array(session: Session, array: Array) -> str:
    """Keep an array of numbers in numpy's own format (no pickle) and return its reference, a SHA-256.

    Raises
    ------
    ValueError
        When the array holds Python objects.
    """
    content = packed_array(array)
    put_packed(session, without_those_kept(session, [content]))
    return content.sha256


def get_array(session: Session, ref: str) -> Array:
    """Return the array that `put_array` kept, read-only.

    Raises
    ------
    NotFoundError
        When there is no such blob.
    """
    array = cast("Array", np.load(io.BytesIO(get_bytes(session, ref)), allow_pickle=False))
    array.setflags(write=False)
    return array
