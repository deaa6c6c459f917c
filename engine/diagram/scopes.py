"""Blocks in their scopes: which names and ports there are, what is connected, and where a signal is really made."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from engine.elements import Ports
from engine.model.document import Connection
from engine.model.errors import DiagramError, IllPosedError, Path

Port = tuple[str, ...]
"""Full path of a port: scopes, block, port."""

_LISTED = 300


@dataclass(slots=True, kw_only=True, eq=False)
class Entry:
    """A block in its scope: a flat block by its ``number``, an input by its ``role``, or a subsystem by its ``inner``."""

    ports: Ports
    role: str | None = None
    role_given: bool = False
    number: int | None = None
    inner: Scope | None = None


@dataclass(slots=True, kw_only=True, eq=False)
class Scope:
    """One system document in its place: the root, or a subsystem of ``parent``."""

    name: str
    path: tuple[str, ...]
    at: Path
    parent: Scope | None
    entries: dict[str, Entry] = field(default_factory=dict)
    driven: dict[tuple[str, str], tuple[str, str]] = field(default_factory=dict)
    outputs: dict[str, tuple[Scope, str, str]] = field(default_factory=dict)

    def label(self, *names: str) -> str:
        """Return the dotted path of something in this scope."""
        return ".".join((*self.path, *names))

    def connect(self, connections: Sequence[Connection]) -> None:
        """Take in the connections.

        Raises
        ------
        DiagramError
            If an endpoint does not exist, or an input is driven twice.
        """
        first: dict[tuple[str, str], str] = {}
        for i, connection in enumerate(connections):
            at = (*self.at, "connections", i)
            source = self.endpoint(connection.source, outputs=True, at=(*at, "from"))
            target = self.endpoint(connection.target, outputs=False, at=(*at, "to"))
            if target in first:
                raise DiagramError(
                    f"input {'.'.join(target)} must be driven once, got '{first[target]}' and '{connection.source}' "
                    "(add them in a sum)",
                    at=(*at, "to"),
                )
            first[target] = connection.source
            self.driven[target] = source

    def endpoint(self, endpoint: str, *, outputs: bool, at: Path) -> tuple[str, str]:
        """Return block and port of ``block`` or ``block.port`` in this scope.

        Raises
        ------
        DiagramError
            If there is no such block or port.
        """
        name, _, port = endpoint.partition(".")
        entry = self.entries.get(name)
        if entry is None:
            raise DiagramError(
                f"endpoint must begin with a block ({listed(self.entries)}), got '{endpoint[:80]}'", at=at
            )
        ports = entry.ports.outputs if outputs else entry.ports.inputs
        if port in ports:
            return name, port
        if len(ports) == 1 and port in ("", "out" if outputs else "in"):
            return name, ports[0]
        side = "outputs" if outputs else "inputs"
        known = listed(f"{name}.{p}" for p in ports)
        rule = f"one of the {side} {known}" if ports else f"another block's: {name} has no {side}"
        raise DiagramError(f"endpoint must be {rule}, got '{endpoint[:80]}'", at=at)

    def find_output(self, endpoint: str, *, at: Path) -> tuple[Scope, str, str]:
        """Return scope, block and port of an output, which may lie inside subsystems: ``inner.motor.position``.

        A port of the subsystem itself goes before a block of the same name inside.

        Raises
        ------
        DiagramError
            If there is no such block or port.
        """
        name, _, rest = endpoint.partition(".")
        entry = self.entries.get(name)
        if entry is not None and entry.inner is not None and rest and rest not in (*entry.ports.outputs, "out"):
            return entry.inner.find_output(rest, at=at)
        return self, *self.endpoint(endpoint, outputs=True, at=at)

    def unit_of(self, block: str, port: str) -> str | None:
        """Return the unit of an output port, None where it follows from what is connected."""
        ports = self.entries[block].ports
        return ports.output_units[ports.outputs.index(port)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Traced:
    """Where a signal is made: ``entry`` is a flat block or an input of the root, None where nothing is connected.

    ``passed`` are the output ports on the way back, the true source last: cutting any of them cuts this consumer.
    """

    passed: tuple[Port, ...]
    entry: Entry | None
    block: str
    port: str


def trace(scope: Scope, block: str, port: str, *, at: Path) -> Traced:
    """Follow the signal of an output port back through the borders of subsystems.

    Raises
    ------
    IllPosedError
        If it leads back to itself through connections alone.
    """
    passed: list[Port] = []
    while True:
        here = (*scope.path, block, port)
        if here in passed:
            names = tuple(".".join(p) for p in passed[passed.index(here) :])[::-1]
            raise IllPosedError(
                f"the loop {' -> '.join((*names, names[0]))} must contain a block, got only connections",
                at=at,
                ports=names,
            )
        passed.append(here)
        entry = scope.entries[block]
        if entry.inner is not None:
            scope, block, port = entry.inner.outputs[port]
        elif entry.role is not None and scope.parent is not None:
            source = scope.parent.driven.get((scope.name, block))
            if source is None:
                return Traced(passed=tuple(passed), entry=None, block=block, port=port)
            scope, (block, port) = scope.parent, source
        else:
            return Traced(passed=tuple(passed), entry=entry, block=block, port=port)


def listed(names: Iterable[str]) -> str:
    """Return names for a message, cut where there are too many."""
    text = ", ".join(names) or "none"
    return text if len(text) <= _LISTED else f"{text[:_LISTED]} ..."
