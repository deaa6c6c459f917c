"""Identifications without a system document: requests to the core, results to bodies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from api.convert.fits import fit_to_wire
from api.convert.identifications import experiment_of, fits_to_wire
from api.convert.recordings import Values
from api.convert.values import number, numbers, optional_si, si
from api.schemas.identifications import BlackBoxRequest, InverseDynamicsRequest
from engine.model.between_samples import BetweenSamples
from optimizers.black_box import BlackBox
from optimizers.estimation.inverse_dynamics import DriveFit, DriveRecording, Treatment
from optimizers.estimation.static_curve import StaticCurve
from optimizers.recorded.recording import RecordedExperiment, Recording


def black_box_from_wire(
    document: BlackBoxRequest, channels: Mapping[str, Values], sample_time: float
) -> tuple[RecordedExperiment, dict[str, Any]]:
    """Return the recording and the settings of the search."""
    recording = Recording(
        inputs={name: channels[channel] for name, channel in document.inputs.items()},
        outputs={name: channels[channel] for name, channel in document.outputs.items()},
        sample_time=sample_time,
        between_samples=dict.fromkeys(document.inputs, BetweenSamples(document.between_samples)),
    )
    return experiment_of(document, recording), {
        "method": document.method,
        "orders": tuple(document.orders),
        "largest_delay": si(document.largest_delay, "s", name="largest_delay", place=("largest_delay",)),
        "offsets": document.offsets == "estimate",
    }


def black_box_to_wire(found: BlackBox) -> dict[str, Any]:
    """Return the body of a finished black box."""
    return {
        "status": str(found.status),
        "advice": "A simulation is judged, not a one-step prediction. Give the document parameters of its own to go on.",
        "order": found.order,
        "delay": number(found.delay),
        "poles": [[number(pole.real), number(pole.imag)] for pole in found.system.poles.tolist()],
        "tried": [
            {
                "order": one.order,
                "delay": number(one.delay),
                "estimation": number(one.estimation),
                "validation": number(one.validation),
                "remark": one.remark,
            }
            for one in found.tried
        ],
        "parameters": {},
        "offsets": {name: number(value) for name, value in found.offsets.items()},
        "fit": {
            "estimation": fits_to_wire(found.estimation),
            "validation": fits_to_wire(found.validation),
            "baselines": {kind: fits_to_wire(fits) for kind, fits in found.baselines.items()},
        },
        "one_step_prediction": fits_to_wire(found.one_step),
        "document": dict(found.document),
        "seconds": found.seconds,
    }


def drive_from_wire(
    document: InverseDynamicsRequest, channels: Mapping[str, Values], sample_time: float
) -> tuple[DriveRecording, Treatment, dict[str, bool]]:
    """Return the recording, what is done to it, and which terms the equation has."""
    recording = DriveRecording(
        force=document.force_factor * channels[document.force],
        position=channels[document.position] if document.position is not None else None,
        velocity=channels[document.velocity] if document.velocity is not None else None,
        further={name: channels[channel] for name, channel in document.further.items()},
        sample_time=sample_time,
    )
    treatment = Treatment(
        low_pass=optional_si(document.low_pass, "rad/s", name="low_pass", place=("low_pass",)),
        order=document.order,
        decimation=document.decimation,
        dropped=document.dropped,
        least_velocity=document.least_velocity,
        transition_velocity=document.transition_velocity,
    )
    return recording, treatment, {key: getattr(document, key) for key in ("asymmetric", "inertia", "viscous")}


def drive_to_wire(found: DriveFit) -> dict[str, Any]:
    """Return the body of a finished regression."""
    return {
        "status": "converged",
        "advice": "The error is that of the equation of forces: simulate the drive with these values to see how it moves.",
        "parameters": {
            name: {
                "value": number(term.value),
                "unit": "",
                "lower95": number(term.lower95),
                "upper95": number(term.upper95),
                "start": None,
            }
            for name, term in found.terms.items()
        },
        "offsets": {},
        "correlations": [[number(value) for value in row] for row in found.correlations],
        "indistinguishable": list(found.indistinguishable),
        "equation_error": fit_to_wire(found.equation_error),
        "samples": found.samples,
    }


def static_curve_to_wire(found: StaticCurve) -> dict[str, Any]:
    """Return the body of a finished curve."""
    return {
        "status": "converged",
        "advice": "A static curve has no dynamics: what it leaves may be a lag, hysteresis or noise.",
        "degree": found.degree,
        "center": number(found.center),
        "scale": number(found.scale),
        "coefficients": numbers(found.coefficients),
        "parameters": {},
        "offsets": {},
        "tried": [{"degree": degree, "validation": number(fit)} for degree, fit in found.validation],
        "static_fit": fit_to_wire(found.fit),
        "document": {
            "name": "static curve",
            "blocks": {
                "u": {"kind": "input"},
                "curve": {
                    "kind": "lookup_table",
                    "points": found.points.tolist(),
                    "values": found.values.tolist(),
                },
            },
            "connections": [{"from": "u", "to": "curve"}],
            "outputs": {"y": "curve"},
        },
    }
