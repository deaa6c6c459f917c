"""Spectra as replies, with their units."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from api.convert.values import number, numbers
from engine.exact.frequency.fourier import Complex, Real
from engine.exact.frequency.harmonics import Harmonics
from engine.recordings.spectra.sampled import Spectrum, Window

Quantity = Literal["amplitude", "density", "transform"]


def unit_of(quantity: Quantity, unit: str) -> str:
    """Return the unit of a spectrum of a signal of this unit ("1" or "" where it has none).

    >>> unit_of("density", "m/s"), unit_of("transform", "1")
    ('(m/s)**2/Hz', 's')
    """
    if quantity == "amplitude":
        return unit or "1"
    if unit in ("", "1"):
        return "1/Hz" if quantity == "density" else "s"
    return f"{squared(unit)}/Hz" if quantity == "density" else f"{unit}*s"


def squared(unit: str) -> str:
    """Return the square of a unit.

    >>> squared("m"), squared("m/s"), squared("1")
    ('m**2', '(m/s)**2', '1')
    """
    if unit in ("", "1"):
        return "1"
    return f"({unit})**2" if any(sign in unit for sign in "*/") else f"{unit}**2"


def energy_unit(unit: str) -> str:
    """Return the unit of the energy of a response.

    >>> energy_unit("m/s"), energy_unit("1")
    ('(m/s)**2*s', 's')
    """
    return "s" if unit in ("", "1") else f"{squared(unit)}*s"


def estimate_to_wire(found: Spectrum) -> dict[str, Any]:
    """Return an estimated spectrum."""
    body: dict[str, Any] = {
        "frequency": numbers(found.frequency),
        "value": numbers(found.value),
        "resolution": number(found.resolution),
        "averages": found.averages,
    }
    return body if found.phase is None else {**body, "phase": numbers(found.phase)}


def transform_to_wire(frequencies: Real, values: Complex) -> dict[str, Any]:
    """Return an exact Fourier integral as magnitude and phase."""
    return {
        "frequency": numbers(frequencies),
        "value": numbers(np.abs(values)),
        "phase": numbers(np.unwrap(np.angle(values))),
    }


def harmonics_to_wire(found: Harmonics, unit: str) -> dict[str, Any]:
    """Return harmonics, order 1 first."""
    return {
        "fundamental": number(found.fundamental),
        "mean": number(found.mean),
        "amplitude": numbers(found.amplitude),
        "phase": numbers(found.phase),
        "thd": number(found.thd),
        "unit": unit or "1",
    }


def window_to_wire(window: Window) -> dict[str, Any]:
    """Return what a window does to a spectrum."""
    return {
        "kind": window.kind,
        "coherent_gain": number(window.coherent_gain),
        "noise_bandwidth": number(window.noise_bandwidth),
    }
