"""One validation: every output measured against simulated, the verdict, and what a diagnosis adds to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
import numpy.typing as npt

from engine.model.errors import EngineError
from engine.recordings.fit import Fit, ResidualTests, baselines, compare, examine_residuals, worst_interval
from engine.recordings.validation.between import Chosen
from engine.recordings.validation.comparison import Comparison
from engine.recordings.validation.diagnosis import Diagnosis
from engine.recordings.validation.prediction import OneStep, one_step
from engine.recordings.validation.spectrum import FrequencyDomain, by_input, frequency_domain
from engine.recordings.validation.unmodelled import Unmodelled, told, unmodelled
from engine.recordings.validation.verdict import Grade, grade, remarks

Samples = npt.NDArray[np.float64]
Answer = Callable[[Mapping[str, float]], Mapping[str, Samples]]
"""Simulates the outputs in the window with other values of some parameters."""

_TRIED = 3
_FRACTIONS = (1.0, 0.5, 0.25)
"""Of a step: a straight line promises too much where the response bends."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Compared:
    """What a validation looks at, over its window, SI.

    Attributes
    ----------
    measured, simulated, inputs : mapping of str to ndarray, shape (samples,)
    theoretical : mapping of str to ndarray, optional
        Simulated with the document's own parameters, where others were given.
    sample_time : float
    offsets : mapping of str to float, optional
        A constant for each output; None estimates them.
    """

    measured: Mapping[str, Samples]
    simulated: Mapping[str, Samples]
    theoretical: Mapping[str, Samples] | None
    inputs: Mapping[str, Samples]
    sample_time: float
    offsets: Mapping[str, float] | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Output:
    """One output; ``comparison.simulated`` has its offset, ``theoretical`` is the fit with the document's parameters."""

    comparison: Comparison
    offset: float
    fit: Fit
    theoretical: Fit | None
    baselines: Mapping[str, Fit]
    worst_interval: tuple[float, float]
    residuals: ResidualTests
    one_step: OneStep | None
    frequency: FrequencyDomain | None
    frequency_by_input: Mapping[str, FrequencyDomain]
    unmodelled: tuple[Unmodelled, ...]
    remarks: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """Values that were tried, and the relative error (%) that the model then really has."""

    values: Mapping[str, float]
    relative_error_percent: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Validated:
    """The outcome.

    Attributes
    ----------
    checks : mapping of str to Check
        The best of each step, its half and its quarter: by parameter, and ``together``.
    note : str
        Why a diagnosis is incomplete.
    between : Chosen, optional
        Which way inputs go on between their samples, where that was not known.
    """

    outputs: Mapping[str, Output]
    grade: Grade
    diagnosis: Diagnosis | None = None
    checks: Mapping[str, Check] = field(default_factory=dict)
    note: str = ""
    between: Chosen | None = None

    def comparisons(self, tangents: Mapping[str, Mapping[str, Samples]]) -> list[Comparison]:
        """Return the comparisons with derivatives, output -> parameter -> samples."""
        return [replace(o.comparison, tangents=tangents.get(name, {})) for name, o in self.outputs.items()]

    def diagnosed(self, diagnosis: Diagnosis, *, note: str = "") -> Validated:
        """Return this outcome with a diagnosis."""
        return replace(self, diagnosis=diagnosis, note=note)

    def checked(self, answer: Answer, *, go_on: Callable[[], bool] = lambda: True) -> Validated:
        """Return this outcome with the most helpful steps of its diagnosis simulated.

        Parameters
        ----------
        answer : callable
        go_on : callable
            Asked before each simulation whether there is time for it; whole steps are tried before parts of them.
        """
        steps = None if self.diagnosis is None else self.diagnosis.steps
        if steps is None:
            return self
        here = {step.parameter: step.value for step in steps.alone}
        moves: dict[str, Mapping[str, float]] = {
            step.parameter: {step.parameter: step.suggested} for step in steps.alone[:_TRIED]
        }
        moves["together"] = steps.together
        checks: dict[str, Check] = {}
        for fraction, (name, there) in product(_FRACTIONS, moves.items()):
            if not go_on():
                note = (
                    "there was no time to try all steps: those without a checked error are promised by straight lines"
                )
                return replace(self, checks=checks, note=self.note or note)
            values = {path: here[path] + fraction * (new - here[path]) for path, new in there.items()}
            error = self._error(answer, values)
            if error is not None and (name not in checks or error < checks[name].relative_error_percent):
                checks[name] = Check(values=values, relative_error_percent=error)
        return replace(self, checks=checks)

    def _error(self, answer: Answer, values: Mapping[str, float]) -> float | None:
        """Return the relative error with other values, %; None where the model then has no finite answer."""
        try:
            simulated = answer(values)
        except EngineError:
            return None
        if not all(np.isfinite(values).all() for values in simulated.values()):
            return None
        squares = []
        for name, output in self.outputs.items():
            error = output.comparison.relative_error(output.comparison.measured - simulated[name] - output.offset)
            if error is None:
                return None
            squares.append(error**2)
        return float(np.sqrt(np.mean(squares)))


def validate(compared: Compared, *, limit_percent: float) -> Validated:
    """Compare every output of a model with its measurement.

    Parameters
    ----------
    compared : Compared
        Finite.
    limit_percent : float
        Relative error up to which an output passes.
    """
    inputs = np.array(list(compared.inputs.values()))
    estimated = compared.offsets is None
    outputs: dict[str, Output] = {}
    for name, measured in compared.measured.items():
        offset = (
            float(np.mean(measured - compared.simulated[name])) if compared.offsets is None else compared.offsets[name]
        )
        model = compared.simulated[name] + offset
        comparison = Comparison(
            name=name, measured=measured, simulated=model, sample_time=compared.sample_time,
            inputs=compared.inputs, constant=estimated,
        )  # fmt: skip
        fit = compare(measured, model)
        left = unmodelled(comparison)
        trivial = baselines(measured, inputs, constant=estimated or offset != 0.0)
        outputs[name] = Output(
            comparison=comparison,
            offset=offset,
            fit=fit,
            theoretical=_theoretical(compared, name, measured),
            baselines=trivial,
            worst_interval=worst_interval(measured, model, sample_time=compared.sample_time),
            residuals=examine_residuals(measured - model, inputs),
            one_step=one_step(comparison),
            frequency=frequency_domain(comparison),
            frequency_by_input=by_input(comparison),
            unmodelled=left,
            remarks=(*remarks(name, fit, trivial), *told(name, left)),
        )
    return Validated(outputs=outputs, grade=grade({name: o.fit for name, o in outputs.items()}, limit_percent))


def _theoretical(compared: Compared, name: str, measured: Samples) -> Fit | None:
    if compared.theoretical is None:
        return None
    model = compared.theoretical[name]
    if not np.isfinite(model).all():
        return None
    offset = float(np.mean(measured - model)) if compared.offsets is None else compared.offsets[name]
    return compare(measured, model + offset)
