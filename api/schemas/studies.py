"""The bodies of simulations, frequency responses and influence studies."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from api.schemas.signals import Inputs, SignalDocument
from api.schemas.systems import SystemRef
from api.schemas.values import (
    AutoOrQuantities,
    AutoOrQuantity,
    Band,
    Change,
    Document,
    OfPaths,
    OfResponses,
    OpenAt,
    Overrides,
    Path,
    Port,
)

Names = Annotated[list[str], Field(max_length=100)]


class SimulationRequest(OfResponses):
    """A command on one or more inputs; the answers of the outputs and their metrics."""

    system: SystemRef
    input: Inputs
    outputs: Names | None = Field(default=None, description="default: all")
    duration: AutoOrQuantity = Field(default="auto", description="s, or chosen by the service")
    samples: int = Field(default=1000, ge=2, description="points of each curve, both ends included")
    metrics: Names | None = Field(default=None, description="default: those that apply")
    band: Band | None = Field(default=None, description="for `band_energy`")
    variants: list[Overrides] | None = Field(default=None, min_length=1)
    keep: bool = Field(default=False, description="remember the reply under /v1/results")


class PathDocument(Document):
    """From an input to an output."""

    source: Port = Field(alias="from")
    target: Port = Field(alias="to")


class FrequencyRequest(OfPaths):
    """A path from an input to an output, or the loop opened at a block's output."""

    system: SystemRef
    source: Port | None = Field(default=None, alias="from")
    target: Port | None = Field(default=None, alias="to")
    open_at: OpenAt | None = None
    frequencies: AutoOrQuantities = Field(
        default="auto", description="rad/s, rising, >= 0; 0 asks for the gain at rest"
    )
    metrics: Names | None = Field(default=None, description="default: those that apply")
    paths: list[PathDocument] | None = Field(
        default=None,
        min_length=1,
        max_length=50,
        description="further paths; the first is also shown where none is named",
    )
    operating_point: Overrides | None = Field(
        default=None,
        description="constant inputs under which a nonlinear system rests where it is linearised; 0 where left out",
    )
    variants: list[Overrides] | None = Field(default=None, min_length=1)
    keep: bool = False


class InfluenceRequest(OfResponses, OfPaths):
    """How much each metric changes with each parameter."""

    system: SystemRef
    input: Port
    output: Port
    signal: SignalDocument | None = Field(default=None, description="default: a step of amplitude 1")
    open_at: OpenAt | None = None
    source: Port | None = Field(default=None, alias="from", description="default: input")
    target: Port | None = Field(default=None, alias="to", description="default: output")
    duration: AutoOrQuantity = "auto"
    band: Band | None = Field(default=None, description="for `band_energy`")
    parameters: list[Path] = Field(
        min_length=1,
        max_length=200,
        description="paths of the system's, and `signals.<input>.<parameter>` of the command's",
    )
    metrics: list[str] = Field(min_length=1, max_length=100)
    change: float = Field(default=0.1, gt=-1.0, description="relative change for the coefficients of eq. (4)")
    predict: list[Annotated[dict[Path, Change], Field(min_length=1, max_length=50)]] | None = Field(
        default=None,
        min_length=1,
        max_length=50,
        description="changes, each of one or more parameters at once, for which every metric is predicted from its "
        'derivatives: parameter path -> new value, or {"change": relative change}',
    )
    keep: bool = False


class StateSpaceRequest(Document):
    """A system whose matrices and poles are wanted: a stored one, or the document itself."""

    system: SystemRef
    parameters: Overrides | None = None
    open_at: OpenAt | None = None
    operating_point: Overrides | None = Field(
        default=None,
        description="constant inputs under which a nonlinear system rests where it is linearised; 0 where left out",
    )
