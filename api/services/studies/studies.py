"""Simulations, frequency responses and influence studies: computed at once, by the exact engine."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from api.convert.optimizations import duration_from_wire
from api.convert.signals import (
    changed_signals,
    check_name,
    command_parameter,
    is_command_path,
    signal_from_wire,
    signals_from_wire,
)
from api.convert.studies import (
    check_metrics,
    frequency_to_wire,
    influence_to_wire,
    prediction_to_wire,
    simulation_to_wire,
    warnings_to_wire,
)
from api.convert.values import band_from_wire, changes_from_wire, opening, options_from_wire, overrides_from_wire, si
from api.problems.documents import at, invalid
from api.problems.pointers import Place
from api.schemas.studies import FrequencyRequest, InfluenceRequest, SimulationRequest
from api.services.jobs import costs
from api.services.operation.app_context import Caller, Installation
from api.services.recordings.datasets import channel_reader
from api.services.studies.results import Study
from api.services.systems.systems import Subject, subject_of
from engine.analysis.commanded import CommandParameter
from engine.analysis.influence import Influence, influence
from engine.analysis.prediction import predict
from engine.analysis.study import MetricRequest, frequency_response, simulate
from engine.diagram.connections import Opening
from engine.diagram.diagram import Diagram
from engine.metrics import catalogue
from engine.model.errors import EngineError, IllPosedError
from engine.model.names import no_parameter
from engine.model.verdicts import Verdict
from engine.signals import Signal, make

_MOST_FREQUENCIES = 100_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """Parameter values as given and in SI, the commands with theirs, and the place to which errors at these values belong."""

    given: Mapping[str, Any]
    overrides: Mapping[str, float]
    signals: Mapping[str, Signal]
    place: Place


def variants_of(
    given: Sequence[Mapping[str, Any]] | None, diagram: Diagram, signals: Mapping[str, Signal] = MappingProxyType({})
) -> list[Variant]:
    """Return the variants asked for: values of the system's parameters, and of the commands' (``signals.port.delay``)."""
    if given is None:
        return [Variant(given={}, overrides={}, signals=signals, place=("system",))]
    found = []
    for i, values in enumerate(given):
        place: Place = ("variants", i)
        commands = {path: value for path, value in values.items() if is_command_path(path, diagram)}
        plain = {path: value for path, value in values.items() if path not in commands}
        found.append(
            Variant(
                given=values,
                overrides=overrides_from_wire(plain, diagram, place=place),
                signals=changed_signals(commands, signals, place=place),
                place=place,
            )
        )
    return found


def study_of(subject: Subject, body: dict[str, Any], request: Any) -> Study:
    """Return a reply as a study of a system."""
    body["system"] = dict(subject.reference) if subject.reference else None
    return Study(body=body, request=request.model_dump(by_alias=True, exclude_unset=True), system=subject.reference)


def run_simulation(service: Installation, caller: Caller, request: SimulationRequest) -> Study:
    """Return the answers of the outputs to the commands, one variant after the other."""
    subject = subject_of(service, caller, request.system)
    diagram = subject.diagram
    signals = signals_from_wire(request.input, diagram, place=("input",), read_channel=channel_reader(service, caller))
    if request.outputs is not None and not request.outputs:
        raise invalid("outputs must name one output at least, or be left out for all, got none", "outputs")
    outputs = diagram.outputs if request.outputs is None else tuple(dict.fromkeys(request.outputs))
    for i, name in enumerate(outputs if request.outputs is not None else ()):
        check_name(name, diagram.outputs, name="output", what="the system's outputs", place=("outputs", i))
    metrics = check_metrics(request.metrics)
    duration = duration_from_wire(request.duration, place=("duration",))
    band = band_from_wire(request.band, place=("band",))
    options = options_from_wire(request, "", place=())
    variants = variants_of(request.variants, diagram, signals)
    service.computing.check_size(samples=request.samples, curves=len(outputs) + 1, variants=len(variants))

    def compute(variant: Variant) -> tuple[dict[str, Any], Sequence[Any]]:
        found = simulate(
            diagram,
            signals=variant.signals,
            overrides=variant.overrides,
            outputs=outputs,
            duration=duration,
            samples=request.samples,
            metrics=metrics,
            band=band,
            options=options,
        )
        return simulation_to_wire(found), found.warnings

    cost = costs.of_system(diagram, duration=duration, variants=len(variants), overrides=variants[0].overrides)
    cost += costs.of_numbers(request.samples * (len(outputs) + 1) * len(variants))
    empty = {"time": [], "outputs": {name: [] for name in outputs}, "metrics": {name: {} for name in outputs}}
    return study_of(subject, each(service, subject, variants, compute, empty, cost=cost), request)


def each(
    service: Installation,
    subject: Subject,
    variants: Sequence[Variant],
    compute: Callable[[Variant], tuple[dict[str, Any], Sequence[Any]]],
    empty: Mapping[str, Any],
    *,
    cost: float,
) -> dict[str, Any]:
    """Compute one variant after the other; one whose algebraic loop has no solution is ``empty`` with that verdict."""
    listed: list[dict[str, Any]] = []
    remarks: list[Any] = list(subject.diagram.warnings)

    def compute_all() -> None:
        for variant in variants:
            try:
                body, found = compute(variant)
            except IllPosedError as error:
                body, found = {**empty, "verdict": str(Verdict.ILL_POSED), "advice": error.message}, ()
            except EngineError as error:
                raise invalid(error.message, *variant.place) from error
            listed.append({"parameters": dict(variant.given), **body})
            remarks.extend(found)

    service.computing.bounded(compute_all, cost)
    return {"variants": listed, "warnings": warnings_to_wire(remarks, place=subject.place)}


def run_frequency_response(service: Installation, caller: Caller, request: FrequencyRequest) -> Study:
    """Return the frequency response of a path or of an opened loop, one variant after the other."""
    subject = subject_of(service, caller, request.system)
    diagram = subject.diagram
    paths = [(path.source, path.target) for path in request.paths or ()]
    source, target = (request.source, request.target) if request.open_at or not paths or request.source else paths[0]
    _check_path(request, source, target, diagram)
    metrics = check_metrics(request.metrics)
    frequencies = frequencies_of(request.frequencies)
    options = options_from_wire(request, "", place=())
    if request.operating_point:
        diagram = diagram.about(constants_from_wire(request.operating_point, diagram))
    variants = variants_of(request.variants, diagram)
    count = 1000 if frequencies is None else frequencies.size
    service.computing.check_size(samples=count, curves=5 * (1 + len(paths)), variants=len(variants))

    def compute(variant: Variant) -> tuple[dict[str, Any], Sequence[Any]]:
        found = frequency_response(
            diagram,
            overrides=variant.overrides,
            source=source,
            target=target,
            open_at=opening(request.open_at),
            frequencies=frequencies,
            metrics=metrics,
            options=options,
            paths=paths,
        )
        return frequency_to_wire(found), found.warnings

    curves = ("frequency", "magnitude", "phase", "real", "imag", "poles")
    cost = costs.of_system(diagram, duration=0.0, variants=len(variants), overrides=variants[0].overrides)
    cost += costs.of_numbers(count * 5 * (1 + len(paths)) * len(variants))
    empty: dict[str, Any] = {"metrics": {}, **{name: [] for name in curves}}
    return study_of(subject, each(service, subject, variants, compute, empty, cost=cost), request)


def _check_path(request: FrequencyRequest, source: str | None, target: str | None, diagram: Diagram) -> None:
    if request.open_at is None:
        for key, value in (("from", source), ("to", target)):
            if value is None:
                raise invalid(f"{key} must be given where open_at is not", key)
    for i, path in enumerate(request.paths or ()):
        place: Place = ("paths", i)
        check_name(path.source, diagram.inputs, name="from", what="the system's inputs", place=(*place, "from"))
        check_name(path.target, diagram.outputs, name="to", what="the system's outputs", place=(*place, "to"))
    if (request.source is None) != (request.target is None):
        missing = "from" if request.source is None else "to"
        raise invalid("from and to must be given together, got one of them", missing)
    if request.source is not None:
        check_name(request.source, diagram.inputs, name="from", what="the system's inputs", place=("from",))
    if request.target is not None:
        check_name(request.target, diagram.outputs, name="to", what="the system's outputs", place=("to",))
    check_open_at(opening(request.open_at), diagram)


def check_open_at(open_at: Opening | None, diagram: Diagram) -> None:
    """Refuse a place where no loop can be opened."""
    if open_at is None:
        return
    try:
        diagram.realize(open_at=open_at)
    except EngineError as error:
        # What is wrong is the name in the request, not a place in the document.
        raise invalid(error.message, "open_at") from error


def constants_from_wire(given: Mapping[str, Any] | None, diagram: Diagram) -> dict[str, float]:
    """Return the constant inputs of an operating point, SI (inputs have no unit of their own)."""
    found = {}
    for name, value in (given or {}).items():
        place: Place = ("operating_point", name)
        check_name(name, diagram.inputs, name="input", what="the system's inputs", place=place)
        found[name] = si(value, "", name=name, place=place)
    return found


def frequencies_of(given: Any) -> np.ndarray[Any, np.dtype[np.float64]] | None:
    """Return increasing angular frequencies >= 0, None where the service is to choose them."""
    if given == "auto":
        return None
    if len(given) > _MOST_FREQUENCIES:
        raise invalid(f"frequencies must be at most {_MOST_FREQUENCIES}, got {len(given)}", "frequencies")
    values = [si(value, "rad/s", name="frequency", place=("frequencies", i)) for i, value in enumerate(given)]
    for i, value in enumerate(values):
        if value < 0.0 or (i > 0 and value <= values[i - 1]):
            raise invalid(f"frequencies must be >= 0 rad/s and increasing, got {value:g}", "frequencies", i)
    return np.array(values)


def run_influence(service: Installation, caller: Caller, request: InfluenceRequest) -> Study:
    """Return how each metric changes with each parameter: exact elasticities and the coefficients of eq. (4)."""
    subject = subject_of(service, caller, request.system)
    diagram = subject.diagram
    check_name(request.input, diagram.inputs, name="input", what="the system's inputs", place=("input",))
    check_name(request.output, diagram.outputs, name="output", what="the system's outputs", place=("output",))
    source, target = request.source or request.input, request.target or request.output
    check_name(source, diagram.inputs, name="from", what="the system's inputs", place=("from",))
    check_name(target, diagram.outputs, name="to", what="the system's outputs", place=("to",))
    check_open_at(opening(request.open_at), diagram)
    if request.change == 0.0:
        raise invalid("change must be > -1 and not 0, got 0", "change")
    if request.signal is None:
        signal = make("step", {})
    else:
        unit = diagram.references.input_units.get(request.input, "")
        signal = signal_from_wire(
            request.signal, place=("signal",), read_channel=channel_reader(service, caller), unit=unit
        )
    duration = duration_from_wire(request.duration, place=("duration",))
    metrics = check_metrics(request.metrics) or ()
    requests = {
        name: _metric_request(
            name,
            request,
            signals={request.input: signal},
            source=source,
            target=target,
            duration=duration,
            band=band_from_wire(request.band, place=("band",)),
            options=options_from_wire(request, diagram.output_units.get(request.output) or "", place=()),
        )
        for name in metrics
    }
    commands = _check_parameters(request.parameters, diagram, {request.input: signal})
    parameters = tuple(dict.fromkeys(request.parameters))
    cost = costs.of_system(diagram, duration=duration, variants=len(metrics) * (1 + 0.3 * len(parameters)))

    @at("system")
    def compute() -> Influence:
        return influence(diagram, requests, parameters, change=request.change, commands=commands)

    body = influence_to_wire(service.computing.bounded(compute, cost))
    if request.predict is not None:
        body["predictions"] = _predictions(service, request.predict, diagram, requests, cost=cost)
    return study_of(subject, {**body, "warnings": subject.warnings()}, request)


def _predictions(
    service: Installation,
    given: Sequence[Mapping[str, Any]],
    diagram: Diagram,
    requests: Mapping[str, MetricRequest],
    *,
    cost: float,
) -> list[dict[str, Any]]:
    """Return every metric as predicted for each set of changes, beside its exact value."""
    changes = [changes_from_wire(change, diagram, place=("predict", i)) for i, change in enumerate(given)]

    def compute(i: int) -> dict[str, Any]:
        with at("predict", i):
            return prediction_to_wire(predict(diagram, requests, changes[i]))

    return service.computing.bounded(lambda: [compute(i) for i in range(len(changes))], cost * len(changes))


def _metric_request(name: str, request: InfluenceRequest, **given: Any) -> MetricRequest:
    domain = catalogue()[name].domain
    if domain == "time":
        return MetricRequest(
            metric=name,
            signals=given["signals"],
            output=request.output,
            duration=given["duration"],
            band=given["band"],
            options=given["options"],
        )
    if domain == "loop":
        return MetricRequest(metric=name, open_at=opening(request.open_at))
    if domain == "path":
        return MetricRequest(metric=name, source=given["source"], target=given["target"], options=given["options"])
    return MetricRequest(metric=name)


def _check_parameters(
    paths: Sequence[str], diagram: Diagram, signals: Mapping[str, Signal]
) -> dict[str, CommandParameter]:
    """Refuse what cannot be varied; return those paths that name a number of a command."""
    commands: dict[str, CommandParameter] = {}
    for i, path in enumerate(paths):
        place: Place = ("parameters", i)
        if is_command_path(path, diagram):
            commands[path] = command_parameter(path, signals, place=place)
            continue
        info = diagram.parameters.get(path)
        if info is None:
            raise invalid(no_parameter(path, diagram.parameters), *place)
        if info.bound:
            raise invalid(f"{path} must be a number to be varied, but an expression gives it", *place)
    return commands
