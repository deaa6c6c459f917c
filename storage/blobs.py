"""Bytes and arrays kept once, under the SHA-256 of their content, in the database itself.

Content is cut into chunks of at most 8 MiB, each compressed by zlib; the eight bytes of float64 samples are first put
beside their equals (byte shuffle), because neighbouring samples share signs, exponents and leading digits.
"""

from __future__ import annotations

import hashlib
import io
import zlib
from collections.abc import Iterator
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import select
from sqlalchemy.orm import Session

from storage.errors import ChecksumError, NotFoundError
from storage.insertion import insert_if_absent
from storage.models import Blob, BlobChunk

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
    if insert_if_absent(session, Blob, sha256=sha256, size=len(data)):
        for number, start in enumerate(range(0, len(data), CHUNK_SIZE)):
            encoding, encoded = _encode(data[start : start + CHUNK_SIZE], itemsize)
            session.add(BlobChunk(sha256=sha256, number=number, encoding=encoding, data=encoded))
        session.flush()
    return sha256


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
        yield _decode(row.encoding, row.data)


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


def _encode(data: bytes, itemsize: int) -> tuple[str, bytes]:
    shuffled = itemsize > 1 and len(data) % itemsize == 0
    packed = zlib.compress(_transpose(data, itemsize) if shuffled else data, level=1)
    if len(packed) >= len(data):
        return "raw", data
    return (f"zlib/{itemsize}" if shuffled else "zlib/1"), packed


def _decode(encoding: str, data: bytes) -> bytes:
    method, _, itemsize = encoding.partition("/")
    if method == "raw":
        return data
    content = zlib.decompress(data)
    return content if itemsize == "1" else _transpose(content, len(content) // int(itemsize))


def _transpose(data: bytes, columns: int) -> bytes:
    """Read ``data`` row by row into ``columns`` columns and give it back column by column."""
    return np.frombuffer(data, dtype=np.uint8).reshape(-1, columns).T.tobytes()
