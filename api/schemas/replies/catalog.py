"""What the service knows."""

from __future__ import annotations

from typing import Any, Literal

from api.schemas.replies.base import Number, Reply


class ParameterEntry(Reply):
    """A declared parameter."""

    name: str
    symbol: str
    unit: str
    default: Any
    lower: Number
    upper: Number
    scale: str
    doc: str


class ElementEntry(Reply):
    """A kind of block."""

    kind: str
    title: str
    inputs: list[str]
    outputs: list[str]
    parameters: list[ParameterEntry]
    equation: str
    source: str


class SignalEntry(Reply):
    """A kind of command."""

    kind: str
    title: str
    parameters: list[ParameterEntry]
    equation: str
    source: str


class MetricEntry(Reply):
    """A metric."""

    kind: str
    title: str
    unit: str
    domain: str
    better: Literal["lower", "higher"]
    definition: str
    source: str


class MethodEntry(Reply):
    """An optimisation method."""

    kind: str
    title: str
    doc: str
    parameters: list[ParameterEntry]
    source: str
