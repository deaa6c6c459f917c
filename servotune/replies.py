"""The service's replies, typed: what `client` returns are plain dictionaries with these keys, SI units throughout."""

from __future__ import annotations

from typing import Any, NotRequired, Required, TypedDict


class Metric(TypedDict):
    """One measured quantity; `value` is None where the verdict says that there is none."""

    value: float | None
    unit: str
    verdict: str
    advice: NotRequired[str | None]
    at: NotRequired[float | None]


class Warned(TypedDict):
    """One warning and the place of the document that it is about."""

    pointer: str
    detail: str


class Stored(TypedDict):
    """A stored system document and which revision it is."""

    id: str
    revision: int
    created_at: str
    document: dict[str, Any]


class StateSpace(TypedDict):
    """A realised system: A, B, C, D without delays; A, B1 to D22 with them."""

    system: dict[str, Any]
    open_at: str | None
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


class Harmonics(TypedDict):
    """Amplitudes and phases (rad, cosines at t = 0) of the orders 1, 2, ... of a fundamental (rad/s)."""

    fundamental: float
    mean: float
    amplitude: list[float]
    phase: list[float]
    thd: float | None
    unit: str


class BandEnergy(TypedDict):
    """Energy or mean square in a band."""

    value: float
    unit: str


class SpectrumVariant(TypedDict):
    """The spectrum for one set of parameter values; frequencies in rad/s."""

    parameters: dict[str, float]
    verdict: str
    advice: NotRequired[str | None]
    frequency: list[float]
    value: list[float]
    phase: NotRequired[list[float] | None]
    resolution: NotRequired[float | None]
    averages: NotRequired[int | None]
    harmonics: NotRequired[Harmonics | None]
    band: NotRequired[BandEnergy | None]


class Spectrum(TypedDict):
    """Spectra, their common unit, and the window of estimates."""

    quantity: str
    unit: str
    window: dict[str, Any] | None
    variants: list[SpectrumVariant]
    system: dict[str, Any] | None
    warnings: list[Warned]


class PredictedCycle(TypedDict):
    """A limit cycle (rad/s) by the describing function of one block; ``amplitude`` is that at the block's input."""

    block: str
    frequency: float
    amplitude: float
    outputs: dict[str, float]
    stable: bool


class LimitCycle(TypedDict):
    """What a response swings in for ever (rad/s, amplitudes of the fundamental), beside what is predicted."""

    frequency: float
    outputs: dict[str, float]
    predictions: list[PredictedCycle]


class OperatingPoint(TypedDict):
    """Where a nonlinear system is linearised (SI)."""

    inputs: dict[str, float]
    outputs: dict[str, float]
    rests: bool


class SimulationVariant(TypedDict):
    """The responses of one set of parameter values."""

    parameters: dict[str, float]
    verdict: str
    time: list[float]
    outputs: dict[str, list[float]]
    metrics: dict[str, dict[str, Metric]]
    error_estimate: NotRequired[float | None]
    limit_cycle: NotRequired[LimitCycle | None]


class Simulation(TypedDict):
    """Responses to a command."""

    variants: list[SimulationVariant]
    warnings: NotRequired[list[Warned]]


class Crossing(TypedDict):
    """One crossing of the open loop and the margin there."""

    frequency: float
    value: float


class Margins(TypedDict):
    """Every crossing of the open loop where its gain is `smallest_loop_gain` or more."""

    gain: list[Crossing]
    phase: list[Crossing]
    delay: list[Crossing]
    smallest_loop_gain: float


class Nyquist(TypedDict):
    """The Nyquist criterion: closed-loop unstable poles = open-loop unstable poles - encirclements of -1."""

    encirclements: int
    open_loop_unstable_poles: int
    closed_loop_unstable_poles: int


class Root(TypedDict):
    """A complex number (rad/s)."""

    real: float
    imag: float


class FrequencyVariant(TypedDict):
    """The frequency response of one set of parameter values (rad/s, rad)."""

    parameters: dict[str, float]
    verdict: str
    frequency: list[float]
    magnitude: list[float]
    phase: list[float]
    real: list[float]
    imag: list[float]
    metrics: dict[str, Metric]
    margins: NotRequired[Margins | None]
    nyquist: NotRequired[Nyquist | None]
    poles: list[Root]
    operating_point: NotRequired[OperatingPoint | None]
    limit_cycles: NotRequired[list[PredictedCycle] | None]


class FrequencyResponse(TypedDict):
    """Frequency responses."""

    variants: list[FrequencyVariant]
    warnings: NotRequired[list[Warned]]


class Elasticity(TypedDict):
    """Relative change of a metric per relative change of a parameter, in the limit."""

    value: float | None
    one_sided: bool
    verdict: str
    method: NotRequired[str]
    error: NotRequired[float | None]


class Coefficient(TypedDict):
    """Influence coefficient of eq. (4) at a finite relative change."""

    value: float | None
    change: float
    initial: float | None
    final: float | None
    verdict: str


class Strongest(TypedDict):
    """The largest elasticity of each row and column."""

    by_parameter: dict[str, str]
    by_metric: dict[str, str]


class Change(TypedDict):
    """A parameter before and after (SI)."""

    initial: float
    final: float


class PredictedMetric(TypedDict):
    """A metric as its derivatives predict it, by the power law M Π (p'/p)^E or on the straight line, and as it is."""

    value: float | None
    law: str
    straight: float | None
    exact: Metric
    error: float | None
    relative_error: float | None
    verdict: str


class Prediction(TypedDict):
    """One set of changes and what it does."""

    changes: dict[str, Change]
    metrics: dict[str, PredictedMetric]


class Influence(TypedDict):
    """How strongly parameters move metrics; `elasticities[metric][parameter]`."""

    base: dict[str, Metric]
    elasticities: dict[str, dict[str, Elasticity]]
    coefficients: dict[str, dict[str, Coefficient]]
    strongest: Strongest
    predictions: NotRequired[list[Prediction] | None]
    warnings: NotRequired[list[Warned]]


class Fit(TypedDict):
    """How well simulated values follow measured ones (%)."""

    fit_percent: float
    relative_error_percent: float
    vaf_percent: float
    nrmse_percent: float


class Estimate(TypedDict):
    """An estimated parameter with its 95 % confidence interval."""

    value: float
    unit: str
    lower95: float | None
    upper95: float | None
    start: float | None


class FitReport(TypedDict):
    """Fits on the part that estimated and on the part that did not, beside trivial models."""

    estimation: dict[str, Fit]
    validation: dict[str, Fit]
    baselines: dict[str, Any]


class Identification(TypedDict):
    """The result of an identification."""

    parameters: dict[str, Estimate]
    offsets: dict[str, Any]
    correlations: list[list[float]]
    indistinguishable: list[str]
    fit: FitReport
    residuals: dict[str, Any]
    status: str
    advice: str


class MeasuredCurves(TypedDict):
    """Measured and simulated values over time (s)."""

    time: list[float]
    measured: list[float]
    simulated: list[float]


class OutputValidation(Fit):
    """How one output compares with its recording."""

    worst_interval: list[float]
    baselines: dict[str, Any]
    curves: MeasuredCurves


class Validation(TypedDict):
    """Measured against simulated, and the verdict."""

    outputs: dict[str, OutputValidation]
    verdict: str


class GoalResult(TypedDict):
    """A goal before and after an optimisation."""

    metric: str
    experiment: NotRequired[str | None]
    output: NotRequired[str | None]
    before: Metric
    after: Metric
    met: bool
    active: bool
    multiplier: float | None
    hard: NotRequired[bool]
    score: NotRequired[float | None]
    scenario: NotRequired[int]
    elasticities: NotRequired[dict[str, float | None]]


class CertifiedGoal(TypedDict):
    """A goal at the optimum, computed exactly."""

    goal: int
    value: float | None
    violation: float | None
    independent: NotRequired[float | None]
    scenario: int
    at: dict[str, float] | None


class Certificate(TypedDict):
    """The optimum, measured again by the exact engine and by a second way of its own; the worse of both counts."""

    valid: bool
    worst_violation: float | None
    goals: list[CertifiedGoal]


class Evaluated(TypedDict):
    """One point of the convergence history."""

    evaluation: int
    objective: float | None
    violation: float | None
    variables: NotRequired[dict[str, float]]


class Map(TypedDict):
    """Objective and violation over a grid, row-major with the first variable slowest."""

    axes: dict[str, list[float]]
    objective: list[float | None]
    violation: list[float | None]


class FrontPoint(TypedDict):
    """A point of a front: its variables, and every goal there."""

    parameters: dict[str, float]
    goals: list[Metric]


class CrossCheck(TypedDict):
    """What another method reached; `gap` is relative to the size of the objective, positive where it is worse."""

    method: str
    status: str
    objective: float | None
    violation: float | None
    gap: float | None
    best: dict[str, float]


class Share(TypedDict):
    """The share of draws that meet every goal, with its 95 % interval."""

    share: float
    lower95: float
    upper95: float
    samples: int
    unstable: int
    failures: list[dict[str, int]]


class Alternative(TypedDict):
    """How the optimisation of one structure ended."""

    name: str
    status: str
    advice: str
    best: dict[str, float]
    objective: float | None
    goals: list[GoalResult]
    certificate: Certificate


# Made from a dictionary because one of its keys, yield, is a word of the language.
_Extras = TypedDict(
    "_Extras",
    {
        "objective": float | None,
        "bound": float | None,
        "conflict": list[dict[str, Any]],
        "front": list[FrontPoint],
        "hypervolume": float | None,
        "knee": int,
        "ideal": list[float | None],
        "nadir": list[float | None],
        "cross_check": list[CrossCheck],
        "robustness": dict[str, Any],
        "yield": Share,
        "alternatives": list[Alternative],
        "chosen": str,
    },
    total=False,
)


class Optimization(_Extras):
    """The result of an optimisation."""

    status: str
    advice: str
    best: dict[str, float]
    goals: list[GoalResult]
    certificate: Certificate
    curves: dict[str, Any]
    elasticities: dict[str, Any]
    history: list[Evaluated]
    evaluations: int
    seconds: float
    map: NotRequired[Map | None]
    system: dict[str, Any]


class Dataset(TypedDict, total=False):
    """A recording."""

    id: Required[str]
    status: Required[str]
    name: str
    format: str
    channels: list[dict[str, Any]]
    sample_rate: float
    samples: int


class ChannelData(TypedDict, total=False):
    """Samples of a channel; with fewer `points` than samples, the smallest and largest value of each piece instead."""

    unit: Required[str]
    time: Required[list[float]]
    values: list[float]
    min: list[float]
    max: list[float]


class JobState(TypedDict):
    """What the service knows about a job."""

    id: str
    kind: str
    status: str
    progress: float
    message: NotRequired[str | None]
    created_at: NotRequired[str | None]
    started_at: NotRequired[str | None]
    finished_at: NotRequired[str | None]
    result: NotRequired[str | None]
    error: NotRequired[dict[str, Any] | None]
