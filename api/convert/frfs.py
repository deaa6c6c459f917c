"""Measured frequency response functions as replies, and what was asked of them as settings of the core."""

from __future__ import annotations

from typing import Any

import numpy as np

from api.convert.values import number, numbers, optional_si, si
from api.problems.documents import at
from api.problems.pointers import Place
from api.schemas.frfs import FrfRequest, SensorResponse
from engine.exact.frequency.fourier import Complex
from engine.recordings.modal.modes import Modes
from engine.recordings.spectra.comparison import Comparison
from engine.recordings.spectra.frf import Doubt, Frf, confidence, unwrapped
from engine.recordings.spectra.sensors import Sensor
from engine.recordings.spectra.stepped_sine import SineStep

_NAMED = {
    "kg*m/s**2": "N",
    "kg*m**2/s**2": "N*m",
    "kg/m/s**2": "Pa",
    "kg*m**2/s**3": "W",
    "kg*m**2/s**3/A": "V",
}
"""SI units of channels that have names of their own."""

_CAUSES = {
    "averages": "segment",
    "delay": "segment",
    "frequency": "steps",
    "leakage": "window",
    "sweep": "window",
    "not_settled": "settle",
    "resonance_bias": "segment",
    "unit": "output",
}
"""Kind of a doubt -> the setting that removes it."""


def named(unit: str) -> str:
    """Return an SI unit by its own name where it has one.

    >>> named("kg*m/s**2"), named("m/s")
    ('N', 'm/s')
    """
    return _NAMED.get(unit, unit)


def ratio_unit(output: str, input: str) -> str:  # noqa: A002 - the contract's word
    """Return the unit of a response over an input, both in SI.

    >>> ratio_unit("m", "kg*m/s**2"), ratio_unit("m", "m"), ratio_unit("m", ""), ratio_unit("", "kg*m**2/s**2")
    ('m/N', '1', 'm', '1/(N*m)')
    """
    above, below = named(output) or "1", named(input) or "1"
    if above == below:
        return "1"
    if below == "1":
        return above
    return f"{above}/({below})" if any(sign in below for sign in "*/") else f"{above}/{below}"


def steps_from_wire(request: FrfRequest) -> tuple[SineStep, ...]:
    """Return the sines of a stepped run."""
    made = []
    for i, step in enumerate(request.steps or ()):
        frequency = si(step.frequency, "rad/s", name="frequency", place=("steps", i, "frequency"))
        start, end = (si(getattr(step, key), "s", name=key, place=("steps", i, key)) for key in ("start", "end"))
        made.append(SineStep(frequency=frequency, start=start, end=end))
    return tuple(made)


def sensor_from_wire(given: SensorResponse | None, *, place: Place) -> Sensor | None:
    """Return what a sensor does, None for an ideal one.

    Raises
    ------
    api.problems.documents.Problem
        422 with the place of a number out of its bounds, or of a wrong unit.
    """
    if given is None:
        return None
    with at(*place):
        return Sensor(
            delay=si(given.delay, "s", name="delay", place=("delay",)),
            coupling=optional_si(given.coupling, "rad/s", name="coupling", place=("coupling",)),
            frequency=_points(given.frequency, "rad/s", "frequency"),
            magnitude=None if given.magnitude is None else np.array(given.magnitude, dtype=np.float64),
            phase=_points(given.phase, "rad", "phase"),
        )


def _points(given: list[Any] | None, unit: str, name: str) -> Any:
    if given is None:
        return None
    return np.array([si(value, unit, name=name, place=(name, i)) for i, value in enumerate(given)])


def frf_to_wire(frf: Frf, *, output: str, input: str, level: float) -> dict[str, Any]:  # noqa: A002 - as above
    """Return one measured response; ``output`` and ``input`` are the SI units of both channels."""
    band = confidence(frf, level)
    bounds = ("magnitude_lower", "magnitude_upper", "phase_lower", "phase_upper")
    return {
        "unit": ratio_unit(output, input),
        "response_unit": named(output),
        "magnitude": numbers(np.abs(frf.value)),
        "phase": numbers(unwrapped(frf.value)),
        "real": numbers(frf.value.real),
        "imag": numbers(frf.value.imag),
        "coherence": None if frf.coherence is None else numbers(frf.coherence),
        **{name: None if band is None else numbers(getattr(band, name)) for name in bounds},
        "doubts": [
            {"kind": doubt.kind, "detail": doubt.detail, "frequency": number(doubt.frequency)} for doubt in frf.doubts
        ],
    }


def doubt_to_warning(doubt: Doubt, output: str) -> dict[str, str]:
    """Return a doubt as a warning at the setting that would remove it."""
    return {"pointer": f"/{_CAUSES[doubt.kind]}", "detail": f"{output}: {doubt.detail}"}


def simulated_to_wire(simulated: Complex, found: Comparison) -> dict[str, Any]:
    """Return a model's response beside a measured one."""
    return {
        "magnitude": numbers(np.abs(simulated)),
        "phase": numbers(unwrapped(simulated)),
        "deviation_db": numbers(found.deviation),
        "phase_deviation": numbers(found.phase_deviation),
        "median_deviation_db": number(found.median_deviation),
        "worst_deviation_db": number(found.worst_deviation),
        "worst_frequency": number(found.worst_frequency),
        "relative_error_percent": number(found.relative_error_percent),
        "within_percent": number(found.within_percent),
    }


def modes_to_wire(found: Modes, *, form: str | None, times: float) -> dict[str, Any]:
    """Return modes with bounds ``times`` their standard deviations away."""
    modes = []
    for mode in found.modes:
        wide, deep = times * mode.frequency_error, times * mode.damping_error
        modes.append(
            {
                "frequency": number(mode.frequency),
                "frequency_lower": number(mode.frequency - wide),
                "frequency_upper": number(mode.frequency + wide),
                "damping_ratio": number(mode.damping),
                "damping_ratio_lower": number(mode.damping - deep),
                "damping_ratio_upper": number(mode.damping + deep),
                "residues": {
                    name: {"real": number(value.real), "imag": number(value.imag)}
                    for name, value in mode.residues.items()
                },
                "doubt": mode.doubt,
            }
        )
    return {
        "modes": modes,
        "relative_error_percent": number(found.relative_error_percent),
        "form": form,
        "band": [number(found.frequency[0]), number(found.frequency[-1])],
        "lines_left_out": found.left_out,
    }
