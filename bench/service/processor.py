"""How much processor time programs take that were started here."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

_TICK = os.sysconf("SC_CLK_TCK")


def processor_time(program: str) -> float:
    """Return the processor time (s) of every process of a program that is a descendant of this one, ended ones of Postgres included."""
    found = dict(filter(None, map(_read, Path("/proc").glob("[0-9]*/stat"))))
    total = 0.0
    for number, (name, fields) in found.items():
        if name.startswith(program) and os.getpid() in _ancestors(found, number):
            parent, _ = found.get(int(fields[1]), ("", []))
            own = int(fields[11]) + int(fields[12])
            ended = (
                0 if parent.startswith(program) else int(fields[13]) + int(fields[14])
            )  # those of the postmaster alone
            total += (own + ended) / _TICK
    return total


def _read(path: Path) -> tuple[int, tuple[str, list[str]]] | None:
    try:
        head, _, rest = path.read_text().rpartition(")")
    except OSError:
        return None
    number, _, name = head.partition(" (")
    return int(number), (name, rest.split())


def _ancestors(found: dict[int, tuple[str, list[str]]], number: int) -> Iterator[int]:
    while number in found:
        number = int(found[number][1][1])
        yield number
