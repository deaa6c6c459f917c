"""The key of an installation that was given none: a file beside its SQLite database, which its user alone can read.

It holds what `SERVOTUNE_SECRET_KEY` would: 32 random bytes in base64. A database on a server has no place beside it.
"""

from __future__ import annotations

import os
from pathlib import Path

from cryptography.fernet import Fernet

from storage.session import sqlite_file


def path_of(url: str) -> Path | None:
    """Return where the key of a database is; None for one on a server."""
    database = sqlite_file(url)
    return None if database is None else database.with_name(database.name + ".key")


def read(url: str) -> tuple[str, ...]:
    """Return the key of a database, alone; none where there is no such file."""
    path = path_of(url)
    return (path.read_text().strip(),) if path is not None and path.is_file() else ()


def make(url: str) -> Path | None:
    """Make a key where there is none yet; return its path, None for a database on a server."""
    path = path_of(url)
    if path is not None and not path.exists():
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(handle, "wb") as file:
            file.write(Fernet.generate_key() + b"\n")
            file.flush()
            os.fsync(handle)  # what it encrypts is on the disk, too
    return path
