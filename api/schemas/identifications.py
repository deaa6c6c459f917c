"""What is identified, and how: parameters of a system, a model without one, a drive's friction, a static curve."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from api.schemas.jobs import Channels, Window
from api.schemas.queue import QueueDocument
from api.schemas.systems import SystemRef
from api.schemas.values import Band, Document, Identifier, Name, Overrides, Path, Quantity

Split = Annotated[
    float,
    Field(
        ge=0.0,
        le=1.0,
        description="first share of a recording, which estimates; the rest validates. 1 estimates with all of it, 0 only validates, "
        "which something else must estimate beside. estimation and validation go before it",
    ),
]
Outputs = Annotated[dict[Name, str], Field(min_length=1, max_length=50)]


class IdentifiedParameter(Document):
    """A parameter to estimate, with bounds and start where they are not those of the parameter itself."""

    parameter: Path
    lower: Quantity | None = None
    upper: Quantity | None = None
    start: Quantity | None = None
    scale: Literal["linear", "log"] = Field(
        default="linear", description="log: searched, and its interval, by its logarithm"
    )


def _path_or_document(value: Any) -> str:
    return "path" if isinstance(value, str) else "document"


_PARTS = {"split", "estimation", "validation"}
"""What says which part of a recording estimates and which validates; beside experiments it is about those that say nothing of it."""


ParameterChoice = Annotated[
    Annotated[Path, Tag("path")] | Annotated[IdentifiedParameter, Tag("document")], Discriminator(_path_or_document)
]


class IdentificationExperiment(Document):
    """One of several recordings, with what is known of it alone."""

    name: Name | None = Field(default=None, description="experiment_1, experiment_2 ... by default")
    dataset: Identifier
    inputs: Channels = Field(description="input port -> channel")
    outputs: Outputs = Field(description="output -> channel")
    parameters: Overrides = Field(
        default_factory=dict, description="parameters that had another value in this experiment: a current, a load"
    )
    split: Split = 0.5
    estimation: Window | None = None
    validation: Window | None = None


class FrequencyResponseExperiment(Document):
    """A measured frequency response that the model is compared with, line by line: of a recording, or one that was kept."""

    name: Name | None = Field(default=None, description="response_1, response_2 ... by default")
    frf: Identifier | None = Field(default=None, description="a kept result of /v1/frfs, in place of dataset")
    dataset: Identifier | None = None
    inputs: Annotated[Channels, Field(max_length=1)] = Field(
        description="input port -> channel; between_samples as for recordings: band_limited compares with G(jω), hold and "
        "linear from sample to sample"
    )
    outputs: Outputs = Field(description="output -> channel")
    parameters: Overrides = Field(
        default_factory=dict, description="parameters that had another value in this experiment: a current, a load"
    )
    estimator: Literal["H1", "H2", "Hv", "measured"] = Field(
        default="H1", description="measured: the responses that the dataset's file holds"
    )
    window: Literal["hann", "flat_top", "none"] = "hann"
    segment: Quantity | None = Field(default=None, description="s, of averaged segments; default as of /v1/frfs")
    overlap: float = Field(default=0.5, ge=0.0, lt=1.0, description="of neighbouring segments")
    removal: Literal["nothing", "mean", "trend"] = Field(default="mean", description="from each segment")
    part: Window | None = Field(default=None, description="[t0, t1] in s; default: everything")
    band: Band | None = Field(default=None, description="the lines that estimate; default: all that tell something")
    least_coherence: float = Field(
        default=0.5, ge=0.0, lt=1.0, description="lines below are left out, as are those that chance may have made"
    )
    weights: Literal["coherence", "equal"] = Field(
        default="coherence",
        description="coherence: each line by the standard deviation that coherence and averages give; equal: all alike",
    )

    @model_validator(mode="after")
    def _one_source(self) -> FrequencyResponseExperiment:
        if (self.frf is None) == (self.dataset is None):
            raise ValueError(f"must have dataset or frf, got {'neither' if self.frf is None else 'both'}")
        estimating = sorted({"estimator", "window", "segment", "overlap", "removal", "part"} & self.model_fields_set)
        if self.frf is not None and estimating:
            raise ValueError(f"must have {estimating[0]} with dataset only: frf was estimated already")
        return self


class IdentificationRequest(Document):
    """A model, what is measured where in one recording or several, and what is to be estimated."""

    method: Literal["grey_box"] = "grey_box"
    system: SystemRef
    dataset: Identifier | None = None
    inputs: Channels | None = Field(default=None, description="input port -> channel")
    outputs: Outputs | None = Field(default=None, description="output -> channel")
    experiments: Annotated[list[IdentificationExperiment], Field(min_length=1, max_length=200)] | None = Field(
        default=None, description="several recordings at once, in place of dataset, inputs and outputs"
    )
    frequency_responses: Annotated[list[FrequencyResponseExperiment], Field(min_length=1, max_length=200)] | None = (
        Field(default=None, description="measured frequency responses, beside recordings or in place of them")
    )
    parameters: list[ParameterChoice] = Field(min_length=1, max_length=50)
    split: Split = 0.5
    offsets: Literal["none", "estimate"] = "none"
    initial_states: Literal["rest", "estimate"] = Field(
        default="rest",
        description="rest: at rest under the first values of the inputs; estimate: unknown, in each recording",
    )
    estimation: Window | None = None
    validation: Window | None = None
    starts: int = Field(default=1, ge=1, le=100, description="the given start, then random ones")
    max_evaluations: int = Field(default=60, ge=1, le=10_000, description="simulations for each start")
    queue: QueueDocument | None = None

    @model_validator(mode="after")
    def _one_or_several(self) -> IdentificationRequest:
        alone = {"dataset": self.dataset, "inputs": self.inputs, "outputs": self.outputs}
        given = [name for name, value in alone.items() if value is not None]
        recorded = bool(given) or self.frequency_responses is None
        if self.experiments is None and recorded and len(given) < len(alone):
            missing = ", ".join(name for name in alone if name not in given)
            raise ValueError(
                f"must have dataset, inputs and outputs, or experiments, or frequency_responses; {missing} is missing"
            )
        if self.experiments is not None and given:
            raise ValueError(f"must have {given[0]} in each of its experiments, not beside them")
        for experiment in self.experiments or ():
            if not _PARTS & experiment.model_fields_set:
                for part in sorted(_PARTS & self.model_fields_set):
                    setattr(experiment, part, getattr(self, part))
        return self


class BlackBoxRequest(Document):
    """A recording from which a model is made that has no diagram yet."""

    method: Literal["subspace", "transfer_function"]
    dataset: Identifier
    inputs: Annotated[dict[Name, str], Field(min_length=1, max_length=20)] = Field(description="name -> channel")
    outputs: Annotated[dict[Name, str], Field(min_length=1, max_length=20)] = Field(description="name -> channel")
    orders: Annotated[list[Annotated[int, Field(ge=1, le=20)]], Field(min_length=1, max_length=20)] = Field(
        default=[1, 2, 3, 4, 5, 6], description="the validation chooses among them"
    )
    largest_delay: Quantity = Field(
        default=0.0,
        description="s, of a transfer function; the delays up to it are searched. By default none is: at 0 the model answers at once",
    )
    offsets: Literal["none", "estimate"] = "estimate"
    between_samples: Literal["hold", "linear"] = Field(
        default="linear",
        description="what the inputs do between their samples: the fits are the same, the model is not",
    )
    split: Split = 0.5
    estimation: Window | None = None
    validation: Window | None = None
    queue: QueueDocument | None = None


class InverseDynamicsRequest(Document):
    """A recording of a drive: mass, friction and offset by linear regression, F = M x'' + b x' + F_c sign x' + c + ..."""

    method: Literal["inverse_dynamics"]
    dataset: Identifier
    force: str = Field(description="channel of the force or torque")
    force_factor: float = Field(
        default=1.0, description="what the channel is multiplied by, in SI: N/V of an amplifier"
    )
    position: str | None = Field(default=None, description="channel; this or velocity")
    velocity: str | None = Field(default=None, description="channel; this or position")
    further: Annotated[dict[Name, str], Field(max_length=10)] = Field(
        default_factory=dict, description="other signals that the force is linear in: coefficient -> channel"
    )
    low_pass: Quantity | None = Field(default=None, description="rad/s, on the motion, forward and backward")
    order: int = Field(default=4, ge=1, le=20)
    decimation: int = Field(default=1, ge=1, le=100)
    dropped: int = Field(default=0, ge=0, description="samples left out at the beginning")
    least_velocity: float = Field(default=0.0, ge=0.0, description="slower samples are left out, SI")
    transition_velocity: float = Field(
        default=0.0, ge=0.0, description="dry friction as tanh of velocity over this, SI; 0: as its sign"
    )
    asymmetric: bool = Field(default=False, description="friction of its own in each direction, in place of the offset")
    inertia: bool = True
    viscous: bool = True
    queue: QueueDocument | None = None


class StaticCurveRequest(Document):
    """A recording through whose pairs of samples a polynomial is drawn."""

    method: Literal["static_curve"]
    dataset: Identifier
    input: str = Field(description="channel")
    output: str = Field(description="channel")
    degree: int | None = Field(default=None, ge=0, le=9, description="chosen by validation by default")
    queue: QueueDocument | None = None


DirectRequest = BlackBoxRequest | InverseDynamicsRequest | StaticCurveRequest
"""Identifications that need no system document."""


def _method(value: Any) -> str:
    method = value.get("method", "grey_box") if isinstance(value, dict) else getattr(value, "method", "grey_box")
    return "black_box" if method in {"subspace", "transfer_function"} else str(method)


AnyIdentification = Annotated[
    Annotated[IdentificationRequest, Tag("grey_box")]
    | Annotated[BlackBoxRequest, Tag("black_box")]
    | Annotated[InverseDynamicsRequest, Tag("inverse_dynamics")]
    | Annotated[StaticCurveRequest, Tag("static_curve")],
    Discriminator(
        _method,
        custom_error_type="method",
        custom_error_message="must be grey_box, subspace, transfer_function, inverse_dynamics or static_curve",
    ),
]
