"""Frequency response functions of recordings, with what is held against them: bands, models, modes."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext, suppress
from statistics import NormalDist
from typing import Any

import numpy as np
import numpy.typing as npt

from api.convert.frfs import (
    doubt_to_warning,
    frf_to_wire,
    modes_to_wire,
    named,
    simulated_to_wire,
)
from api.convert.signals import check_name
from api.convert.spectra import window_to_wire
from api.convert.values import band_from_wire, number, numbers, overrides_from_wire
from api.problems.documents import at, invalid
from api.problems.pointers import Place
from api.schemas.frfs import FrfRequest
from api.services.frequency.measured_frfs import formed, frfs_of, segment_of, sensors_of
from api.services.frequency.measured_parts import Part, check_lines, part_of_recording
from api.services.jobs import costs
from api.services.operation.app_context import Caller, Installation
from api.services.recordings.functions import measured_part
from api.services.studies.results import Study
from api.services.systems.systems import Subject, subject_of
from api.units.conversion import UnitError, factor
from engine.analysis.evaluation import Evaluation
from engine.analysis.study import frequency_response
from engine.exact.frequency.sampled_frequency import sampled_frequency_response
from engine.model.between_samples import BetweenSamples
from engine.model.errors import UnresolvedError
from engine.recordings.modal.modes import modes_of
from engine.recordings.spectra.comparison import compared
from engine.recordings.spectra.frf import Frf
from engine.recordings.spectra.motion import MOTIONS, in_form
from engine.recordings.spectra.sampled import window_of
from engine.recordings.spectra.sensors import Sensor

KIND = "frf"


def run_frf(service: Installation, caller: Caller, request: FrfRequest) -> Study:
    """Return the responses of the outputs to the input, line by line."""
    names = request.output if isinstance(request.output, list) else [request.output]
    if len(set(names)) < len(names):
        raise invalid("output must name each channel once", "output")
    measured = _measured(service, caller, request, names)
    sensors = sensors_of(request, names)
    subject = None if request.system is None else subject_of(service, caller, request.system)
    if subject is not None:
        _check_path(request, subject)
    cost = costs.of_numbers(sum(part.size for channel in measured.channels.values() for part in channel))
    body = service.computing.bounded(
        lambda: _body(service, request, measured, names, sensors=sensors, subject=subject), cost
    )
    reference = None if subject is None else subject.reference
    return Study(body=body, request=request.model_dump(by_alias=True, exclude_unset=True), system=reference)


@at()
def _body(
    service: Installation,
    request: FrfRequest,
    measured: Part,
    names: list[str],
    *,
    sensors: Mapping[str, Sensor | None],
    subject: Subject | None,
) -> dict[str, Any]:
    found = frfs_of(request, measured, names, sensors)
    first = next(iter(found.values()))
    check_lines(service, first.frequency.size, curves=9 * len(names))
    outputs, warnings = {}, []
    for name, corrected in found.items():
        frf, unit = formed(request, corrected, measured.units[name])
        source = measured.units[request.input]
        outputs[name] = frf_to_wire(frf, output=unit, input=source, level=request.confidence)
        warnings += [doubt_to_warning(doubt, name) for doubt in frf.doubts]
        if subject is not None:
            _check_unit(request, subject, name, unit)
            outputs[name]["simulated"] = _simulated(request, subject, frf, 1.0 / measured.rate)
    modes = _modes(request, found, measured.units)
    return {
        "dataset": request.dataset,
        "input": request.input,
        "input_unit": named(measured.units[request.input]),
        "estimator": request.estimator,
        "form": request.form,
        "frequency": numbers(first.frequency),
        "resolution": number(first.resolution),
        "averages": first.averages,
        "effective_averages": number(first.effective_averages),
        "confidence": request.confidence,
        "window": _window(request, measured),
        "outputs": outputs,
        "modes": modes,
        "system": dict(subject.reference) if subject is not None and subject.reference else None,
        "warnings": warnings + ([] if subject is None else subject.warnings()),
    }


def _measured(service: Installation, caller: Caller, request: FrfRequest, names: list[str]) -> Part:
    many = isinstance(request.output, list)
    places: dict[Place, str] = {("input",): request.input}
    places |= {("output", i) if many else ("output",): name for i, name in enumerate(names)}
    if request.estimator == "measured":
        return measured_part(service.database, caller.workspace, request.dataset, places)
    return part_of_recording(service, caller, request.dataset, places, request.part)


def _check_path(request: FrfRequest, subject: Subject) -> None:
    diagram = subject.diagram
    check_name(str(request.source), diagram.inputs, name="from", what="the system's inputs", place=("from",))
    check_name(str(request.target), diagram.outputs, name="to", what="the system's outputs", place=("to",))


def _check_unit(request: FrfRequest, subject: Subject, name: str, unit: str) -> None:
    expected = subject.diagram.output_units.get(str(request.target), "")
    try:
        if expected and unit:
            factor(unit, expected)
    except UnitError as error:
        detail = f"to must be an output in a unit of {name!r} ({unit}), got {request.target}, which is in {expected}"
        raise invalid(detail, "to") from error


def _simulated(request: FrfRequest, subject: Subject, frf: Frf, sample_time: float) -> dict[str, Any]:
    overrides = overrides_from_wire(request.parameters or {}, subject.diagram, place=("parameters",))
    ways: tuple[BetweenSamples, ...] = (BetweenSamples.BAND_LIMITED,)
    if subject.diagram.sampled and request.between_samples in {BetweenSamples.HOLD, BetweenSamples.LINEAR}:
        detail = (
            "between_samples must be band_limited (or auto) for a system with samplers, which has samples of its own"
        )
        raise invalid(f"{detail}, got {request.between_samples!r}", "between_samples")
    if request.estimator == "measured" and request.between_samples in {BetweenSamples.HOLD, BetweenSamples.LINEAR}:
        detail = "between_samples must be band_limited (or auto) for a measured response, which has no samples"
        raise invalid(f"{detail}, got {request.between_samples!r}", "between_samples")
    if request.form is None and not subject.diagram.sampled and request.estimator != "measured":
        # the continuous response first: of equals it is taken
        ways = (*ways, BetweenSamples.HOLD, BetweenSamples.LINEAR)
    if request.between_samples != "auto":
        ways = (BetweenSamples(request.between_samples),)
    found = {}
    for way in ways:
        with nullcontext() if len(ways) == 1 else suppress(UnresolvedError):  # what was asked for is refused in words
            found[way] = _response(request, subject, frf.frequency, overrides, sample_time=sample_time, way=way)
    errors = {way: compared(frf, values, level=request.confidence) for way, values in found.items()}
    best = min(errors, key=lambda way: errors[way].relative_error_percent)
    return simulated_to_wire(found[best], errors[best]) | {
        "between_samples": {
            "chosen": str(best),
            "tried": {str(way): number(one.relative_error_percent) for way, one in errors.items()},
        }
    }


def _response(
    request: FrfRequest,
    subject: Subject,
    frequency: npt.NDArray[np.float64],
    overrides: Mapping[str, float],
    *,
    sample_time: float,
    way: BetweenSamples,
) -> npt.NDArray[np.complex128]:
    diagram = subject.diagram
    if way is not BetweenSamples.BAND_LIMITED:
        ends = diagram.inputs.index(str(request.source)), diagram.outputs.index(str(request.target))
        system = Evaluation(diagram, overrides).system
        return sampled_frequency_response(system, ends, frequency, sample_time=sample_time, way=way)
    found = frequency_response(
        diagram, overrides=overrides, source=request.source, target=request.target, frequencies=frequency, metrics=(),
    )  # fmt: skip
    return np.asarray(found.response, dtype=np.complex128)


def _modes(request: FrfRequest, found: Mapping[str, Frf], units: Mapping[str, str]) -> dict[str, Any] | None:
    """Return the modes that all outputs have in common; motions are looked at as displacements."""
    if request.modes is None:
        return None
    motions = all(units[name] in MOTIONS for name in found)
    frfs = {name: in_form(frf, "receptance", unit=units[name])[0] if motions else frf for name, frf in found.items()}
    band = band_from_wire(request.modes.band, place=("modes", "band"))
    with at("modes"):
        if band is not None:
            frfs = {name: frf.within(*band) for name, frf in frfs.items()}
        fitted = modes_of(frfs, count=request.modes.count)
    times = NormalDist().inv_cdf((1 + request.confidence) / 2)
    return modes_to_wire(fitted, form="receptance" if motions else None, times=times)


def _window(request: FrfRequest, measured: Part) -> dict[str, Any] | None:
    if request.estimator not in ("H1", "H2", "Hv"):
        return None
    facts, _ = window_of(request.window, segment_of(request, measured))
    return window_to_wire(facts)
