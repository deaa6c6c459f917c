"""Responses in time and over frequency."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, cast

from servotune import plots, tables
from servotune.replies.base import Reply
from servotune.replies.cycles import LimitCycle, OperatingPoint, PredictedCycle
from servotune.replies.values import Metric, Root, Warned
from servotune.replies.variants import OfVariants

if TYPE_CHECKING:
    import pandas as pd
    import xarray
    from matplotlib.axes import Axes


class SimulationVariant(Reply):
    """The responses of one set of parameter values."""

    parameters: dict[str, float]
    verdict: str
    time: list[float]
    outputs: dict[str, list[float]]
    metrics: dict[str, dict[str, Metric]]
    error_estimate: float | None
    limit_cycle: LimitCycle | None

    def unit_of(self, output: str) -> str:
        """Return the SI unit of an output as its metrics tell it, "" where they do not."""
        peak = self.metrics.get(output, {}).get("peak")
        return peak.unit if peak is not None else ""

    def to_pandas(self) -> pd.DataFrame:
        """Return the outputs over time (s)."""
        return tables.frame("time", "s", self.time, self.outputs)

    def metrics_to_pandas(self) -> pd.DataFrame:
        """Return value, unit and verdict of each output and metric."""
        return tables.metrics_frame(self.metrics)

    def summary(self) -> str:
        """Return what is told of it in a line."""
        until = f"{len(self.time)} samples to {self.time[-1]:.4g} s" if self.time else "no curves"
        return f"{self.verdict}, {', '.join(self.outputs)}: {until}, {sum(map(len, self.metrics.values()))} metrics"

    def table(self) -> Iterator[tuple[str, str]]:
        """Yield names and texts of what a notebook shows."""
        for output, metrics in self.metrics.items():
            for name, metric in metrics.items():
                yield f"{output}: {name}", f"{metric}"


class Simulation(OfVariants):
    """Responses to a command."""

    variants: list[SimulationVariant]
    warnings: list[Warned] | None

    @property
    def _only(self) -> SimulationVariant:
        return cast("SimulationVariant", self.only())

    @property
    def metrics(self) -> dict[str, dict[str, Metric]]:
        """The metrics by output and name, of a reply with one variant."""
        return self._only.metrics

    @property
    def time(self) -> list[float]:
        """The instants of the curves (s), of a reply with one variant."""
        return self._only.time

    @property
    def outputs(self) -> dict[str, list[float]]:
        """The curves by output, of a reply with one variant."""
        return self._only.outputs

    def to_pandas(self) -> pd.DataFrame:
        """Return the outputs over time (s); of several variants their numbers are the first level of the index."""
        return tables.stacked(self.variants, SimulationVariant.to_pandas)

    def metrics_to_pandas(self) -> pd.DataFrame:
        """Return value, unit and verdict of each output and metric; of several variants their numbers come first."""
        return tables.stacked(self.variants, SimulationVariant.metrics_to_pandas)

    def to_xarray(self) -> xarray.Dataset:
        """Return the outputs over time, and over the variants where there are several."""
        units = {output: self.variants[0].unit_of(output) for output in self.variants[0].outputs}
        return tables.dataset(self.to_pandas(), units)

    def plot(self, axes: list[Axes] | None = None) -> list[Axes]:
        """Draw the outputs over time."""
        return plots.responses(self, axes)


class Crossing(Reply):
    """One crossing of the open loop and the margin there."""

    frequency: float
    value: float


class Margins(Reply):
    """Every crossing of the open loop where its gain is `smallest_loop_gain` or more."""

    gain: list[Crossing]
    phase: list[Crossing]
    delay: list[Crossing]
    smallest_loop_gain: float


class Nyquist(Reply):
    """The Nyquist criterion: closed-loop unstable poles = open-loop unstable poles - encirclements of -1."""

    encirclements: int
    open_loop_unstable_poles: int
    closed_loop_unstable_poles: int


class Unbounded(Reply):
    """A frequency at which the response is null, since it meets a pole on the imaginary axis."""

    frequency: float
    verdict: str
    advice: str


class FrequencyPath(Reply):
    """One of several paths of a frequency response; `zeros` is null where delays make them endless."""

    from_: str
    to: str
    frequency: list[float]
    magnitude: list[float | None]
    phase: list[float | None]
    real: list[float | None]
    imag: list[float | None]
    metrics: dict[str, Metric]
    zeros: list[Root] | None
    unbounded: list[Unbounded] | None


class FrequencyVariant(Reply):
    """The frequency response of one set of parameter values (rad/s, rad)."""

    parameters: dict[str, float]
    verdict: str
    frequency: list[float]
    magnitude: list[float | None]
    phase: list[float | None]
    real: list[float | None]
    imag: list[float | None]
    metrics: dict[str, Metric]
    margins: Margins | None
    nyquist: Nyquist | None
    poles: list[Root]
    zeros: list[Root] | None
    paths: list[FrequencyPath] | None
    unbounded: list[Unbounded] | None
    operating_point: OperatingPoint | None
    limit_cycles: list[PredictedCycle] | None

    def to_pandas(self) -> pd.DataFrame:
        """Return magnitude and phase (rad) over the frequency (rad/s)."""
        curves = {"magnitude": self.magnitude, "phase": self.phase, "real": self.real, "imag": self.imag}
        return tables.frame("frequency", "rad/s", self.frequency, curves)

    def summary(self) -> str:
        """Return what is told of it in a line."""
        return f"{self.verdict}, {len(self.frequency)} frequencies, {len(self.metrics)} metrics"

    def table(self) -> Iterator[tuple[str, str]]:
        """Yield names and texts of what a notebook shows."""
        for name, metric in self.metrics.items():
            yield name, f"{metric}"


class FrequencyResponse(OfVariants):
    """Frequency responses."""

    variants: list[FrequencyVariant]
    warnings: list[Warned] | None

    @property
    def metrics(self) -> dict[str, Metric]:
        """The metrics by name, of a reply with one variant."""
        return cast("FrequencyVariant", self.only()).metrics

    def to_pandas(self) -> pd.DataFrame:
        """Return magnitude and phase (rad) over the frequency (rad/s); of several variants their numbers come first."""
        return tables.stacked(self.variants, FrequencyVariant.to_pandas)

    def to_xarray(self) -> xarray.Dataset:
        """Return magnitude and phase (rad) over the frequency, and over the variants where there are several."""
        return tables.dataset(self.to_pandas(), {"phase": "rad"})

    def plot(self, kind: str = "bode", axes: list[Axes] | None = None) -> list[Axes]:
        """Draw the Bode plot, or with ``kind="nyquist"`` that of Nyquist."""
        drawn = {"bode": plots.bode, "nyquist": plots.nyquist}
        if kind not in drawn:
            raise ValueError(f"kind must be one of {', '.join(drawn)}, got {kind!r}")
        return drawn[kind](self, axes)
