"""Identifications and validations: recordings against models, as bodies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from api.convert.fits import fit_to_wire
from api.convert.recordings import window
from api.convert.values import number, numbers, optional_si
from api.schemas.jobs import IdentificationRequest, IdentifiedParameter
from engine.diagram import Diagram
from optimizers.identification import Identified
from optimizers.problem import Variable
from optimizers.recording import Identification, RecordedExperiment, Recording


def identification_from_wire(document: IdentificationRequest, diagram: Diagram, recording: Recording) -> Identification:
    """Return the identification, proven to make sense.

    Raises
    ------
    api.errors.Problem
        422 with the place of a quantity in a wrong unit or a window outside of the recording.
    ProblemError
        For everything else that cannot be identified.
    """
    return Identification(
        diagram=diagram,
        experiments=(
            RecordedExperiment(
                recording=recording,
                estimation=window(document.estimation, length=recording.end, name="estimation"),
                validation=window(document.validation, length=recording.end, name="validation"),
                split=document.split,
            ),
        ),
        parameters=tuple(_variable(choice, diagram, i) for i, choice in enumerate(document.parameters)),
        offsets=document.offsets == "estimate",
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
    return Variable(parameter=choice.parameter, lower=lower, upper=upper, start=start)


def identified_to_wire(
    found: Identified, problem: Identification, *, system: Mapping[str, Any] | None
) -> dict[str, Any]:
    """Return the body of a finished identification."""
    estimation, validation = problem.experiments[0].windows
    return {
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
            "estimation": {output: fit_to_wire(fit) for output, fit in found.estimation.items()},
            "validation": {output: fit_to_wire(fit) for output, fit in found.validation.items()},
            "baselines": {
                kind: {output: fit_to_wire(fit) for output, fit in fits.items()}
                for kind, fits in found.baselines.items()
            },
        },
        "residuals": {
            output: {
                "white": tests.white,
                "independent": tests.independent,
                "autocorrelation": numbers(tests.autocorrelation),
                "autocorrelation_bound": number(tests.autocorrelation_bound),
                "cross_correlation": numbers(tests.cross_correlation),
                "cross_correlation_bound": numbers(tests.cross_correlation_bound),
            }
            for output, tests in found.residuals.items()
        },
        "windows": {
            "estimation": list(estimation) if estimation is not None else None,
            "validation": list(validation) if validation is not None else None,
        },
        "evaluations": found.evaluations,
        "seconds": found.seconds,
        "system": dict(system) if system else None,
    }
