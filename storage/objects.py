"""Blobs' chunks in an S3-compatible store, beside the database: what lies there, the database knows under a name.

A name holds the SHA-256 of the bytes, so that they are checked whenever they are read, and is used once::

    <first two digits>/<SHA-256 of the bytes>-<random>

So an object whose name no row has is waste as soon as whoever wrote it can not commit any more, and may be deleted without asking
anybody. Requests end soon (`_TIMEOUT`), because some are made within a transaction. Who may come in, where and how is told by the
environment as for any program of S3: ``AWS_ENDPOINT_URL``, ``AWS_REGION``, ``AWS_ACCESS_KEY_ID``, ``AWS_SECRET_ACCESS_KEY``.
"""

from __future__ import annotations

import hashlib
import re
import secrets
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime, timedelta
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar

from storage.errors import DamagedBlobError, ObjectStoreError

if TYPE_CHECKING:
    from obstore.store import S3Store

#: What an address looks like; the part behind the bucket stands in front of every name.
ADDRESS = r"^s3://[a-z0-9][a-z0-9.-]{1,61}[a-z0-9](/[A-Za-z0-9_.-]+)*$"

#: s that a request may take, and within which it is tried again: together less than a transaction may rest (`storage.postgres`).
_TIMEOUT, _AGAIN = timedelta(seconds=5), timedelta(seconds=2)
#: Requests at a time.
_THREADS = 8
#: Names in one page of a list.
_PAGE = 1000
_STATUS = re.compile(r"status code: (\d{3})")

Value = TypeVar("Value")


class ObjectStore:
    """One bucket of an S3-compatible store, or a part of it; safe to share between threads.

    Parameters
    ----------
    address : str
        ``s3://bucket/in/front/of/names``, of one database alone.
    preferred : bool
        Whether new blobs go there.
    """

    def __init__(self, address: str, *, preferred: bool) -> None:
        self.address = address
        self.preferred = preferred

    def put(self, contents: Sequence[bytes]) -> list[str]:
        """Keep contents, side by side; return their names.

        Raises
        ------
        ObjectStoreError
            When the store is away, full, or lets nobody in; some of them may lie there, under names that nobody has.
        """
        return list(self._pool.map(self._put, contents))

    def get(self, names: Sequence[str]) -> list[bytes]:
        """Return what lies under these names, fetched side by side.

        Raises
        ------
        ObjectStoreError
            When the store does not answer.
        DamagedBlobError
            When it has no such object, or gives other bytes than were kept, twice.
        """
        return list(self._pool.map(self._get, names))

    def delete(self, names: Sequence[str]) -> None:
        """Delete objects, also those that are gone; raises `ObjectStoreError`."""
        if names:
            self._ask(lambda store: store.delete(names))

    def older(self, than: datetime) -> Iterator[list[str]]:
        """Give the names of all objects written before, page by page; raises `ObjectStoreError`."""
        pages = self._ask(lambda store: store.list(chunk_size=_PAGE))
        while (page := self._ask(lambda _: next(pages, None))) is not None:
            yield [found["path"] for found in page if found["last_modified"] < than]

    def _put(self, content: bytes) -> str:
        digest = hashlib.sha256(content).hexdigest()
        name = f"{digest[:2]}/{digest}-{secrets.token_hex(8)}"
        self._ask(lambda store: store.put(name, content, use_multipart=False))
        return name

    def _get(self, name: str) -> bytes:
        expected = name[3:67]
        actual = ""
        for _ in range(2):  # what was garbled on its way is right the second time
            content = self._ask(lambda store: store.get(name).bytes().to_bytes(), name=name)
            actual = hashlib.sha256(content).hexdigest()
            if actual == expected:
                return content
        raise DamagedBlobError(f"sha256 of {name!r} in the object store must be {expected}, got {actual}")

    def _ask(self, question: Callable[[S3Store], Value], *, name: str | None = None) -> Value:
        from obstore.exceptions import BaseError  # noqa: PLC0415 - loaded only where there is such a store

        try:
            return question(self._store)
        except (BaseError, FileNotFoundError) as error:
            text = str(error).partition("Debug source:")[0]
            if name is not None and isinstance(error, FileNotFoundError) and "NoSuchBucket" not in text:
                raise DamagedBlobError(f"the object store must have {name!r}, it has no such object") from error
            raise ObjectStoreError(f"{_why(error, text)} ({self.address})") from error

    @cached_property
    def _pool(self) -> ThreadPoolExecutor:
        return ThreadPoolExecutor(_THREADS, thread_name_prefix="objects")

    @cached_property
    def _store(self) -> S3Store:
        try:
            from obstore.store import S3Store  # noqa: PLC0415 - as above
        except ImportError as error:
            raise ObjectStoreError(
                "an object store needs the extra servotune-server[objects], which is not installed"
            ) from error

        return S3Store.from_url(
            self.address,
            checksum_algorithm="sha256",  # the store checks what arrives
            client_options={"allow_http": True, "connect_timeout": _TIMEOUT / 2, "timeout": _TIMEOUT},
            retry_config={"max_retries": 2, "retry_timeout": _AGAIN},
        )


def _why(error: Exception, text: str) -> str:
    """Return a clause that says why the store could not do its work, without anything of what it was."""
    found = _STATUS.search(text)
    status = int(found[1]) if found else 0
    if status == 507 or "XMinioStorageFull" in text:
        return "the object store takes no blobs: it is full"
    if status in {401, 403} or "Missing" in text:
        return "the object store lets nobody in with the AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY that there are"
    if isinstance(error, FileNotFoundError):
        return "the object store has no such bucket"
    if status:
        return f"the object store cannot do its work now, it answers {status}"
    return "the object store does not answer"
