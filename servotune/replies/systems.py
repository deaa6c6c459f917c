"""Stored systems, their realisation, and what the service knows."""

from __future__ import annotations

from typing import Any, NotRequired, Required, TypedDict

from servotune.replies.values import Root, Warned


class Stored(TypedDict):
    """A stored system document and which revision it is."""

    id: str
    revision: int
    created_at: str
    document: dict[str, Any]


class StateSpace(TypedDict):
    """A realised system: A, B, C, D without delays; A, B1 to D22 with them."""

    system: dict[str, Any] | None
    open_at: str | list[str] | None
    states: list[str]
    inputs: list[str]
    outputs: list[str]
    output_units: list[str]
    channels: list[str]
    A: list[list[float]]
    B: NotRequired[list[list[float]]]
    C: NotRequired[list[list[float]]]
    D: NotRequired[list[list[float]]]
    B1: NotRequired[list[list[float]]]
    B2: NotRequired[list[list[float]]]
    C1: NotRequired[list[list[float]]]
    C2: NotRequired[list[list[float]]]
    D11: NotRequired[list[list[float]]]
    D12: NotRequired[list[list[float]]]
    D21: NotRequired[list[list[float]]]
    D22: NotRequired[list[list[float]]]
    delays: list[float]
    x0: list[float]
    poles: list[Root]
    warnings: list[Warned]


class CatalogItem(TypedDict, total=False):
    """One entry of the catalogue."""

    kind: Required[str]
    title: Required[str]
    inputs: list[str]
    outputs: list[str]
    parameters: list[dict[str, Any]]
    equation: str
    definition: str
    unit: str
    source: str
