"""The body and the reply of the Fourier analyser."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, model_validator

from api.schemas.jobs import Window
from api.schemas.replies import Curve, Number, Reply, StudyReply, VerdictWord
from api.schemas.signals import Inputs
from api.schemas.systems import SystemRef
from api.schemas.values import AutoOrQuantities, AutoOrQuantity, Band, Document, Identifier, Overrides, Port, Quantity


class SpectrumRequest(Document):
    """The output of a system under a command, or the channel of a dataset; what of its spectrum is wanted."""

    system: SystemRef | None = None
    input: Inputs | None = Field(default=None, description="with `system`")
    output: Port | None = Field(default=None, description="with `system`")
    variants: list[Overrides] | None = Field(
        default=None,
        min_length=1,
        description="with `system`: parameters, also of commands: `signals.reference.delay` makes a waterfall",
    )
    dataset: Identifier | None = None
    channel: str | None = Field(default=None, min_length=1, max_length=200, description="with `dataset`")
    quantity: Literal["amplitude", "density", "transform"] = Field(
        default="amplitude",
        description="estimated from samples: the amplitude of a sine on each line, or the mean square per Hz; "
        "of a simulated response that settles: its exact Fourier integral",
    )
    window: Literal["flat_top", "hann", "none"] = "flat_top"
    segment: Quantity | None = Field(default=None, description="s, of averaged segments; default: one segment")
    overlap: float = Field(default=0.5, ge=0.0, lt=1.0, description="of neighbouring segments")
    removal: Literal["nothing", "mean", "trend"] = Field(default="nothing", description="from each segment")
    part: Window | None = Field(default=None, description="[t0, t1] in s: what is sampled; default: everything")
    duration: AutoOrQuantity = Field(default="auto", description="s; of the simulated response that is sampled")
    samples: int = Field(default=4096, ge=8, description="of the simulated response")
    frequencies: AutoOrQuantities = Field(default="auto", description="rad/s; of `transform`")
    fundamental: Quantity | None = Field(
        default=None, description="rad/s: its harmonics are wanted, too (not with `transform`)"
    )
    orders: int = Field(default=10, ge=1, le=1000, description="highest order of the harmonics")
    band: Band | None = Field(default=None, description="its energy (`transform`) or mean square is wanted, too")
    keep: bool = False

    @model_validator(mode="after")
    def _one_source(self) -> SpectrumRequest:
        if self.quantity == "transform" and self.fundamental is not None:
            raise ValueError("fundamental must be left out for a transform: what ends has no harmonics")
        simulated = (self.system is not None, self.input is not None, self.output is not None)
        recorded = (self.dataset is not None, self.channel is not None)
        if (all(simulated) and not any(recorded)) or (all(recorded) and not any(simulated)):
            return self
        raise ValueError("must have either system, input and output, or dataset and channel")


class AppliedWindow(Reply):
    """The window; its noise bandwidth is in lines."""

    kind: str
    coherent_gain: float
    noise_bandwidth: float


class HarmonicsReply(Reply):
    """Order 1 first; phases of cosines at t = 0, rad."""

    fundamental: float
    mean: Number
    amplitude: Curve
    phase: Curve
    thd: Number
    unit: str


class BandReply(Reply):
    """Energy or mean square in the band."""

    value: Number
    unit: str


class SpectrumVariant(Reply):
    """One set of parameters; `resolution` is the distance of lines in rad/s."""

    parameters: dict[str, Any]
    verdict: VerdictWord
    advice: str | None = None
    frequency: Curve
    value: Curve
    phase: Curve | None = None
    resolution: Number = None
    averages: int | None = None
    harmonics: HarmonicsReply | None = None
    band: BandReply | None = None


class SpectrumReply(StudyReply):
    """Frequencies in rad/s and what was asked for, in `unit`."""

    quantity: str
    unit: str
    window: AppliedWindow | None
    variants: list[SpectrumVariant]
