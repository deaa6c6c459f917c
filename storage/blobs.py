"""Bytes and arrays kept once, under the SHA-256 of their content, in the database itself.

Content is cut into chunks of at most 8 MiB, each compressed as `storage.packing` says.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import CursorResult, Table, delete, exists, func, select, update
from sqlalchemy.orm import Session

from storage.errors import ChecksumError, NotFoundError
from storage.insertion import insert_if_absent
from storage.models import Blob, BlobChunk
from storage.models.base import Base, utc_now
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
    if _is_new(session, sha256, len(data)):
        put_chunks(session, [packed(data, itemsize=itemsize, sha256=sha256)])
    return sha256


@dataclass(frozen=True, slots=True, kw_only=True)
class Packed:
    """Content ready to be kept: compressed, under its SHA-256. Made without a database, in any thread."""

    sha256: str
    size: int
    chunks: Sequence[tuple[str, bytes]]


def packed(data: bytes, *, itemsize: int = 1, sha256: str | None = None) -> Packed:
    """Compress ``data``, whose SHA-256 may be known."""
    pieces = (data[start : start + CHUNK_SIZE] for start in range(0, len(data), CHUNK_SIZE))
    chunks = [encode(piece, itemsize) for piece in pieces]
    return Packed(sha256=sha256 or sha256_of(data), size=len(data), chunks=chunks)


def put_packed(session: Session, contents: Sequence[Packed]) -> None:
    """Keep several contents, each unless it is there already; in one order, so that two writers never wait in a ring."""
    ordered = sorted({content.sha256: content for content in contents}.values(), key=lambda content: content.sha256)
    put_chunks(session, [content for content in ordered if _is_new(session, content.sha256, content.size)])


def put_chunks(session: Session, contents: Sequence[Packed]) -> None:
    """Write the chunks of blobs whose heads have just been written."""
    rows = [
        {"sha256": content.sha256, "number": number, "encoding": encoding, "data": data}
        for content in contents
        for number, (encoding, data) in enumerate(content.chunks)
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
        row = session.execute(
            select(BlobChunk.encoding, BlobChunk.data).where(BlobChunk.sha256 == sha256, BlobChunk.number == number)
        ).one()
        yield decode(row.encoding, row.data, min(CHUNK_SIZE, size - number * CHUNK_SIZE))


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
    buffer = io.BytesIO()
    np.save(buffer, np.ascontiguousarray(array) if array.ndim else array, allow_pickle=False)
    return put_bytes(session, buffer.getvalue(), itemsize=array.itemsize)


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
