"""A system as its author wrote it: parameters, blocks, connections and outputs, all by name and in SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from engine.model.errors import Path
from engine.model.parameters import Scale


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A system parameter: a number in SI, or an expression ``=...`` over other parameters of the same system."""

    value: float | str
    unit: str = ""
    lower: float | None = None
    upper: float | None = None
    scale: Scale | None = None
    doc: str = ""


@dataclass(frozen=True, kw_only=True)
class Block:
    """A block: its kind and values (number, ``=expression``, nested list of those, text or None); a subsystem its system."""

    kind: str
    values: Mapping[str, Any] = field(default_factory=dict)
    system: System | None = None


@dataclass(frozen=True, kw_only=True)
class Connection:
    """A line from an output to an input, each ``block`` or ``block.port``."""

    source: str
    target: str


@dataclass(frozen=True, kw_only=True)
class System:
    """A system document. ``outputs`` maps names to endpoints, which may lie inside a subsystem (``inner.motor.position``)."""

    name: str = ""
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    blocks: Mapping[str, Block] = field(default_factory=dict)
    connections: tuple[Connection, ...] = ()
    outputs: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Remark:
    """Something in the document that is allowed and probably not meant; ``at`` is its path from the root."""

    at: Path
    detail: str
