"""Systems beside recordings: identification and validation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from servotune import plots, tables
from servotune.replies.base import Reply

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


class Fit(Reply):
    """How well simulated values follow measured ones (%)."""

    fit_percent: float
    relative_error_percent: float
    vaf_percent: float
    nrmse_percent: float


class Estimate(Reply):
    """An estimated parameter with its 95 % confidence interval."""

    value: float
    unit: str
    lower95: float | None
    upper95: float | None
    start: float | None


class FitReport(Reply):
    """Fits on the part that estimated and on the part that did not, beside trivial models."""

    estimation: dict[str, Fit]
    validation: dict[str, Fit]
    baselines: dict[str, Any]


class Identification(Reply):
    """The result of an identification."""

    parameters: dict[str, Estimate]
    offsets: dict[str, Any]
    correlations: list[list[float]]
    indistinguishable: list[str]
    fit: FitReport
    one_step_prediction: dict[str, Fit]
    experiments: list[dict[str, Any]]
    frequency_responses: list[dict[str, Any]]
    residuals: dict[str, Any]
    between_samples: dict[str, Any] | None
    warnings: list[dict[str, str]]
    status: str
    advice: str

    def to_pandas(self) -> pd.DataFrame:
        """Return value, unit and 95 % interval of each parameter."""
        return tables.estimates(self.parameters)


class BlackBox(Reply):
    """A model without a diagram: its order, every order tried, its simulation fits, and itself as a system document."""

    order: int
    delay: float
    poles: list[list[float]]
    tried: list[dict[str, Any]]
    offsets: dict[str, float]
    fit: FitReport
    one_step_prediction: dict[str, Fit]
    document: dict[str, Any]


class DriveParameters(Reply):
    """Mass, friction and offset of a drive, and the error of the equation of forces: no simulation."""

    parameters: dict[str, Estimate]
    correlations: list[list[float]]
    indistinguishable: list[str]
    equation_error: Fit
    samples: int

    def to_pandas(self) -> pd.DataFrame:
        """Return value, unit and 95 % interval of each parameter."""
        return tables.estimates(self.parameters)


class StaticCurve(Reply):
    """A polynomial in (u - center)/scale, its fit, and itself as a lookup table in a system document."""

    degree: int
    center: float
    scale: float
    coefficients: list[float]
    tried: list[dict[str, Any]]
    static_fit: Fit
    document: dict[str, Any]


class MeasuredCurves(Reply):
    """Measured and simulated values over time (s)."""

    time: list[float]
    measured: list[float]
    simulated: list[float]


class OneStepPrediction(Reply):
    """How well the next sample is foretold from those before: never a measure of the model."""

    model: Fit
    last_sample: Fit
    order: int


class OutputValidation(Fit):
    """How one output compares with its recording; the measures are those of a simulation."""

    worst_interval: list[float]
    baselines: dict[str, Any]
    residuals: dict[str, Any]
    one_step_prediction: OneStepPrediction | None
    frequency_domain: dict[str, Any] | None
    frequency_by_input: dict[str, dict[str, Any]]
    offset: float
    unit: str
    curves: MeasuredCurves


class Validation(Reply):
    """Measured against simulated, the verdict, and what to try if it fails."""

    outputs: dict[str, OutputValidation]
    verdict: str
    grade: str
    adjustment: dict[str, Any] | None
    diagnosis: dict[str, Any] | None
    between_samples: dict[str, Any] | None
    remarks: list[str]
    advice: str

    def to_pandas(self) -> pd.DataFrame:
        """Return measured and simulated values over time (s), a pair of columns for each output."""
        return tables.side_by_side({name: output.curves for name, output in self.outputs.items()})

    def plot(self, axes: list[Axes] | None = None) -> list[Axes]:
        """Draw measured and simulated values over time."""
        return plots.validation(self, axes)
