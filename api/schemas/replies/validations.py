"""Measured against simulated."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from api.schemas.replies.base import Curve, MetricReply, Number, Reply, StudyReply


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


class ResidualReply(Reply):
    """What the residuals still hold; `lags` of the cross-correlation in s, positive where the input came before."""

    white: bool
    ljung_box: Number
    ljung_box_limit: Number = Field(description="what white residuals stay below, with this confidence")
    independent: bool
    confidence: float
    lags: Curve
    autocorrelation: Curve
    autocorrelation_bound: Number
    cross_correlation: list[Curve]
    cross_correlation_bound: Curve


class OneStepReply(Reply):
    """How well the next sample is foretold from those before: never a measure of the model."""

    model: FitReply
    last_sample: FitReply = Field(description="the sample before, repeated")
    order: int


class PolarCurve(Reply):
    """Magnitude (ratio) and unwrapped phase (rad)."""

    magnitude: Curve
    phase: Curve


class BoundsReply(Reply):
    """What holds the truth of the measured response, line by line, with this probability."""

    confidence: float
    magnitude_lower: Curve
    magnitude_upper: Curve
    phase_lower: Curve
    phase_upper: Curve


class FrequencyDomainReply(Reply):
    """Measured and simulated frequency responses where the recording tells something; rad/s, deviations in dB."""

    input: str
    estimator: str
    averages: int
    lines: int = Field(description="whose coherence is at least 0.7, of an input that is there")
    lines_of: int
    frequency: Curve
    coherence: Curve | None
    measured: PolarCurve
    simulated: PolarCurve
    bounds: BoundsReply | None
    relative_error_percent: Number
    median_deviation: Number
    worst_deviation: Number
    worst_frequency: Number
    within_percent: Number = Field(description="lines at which the model lies within the bounds")
    unexplained_percent: Number = Field(
        description="relative error that linear models of this input leave, judged from the coherence (too large for steps)"
    )


class UnmodelledMode(Reply):
    """A resonance that the model does not have, or has elsewhere; rad/s."""

    frequency: Number
    damping_ratio: Number


class UnmodelledBand(Reply):
    """Where an input still explains a part of the residual; rad/s, SI.

    Noise makes one recording in a hundred look so.
    """

    input: str
    lower: Number
    upper: Number
    frequency: Number = Field(description="where that part is strongest")
    rms: Number = Field(description="of that part, in the unit of the output")
    share_percent: Number = Field(description="of that part in the power of the residual")
    relative_percent: Number = Field(description="of that part at `frequency`, beside the response of the model")
    mode: UnmodelledMode | None = Field(description="where the band has the shape of a resonance")


class ValidatedOutput(FitReply):
    """One output; its measures are those of a simulation."""

    measures: dict[str, MetricReply]
    worst_interval: Annotated[Curve, Field(min_length=2, max_length=2)]
    baselines: dict[str, FitReply]
    residuals: ResidualReply
    one_step_prediction: OneStepReply | None
    frequency_domain: FrequencyDomainReply | None = Field(
        description="null for several inputs, a short window, or where nothing is coherent"
    )
    frequency_by_input: dict[str, FrequencyDomainReply] = Field(
        description="of several inputs: for each, without what the others explain; empty for one"
    )
    unmodelled: list[UnmodelledBand] = Field(
        description="in which bands the residual still follows an input, the strongest first; hum of the mains does not"
    )
    offset: Number
    unit: str
    curves: ValidationCurves


class AdjustedParameter(Reply):
    """A parameter as the document has it and as it was given here."""

    parameter: str
    unit: str
    theoretical: Number
    adjusted: Number
    change_percent: Number
    lower95: Number
    upper95: Number
    theory_within: bool | None = Field(description="whether the theoretical value lies in the 95 % interval")


class AdjustedFit(Reply):
    """An output with the document's parameters and with the adjusted ones; null where the former has no finite answer."""

    theoretical: FitReply | None
    adjusted: FitReply


class AdjustmentReply(Reply):
    """Adjusted against theoretical parameters."""

    parameters: list[AdjustedParameter]
    outputs: dict[str, AdjustedFit]


class RemedyReply(Reply):
    """A cause of the error, and what would be left without it."""

    kind: Literal["offset", "gain", "delay", "saturation", "friction", "direction"]
    relative_error_percent: Number
    values: dict[str, Number]
    sentence: str


class StepReply(Reply):
    """Where one parameter would have to move.

    `relative_error_percent` is what a straight line promises for the whole step; `checked_percent`, where there is one, what
    a simulation has at `suggested`: the best of the whole step, its half and its quarter.
    """

    parameter: str
    unit: str
    value: Number
    suggested: Number
    change_percent: Number
    relative_error_percent: Number
    checked_percent: Number


class TogetherReply(Reply):
    """Where all parameters would move together; the numbers are those of a single step."""

    suggested: dict[str, Number]
    relative_error_percent: Number
    checked_percent: Number


class DiagnosisReply(Reply):
    """What would make the error smaller, the most helpful first; nothing is fitted again."""

    remedies: dict[str, list[RemedyReply]]
    parameters: list[StepReply]
    together: TogetherReply | None
    note: str


class BetweenReply(Reply):
    """What inputs are taken to do between their samples, and the fits with each way that was tried, output by output."""

    chosen: Literal["hold", "linear", "band_limited"]
    tried: dict[str, dict[str, FitReply]]


class ValidationReply(StudyReply):
    """Measured against simulated."""

    outputs: dict[str, ValidatedOutput]
    verdict: Literal["pass", "fail"]
    grade: Literal["best", "pass", "fail"] = Field(description="best: every relative error is at most 1 %")
    basis: Literal["simulation"]
    definitions: dict[str, str]
    limit_percent: float
    dataset: str
    identification: str | None
    adjustment: AdjustmentReply | None
    diagnosis: DiagnosisReply | None
    between_samples: BetweenReply | None = Field(
        description="null where the request says what every input does, or the identification has found it"
    )
    remarks: list[str]
    advice: str
