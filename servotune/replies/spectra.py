"""Spectra of systems and of recordings."""

from __future__ import annotations

from typing import Any, NotRequired, TypedDict

from servotune.replies.values import Warned


class Harmonics(TypedDict):
    """Amplitudes and phases (rad, cosines at t = 0) of the orders 1, 2, ... of a fundamental (rad/s)."""

    fundamental: float
    mean: float
    amplitude: list[float]
    phase: list[float]
    thd: float | None
    unit: str


class BandEnergy(TypedDict):
    """Energy or mean square in a band."""

    value: float
    unit: str


class SpectrumVariant(TypedDict):
    """The spectrum for one set of parameter values; frequencies in rad/s."""

    parameters: dict[str, float]
    verdict: str
    advice: NotRequired[str | None]
    frequency: list[float]
    value: list[float]
    phase: NotRequired[list[float] | None]
    resolution: NotRequired[float | None]
    averages: NotRequired[int | None]
    harmonics: NotRequired[Harmonics | None]
    band: NotRequired[BandEnergy | None]


class Spectrum(TypedDict):
    """Spectra, their common unit, and the window of estimates."""

    quantity: str
    unit: str
    window: dict[str, Any] | None
    variants: list[SpectrumVariant]
    system: dict[str, Any] | None
    warnings: list[Warned]
