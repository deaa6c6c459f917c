"""Spectra of systems and of recordings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from servotune import plots, tables
from servotune.replies.base import Reply
from servotune.replies.values import Warned
from servotune.replies.variants import OfVariants

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


class Harmonics(Reply):
    """Amplitudes and phases (rad, cosines at t = 0) of the orders 1, 2, ... of a fundamental (rad/s)."""

    fundamental: float
    mean: float
    amplitude: list[float]
    phase: list[float]
    thd: float | None
    unit: str


class BandEnergy(Reply):
    """Energy or mean square in a band."""

    value: float
    unit: str


class SpectrumVariant(Reply):
    """The spectrum for one set of parameter values; frequencies in rad/s."""

    parameters: dict[str, float]
    verdict: str
    advice: str | None
    frequency: list[float]
    value: list[float]
    phase: list[float] | None
    resolution: float | None
    averages: int | None
    harmonics: Harmonics | None
    band: BandEnergy | None

    def to_pandas(self) -> pd.DataFrame:
        """Return the values over the frequency (rad/s), and the phase (rad) where there is one."""
        curves = {"value": self["value"], "phase": self.phase}
        known = {name: curve for name, curve in curves.items() if curve is not None}
        return tables.frame("frequency", "rad/s", self.frequency, known)

    def summary(self) -> str:
        """Return what is told of it in a line."""
        return f"{self.verdict}, {len(self.frequency)} frequencies"


class Spectrum(OfVariants):
    """Spectra, their common unit, and the window of estimates."""

    quantity: str
    unit: str
    window: dict[str, Any] | None
    variants: list[SpectrumVariant]
    system: dict[str, Any] | None
    warnings: list[Warned]

    def to_pandas(self) -> pd.DataFrame:
        """Return the values over the frequency (rad/s); of several variants their numbers come first."""
        return tables.stacked(self.variants, SpectrumVariant.to_pandas)

    def plot(self, axes: list[Axes] | None = None) -> list[Axes]:
        """Draw the values over the frequency."""
        return plots.spectrum(self, axes)
