"""Files that are to be written: judged before anything is asked of the service, not after minutes of its work."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def target_of(given: Path | str, name: str) -> Path:
    """Return where a file is to be written.

    Raises
    ------
    ValueError
        It is a folder, or in none, or may not be written.
    """
    path = Path(given)
    rule = f"{name} must be a file that can be written"
    if path.is_dir():
        raise ValueError(f"{rule}, got the folder {str(path)!r}")
    if not path.parent.is_dir():
        raise ValueError(f"{rule}, got {str(path)!r} in a folder that is not there")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise ValueError(f"{rule}, got {str(path)!r}, which this user may not")
    return path


@contextmanager
def room_at(target: Path) -> Iterator[None]:
    """Name the file whose disk is full; the system does not.

    Raises
    ------
    OSError
        What is written inside finds no room.
    """
    try:
        yield
    except OSError as error:
        if error.errno not in {errno.ENOSPC, errno.EDQUOT}:
            raise
        rule = f"the disk of {target} must have room for what is written, it is full"
        raise OSError(rule) from error
