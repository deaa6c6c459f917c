"""Stored systems, their realisation, and what the service knows."""

from __future__ import annotations

from typing import Any

from servotune.replies.base import Reply
from servotune.replies.values import Root, Warned


class Stored(Reply):
    """A stored system document and which revision it is; lists tell its name in place of the document."""

    id: str
    revision: int
    created_at: str
    updated_at: str | None
    name: str | None
    document: dict[str, Any]


class StateSpace(Reply):
    """A realised system: A, B, C, D without delays; A, B1 to D22 with them."""

    system: dict[str, Any] | None
    open_at: str | list[str] | None
    states: list[str]
    inputs: list[str]
    outputs: list[str]
    output_units: list[str]
    channels: list[str]
    A: list[list[float]]
    B: list[list[float]] | None
    C: list[list[float]] | None
    D: list[list[float]] | None
    B1: list[list[float]] | None
    B2: list[list[float]] | None
    C1: list[list[float]] | None
    C2: list[list[float]] | None
    D11: list[list[float]] | None
    D12: list[list[float]] | None
    D21: list[list[float]] | None
    D22: list[list[float]] | None
    delays: list[float]
    x0: list[float]
    poles: list[Root]
    warnings: list[Warned]


class CatalogItem(Reply):
    """One entry of the catalogue."""

    kind: str
    title: str
    inputs: list[str] | None
    outputs: list[str] | None
    parameters: list[dict[str, Any]] | None
    equation: str | None
    definition: str | None
    unit: str | None
    source: str | None
