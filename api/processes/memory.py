"""How much memory a process may take that computes one thing and ends."""

from __future__ import annotations

import re
import resource
from pathlib import Path


def bound_memory(limit: int, *, more: int | None = None) -> int:
    """Let this process, which computes one thing and ends, have no more memory than that; 0 is as much as there is.

    Parameters
    ----------
    limit : int
        Bytes.
    more : int, optional
        What it may take beyond what it has now (bytes), where that is less.

    Returns
    -------
    int
        The limit that holds (bytes), 0 without one.
    """
    if more is not None:
        found = re.search(r"^VmData:\s+(\d+) kB$", Path("/proc/self/status").read_text(), re.MULTILINE)
        assert found is not None
        own = (int(found[1]) << 10) + more
        limit = min(limit, own) if limit else own
    if limit:
        resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
    return limit
