"""What is to be identified from which recording: checked before anything is computed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.errors import Path
from optimizers.problem import ProblemError, Variable
from optimizers.problem.errors import amount

if TYPE_CHECKING:
    from engine.diagram import Diagram

Samples = npt.NDArray[np.float64]
Window = tuple[float, float]

MIN_SAMPLES_PER_PARAMETER = 10


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """What was measured, in SI units: every signal at the same instants, ``sample_time`` (s) apart, from t = 0.

    Parameters
    ----------
    inputs, outputs : mapping of str to ndarray, shape (samples,)
        By the names of the diagram's inputs and outputs.
    sample_time : float
    """

    inputs: Mapping[str, Samples]
    outputs: Mapping[str, Samples]
    sample_time: float

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
class Identification:
    """An identification that has been proven to make sense.

    Parameters
    ----------
    diagram : Diagram
    recording : Recording
        Inputs of the diagram that were not recorded are 0.
    parameters : tuple of Variable
        The unknown ones. Bounds default to the parameter's own and may be infinite; ``start`` to its present value.
    offsets : bool
        Whether each output has an unknown constant offset.
    estimation, validation : (float, float), optional
        Windows in s. Default: the first ``split`` of the recording estimates, the rest validates; with an estimation
        window alone, the longer part beside it validates.
    split : float
    starts : int
        How many starts: the given one, then random ones.
    max_evaluations : int
        Simulations for each start.

    Raises
    ------
    ProblemError
        With the place in the document.
    """

    diagram: Diagram
    recording: Recording
    parameters: tuple[Variable, ...]
    offsets: bool = False
    estimation: Window | None = None
    validation: Window | None = None
    split: float = 0.5
    starts: int = 1
    max_evaluations: int = 60
    unknowns: tuple[Unknown, ...] = field(init=False)

    def __post_init__(self) -> None:
        _check_recording(self.diagram, self.recording)
        if not self.parameters:
            raise ProblemError("parameters must be at least one, got none", at=("parameters",))
        names = [variable.parameter for variable in self.parameters]
        for index, name in enumerate(names):
            if name in names[:index]:
                raise ProblemError(f"parameter must be named once, got {name!r} twice", at=("parameters", index))
        unknowns = tuple(_unknown(self.diagram, v, ("parameters", i)) for i, v in enumerate(self.parameters))
        object.__setattr__(self, "unknowns", unknowns)
        if self.starts < 1:
            raise ProblemError(f"starts must be >= 1, got {self.starts}", at=("starts",))
        self._check_windows()

    def _check_windows(self) -> None:
        if not 0 < self.split <= 1:
            raise ProblemError(f"split must be > 0 and <= 1, got {self.split:g}", at=("split",))
        end = self.recording.end
        for key, window in (("estimation", self.estimation), ("validation", self.validation)):
            # the last sample stands for the interval of which it is the beginning
            if window is not None and not 0 <= window[0] < window[1] <= end + 1.000001 * self.recording.sample_time:
                raise ProblemError(
                    f"{key} must be [t0, t1] with 0 <= t0 < t1 <= {end:g} s, got {list(window)}", at=(key,)
                )
        part = self.recording.within(self.windows[0])
        fewest = MIN_SAMPLES_PER_PARAMETER * (len(self.parameters) + 1)
        if part.stop - part.start < fewest:
            raise ProblemError(
                f"estimation must hold at least {fewest} samples, got {part.stop - part.start}", at=("estimation",)
            )
        for name, measured in self.recording.outputs.items():
            if np.ptp(measured[part]) == 0:
                raise ProblemError(
                    f"output {name} must vary in the estimation window, got a constant", at=("outputs", name)
                )

    @cached_property
    def windows(self) -> tuple[Window, Window | None]:
        """Estimation and validation windows in s; no validation window when nothing is left for it."""
        end = self.recording.end
        estimation = self.estimation or (0.0, self.split * end)
        if self.validation is not None:
            return estimation, self.validation
        rest = max((estimation[1], end), (0.0, estimation[0]), key=lambda window: window[1] - window[0])
        return estimation, rest if rest[1] - rest[0] >= 0.02 * end else None


def _check_recording(diagram: Diagram, recording: Recording) -> None:
    if not (recording.sample_time > 0 and math.isfinite(recording.sample_time)):
        raise ProblemError(f"sample_time must be > 0 s, got {recording.sample_time}", at=("dataset",))
    for key, signals, known in (
        ("inputs", recording.inputs, diagram.inputs),
        ("outputs", recording.outputs, diagram.outputs),
    ):
        if not signals:
            raise ProblemError(f"{key} must name at least one recorded signal, got none", at=(key,))
        for name, signal in signals.items():
            if name not in known:
                raise ProblemError(f"{key} must be among {', '.join(known)}, got {name!r}", at=(key, name))
            if signal.ndim != 1 or signal.size != recording.samples:
                raise ProblemError(
                    f"{name} must have {recording.samples} samples as the first output has, got {signal.size}",
                    at=(key, name),
                )
            if not np.isfinite(signal).all():
                raise ProblemError(f"{name} must be finite at every sample, got NaN or infinity", at=(key, name))


def _unknown(diagram: Diagram, variable: Variable, at: Path) -> Unknown:
    name = variable.parameter
    if name not in diagram.parameters:
        raise ProblemError(f"parameter must be one of the system's, got {name!r}", at=(*at, "parameter"))
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
