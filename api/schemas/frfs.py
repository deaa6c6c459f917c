"""The body and the reply of measured frequency response functions."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from api.schemas.datasets import ChannelName
from api.schemas.jobs import Between, Window
from api.schemas.replies import Curve, Number, Reply, StudyReply
from api.schemas.spectra import AppliedWindow
from api.schemas.systems import SystemRef
from api.schemas.values import Band, Document, Identifier, Overrides, Port, Quantity

Quantities = Annotated[list[Quantity], Field(min_length=2, max_length=10_000)]


class SensorResponse(Document):
    """What a measuring channel does to what it measures, relative to its nominal sensitivity; it is taken back."""

    delay: Quantity = Field(default=0.0, description="s")
    coupling: Quantity | None = Field(default=None, description="rad/s: corner of an AC or IEPE coupling")
    frequency: Quantities | None = Field(default=None, description="rad/s, increasing: points of a calibration")
    magnitude: list[float] | None = Field(default=None, max_length=10_000, description="at these points, a ratio")
    phase: Quantities | None = Field(default=None, description="at these points, rad")

    @model_validator(mode="after")
    def _whole_table(self) -> SensorResponse:
        curves = self.magnitude is not None or self.phase is not None
        if curves != (self.frequency is not None):
            raise ValueError("must have frequency together with magnitude, phase or both")
        return self


class SineStepDocument(Document):
    """One sine of a stepped run."""

    frequency: Quantity = Field(description="rad/s")
    start: Quantity = Field(description="s from the first sample")
    end: Quantity = Field(description="s from the first sample")


class ModesRequest(Document):
    """Modes to be fitted to all outputs together."""

    count: int | None = Field(default=None, ge=1, le=20, description="default: those that the data need")
    band: Band | None = Field(default=None, description="where they are looked for; default: all lines")


def _one_or_many(value: Any) -> str:
    return "many" if isinstance(value, list) else "one"


OutputChannels = Annotated[
    Annotated[ChannelName, Tag("one")] | Annotated[list[ChannelName], Field(min_length=1, max_length=50), Tag("many")],
    Discriminator(_one_or_many),
]


class FrfRequest(Document):
    """Two channels of a recording (or two points of a measured response), how the response of one to the other is estimated, and what it is held against."""

    dataset: Identifier
    input: ChannelName = Field(description="what was measured of the excitation: the force, not the command")
    output: OutputChannels = Field(description="one channel or several")
    estimator: Literal["H1", "H2", "Hv", "stepped_sine", "multisine", "measured"] = Field(
        default="H1",
        description="measured: the responses that the dataset's file holds; input and output are their points",
    )
    window: Literal["hann", "flat_top", "none"] = "hann"
    segment: Quantity | None = Field(
        default=None,
        description="s, of averaged segments; default: an eighth of the longest experiment, at most 65536 samples",
    )
    overlap: float = Field(default=0.5, ge=0.0, lt=1.0, description="of neighbouring segments")
    removal: Literal["nothing", "mean", "trend"] = Field(default="mean", description="from each segment")
    period: Quantity | None = Field(default=None, description="s; of a multisine")
    settle: Quantity = Field(default=0.0, description="s left out before a multisine, or at each stepped sine")
    steps: list[SineStepDocument] | None = Field(default=None, min_length=1, max_length=10_000)
    part: Window | None = Field(default=None, description="[t0, t1] in s; default: everything")
    band: Band | None = Field(default=None, description="the lines that are wanted; default: all")
    form: Literal["receptance", "mobility", "accelerance"] | None = Field(
        default=None, description="of a motion over a force; default: as it was measured"
    )
    corrections: dict[ChannelName, SensorResponse] | None = Field(
        default=None, max_length=51, description="channel -> what its sensor does"
    )
    confidence: float = Field(default=0.95, gt=0.0, lt=1.0, description="probability with which bands hold the truth")
    system: SystemRef | None = Field(default=None, description="a model to be held against the measurement")
    source: Port | None = Field(default=None, alias="from", description="with `system`: its input")
    target: Port | None = Field(default=None, alias="to", description="with `system`: its output")
    parameters: Overrides | None = Field(default=None, description="with `system`: values other than its own")
    between_samples: Between = Field(
        default="auto",
        description="with `system`: what the input does between its samples; the model answers from sample to sample then. "
        "auto: the way that fits best, band_limited with `form`",
    )
    modes: ModesRequest | None = Field(
        default=None, description="natural frequencies and damping ratios are wanted, too"
    )
    keep: bool = False

    @model_validator(mode="after")
    def _what_belongs_together(self) -> FrfRequest:
        for name, estimator in (("period", "multisine"), ("steps", "stepped_sine")):
            if (getattr(self, name) is not None) != (self.estimator == estimator):
                raise ValueError(f"must have {name} with the estimator {estimator}, and only with it")
        if self.estimator == "measured" and self.part is not None:
            raise ValueError("must have part only with an estimator that looks at a recording over time")
        model = (self.system is not None, self.source is not None, self.target is not None)
        if any(model) and not all(model):
            raise ValueError("must have system, from and to together")
        if self.system is None and self.parameters is not None:
            raise ValueError("must have parameters only with system")
        if self.form is not None and self.between_samples not in {"auto", "band_limited"}:
            raise ValueError(
                "must have between_samples band_limited (or auto) with form, which is of continuous motions"
            )
        if self.system is not None and isinstance(self.output, list) and len(self.output) > 1:
            raise ValueError("must have one output to be held against a system")
        return self


class DoubtReply(Reply):
    """A systematic error that the bands do not show; `frequency` in rad/s where it has a place."""

    kind: str
    detail: str
    frequency: Number = None


class BetweenErrorsReply(Reply):
    """What the input is taken to do between its samples, and the relative error (%) with each way that was tried."""

    chosen: Literal["hold", "linear", "band_limited"]
    tried: dict[str, Number]


class SimulatedReply(Reply):
    """The model on the same lines, and how far it is from the measurement (dB and rad, model against measurement)."""

    magnitude: Curve
    phase: Curve
    deviation_db: Curve
    phase_deviation: Curve
    median_deviation_db: Number
    worst_deviation_db: Number
    worst_frequency: Number
    relative_error_percent: Number
    within_percent: Number
    between_samples: BetweenErrorsReply


class FrfOutput(Reply):
    """One response over the input; phases unwrapped, rad; bounds hold the truth line by line."""

    unit: str
    response_unit: str
    magnitude: Curve
    phase: Curve
    real: Curve
    imag: Curve
    coherence: Curve | None
    magnitude_lower: Curve | None
    magnitude_upper: Curve | None
    phase_lower: Curve | None
    phase_upper: Curve | None
    doubts: list[DoubtReply]
    simulated: SimulatedReply | None = None


class ResidueReply(Reply):
    """A of A/(jω - λ) + A*/(jω - λ*)."""

    real: Number
    imag: Number


class ModeReply(Reply):
    """One mode: undamped natural frequency in rad/s and damping ratio, with the bounds of their confidence."""

    frequency: Number
    frequency_lower: Number
    frequency_upper: Number
    damping_ratio: Number
    damping_ratio_lower: Number
    damping_ratio_upper: Number
    residues: dict[str, ResidueReply]
    doubt: str


class ModesReply(Reply):
    """Modes by frequency, and the relative error of what they give on their lines.

    Lines that tell nothing are left out: no input is there, or noise hides the response. ``band`` (rad/s) holds the others.
    """

    modes: list[ModeReply]
    relative_error_percent: Number
    form: str | None
    band: list[Number]
    lines_left_out: int


class FrfReply(StudyReply):
    """Lines in rad/s, the same for every output."""

    dataset: str
    input: str
    input_unit: str
    estimator: str
    form: str | None
    frequency: Curve
    resolution: Number
    averages: int
    effective_averages: Number
    confidence: float
    window: AppliedWindow | None
    outputs: dict[str, FrfOutput]
    modes: ModesReply | None = None
