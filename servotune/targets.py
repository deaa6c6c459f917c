"""Files that are to be written: judged before anything is asked of the service, not after minutes of its work."""

from __future__ import annotations

import os
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
