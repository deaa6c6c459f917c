"""Processing steps of a request as those of the core, and processed channels as descriptions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from api.convert.values import check_unit, optional_si
from api.problems.documents import at
from api.problems.pointers import Place
from api.schemas import processing as wire
from engine.recordings.processing.calibrate import Calibrate
from engine.recordings.processing.cut import Cut
from engine.recordings.processing.decimate import Decimate
from engine.recordings.processing.detrend import Detrend
from engine.recordings.processing.differentiate import Differentiate
from engine.recordings.processing.fill import Fill
from engine.recordings.processing.integrate import Integrate
from engine.recordings.processing.record import Record, Step
from engine.recordings.processing.resample import Resample
from engine.recordings.processing.select import Select
from engine.recordings.processing.zero_phase import ZeroPhaseFilter

_STEPS: Mapping[str, Callable[..., Step]] = {
    "calibrate": Calibrate,
    "cut": Cut,
    "decimate": Decimate,
    "detrend": Detrend,
    "differentiate": Differentiate,
    "fill": Fill,
    "filter": ZeroPhaseFilter,
    "integrate": Integrate,
    "resample": Resample,
    "select": Select,
}
"""The fields of a step on the wire are those of the core's, quantities in SI."""
_UNITS = {"start": "s", "end": "s", "longest": "s", "frequency": "rad/s", "low_pass": "rad/s", "high_pass": "rad/s"}


def steps_from_wire(request: wire.ProcessingRequest) -> tuple[Step, ...]:
    """Return the steps of a processing.

    Raises
    ------
    api.problems.documents.Problem
        422 with the place of a number out of its bounds, or of a wrong unit.
    """
    made = []
    for number, step in enumerate(request.steps):
        place: Place = ("steps", number)
        with at(*place):
            made.append(_step(step))
    return tuple(made)


def _step(document: wire.StepDocument) -> Step:
    given = {name: value for name, value in dict(document).items() if name != "kind"}
    if given.get("unit") is not None:
        check_unit(given["unit"], name=f"unit of {given['channel']}", place=("unit",))
    return _STEPS[document.kind](**{name: _value(name, value) for name, value in given.items()})


def _value(name: str, given: Any) -> Any:
    if isinstance(given, list):
        return tuple(_one(name, value, (name, i)) for i, value in enumerate(given))
    return _one(name, given, (name,))


def _one(name: str, given: Any, place: Place) -> Any:
    return optional_si(given, _UNITS[name], name=name, place=place) if name in _UNITS else given


def described(record: Record, known: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the descriptions of processed channels; quantity and sensor stay with a channel that still measures the same.

    Parameters
    ----------
    record : Record
    known : mapping
        Name -> description of the source's channels.
    """
    return [_channel(name, record.unit(name), known.get(name, {})) for name in record.channels]


def _channel(name: str, unit: str, source: Mapping[str, Any]) -> dict[str, Any]:
    channel = {"name": name, "unit": unit}
    if source.get("unit", "") == unit:
        channel |= {key: source[key] for key in ("quantity", "sensor") if source.get(key)}
    return channel
