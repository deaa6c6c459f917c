"""Where numbers come from: the graph, and the file that repeats it elsewhere."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal

from servotune.repeating import Repeated, Told, repeat
from servotune.replies.base import Reply
from servotune.targets import room_at, target_of
from servotune.transport import Transport

Direction = Literal["both", "up", "down"]

_SILENCE = 600.0
"""The service may take its time to put a long recording into a file."""


class LineageNode(Reply):
    """Something that was made."""

    id: str
    kind: str
    name: str
    exists: bool
    created_at: str | None
    facts: dict[str, object]


class LineageEdge(Reply):
    """`to` was made from `from`."""

    from_: str
    to: str
    role: str


class LineageGraph(Reply):
    """Everything that a thing was made from, and everything that was made from it."""

    id: str
    nodes: list[LineageNode]
    edges: list[LineageEdge]
    truncated: bool


class Lineage:
    """What was made from what."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def get(self, identifier: str, *, direction: Direction = "both") -> LineageGraph:
        """Return the graph around a dataset, job, kept study, acquisition, system, or revision `sys_...@3`."""
        return LineageGraph(self._transport.get(f"/v1/lineage/{identifier}", params={"direction": direction}))

    def export(self, identifier: str, output: Path, *, direction: Direction = "up") -> Path:
        """Write everything that a result needs into one file, which `repeat` makes again elsewhere.

        The file is there when it is complete: nothing half-written stays behind.

        Raises
        ------
        ValueError
            Nothing can be written at ``output``.
        """
        output = target_of(output, "output")
        part = output.with_name(f"{output.name}.part-{os.getpid()}")
        path = f"/v1/lineage/{identifier}/bundle?direction={direction}"
        try:
            with (
                room_at(output),
                self._transport.stream(path, headers={"Accept": "application/zip"}, silence=_SILENCE) as response,
                part.open("wb") as file,
            ):
                for piece in response.iter_bytes():
                    file.write(piece)
            part.replace(output)
        finally:
            part.unlink(missing_ok=True)
        return output

    def repeat(self, path: Path, *, told: Told = lambda _: None) -> list[Repeated]:
        """Make everything in an exported lineage again, here, and put every number beside the recorded one.

        Parameters
        ----------
        path : pathlib.Path
        told : callable, optional
            Takes each thing as soon as it is there.

        Raises
        ------
        BundleError
            When the file is damaged.
        ApiError
            When this installation refuses something that the other one took.
        """
        return repeat(self._transport, path, told=told)
