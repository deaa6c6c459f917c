"""The Fourier analyser: spectra of simulated outputs, exact or estimated, and of recorded channels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from api.convert.optimizations import duration_from_wire
from api.convert.recordings import window as part_of
from api.convert.signals import check_name, signals_from_wire
from api.convert.spectra import (
    energy_unit,
    estimate_to_wire,
    harmonics_to_wire,
    squared,
    transform_to_wire,
    unit_of,
    window_to_wire,
)
from api.convert.values import band_from_wire, number, optional_si
from api.problems.documents import at, invalid
from api.schemas.spectra import SpectrumRequest
from api.services.frequency.measured_parts import check_lines, part_of_recording
from api.services.jobs import costs
from api.services.operation.app_context import Caller, Installation
from api.services.recordings.datasets import channel_reader
from api.services.studies.results import Study
from api.services.studies.studies import Variant, each, frequencies_of, study_of, variants_of
from api.services.systems.systems import subject_of
from engine.analysis.study import simulate
from engine.diagram.diagram import Diagram
from engine.exact.frequency.fourier import Real
from engine.exact.frequency.harmonics import Harmonics, harmonics_of_samples
from engine.model.errors import SpectrumError
from engine.recordings.spectra.sampled import Spectrum, averaged_spectrum, band_mean_square, window_of
from engine.recordings.spectra.simulated import steady_harmonics, transient


def run_spectra(service: Installation, caller: Caller, request: SpectrumRequest) -> Study:
    """Return the spectrum of a recording, or of an output, one variant after the other."""
    return _recorded(service, caller, request) if request.system is None else _simulated(service, caller, request)


def _recorded(service: Installation, caller: Caller, request: SpectrumRequest) -> Study:
    if request.quantity == "transform":
        raise invalid("quantity must be amplitude or density for a recording, got 'transform'", "quantity")
    if request.variants is not None:
        raise invalid("variants must be left out for a recording", "variants")
    channel = str(request.channel)

    def check(rate: float, longest: int) -> None:
        check_lines(service, (_segment(request, rate) or longest) // 2, curves=3)

    part = part_of_recording(service, caller, str(request.dataset), {("channel",): channel}, request.part, check=check)
    rate, unit, experiments = part.rate, part.units[channel], part.experiments(channel)
    if request.fundamental is not None and len(experiments) > 1:
        raise invalid(f"part must lie in one experiment for harmonics, got {len(experiments)} of them", "part")
    cost = costs.of_numbers(sum(map(len, experiments)))
    body = service.computing.bounded(lambda: at()(_estimate)(request, experiments, rate, unit), cost)
    # a variant like those of a simulated output, so that one reader serves both
    variant = {"parameters": {}, "verdict": "ok", **body}
    reply = {
        **_head(request, unit, min(map(len, experiments)), rate),
        "variants": [variant],
        "warnings": [],
        "system": None,
    }
    return Study(body=reply, request=request.model_dump(by_alias=True, exclude_unset=True))


def _simulated(service: Installation, caller: Caller, request: SpectrumRequest) -> Study:
    assert request.system is not None
    assert request.input is not None
    subject = subject_of(service, caller, request.system)
    diagram, output = subject.diagram, str(request.output)
    signals = signals_from_wire(request.input, diagram, place=("input",), read_channel=channel_reader(service, caller))
    check_name(output, diagram.outputs, name="output", what="the system's outputs", place=("output",))
    variants = variants_of(request.variants, diagram, signals)
    service.computing.check_size(samples=request.samples, curves=3, variants=len(variants))
    unit = diagram.output_units.get(output) or "1"
    rates: list[tuple[int, float]] = []

    def compute(variant: Variant) -> tuple[dict[str, Any], Sequence[Any]]:
        try:
            if request.quantity == "transform":
                return {"verdict": "ok", **_transform(request, diagram, variant, unit)}, ()
            values, rate, verdict = _sampled(request, diagram, variant)
            rates.append((len(values), rate))
            steady = _steady(request, diagram, variant)
            return {"verdict": verdict, **_estimate(request, [values], rate, unit, steady=steady)}, ()
        except SpectrumError as error:
            if not error.verdict:
                raise invalid(error.message, *error.at) from error
            return {"frequency": [], "value": [], "verdict": error.verdict, "advice": error.message}, ()

    duration = duration_from_wire(request.duration, place=("duration",))
    cost = costs.of_system(diagram, duration=duration, variants=len(variants), overrides=variants[0].overrides)
    cost += costs.of_numbers(3 * request.samples * len(variants))
    body = each(service, subject, variants, compute, {"frequency": [], "value": []}, cost=cost)
    length, rate = rates[0] if rates else (request.samples, 1.0)
    return study_of(subject, {**_head(request, unit, length, rate), **body}, request)


def _head(request: SpectrumRequest, unit: str, length: int, rate: float) -> dict[str, Any]:
    window = None
    if request.quantity != "transform":
        applied, _ = window_of(request.window, _segment(request, rate) or length)
        window = window_to_wire(applied)
    return {"quantity": request.quantity, "unit": unit_of(request.quantity, unit), "window": window}


def _sampled(request: SpectrumRequest, diagram: Diagram, variant: Variant) -> tuple[Real, float, str]:
    """Return samples of the response and their rate."""
    output = str(request.output)
    found = simulate(
        diagram,
        signals=variant.signals,
        overrides=variant.overrides,
        outputs=[output],
        duration=duration_from_wire(request.duration, place=("duration",)),
        # one more than wanted: the last instant is the first one of the following period
        samples=request.samples + 1,
        metrics=(),
    )
    values = found.curves[output][:-1]
    rate = request.samples / float(found.time[-1])
    if not np.isfinite(values).all():
        why = "it grows beyond 1e100" if found.error is None else found.warnings[-1].detail
        msg = f"output must be followed to the end to have a spectrum, got {output}: {why}"
        raise SpectrumError(msg, verdict=str(found.verdict))
    return _part(request, values, rate), rate, str(found.verdict)


def _part(request: SpectrumRequest, values: Real, rate: float) -> Real:
    part = part_of(request.part, length=len(values) / rate, name="part")
    if part is None:
        return values
    first, last = (round(instant * rate) for instant in part)
    return values[first:last]


def _segment(request: SpectrumRequest, rate: float) -> int | None:
    seconds = optional_si(request.segment, "s", name="segment", place=("segment",))
    return None if seconds is None else round(min(seconds * rate, 1e12))


def _steady(request: SpectrumRequest, diagram: Diagram, variant: Variant) -> Harmonics | None:
    """Return the harmonics of a steady state without sampling, None where there is no such state."""
    fundamental = _fundamental(request)
    if fundamental is None:
        return None
    try:
        return steady_harmonics(
            diagram,
            variant.signals,
            str(request.output),
            fundamental=fundamental,
            count=request.orders,
            overrides=variant.overrides,
        )
    except SpectrumError:
        return None


def _fundamental(request: SpectrumRequest) -> float | None:
    value = optional_si(request.fundamental, "rad/s", name="fundamental", place=("fundamental",))
    if value is not None and value <= 0.0:
        raise invalid(f"fundamental must be > 0 rad/s, got {value:g}", "fundamental")
    return value


def _estimate(
    request: SpectrumRequest, experiments: list[Real], rate: float, unit: str, *, steady: Harmonics | None = None
) -> dict[str, Any]:
    """Return the spectrum of samples, with the harmonics and the band asked for."""

    def estimated(quantity: Any) -> Spectrum:
        return averaged_spectrum(
            experiments,
            rate,
            quantity=quantity,
            window=request.window,
            segment=_segment(request, rate),
            overlap=request.overlap,
            removal=request.removal,
        )

    found = estimated(request.quantity)
    body = estimate_to_wire(found)
    fundamental = _fundamental(request)
    if fundamental is not None:
        harmonics = steady or harmonics_of_samples(experiments[0], rate, fundamental, request.orders)
        body["harmonics"] = harmonics_to_wire(harmonics, unit)
    band = band_from_wire(request.band, place=("band",))
    if band is not None:
        density = found if request.quantity == "density" else estimated("density")
        body["band"] = {"value": number(band_mean_square(density, *band)), "unit": squared(unit)}
    return body


def _transform(request: SpectrumRequest, diagram: Diagram, variant: Variant, unit: str) -> dict[str, Any]:
    """Return the exact Fourier integral of a response, with the energy of a band."""
    found = transient(diagram, variant.signals, str(request.output), overrides=variant.overrides)
    chosen = frequencies_of(request.frequencies)
    if chosen is not None and chosen[0] == 0.0:
        raise invalid("frequencies of a spectrum must be > 0 rad/s, got 0", "frequencies", 0)
    frequencies = found.telling_frequencies() if chosen is None else chosen
    body = transform_to_wire(frequencies, found.at(frequencies))
    band = band_from_wire(request.band, place=("band",))
    if band is not None:
        body["band"] = {"value": number(found.energy(*band)), "unit": energy_unit(unit)}
    return body
