"""Identifications and validations: recordings against models, as bodies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any, Protocol

import numpy as np

from api.convert.fits import fit_to_wire
from api.convert.recordings import window
from api.convert.values import number, numbers, optional_si, overrides_from_wire
from api.problems.pointers import Place
from api.schemas.identifications import IdentificationRequest, IdentifiedParameter
from engine.diagram.diagram import Diagram
from engine.recordings.fit import Fit, ResidualTests
from optimizers.identification import Identified, Judged
from optimizers.problem import Variable
from optimizers.recorded.measured_response import FrequencyExperiment
from optimizers.recorded.recording import Identification, RecordedExperiment, Recording


def identification_from_wire(
    document: IdentificationRequest,
    diagram: Diagram,
    recordings: Sequence[Recording],
    frequency: Sequence[FrequencyExperiment] = (),
) -> Identification:
    """Return the identification, proven to make sense.

    Parameters
    ----------
    document : IdentificationRequest
    diagram : Diagram
    recordings : sequence of Recording
        Of the experiments in their order, or the only one.
    frequency : sequence of FrequencyExperiment
        Measured frequency responses in their order.

    Raises
    ------
    api.problems.documents.Problem
        422 with the place of a quantity in a wrong unit or a window outside of the recording.
    ProblemError
        For everything else that cannot be identified.
    """
    return Identification(
        diagram=diagram,
        experiments=tuple(_experiments(document, diagram, recordings)),
        parameters=tuple(_variable(choice, diagram, i) for i, choice in enumerate(document.parameters)),
        offsets=document.offsets == "estimate",
        initial_states=document.initial_states == "estimate",
        starts=document.starts,
        max_evaluations=document.max_evaluations,
        frequency=tuple(frequency),
    )


def _experiments(
    document: IdentificationRequest, diagram: Diagram, recordings: Sequence[Recording]
) -> Iterator[RecordedExperiment]:
    if document.dataset is not None:
        yield experiment_of(document, recordings[0])
        return
    for index, (one, recording) in enumerate(zip(document.experiments or (), recordings, strict=True)):
        place: Place = ("experiments", index)
        found = experiment_of(one, recording, place=place)
        values = overrides_from_wire(one.parameters, diagram, place=(*place, "parameters"))
        yield replace(found, name=one.name or f"experiment_{index + 1}", values=values)


class _Windowed(Protocol):
    """What has windows."""

    split: float
    estimation: list[Any] | None
    validation: list[Any] | None


def experiment_of(document: _Windowed, recording: Recording, *, place: Place = ()) -> RecordedExperiment:
    """Return a recording with the windows of a document."""
    return RecordedExperiment(
        recording=recording,
        estimation=window(document.estimation, length=recording.end, name="estimation", place=place),
        validation=window(document.validation, length=recording.end, name="validation", place=place),
        split=document.split,
        at=place,
    )


def _variable(choice: str | IdentifiedParameter, diagram: Diagram, index: int) -> Variable:
    if isinstance(choice, str):
        return Variable(parameter=choice)
    info = diagram.parameters.get(choice.parameter)
    unit = info.unit if info is not None else ""
    lower, upper, start = (
        optional_si(getattr(choice, key), unit, name=f"{key} of {choice.parameter}", place=("parameters", index, key))
        for key in ("lower", "upper", "start")
    )
    return Variable(parameter=choice.parameter, lower=lower, upper=upper, start=start, scale=choice.scale)


def identified_to_wire(
    found: Identified, problem: Identification, *, system: Mapping[str, Any] | None
) -> dict[str, Any]:
    """Return the body of a finished identification."""
    estimation, validation = problem.experiments[0].windows if problem.experiments else (None, None)
    return {
        "method": "grey_box",
        "status": str(found.status),
        "advice": found.advice,
        "parameters": {
            name: {
                "value": number(estimate.value),
                "unit": estimate.unit,
                "lower95": number(estimate.lower95),
                "upper95": number(estimate.upper95),
                "start": number(estimate.start),
            }
            for name, estimate in found.parameters.items()
        },
        "offsets": {name: number(value) for name, value in found.offsets.items()},
        "correlations": [[number(value) for value in row] for row in np.asarray(found.correlations)],
        "indistinguishable": list(found.indistinguishable),
        "fit": {
            "estimation": fits_to_wire(found.estimation),
            "validation": fits_to_wire(found.validation),
            "baselines": {kind: fits_to_wire(fits) for kind, fits in found.baselines.items()},
        },
        "one_step_prediction": fits_to_wire(found.one_step),
        "experiments": [_judged_to_wire(one) for one in found.experiments],
        "frequency_responses": [
            {
                "name": one.name,
                "outputs": {name: asdict(judged) | {"band": list(judged.band)} for name, judged in outputs.items()},
            }
            for one, outputs in zip(problem.frequency, found.responses, strict=True)
        ],
        "residuals": _residuals_to_wire(found.residuals),
        "between_samples": None if found.between_samples is None else _between_to_wire(found),
        "warnings": [{"pointer": "/parameters", "detail": sentence} for sentence in found.warnings],
        "windows": {
            "estimation": list(estimation) if estimation is not None else None,
            "validation": list(validation) if validation is not None else None,
        },
        "evaluations": found.evaluations,
        "seconds": found.seconds,
        "system": dict(system) if system else None,
    }


def _between_to_wire(found: Identified) -> dict[str, Any]:
    """Return the way that inputs between their samples are taken to go, and what every way that was tried comes to."""
    return {
        "chosen": str(found.between_samples),
        "tried": {
            str(way): {
                "fit_percent": number(one.fit_percent),
                "parameters": None if one.values is None else {name: number(v) for name, v in one.values.items()},
            }
            for way, one in found.between_tried.items()
        },
    }


def fits_to_wire(fits: Mapping[str, Fit]) -> dict[str, Any]:
    """Return the fit measures of every output."""
    return {output: fit_to_wire(fit) for output, fit in fits.items()}


def _judged_to_wire(judged: Judged) -> dict[str, Any]:
    return {
        "name": judged.name or None,
        "offsets": {name: number(value) for name, value in judged.offsets.items()},
        "initial_state": numbers(judged.initial_state),
        "estimation": fits_to_wire(judged.estimation),
        "validation": fits_to_wire(judged.validation),
        "one_step_prediction": fits_to_wire(judged.one_step),
        "residuals": {
            output: {"white": tests.white, "independent": tests.independent}
            for output, tests in judged.residuals.items()
        },
    }


def _residuals_to_wire(residuals: Mapping[str, ResidualTests]) -> dict[str, Any]:
    return {
        output: {
            "white": tests.white,
            "ljung_box": number(tests.ljung_box),
            "ljung_box_limit": number(tests.ljung_box_limit),
            "independent": tests.independent,
            "autocorrelation": numbers(tests.autocorrelation),
            "autocorrelation_bound": number(tests.autocorrelation_bound),
            "cross_correlation": numbers(tests.cross_correlation),
            "cross_correlation_bound": numbers(tests.cross_correlation_bound),
        }
        for output, tests in residuals.items()
    }
