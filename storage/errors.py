"""What can go wrong with remembered things, said in the caller's words.

::

    StorageError
    ├── NotFoundError             no such thing in this workspace
    ├── RevisionConflictError     somebody else changed it first
    ├── StateError                the thing is not in a state that allows this
    │   ├── UnmigratedError       tables that are not yet as this version needs them
    │   └── LeaseLostError        a rig's job is not this agent's any more
    │       └── CancelledError    because a person has cancelled it
    ├── ChecksumError             bytes that are not what they claim to be
    ├── ObjectStoreError          a store of blobs that cannot do its work now
    ├── DamagedBlobError          a blob that is not what was kept, or is gone
    ├── MissingSegmentsError      a manifest that names segments never received
    ├── DocumentError             a document that is no JSON
    ├── InvalidCursorError        a page cursor that this list did not hand out
    ├── QuotaExceededError        more than the workspace may have
    ├── DatabaseUrlError          a database this package cannot work with
    ├── VaultError                a secret without a key, or that was encrypted under another one
    ├── CopyError                 a copy that cannot be made, or is not what was copied
    └── IdempotencyError          a key used for another request, or one still running
        ├── IdempotencyMismatchError
        └── IdempotencyRunningError
"""

from __future__ import annotations

import errno
import sqlite3
from collections.abc import Sequence
from typing import ClassVar

from sqlalchemy.exc import DontWrapMixin, InterfaceError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError

#: What Postgres says of a server that only reads, of a full disk, and of a transaction that was left alone for too long; SQLite's
#: numbers are in its module.
_READ_ONLY, _DISK_FULL, _LEFT_ALONE = "25006", "53100", "25P03"

#: What SQLite says of the place and the moment, and not of what is in the file.
_CIRCUMSTANCES = frozenset(
    {
        sqlite3.SQLITE_AUTH, sqlite3.SQLITE_BUSY, sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_CONSTRAINT, sqlite3.SQLITE_FULL,
        sqlite3.SQLITE_INTERRUPT, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_LOCKED, sqlite3.SQLITE_NOMEM, sqlite3.SQLITE_PERM,
        sqlite3.SQLITE_PROTOCOL, sqlite3.SQLITE_READONLY,
    }
)  # fmt: skip


def why_unavailable(error: Exception) -> str:
    """Return a clause that says why the database, or the store of blobs, could not do its work, without anything of what it was."""
    if isinstance(error, ObjectStoreError):
        return error.message
    cause = getattr(error, "orig", None)
    code = getattr(cause, "sqlite_errorcode", 0) & 0xFF
    if is_read_only(error):
        return "the database takes no changes: it is read-only"
    if is_full(cause) or isinstance(error, FullDiskError):
        return "the database takes no changes: its disk is full"
    if code in {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED}:
        return "the database takes no changes: another process has held its lock for too long"
    return "the database does not answer"


def is_damage(error: Exception) -> bool:
    """Tell whether SQLite could not read what is in its file, and not only do nothing with it now; a column or letters that are not there, too."""
    cause = getattr(error, "orig", error)
    if isinstance(cause, UnicodeDecodeError):  # in what SQLite says of the damage, or in a text
        return True
    if not isinstance(cause, sqlite3.DatabaseError):
        return False
    return (getattr(cause, "sqlite_errorcode", sqlite3.SQLITE_ERROR) & 0xFF) not in _CIRCUMSTANCES


def is_read_only(error: Exception) -> bool:
    """Tell whether the database takes no changes because it is read-only."""
    cause = getattr(error, "orig", None)
    code = getattr(cause, "sqlite_errorcode", 0) & 0xFF
    return getattr(cause, "sqlstate", None) == _READ_ONLY or code == sqlite3.SQLITE_READONLY


def full_disk(error: BaseException) -> str | None:
    """Return the sentence that says whose disk is full; None for another error."""
    if isinstance(error, FullDiskError):
        place = error.place
    elif isinstance(error, OSError) and error.errno in {errno.ENOSPC, errno.EDQUOT}:
        place = str(error.filename2 or error.filename or "what is written")
    else:
        return None
    return f"the disk of {place} must have room for what is written, it is full"


def is_full(cause: BaseException | None) -> bool:
    """Tell whether a driver says that the disk is full."""
    code = getattr(cause, "sqlite_errorcode", 0) & 0xFF
    return getattr(cause, "sqlstate", None) == _DISK_FULL or code == sqlite3.SQLITE_FULL


def is_refusal(cause: BaseException | None) -> bool:
    """Tell whether Postgres refused to change anything, or any more, which its driver does not count among operational errors."""
    return getattr(cause, "sqlstate", None) in {_READ_ONLY, _LEFT_ALONE}


class StorageError(Exception):
    """A request that the storage refuses; ``message`` is a sentence for the user."""

    def __init__(self, message: str) -> None:
        super().__init__(message)
        self.message = message


class ObjectStoreError(StorageError, DontWrapMixin):
    """The store of blobs cannot be reached, is full, or lets nobody in."""


class DamagedBlobError(StorageError):
    """A blob that the object store has lost, or gives as something else."""


#: What is raised when the database cannot be reached, is full, locked or read-only, or the object store.
UNAVAILABLE: tuple[type[Exception], ...] = (OperationalError, InterfaceError, PoolTimeoutError, ObjectStoreError)


class FullDiskError(OperationalError):
    """The disk of a database is full; ``place`` says of which one."""

    place = "the database"


class VaultError(StorageError):
    """A secret that cannot be kept or read with the keys that there are."""


class NotFoundError(StorageError):
    """There is no such thing in this workspace (or it has been deleted)."""

    def __init__(self, kind: str, identifier: str) -> None:
        super().__init__(f"{kind} {identifier!r} does not exist")
        self.kind = kind
        self.identifier = identifier


class LeftOutError(StorageError):
    """The original of a recording is not kept any more, as the operator wants it."""

    def __init__(self, identifier: str, sha256: str | None) -> None:
        super().__init__(
            f"the original of dataset {identifier!r} (SHA-256 {sha256}) is not kept: it was left out, as this installation is set, "
            "after its channels had been read back and were the same; export gives its samples"
        )


class RevisionConflictError(StorageError):
    """The document has changed since the revision that the caller knows."""

    def __init__(self, identifier: str, *, expected: int, actual: int) -> None:
        super().__init__(f"revision of {identifier!r} must be {actual}, got {expected}")
        self.identifier = identifier
        self.expected = expected
        self.actual = actual


class StateError(StorageError):
    """The thing is in a state that does not allow this."""


class UnmigratedError(StateError):
    """The tables are not yet as this version needs them."""


class LeaseLostError(StateError):
    """The agent has had its time: what it does on the rig must end."""


class CancelledError(LeaseLostError):
    """A person has cancelled what the agent does."""


class ChecksumError(StorageError):
    """Bytes whose SHA-256 is not the one that was promised."""

    def __init__(self, what: str, *, expected: str, actual: str) -> None:
        super().__init__(f"sha256 of {what} must be {expected}, got {actual}")
        self.expected = expected
        self.actual = actual


class MissingSegmentsError(StorageError):
    """A manifest names segments that have not been received."""

    def __init__(self, dataset: str, missing: Sequence[str]) -> None:
        super().__init__(f"dataset {dataset!r} lacks {len(missing)} of the segments in the manifest")
        self.missing = tuple(missing)


class InvalidCursorError(StorageError):
    """A cursor must come from the ``next_cursor`` of the same list."""

    def __init__(self, cursor: str) -> None:
        super().__init__(f"cursor must be a next_cursor of this list, got {cursor!r}")


class QuotaExceededError(StorageError):
    """The workspace has as much as it may have; ``name`` says of what."""

    _THINGS: ClassVar = {
        "systems": "systems",
        "schedules": "schedules",
        "webhooks": "webhooks",
        "stored_bytes": "stored bytes",
        "jobs": "unfinished jobs",
    }

    def __init__(self, name: str, *, limit: int, used: int) -> None:
        super().__init__(f"a workspace must have at most {limit} {self._THINGS[name]}, this one has {used}")
        self.name = name
        self.limit = limit
        self.used = used


class DocumentError(StorageError, DontWrapMixin):
    """A document holds NaN, infinity, or something that JSON has no word for."""


class DatabaseUrlError(StorageError):
    """The database URL names a database that this package cannot work with."""


class CopyError(StorageError):
    """A backup, or a database to be filled, that is not what it must be."""


class IdempotencyError(StorageError):
    """An idempotency key that cannot be used now."""


class IdempotencyMismatchError(IdempotencyError):
    """The key was used before with another request."""


class IdempotencyRunningError(IdempotencyError):
    """The first request with this key has not finished yet."""
