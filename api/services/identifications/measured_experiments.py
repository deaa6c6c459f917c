"""Measured frequency responses as experiments of identifications: of a recording, or as a kept result was estimated."""

from __future__ import annotations

import math
from typing import Any

from api.convert.signals import check_name
from api.convert.values import band_from_wire, overrides_from_wire
from api.problems.documents import at, invalid
from api.problems.pointers import Place
from api.schemas.frfs import FrfRequest
from api.schemas.identifications import FrequencyResponseExperiment
from api.services.frequency.measured_frfs import formed, frfs_of, sensors_of
from api.services.frequency.measured_parts import stored_part
from api.services.recordings.functions import measured_part
from api.services.recordings.recordings import check_unit
from engine.diagram.diagram import Diagram
from engine.model.between_samples import BetweenSamples
from engine.recordings.spectra.frf import Frf
from optimizers.recorded.measured_response import FrequencyExperiment, MeasuredResponse, measured_response
from storage.errors import NotFoundError
from storage.repositories import ResultRepository
from storage.session import Database

_ESTIMATING = ("estimator", "window", "segment", "overlap", "removal", "part")


def frequency_experiment_of(
    document: FrequencyResponseExperiment,
    diagram: Diagram,
    *,
    name: str,
    database: Database,
    workspace: str,
    place: Place,
) -> FrequencyExperiment:
    """Return the measured responses of a document with their certainty.

    A kept result is estimated again from its recording, as it was asked for: the same lines, and all that is behind them.

    Parameters
    ----------
    document : FrequencyResponseExperiment
    diagram : Diagram
    name : str
    place : tuple
        Of the document in the request.

    Raises
    ------
    Problem
        422 at a port, channel, dataset or result that does not exist, at a band without lines or beyond the Nyquist
        frequency, at too few averages; 409 for a dataset not ready.
    """
    with at(*place):
        ((port, given),) = document.inputs.items()
        channel, way = (given, "auto") if isinstance(given, str) else (given.channel, given.between_samples)
        check_name(port, diagram.inputs, name="input", what="the system's inputs", place=("inputs", port))
        for output in document.outputs:
            check_name(output, diagram.outputs, name="output", what="the system's outputs", place=("outputs", output))
        request = _request(document, channel, database=database, workspace=workspace)
        places: dict[Place, str] = {("inputs", port): channel}
        places |= {("outputs", output): own for output, own in document.outputs.items()}
        if request.estimator == "measured":
            part = measured_part(database, workspace, request.dataset, places)
        else:
            part = stored_part(database, workspace, request.dataset, places, request.part)
        band = band_from_wire(document.band, place=("band",))
        nyquist = math.pi * part.rate
        if band is not None and band[1] > nyquist * (1 + 1e-9):
            raise invalid(
                f"band must end at most at {nyquist:g} rad/s, half the sample rate of the recording, got {band[1]:g}",
                "band",
            )
        names = list(dict.fromkeys(document.outputs.values()))
        found = frfs_of(request, part, names, sensors_of(request, names))
        responses: dict[str, MeasuredResponse] = {}
        remarks = []
        for output, own in document.outputs.items():
            frf, unit = formed(request, found[own], part.units[own])
            check_unit(unit, diagram.output_units.get(output, ""), channel=own, port=("outputs", output))
            frf = frf if band is None else frf.within(*band)
            responses[output] = _lines(document, frf, nyquist)
            remarks += [f"{output}: {doubt.detail}" for doubt in frf.doubts]
        return FrequencyExperiment(
            source=port,
            responses=responses,
            sample_time=1.0 / part.rate,
            between_samples=_way(way, request, port),
            name=name,
            values=overrides_from_wire(document.parameters, diagram, place=("parameters",)),
            remarks=tuple(dict.fromkeys(remarks)),
            at=place,
        )


def dataset_of(document: FrequencyResponseExperiment, *, database: Database, workspace: str) -> str:
    """Return the dataset behind a measured response; see :func:`frequency_experiment_of`."""
    return document.dataset if document.dataset is not None else _kept(document, database, workspace).dataset


def _request(document: FrequencyResponseExperiment, channel: str, *, database: Database, workspace: str) -> FrfRequest:
    names = list(dict.fromkeys(document.outputs.values()))
    if document.dataset is not None:
        own = {key: getattr(document, key) for key in _ESTIMATING}
        return FrfRequest.model_validate({"dataset": document.dataset, "input": channel, "output": names, **own})
    kept = _kept(document, database, workspace)
    measured = kept.output if isinstance(kept.output, list) else [kept.output]
    if channel != kept.input:
        raise invalid(f"inputs must be the channel of the kept response ({kept.input}), got {channel!r}", "inputs")
    for output, own_channel in document.outputs.items():
        if own_channel not in measured:
            raise invalid(
                f"outputs must be channels of the kept response ({', '.join(measured)}), got {own_channel!r}",
                "outputs", output,
            )  # fmt: skip
    corrections = {k: v for k, v in (kept.corrections or {}).items() if k == kept.input or k in names}
    return kept.model_copy(update={"output": names, "corrections": corrections or None})


def _kept(document: FrequencyResponseExperiment, database: Database, workspace: str) -> FrfRequest:
    """Return the request of a kept frequency response function."""
    with database.session() as session:
        try:
            row = ResultRepository(session, workspace).get(str(document.frf))
        except NotFoundError as error:
            raise invalid(f"frf must be a result that exists, got {document.frf!r}", "frf") from error
        kind, asked = row.kind, dict[str, Any](row.request or {})
    if kind != "frf":
        raise invalid(f"frf must be a kept result of /v1/frfs, {document.frf!r} is a result of kind {kind}", "frf")
    return FrfRequest.model_validate(asked)


def _lines(document: FrequencyResponseExperiment, frf: Frf, nyquist: float) -> MeasuredResponse:
    """Return the lines that tell something; at half the sample rate a response is real whatever it is."""
    below = frf.within(0.0, nyquist * (1 - 1e-9))
    return measured_response(below, least_coherence=document.least_coherence, weighted=document.weights == "coherence")


def _way(way: str, request: FrfRequest, port: str) -> BetweenSamples | None:
    if request.form is None and request.estimator != "measured":
        return None if way == "auto" else BetweenSamples(way)
    if way not in {"auto", "band_limited"}:
        raise invalid(
            f"between_samples must be band_limited (or auto) with form or a measured response, which are of continuous signals, got {way!r}",
            "inputs", port,
        )  # fmt: skip
    return BetweenSamples.BAND_LIMITED
