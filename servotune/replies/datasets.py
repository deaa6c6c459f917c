"""Recordings and their samples."""

from __future__ import annotations

from typing import Any, Required, TypedDict


class Dataset(TypedDict, total=False):
    """A recording."""

    id: Required[str]
    status: Required[str]
    name: str
    format: str
    channels: list[dict[str, Any]]
    sample_rate: float | None
    sample_count: int
    uneven: bool


class ChannelData(TypedDict, total=False):
    """Samples of a channel; with fewer `points` than samples, the smallest and largest value of each piece instead."""

    unit: Required[str]
    time: Required[list[float]]
    values: list[float]
    min: list[float]
    max: list[float]
