"""A front panel's system: opened once, then its curves at any values, as fast as a slider moves.

Linear systems without delays are sampled in a batch (:mod:`engine.exact.time.sampling`); all others take the exact path. Metrics
and elasticities are always those of the exact path, and computed when the values rest.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from api.convert.optimizations import duration_from_wire
from api.convert.signals import check_name, signals_from_wire
from api.convert.studies import check_metrics
from api.convert.values import measured_to_wire, number, opening
from api.problems.documents import at, invalid
from api.schemas.live import LiveOpen
from api.services.operation.app_context import Caller, Installation
from api.services.recordings.datasets import channel_reader
from api.services.studies.live_overlay import overlays
from api.services.studies.studies import check_open_at
from api.services.systems.systems import Subject, subject_of
from engine.analysis.evaluation import Evaluation
from engine.analysis.measuring import MetricRequest, measure
from engine.analysis.study import frequency_response, simulate
from engine.diagram.connections import Opening
from engine.diagram.diagram import LOOP, Diagram
from engine.exact.time import sampling
from engine.metrics import catalogue
from engine.model.errors import EngineError
from engine.model.linear_system import LinearSystem
from engine.model.names import no_parameter
from engine.model.verdicts import Verdict
from engine.signals import Signal, make
from engine.signals.step import Step

_FREQUENCIES = 1000
_DRAWABLE = 1e30
"""Beyond this a curve is no longer one: float32, in which it travels, ends at 3e38."""

Real = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Drawn:
    """The curves at one vector; NaN where there are none."""

    outputs: Real
    response: Real
    poles: npt.NDArray[np.complex128]
    verdict: Mapping[str, str]


@dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """An opened system: what varies, what is commanded, what is drawn and measured."""

    subject: Subject
    parameters: tuple[str, ...]
    signals: Mapping[str, Signal]
    outputs: tuple[str, ...]
    metrics: Mapping[str, MetricRequest]
    open_at: Opening | None
    source: str | None
    target: str | None
    time: Real
    frequency: Real
    steps: Mapping[int, float] | None
    """Input number -> amplitude where every command is a step at 0, which a batch can sample."""
    drawn: dict[tuple[float, ...], _Drawn] = field(default_factory=dict)
    """The curves of the frame before: a reference or a comparison that stands still is not computed again."""

    @property
    def diagram(self) -> Diagram:
        """The checked system."""
        return self.subject.diagram

    def overrides(self, vector: Sequence[float]) -> dict[str, float]:
        """Return parameter path -> value.

        Raises
        ------
        Problem
            422 for a vector of another length.
        """
        if len(vector) != len(self.parameters):
            raise invalid(f"a vector must be {len(self.parameters)} numbers, got {len(vector)}", "vectors")
        return dict(zip(self.parameters, vector, strict=True))


def open_panel(service: Installation, caller: Caller, request: LiveOpen) -> tuple[Panel, dict[str, Any]]:
    """Return the opened system, and what the page is told of it.

    Raises
    ------
    Problem
        422 with the place of what is wrong.
    """
    subject = subject_of(service, caller, request.system)
    diagram = subject.diagram
    for i, path in enumerate(request.parameters):
        info = diagram.parameters.get(path)
        if info is None:
            raise invalid(no_parameter(path, diagram.parameters), "parameters", i)
        if info.bound:
            raise invalid(f"{path} must be a number to be varied, but an expression gives it", "parameters", i)
    if request.input is None:
        signals: dict[str, Signal] = {diagram.inputs[0]: make("step", {})} if diagram.inputs else {}
    else:
        signals = signals_from_wire(
            request.input, diagram, place=("input",), read_channel=channel_reader(service, caller)
        )
    outputs = tuple(diagram.outputs if request.outputs is None else dict.fromkeys(request.outputs))
    for i, name in enumerate(outputs):
        check_name(name, diagram.outputs, name="output", what="the system's outputs", place=("outputs", i))
    chosen = request.output or (outputs or diagram.outputs)[0]
    check_name(chosen, diagram.outputs, name="output", what="the system's outputs", place=("output",))
    open_at, source, target = _frequency_of(request, diagram)
    service.computing.check_size(samples=request.samples, curves=len(outputs) + 1, variants=1)
    names = check_metrics(request.metrics) or ()
    duration = duration_from_wire(request.duration, place=("duration",))

    @at("system")
    def axes() -> tuple[float, Real]:
        first = simulate(diagram, signals=signals, outputs=outputs, duration=duration, samples=2, metrics=())
        if open_at is None and source is None:
            return float(first.time[-1]), np.zeros(0)
        seen = frequency_response(diagram, open_at=open_at, source=source, target=target, metrics=())
        return float(first.time[-1]), np.geomspace(seen.frequency[0], seen.frequency[-1], _FREQUENCIES)

    end, grid = service.computing.bounded(axes)
    steps = {place: signal.amplitude for place, signal in _steps(diagram, signals)}
    panel = Panel(
        subject=subject,
        parameters=tuple(request.parameters),
        signals=signals,
        outputs=outputs,
        metrics=_requests(names, signals, chosen, duration, (open_at, source, target)),
        open_at=open_at,
        source=source,
        target=target,
        time=np.linspace(0.0, end, request.samples),
        frequency=grid,
        steps=steps if len(steps) == len(signals) and not diagram.nonlinear else None,
    )
    measured = overlays(service, caller, request.measured, diagram, panel.time)
    return panel, {"type": "opened", **_described(panel), "measured": measured, "warnings": subject.warnings()}


def _frequency_of(request: LiveOpen, diagram: Diagram) -> tuple[Opening | None, str | None, str | None]:
    given = request.frequency
    if given is None:
        return None, None, None
    open_at = opening(given.open_at)
    check_open_at(open_at, diagram)
    if given.source is not None:
        check_name(given.source, diagram.inputs, name="from", what="the system's inputs", place=("frequency", "from"))
    if given.target is not None:
        check_name(given.target, diagram.outputs, name="to", what="the system's outputs", place=("frequency", "to"))
    return open_at, given.source, given.target


def _steps(diagram: Diagram, signals: Mapping[str, Signal]) -> list[tuple[int, Step]]:
    return [
        (diagram.inputs.index(name), signal)
        for name, signal in signals.items()
        if isinstance(signal, Step) and signal.start == 0.0
    ]


def _requests(
    names: Sequence[str],
    signals: Mapping[str, Signal],
    output: str,
    duration: float | None,
    where: tuple[Opening | None, str | None, str | None],
) -> dict[str, MetricRequest]:
    """Return what can be measured here; a metric of a loop needs one that is opened."""
    open_at, source, target = where
    found: dict[str, MetricRequest] = {}
    for name in names:
        domain = catalogue()[name].domain
        if domain == "time" and signals:
            found[name] = MetricRequest(metric=name, signals=signals, output=output, duration=duration)
        elif domain == "loop" and open_at is not None:
            found[name] = MetricRequest(metric=name, open_at=open_at)
        elif domain == "path" and signals:
            found[name] = MetricRequest(metric=name, source=source or next(iter(signals)), target=target or output)
        elif domain == "system":
            found[name] = MetricRequest(metric=name)
    return found


def _described(panel: Panel) -> dict[str, Any]:
    diagram = panel.diagram
    return {
        "system": dict(panel.subject.reference) if panel.subject.reference else None,
        "inputs": list(diagram.inputs),
        "outputs": [{"name": name, "unit": unit} for name, unit in diagram.output_units.items()],
        "parameters": [
            {
                "path": info.path,
                "value": info.value,
                "unit": info.unit,
                "lower": number(info.lower),
                "upper": number(info.upper),
                "scale": str(info.scale),
                "doc": info.doc,
                "bound": info.bound,
            }
            for info in diagram.parameters.values()
        ],
        "curves": list(panel.outputs),
        "metrics": list(panel.metrics),
        "duration": float(panel.time[-1]),
        "nonlinear": diagram.nonlinear,
    }


def curves(service: Installation, panel: Panel, seq: int, vectors: Sequence[Sequence[float]]) -> bytes:
    """Return one frame: a header in JSON, then every curve of every vector as float32.

    The frame is: length of the header (uint32), header, arrays one after the other, all little-endian. The header lists name
    and shape of each array: ``time`` (samples), ``outputs`` (vectors, outputs, samples), ``frequency`` (k), ``response``
    (vectors, 2, k: real and imaginary part) and ``poles`` (vectors, 2, n). What does not exist is NaN.
    """
    everything = {tuple(vector): panel.overrides(vector) for vector in vectors}
    found = service.computing.bounded(
        lambda: {vector: panel.drawn.get(vector) or _drawn(panel, given) for vector, given in everything.items()}
    )
    panel.drawn.clear()
    panel.drawn.update(found)
    each = [found[tuple(vector)] for vector in vectors]
    most = max(own.poles.size for own in each)
    placed = np.full((len(each), 2, most), np.nan)
    for k, own in enumerate(each):
        placed[k, 0, : own.poles.size], placed[k, 1, : own.poles.size] = own.poles.real, own.poles.imag
    arrays = {
        "time": panel.time,
        "outputs": np.stack([own.outputs for own in each]),
        "frequency": panel.frequency,
        "response": np.stack([own.response for own in each]),
        "poles": placed,
    }
    return _frame({"seq": seq, "variants": [own.verdict for own in each]}, arrays)


def _drawn(panel: Panel, overrides: Mapping[str, float]) -> _Drawn:
    """Return the curves at one set of values."""
    outputs = np.full((len(panel.outputs), panel.time.size), np.nan)
    response = np.full((2, panel.frequency.size), np.nan)
    try:
        verdict, poles = _curves_at(panel, overrides, outputs, response)
    except EngineError as error:
        told = {"verdict": str(Verdict.ILL_POSED), "advice": error.message}
        return _Drawn(outputs=outputs, response=response, poles=np.zeros(0, dtype=complex), verdict=told)
    return _Drawn(outputs=outputs, response=response, poles=poles, verdict={"verdict": verdict})


def _curves_at(
    panel: Panel, overrides: Mapping[str, float], outputs: Real, response: Real
) -> tuple[str, npt.NDArray[np.complex128]]:
    """Write the curves at one set of values; return the verdict of the system and its poles."""
    diagram = panel.diagram
    system = diagram.realize(overrides)
    quick = panel.steps is not None and not system.delays.size
    if quick:
        assert panel.steps is not None
        places = [diagram.outputs.index(name) for name in panel.outputs]
        outputs[:] = sampling.step_response(system, panel.steps, float(panel.time[-1]), panel.time.size)[places]
        poles = np.linalg.eigvals(system.a).astype(complex)
        verdict = _stability(poles)
    else:
        found = simulate(
            diagram, signals=panel.signals, overrides=overrides, outputs=panel.outputs,
            duration=float(panel.time[-1]), samples=panel.time.size, metrics=(),
        )  # fmt: skip
        outputs[:] = [found.curves[name] for name in panel.outputs]
        poles, verdict = np.zeros(0, dtype=complex), str(found.verdict)
    if panel.frequency.size:
        values = _response(panel, overrides, system)
        response[0], response[1] = values.real, values.imag
    return verdict, poles


def _response(panel: Panel, overrides: Mapping[str, float], system: LinearSystem) -> npt.NDArray[np.complex128]:
    diagram = panel.diagram
    if diagram.sampled:
        evaluation = Evaluation(diagram, overrides)
        if panel.open_at is not None:
            return evaluation.loop(panel.open_at).response(panel.frequency)
        return evaluation.path(str(panel.source), str(panel.target)).response(panel.frequency)
    if panel.open_at is not None:
        opened = diagram.realize(overrides, panel.open_at)
        assert opened.inputs[-1] == opened.outputs[-1] == LOOP
        return -sampling.frequency_response(opened, len(opened.inputs) - 1, len(opened.outputs) - 1, panel.frequency)
    assert panel.source is not None
    assert panel.target is not None
    source, target = diagram.inputs.index(panel.source), diagram.outputs.index(panel.target)
    return sampling.frequency_response(system, source, target, panel.frequency)


def _stability(poles: npt.NDArray[np.complex128]) -> str:
    """Return what a picture says at once; the exact verdict comes with the metrics."""
    if not poles.size:
        return str(Verdict.OK)
    size = float(np.abs(poles).max(initial=0.0))
    return str(Verdict.UNSTABLE if float(poles.real.max()) > 1e-9 * size else Verdict.OK)


def _frame(header: dict[str, Any], arrays: Mapping[str, Real]) -> bytes:
    parts = []
    for values in arrays.values():
        drawn = np.array(values, dtype=np.float64)
        drawn[~(np.abs(drawn) <= _DRAWABLE)] = np.nan
        parts.append(drawn.astype("<f4").tobytes())
    listed = [{"name": name, "shape": list(values.shape)} for name, values in arrays.items()]
    text = json.dumps({**header, "arrays": listed}, separators=(",", ":"), allow_nan=False).encode()
    # Arrays begin at a multiple of four bytes, so that the page reads them where they lie.
    text += b" " * (-len(text) % 4)
    return b"".join([struct.pack("<I", len(text)), text, *parts])


def measured(service: Installation, panel: Panel, seq: int, variant: int, vector: Sequence[float]) -> dict[str, Any]:
    """Return the metrics at one vector and, of the first, the elasticities by every parameter: the exact path.

    Raises
    ------
    RecalledError
        When it was recalled meanwhile.
    """
    overrides = panel.overrides(vector)
    names = list(panel.metrics)
    gradient = panel.parameters if variant == 0 else ()
    found = service.computing.bounded(
        lambda: measure(panel.diagram, list(panel.metrics.values()), overrides=overrides, gradient=gradient)
    )
    elasticities: dict[str, dict[str, float | None]] = {}
    for name, (value, slopes) in zip(names, found, strict=True):
        if slopes is not None and value.value:
            elasticities[name] = {
                path: number(float(slope) * overrides[path] / value.value)
                for path, slope in zip(gradient, slopes.values, strict=True)
            }
    return {
        "type": "metrics",
        "seq": seq,
        "variant": variant,
        "metrics": {name: measured_to_wire(value) for name, (value, _) in zip(names, found, strict=True)},
        "elasticities": elasticities,
    }
