"""Stored systems and their realisation."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from pydantic import Field

from api.schemas.replies.base import Pole, Reply, SystemReference, WarningReply


class SystemHead(Reply):
    """A system as it is listed."""

    id: str
    name: str
    revision: int
    created_at: datetime
    updated_at: datetime


class RevisionHead(Reply):
    """A revision as it is listed."""

    id: str
    revision: int
    created_at: datetime


class StoredSystem(Reply):
    """A system document at one of its revisions."""

    id: str
    revision: int
    created_at: datetime
    document: dict[str, Any]
    warnings: list[WarningReply]


Matrix = list[list[float]]


class StateSpaceReply(Reply):
    """A realised system in SI: x' = A x + B u, y = C x + D u without delays.

    With delays x' = A x + B1 u + B2 w, y = C1 x + D11 u + D12 w, z = C2 x + D21 u + D22 w and w_i(t) = z_i(t - delays_i): the
    form of MATLAB's `setDelayModel`.
    """

    system: SystemReference | None = Field(description="null for a system that is not stored")
    open_at: str | list[str] | None
    states: list[str] = Field(examples=[["controller.x1", "motor.x1"]])
    inputs: list[str]
    outputs: list[str]
    output_units: list[str] = Field(description='SI unit of each output, "" where it is not known')
    channels: list[str] = Field(description="the delay channels; empty without delays")
    A: Matrix
    B: Matrix | None = Field(default=None, description="without delays only, as C and D")
    C: Matrix | None = None
    D: Matrix | None = None
    B1: Matrix | None = Field(default=None, description="with delays only, as all up to D22")
    B2: Matrix | None = None
    C1: Matrix | None = None
    C2: Matrix | None = None
    D11: Matrix | None = None
    D12: Matrix | None = None
    D21: Matrix | None = None
    D22: Matrix | None = None
    delays: list[float] = Field(description="s, one for each channel")
    x0: list[float] = Field(description="initial state")
    poles: list[Pole] = Field(description="rad/s, by falling real part; with delays the rightmost ones")
    warnings: list[WarningReply]
