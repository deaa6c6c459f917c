"""The most memory that this process ever had."""

from __future__ import annotations

from pathlib import Path


def peak_memory() -> float:
    """Return it in MB (2^20 bytes); what a parent had before this process was made does not count, as it does for getrusage."""
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1024
    raise RuntimeError("the system must tell VmHWM of a process")
