"""Tells whether a process of this machine has ended, which is certain, where a silent heartbeat is only likely.

A process is named by what no other one ever has::

    <boot of the machine>/<namespace of process ids>/<number in there>/<its start, in ticks since the boot>

Whoever shares the first two can look. Of a process on another machine, or in another container, nothing can be said.
"""

from __future__ import annotations

import os
from pathlib import Path

_PROC = Path("/proc")


def this_process() -> str | None:
    """Return the name of this process; None on a system that cannot tell (anything but Linux)."""
    return name_of(os.getpid())


def name_of(number: int) -> str | None:
    """Return the name of a process that this one can see by its number; None where the system cannot tell."""
    here, start = _here(), _start_of(number)
    return None if here is None or start is None else f"{here}/{number}/{start}"


def alive(process: str | None) -> bool | None:
    """Return whether a process exists; None when nobody here can know.

    Parameters
    ----------
    process : str, optional
        What `this_process` told in that process.
    """
    if process is None:
        return None
    here, number, start = process.rsplit("/", 2)
    if here != _here():
        return None
    try:
        os.kill(int(number), 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass  # there is one, under another user
    found = _start_of(int(number))
    return None if found is None else found == start


def _here() -> str | None:
    try:
        boot = (_PROC / "sys/kernel/random/boot_id").read_text().strip()
        return f"{boot}/{(_PROC / 'self/ns/pid').readlink()}"
    except OSError:
        return None


def _start_of(number: int) -> str | None:
    """Return when a process started, ``ended`` when only its entry in the table is left; None when it cannot be seen."""
    try:
        stat = (_PROC / str(number) / "stat").read_text()
    except OSError:
        return None
    state, *fields = stat[stat.rindex(")") + 2 :].split()  # its name, in brackets before, may hold anything
    return "ended" if state in "ZX" else fields[18]
