"""What is to be identified from which recording: checked before anything is computed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.model.between_samples import BetweenSamples
from engine.model.errors import Path
from engine.model.names import no_parameter
from optimizers.problem import ProblemError, Variable
from optimizers.problem.errors import amount
from optimizers.recorded.measured_response import FrequencyExperiment

if TYPE_CHECKING:
    from engine.diagram.diagram import Diagram

Samples = npt.NDArray[np.float64]
Window = tuple[float, float]

MIN_SAMPLES_PER_PARAMETER = 10
MOST_STARTS = 100


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """What was measured, in SI units: every signal at the same instants, ``sample_time`` (s) apart, from t = 0.

    Parameters
    ----------
    inputs, outputs : mapping of str to ndarray, shape (samples,)
        By the names of the diagram's inputs and outputs.
    sample_time : float
    between_samples : mapping of str to BetweenSamples
        What the inputs do between their samples; linear where nothing is said.
    undecided : tuple of str
        Inputs of which nobody knows it: every way is tried on them, all of them alike, and the best one taken.
    remarks : tuple of str
        What is doubtful about the channels beside their samples.
    """

    inputs: Mapping[str, Samples]
    outputs: Mapping[str, Samples]
    sample_time: float
    between_samples: Mapping[str, BetweenSamples] = field(default_factory=dict)
    undecided: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    def with_undecided(self, way: BetweenSamples) -> Recording:
        """Return this recording with one way for all inputs that are undecided."""
        return replace(
            self, between_samples={**self.between_samples, **dict.fromkeys(self.undecided, way)}, undecided=()
        )

    @property
    def samples(self) -> int:
        """Number of samples."""
        return next(iter(self.outputs.values())).size

    @property
    def end(self) -> float:
        """Instant of the last sample, s."""
        return (self.samples - 1) * self.sample_time

    def within(self, window: Window) -> slice:
        """Return the samples in a window, both ends included."""
        first = math.ceil(window[0] / self.sample_time - 1e-6)
        last = math.floor(window[1] / self.sample_time + 1e-6)
        return slice(max(first, 0), min(last, self.samples - 1) + 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Unknown:
    """An unknown parameter with every default filled in (SI); searched by its logarithm when ``log``."""

    parameter: str
    unit: str
    lower: float
    upper: float
    start: float
    log: bool

    def coordinate(self, value: float) -> float:
        """Return what is searched for a value of the parameter."""
        if not self.log:
            return value
        return math.log(value) if math.isfinite(value) else math.inf

    def value(self, coordinate: float) -> float:
        """Return the value of the parameter."""
        value = math.exp(coordinate) if self.log else coordinate
        return min(max(value, self.lower), self.upper)

    def slope(self, coordinate: float) -> float:
        """Return d(value)/d(coordinate)."""
        return math.exp(coordinate) if self.log else 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedExperiment:
    """One recording with what is known of it alone, and the parts of it that estimate and validate.

    Parameters
    ----------
    recording : Recording
        Inputs of the diagram that were not recorded are 0.
    name : str
        Different for each of several.
    values : mapping of str to float
        Parameters (SI) that had another value in this experiment than the diagram says: a current, a load.
    estimation, validation : (float, float), optional
        Windows in s. Default: the first ``split`` of the recording estimates, the rest validates; with an estimation
        window alone, the longer part beside it validates.
    split : float
        1: everything estimates; 0: everything validates.
    at : tuple
        Where the experiment stands in its document, for messages.
    """

    recording: Recording
    name: str = ""
    values: Mapping[str, float] = field(default_factory=dict)
    estimation: Window | None = None
    validation: Window | None = None
    split: float = 0.5
    at: Path = ()

    @cached_property
    def windows(self) -> tuple[Window | None, Window | None]:
        """Estimation and validation windows in s; None for one that does not exist."""
        end = self.recording.end
        if self.estimation is None and self.split == 0:
            return None, self.validation or (0.0, end)
        estimation = self.estimation or (0.0, self.split * end)
        if self.validation is not None:
            return estimation, self.validation
        rest = max((estimation[1], end), (0.0, estimation[0]), key=lambda window: window[1] - window[0])
        return estimation, rest if rest[1] - rest[0] >= 0.02 * end else None

    def check(self, diagram: Diagram) -> None:
        """Refuse what cannot be compared with the diagram.

        Raises
        ------
        ProblemError
        """
        _check_recording(diagram, self.recording, self.at)
        if not 0 <= self.split <= 1:
            raise ProblemError(f"split must be >= 0 and <= 1, got {self.split:g}", at=(*self.at, "split"))
        end = self.recording.end
        for key, window in (("estimation", self.estimation), ("validation", self.validation)):
            # the last sample stands for the interval of which it is the beginning
            if window is not None and not 0 <= window[0] < window[1] <= end + 1.000001 * self.recording.sample_time:
                raise ProblemError(
                    f"{key} must be [t0, t1] with 0 <= t0 < t1 <= {end:g} s, got {list(window)}", at=(*self.at, key)
                )
        if self.windows[0] is None:
            return
        part = self.recording.within(self.windows[0])
        for name, measured in self.recording.outputs.items():
            if part.stop > part.start and np.ptp(measured[part]) == 0:
                raise ProblemError(
                    f"output {name} must vary in the estimation window, got a constant",
                    at=(*self.at, "outputs", name),
                )


@dataclass(frozen=True, kw_only=True, eq=False)
class Identification:
    """An identification that has been proven to make sense.

    Parameters
    ----------
    diagram : Diagram
    experiments : tuple of RecordedExperiment
        At least one of them estimates, or a measured frequency response does.
    parameters : tuple of Variable
        The unknown ones. Bounds default to the parameter's own and may be infinite; ``start`` to its present value.
    offsets : bool
        Whether each output has an unknown constant offset, in each experiment another.
    initial_states : bool
        Whether the state at the beginning of each recording is unknown, too. Otherwise the system has then been
        at rest under the first values of its inputs, or starts from its own initial state where it cannot rest.
    starts : int
        How many starts: the given one, then random ones.
    max_evaluations : int
        Simulations of all experiments for each start.
    frequency : tuple of FrequencyExperiment
        Measured frequency responses, all lines of which estimate.

    Raises
    ------
    ProblemError
        With the place in the document.
    """

    diagram: Diagram
    experiments: tuple[RecordedExperiment, ...]
    parameters: tuple[Variable, ...]
    offsets: bool = False
    initial_states: bool = False
    starts: int = 1
    max_evaluations: int = 60
    frequency: tuple[FrequencyExperiment, ...] = ()
    unknowns: tuple[Unknown, ...] = field(init=False)

    def __post_init__(self) -> None:
        every = self._every
        if not every:
            raise ProblemError("experiments must be at least one, got none", at=("experiments",))
        for experiment in every:
            check_known(self.diagram, experiment.values, experiment.at)
            experiment.check(self.diagram)
        if not self.parameters:
            raise ProblemError("parameters must be at least one, got none", at=("parameters",))
        names = [variable.parameter for variable in self.parameters]
        for index, name in enumerate(names):
            if name in names[:index]:
                raise ProblemError(f"parameter must be named once, got {name!r} twice", at=("parameters", index))
            for experiment in every:
                if name in experiment.values:
                    raise ProblemError(
                        f"{name} must be either estimated or known, got both", at=(*experiment.at, "parameters", name)
                    )
        unknowns = tuple(_unknown(self.diagram, v, ("parameters", i)) for i, v in enumerate(self.parameters))
        object.__setattr__(self, "unknowns", unknowns)
        if not 1 <= self.starts <= MOST_STARTS:
            raise ProblemError(f"starts must be >= 1 and <= {MOST_STARTS}, got {self.starts}", at=("starts",))
        if self.max_evaluations < 1:
            raise ProblemError(f"max_evaluations must be >= 1, got {self.max_evaluations}", at=("max_evaluations",))
        self._check_names()
        self._check_contents()

    @property
    def _every(self) -> tuple[RecordedExperiment | FrequencyExperiment, ...]:
        return (*self.experiments, *self.frequency)

    @property
    def undecided(self) -> tuple[str, ...]:
        """Inputs of which nobody knows what they do between their samples."""
        sampled = () if self.diagram.sampled else self.frequency  # samplers of its own: nothing to be tried
        measured = (f.source for f in sampled if f.between_samples is None)
        return tuple(dict.fromkeys([*(name for e in self.experiments for name in e.recording.undecided), *measured]))

    @property
    def estimating(self) -> tuple[RecordedExperiment, ...]:
        """The experiments with an estimation window."""
        return tuple(experiment for experiment in self.experiments if experiment.windows[0] is not None)

    def _check_names(self) -> None:
        names = [experiment.name for experiment in self._every]
        for experiment in self._every:
            if names.count(experiment.name) > 1:
                raise ProblemError(
                    f"name must be different for each experiment, got {experiment.name!r} twice",
                    at=(*experiment.at, "name"),
                )

    def _check_contents(self) -> None:
        """Refuse an identification whose estimation windows hold too little."""
        if not self.estimating and not self.frequency:
            alone = len(self.experiments) == 1
            raise ProblemError(
                f"at least one experiment must have an estimation window, got none: split must be > 0, got {self.experiments[0].split:g}",
                at=(*self.experiments[0].at, "split") if alone else ("experiments",),
            )
        slices = [(e, e.recording.within(e.windows[0])) for e in self.estimating if e.windows[0] is not None]
        fewest, held = MIN_SAMPLES_PER_PARAMETER * (len(self.parameters) + 1), sum(s.stop - s.start for _, s in slices)
        told = held + 2 * sum(f.lines for f in self.frequency)
        if told < fewest and not self.estimating:
            raise ProblemError(
                f"band must hold at least {fewest // 2} lines, got {told // 2}: {MIN_SAMPLES_PER_PARAMETER // 2} for each "
                "parameter, and as many for the model",
                at=(*self.frequency[0].at, "band"),
            )
        if told < fewest:
            raise ProblemError(
                f"estimation must hold at least {fewest} samples, got {held}: "
                f"{MIN_SAMPLES_PER_PARAMETER} for each parameter, and as many for the model",
                at=(*self.estimating[0].at, "estimation"),
            )
        moved = any(np.ptp(u[: part.stop]) > 0 for e, part in slices for u in e.recording.inputs.values())
        if not moved and not self.initial_states and not self.frequency:
            raise ProblemError(
                "inputs must vary: constant ones excite nothing (initial_states may be estimated from free motion)",
                at=(*self.estimating[0].at, "inputs"),
            )


def check_known(diagram: Diagram, values: Mapping[str, float], at: Path) -> None:
    """Refuse values of parameters that the diagram does not have.

    Raises
    ------
    ProblemError
    """
    for name, value in values.items():
        place = (*at, "parameters", name)
        if name not in diagram.parameters:
            raise ProblemError(no_parameter(name, diagram.parameters), at=place)
        if not math.isfinite(value):
            raise ProblemError(f"{name} must be finite, got {value}", at=place)


def _check_recording(diagram: Diagram, recording: Recording, at: Path) -> None:
    if not (recording.sample_time > 0 and math.isfinite(recording.sample_time)):
        raise ProblemError(f"sample_time must be > 0 s, got {recording.sample_time}", at=(*at, "dataset"))
    for key, signals, known in (
        ("inputs", recording.inputs, diagram.inputs),
        ("outputs", recording.outputs, diagram.outputs),
    ):
        if not signals:
            raise ProblemError(f"{key} must name at least one recorded signal, got none", at=(*at, key))
        for name, signal in signals.items():
            if name not in known:
                raise ProblemError(f"{key} must be among {', '.join(known)}, got {name!r}", at=(*at, key, name))
            if signal.ndim != 1 or signal.size != recording.samples:
                raise ProblemError(
                    f"{name} must have {recording.samples} samples as the first output has, got {signal.size}",
                    at=(*at, key, name),
                )
            if not np.isfinite(signal).all():
                raise ProblemError(f"{name} must be finite at every sample, got NaN or infinity", at=(*at, key, name))


def _unknown(diagram: Diagram, variable: Variable, at: Path) -> Unknown:
    name = variable.parameter
    if name not in diagram.parameters:
        raise ProblemError(no_parameter(name, diagram.parameters), at=(*at, "parameter"))
    info = diagram.parameters[name]
    if info.bound:
        raise ProblemError(
            f"{name} must be a number to be estimated, got an expression (estimate the parameters it is made of)",
            at=(*at, "parameter"),
        )
    lower = max(_first(variable.lower, info.lower, -math.inf), _first(info.lower, None, -math.inf))
    upper = min(_first(variable.upper, info.upper, math.inf), _first(info.upper, None, math.inf))
    if not lower < upper:
        raise ProblemError(f"upper must be > lower {amount(lower, info.unit)}, got {upper:g}", at=(*at, "upper"))
    if variable.scale not in {None, "linear", "log"}:
        raise ProblemError(f"scale must be linear or log, got {variable.scale!r}", at=(*at, "scale"))
    if variable.scale == "log" and lower <= 0:
        raise ProblemError(
            f"lower must be > {amount(0.0, info.unit)} on a logarithmic scale, got {lower:g}", at=(*at, "lower")
        )
    start = info.value if variable.start is None else variable.start
    if variable.start is not None and not lower <= start <= upper:
        raise ProblemError(
            f"start must be within {lower:g} … {amount(upper, info.unit)}, got {start:g}", at=(*at, "start")
        )
    # linear unless asked: responses are nearly linear in small lags, and an interval that meets 0 should show it
    return Unknown(
        parameter=name,
        unit=info.unit,
        lower=lower,
        upper=upper,
        start=min(max(start, lower), upper),
        log=variable.scale == "log",
    )


def _first(given: float | None, default: float | None, otherwise: float) -> float:
    if given is not None:
        return given
    return otherwise if default is None else default
