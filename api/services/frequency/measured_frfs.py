"""Frequency response functions of channels, as a request wants them estimated: for whoever looks at them, or fits a model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from api.convert.frfs import sensor_from_wire, steps_from_wire
from api.convert.values import band_from_wire, optional_si, si
from api.problems.documents import at, invalid
from api.schemas.frfs import FrfRequest
from api.services.frequency.measured_parts import Part
from engine.recordings.spectra.averaged import averaged_frf
from engine.recordings.spectra.frf import Frf
from engine.recordings.spectra.motion import in_form
from engine.recordings.spectra.multisine import multisine_frf
from engine.recordings.spectra.sensors import Sensor, correction
from engine.recordings.spectra.stepped_sine import stepped_sine_frf

_SEGMENTS, _LONGEST = 8, 65_536
"""Parts that a recording is cut into unless the request says how long a segment is, and the most samples of such a one."""


def frfs_of(
    request: FrfRequest, measured: Part, names: Sequence[str], sensors: Mapping[str, Sensor | None]
) -> dict[str, Frf]:
    """Return the responses of output channels over the input, of the lines that are wanted, without what sensors do.

    Raises
    ------
    Problem, EngineError
        For what cannot be estimated so.
    """
    found = dict(measured.frfs) or {name: _frf(request, measured, name) for name in names}
    band = band_from_wire(request.band, place=("band",))
    if band is not None:
        found = {name: frf.within(*band) for name, frf in found.items()}
    return {name: _corrected(frf, request.input, name, sensors) for name, frf in found.items()}


def sensors_of(request: FrfRequest, names: Sequence[str]) -> dict[str, Sensor | None]:
    """Return what is known of the channels' sensors.

    Raises
    ------
    Problem
        422 at a channel that is not used.
    """
    sensors = {}
    for name, given in (request.corrections or {}).items():
        if name not in {request.input, *names}:
            known = ", ".join((request.input, *names))
            raise invalid(f"corrections must be of channels used here ({known}), got {name!r}", "corrections", name)
        sensors[name] = sensor_from_wire(given, place=("corrections", name))
    return sensors


def segment_of(request: FrfRequest, measured: Part) -> int:
    """Return the samples of each averaged segment."""
    seconds = optional_si(request.segment, "s", name="segment", place=("segment",))
    return (
        min(measured.longest // _SEGMENTS, _LONGEST)
        if seconds is None
        else round(min(max(seconds * measured.rate, 0.0), 1e12))
    )


def _frf(request: FrfRequest, measured: Part, name: str) -> Frf:
    pairs = list(zip(measured.channels[request.input], measured.channels[name], strict=True))
    if request.estimator in ("H1", "H2", "Hv"):
        return averaged_frf(
            pairs,
            measured.rate,
            estimator=request.estimator,
            segment=segment_of(request, measured),
            window=request.window,
            overlap=request.overlap,
            removal=request.removal,
        )
    if len(pairs) > 1:
        detail = f"part must lie in one experiment for {request.estimator}, got {len(pairs)} of them"
        raise invalid(detail, "part")
    settle = si(request.settle, "s", name="settle", place=("settle",))
    x, y = (recorded[:] for recorded in pairs[0])
    if request.estimator == "multisine":
        period = si(request.period, "s", name="period", place=("period",))
        return multisine_frf(x, y, measured.rate, period=period, settle=settle)
    return stepped_sine_frf(x, y, measured.rate, steps_from_wire(request), settle=settle)


def _corrected(frf: Frf, source: str, target: str, sensors: Mapping[str, Sensor | None]) -> Frf:
    if not sensors:
        return frf
    for name in (source, target):
        with at("corrections", name):
            if (sensor := sensors.get(name)) is not None:
                sensor.response(frf.frequency)
    return frf.times(correction(frf.frequency, input=sensors.get(source), output=sensors.get(target)))


def formed(request: FrfRequest, frf: Frf, unit: str) -> tuple[Frf, str]:
    """Return a response in the form that is wanted, and its unit."""
    return (frf, unit) if request.form is None else in_form(frf, request.form, unit=unit)
