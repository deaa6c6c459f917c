"""What an identification says: estimates with their intervals, fits by name, and what the recordings cannot tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from engine.model.between_samples import BetweenSamples
from engine.recordings.fit import Fit, ResidualTests
from optimizers.search.result import Status

Samples = npt.NDArray[np.float64]
Fits = Mapping[str, Fit]


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A parameter (SI) with its 95 % interval within its bounds; None where nothing limits it."""

    value: float
    unit: str
    lower95: float | None
    upper95: float | None
    start: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """How the model stands to one experiment.

    Attributes
    ----------
    offsets : mapping of output to float
        Empty unless they were estimated.
    initial_state : ndarray, shape (states,)
        How far the state at the beginning was from rest, in the order of the system's state space; empty unless estimated.
    estimation, validation : mapping of output to Fit
        Simulation fits in either window; empty without it.
    one_step : mapping of output to Fit
        Fits of the one-step prediction in the validation window (the estimation window without one): the simulation plus
        what an autoregression makes of the errors just measured. It is no simulation, and always looks better.
    residuals : mapping of output to ResidualTests
        In the estimation window.
    """

    name: str
    offsets: Mapping[str, float]
    initial_state: Samples
    estimation: Fits
    validation: Fits
    one_step: Fits
    residuals: Mapping[str, ResidualTests]


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedResponse:
    """How the model stands to one measured frequency response.

    Attributes
    ----------
    fit_percent, relative_error_percent : float or None
        100 (1 - ||H - G|| / ||H - mean H||) and 100 ||H - G|| / ||H|| in the complex plane, each line alike.
    lines, lines_left_out : int
    band : (float, float)
        Of the lines that were used, rad/s.
    scatter, scatter_limit : float or None
        Mean square of the errors over their standard deviations, and what it seldom exceeds where the model is
        right; None where nothing tells the deviations.
    white : bool or None
        Whether errors of lines that share no window are independent; None for too few lines.
    """

    fit_percent: float | None
    relative_error_percent: float | None
    lines: int
    lines_left_out: int
    band: tuple[float, float]
    scatter: float | None
    scatter_limit: float | None
    white: bool | None


@dataclass(frozen=True, slots=True, kw_only=True)
class BetweenTried:
    """What the parameters come to with one way of inputs between their samples.

    ``fit_percent`` is 100 (1 - ||y - ŷ|| / ||y - mean y||) in the estimation windows, all outputs together; ``values`` are
    those of the parameters (SI). None where the model has no bounded response.
    """

    fit_percent: float | None
    values: Mapping[str, float] | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Identified:
    """Everything that a user needs to judge an identification.

    Attributes
    ----------
    correlations : ndarray, shape (parameters, parameters)
        Of the estimates, in the order of the parameters.
    indistinguishable : tuple of str
        Sentences on what the recordings cannot tell apart, or cannot tell at all.
    estimation, validation : mapping of output to Fit
        Simulation fits of the same model, offsets included, over all experiments together; empty without such windows.
    one_step : mapping of output to Fit
        Fits of the one-step prediction where the validation is (the estimation without one).
    baselines : mapping of baseline to mapping of output to Fit
        What models without dynamics reach where the validation is (the estimation without one).
    experiments : tuple of Judged
        The recordings one by one.
    responses : tuple of (mapping of output to JudgedResponse)
        The measured frequency responses one by one; empty where the model has none.
    between_samples : BetweenSamples or None
        The way that fits best, where it was not known what inputs do between their samples; everything else is said with it.
    between_tried : mapping of BetweenSamples to BetweenTried
        Each way that was tried.
    warnings : tuple of str
        Why the intervals may be wrong.
    """

    parameters: Mapping[str, Estimate]
    correlations: Samples
    indistinguishable: tuple[str, ...]
    estimation: Fits
    validation: Fits
    one_step: Fits
    baselines: Mapping[str, Fits]
    experiments: tuple[Judged, ...]
    status: Status
    advice: str
    evaluations: int
    seconds: float
    between_samples: BetweenSamples | None
    between_tried: Mapping[BetweenSamples, BetweenTried]
    warnings: tuple[str, ...]
    responses: tuple[Mapping[str, JudgedResponse], ...] = ()

    @property
    def offsets(self) -> Mapping[str, float]:
        """Offsets of the first recording."""
        return self.experiments[0].offsets if self.experiments else {}

    @property
    def residuals(self) -> Mapping[str, ResidualTests]:
        """Tests of the residuals of the first experiment that has some."""
        return next((judged.residuals for judged in self.experiments if judged.residuals), {})
