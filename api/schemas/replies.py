"""The replies, for the API reference and the contract tests; services make them as plain documents."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field

Item = TypeVar("Item")
Number = float | None
Curve = list[Number]


class Reply(BaseModel):
    """Base of every reply; replies may grow fields."""

    model_config = ConfigDict(extra="allow")


class Page(Reply, Generic[Item]):
    """One page of a list; `next_cursor` is null on the last one."""

    items: list[Item]
    next_cursor: str | None


class FaultReply(Reply):
    """One thing that is wrong in the request body."""

    pointer: str = Field(examples=["/system/blocks/motor/area"])
    detail: str


class ProblemReply(Reply):
    """RFC 9457 problem document."""

    type: str
    title: str
    status: int
    detail: str
    errors: list[FaultReply] = Field(default_factory=list)


class WarningReply(Reply):
    """Something in the document that is allowed and probably not meant."""

    pointer: str
    detail: str


class SystemReference(Reply):
    """The stored revision that was used."""

    id: str
    revision: int


VerdictWord = Literal[
    "ok", "unstable", "marginal", "integrating", "not_settled", "never_crosses", "zero_static_gain",
    "not_oscillatory", "diverges", "ill_posed", "discontinuous", "zero_base", "not_applicable", "too_short", "doubtful",
]  # fmt: skip


class MetricReply(Reply):
    """A metric; without a value the verdict says why, and `advice` what to do."""

    value: Number
    unit: str
    verdict: VerdictWord
    advice: str | None = None


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

    system: SystemReference
    open_at: str | None
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
    warnings: list[WarningReply]


class StudyReply(Reply):
    """What every study says beside its numbers."""

    id: str | None = Field(default=None, description="under /v1/results, when it was asked to be kept")
    system: SystemReference | None
    warnings: list[WarningReply]


class PredictedCycleReply(Reply):
    """A limit cycle by the describing function of one block; one that is not stable parts what dies from what grows."""

    block: str
    frequency: Number = Field(description="rad/s")
    amplitude: Number = Field(description="of the fundamental at the block's input")
    outputs: dict[str, Number] = Field(description="amplitude of each output's fundamental")
    stable: bool


class LimitCycleReply(Reply):
    """What a response swings in for ever, beside what describing functions predict."""

    frequency: Number = Field(description="rad/s")
    outputs: dict[str, Number] = Field(description="amplitude of each output's fundamental")
    predictions: list[PredictedCycleReply]


class OperatingPointReply(Reply):
    """Where a nonlinear system is linearised; where it does not rest, at its initial state."""

    inputs: dict[str, Number]
    outputs: dict[str, Number]
    rests: bool


class SimulationVariant(Reply):
    """One set of parameters."""

    parameters: dict[str, Any]
    time: Curve
    outputs: dict[str, Curve]
    metrics: dict[str, dict[str, MetricReply]]
    verdict: VerdictWord
    error_estimate: float | None = Field(
        default=None,
        description="of the curves of a nonlinear system, relative to their largest values; null: exact to rounding",
    )
    limit_cycle: LimitCycleReply | None = Field(
        default=None, description="where a nonlinear response to commands that settle does not"
    )


class SimulationReply(StudyReply):
    """Curves and metrics."""

    variants: list[SimulationVariant]


class Crossing(Reply):
    """A margin and where it is."""

    frequency: Number
    value: Number


class Margins(Reply):
    """Every crossing of the loop where its gain is ``smallest_loop_gain`` or more."""

    gain: list[Crossing]
    phase: list[Crossing]
    delay: list[Crossing]
    smallest_loop_gain: Number = None


class NyquistReply(Reply):
    """The Nyquist criterion: closed-loop unstable poles = open-loop unstable poles - encirclements of -1."""

    encirclements: int
    open_loop_unstable_poles: int
    closed_loop_unstable_poles: int


class Pole(Reply):
    """A pole in rad/s."""

    real: Number
    imag: Number


class FrequencyVariant(Reply):
    """One set of parameters."""

    parameters: dict[str, Any]
    verdict: VerdictWord
    frequency: Curve
    magnitude: Curve
    phase: Curve
    real: Curve
    imag: Curve
    metrics: dict[str, MetricReply]
    margins: Margins | None = None
    nyquist: NyquistReply | None = None
    poles: list[Pole]
    operating_point: OperatingPointReply | None = Field(default=None, description="of a nonlinear system")
    limit_cycles: list[PredictedCycleReply] | None = Field(
        default=None, description="of a nonlinear system with `open_at`: what describing functions predict"
    )


class FrequencyReply(StudyReply):
    """Bode and Nyquist data, metrics and margins."""

    variants: list[FrequencyVariant]


class ElasticityReply(Reply):
    """d ln(metric) / d ln(parameter)."""

    value: Number
    one_sided: bool
    verdict: VerdictWord
    method: Literal["exact", "differences"] = Field(
        default="exact", description="carried through the whole computation, or from differences that converge"
    )
    error: Number = Field(default=None, description="what a value from differences is estimated to miss")


class CoefficientReply(Reply):
    """Eq. (4) at a finite change."""

    value: Number
    change: Number
    initial: Number
    final: Number
    verdict: VerdictWord


class Strongest(Reply):
    """By |elasticity|."""

    by_parameter: dict[str, str | None]
    by_metric: dict[str, str | None]


class ChangeReply(Reply):
    """A parameter before and after, in SI."""

    initial: Number
    final: Number


class PredictedMetric(Reply):
    """A metric as its derivatives predict it: by the power law M Π (p'/p)^E, or on the straight line."""

    value: Number
    law: Literal["power", "straight"]
    straight: Number
    exact: MetricReply
    error: Number
    relative_error: Number
    verdict: VerdictWord


class PredictionReply(Reply):
    """One set of changes and what it does."""

    changes: dict[str, ChangeReply]
    metrics: dict[str, PredictedMetric]


class InfluenceReply(StudyReply):
    """Elasticities and influence coefficients; predictions where changes were named."""

    base: dict[str, MetricReply]
    elasticities: dict[str, dict[str, ElasticityReply]]
    coefficients: dict[str, dict[str, CoefficientReply]]
    strongest: Strongest
    predictions: list[PredictionReply] | None = None


class FitReply(Reply):
    """Fit measures in percent; null where one does not exist."""

    fit_percent: Number
    relative_error_percent: Number
    vaf_percent: Number
    nrmse_percent: Number


class ValidationCurves(Reply):
    """Measured and simulated, SI."""

    time: Curve
    measured: Curve
    simulated: Curve


class ValidatedOutput(FitReply):
    """One output."""

    worst_interval: Annotated[Curve, Field(min_length=2, max_length=2)]
    baselines: dict[str, FitReply]
    offset: Number
    unit: str
    curves: ValidationCurves


class ValidationReply(StudyReply):
    """Measured against simulated."""

    outputs: dict[str, ValidatedOutput]
    verdict: Literal["pass", "fail"]
    limit_percent: float
    dataset: str


class JobReply(Reply):
    """Long work and how far it is."""

    id: str
    kind: str
    status: Literal["queued", "running", "succeeded", "failed", "cancelled"]
    progress: float
    message: str
    created_at: datetime
    started_at: datetime | None
    finished_at: datetime | None
    result: str | None
    error: dict[str, Any] | None
    schedule: str | None = Field(default=None, description="id of the schedule that asked for it")
    system: SystemReference | None
    warnings: list[WarningReply]


class ResultHead(Reply):
    """A kept result as it is listed."""

    id: str
    kind: str
    created_at: datetime
    system: SystemReference | None
    versions: dict[str, str]


class KeptResult(ResultHead):
    """A kept result: the reply as it was given, and the request."""

    request: dict[str, Any] | None
    result: dict[str, Any]


class DatasetHead(Reply):
    """A recording as it is listed."""

    id: str
    name: str
    format: str
    status: Literal["open", "parsing", "ready", "failed"]
    created_at: datetime
    start_time: datetime | None


class DatasetReply(DatasetHead):
    """A recording without its samples."""

    revision: int
    document: dict[str, Any] | None
    sample_rate: Number
    sample_count: int | None
    duration: Number
    channels: list[dict[str, Any]]
    size: int | None
    sha256: str | None
    error: dict[str, Any] | None
    job: JobReply | None = None


class SegmentReply(Reply):
    """A segment that is there."""

    sha256: str
    size: int


class ChannelReply(Reply):
    """A stretch of a channel: `values`, or `min` and `max` of consecutive stretches."""

    unit: str
    sample_rate: float
    time: Curve
    values: Curve | None = None
    min: Curve | None = None
    max: Curve | None = None


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


class Health(Reply):
    """The process is alive."""

    status: Literal["ok"]


class Readiness(Reply):
    """Whether the service can work, and what was checked."""

    status: Literal["ready", "not ready"]
    checks: dict[str, str]
