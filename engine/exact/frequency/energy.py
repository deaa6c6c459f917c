"""Energy of a response in a band of its spectrum.

    E = (1/π) ∫ |Y(jω)|² dω from low to high;   over all frequencies that is ∫ y² dt (Parseval)

|Y|² holds no oscillation over ω faster than the response is long, so that Gauss-Legendre panels of a known width
integrate it to rounding.
"""

from __future__ import annotations

import numpy as np

from engine.exact.frequency.fourier import Real, transform
from engine.exact.time.curve import Curve
from engine.model.errors import UnresolvedError
from engine.model.linear_system import Array
from engine.model.tangent import INFINITESIMAL

MOST_POINTS = 200_000

_POINTS = 24  # of a panel that holds four periods of the fastest oscillation: about (e 4π / 96)^48 = 3e-22 is lost
_CYCLES = 4
_SILENT = 1e-16
"""What is left when only this part of the energy is still to come decides nothing about the width of panels."""


def band_energy(curve: Curve, low: float, high: float, *, final: Array | None = None) -> Array:
    """Return the energy between two angular frequencies.

    Parameters
    ----------
    curve : Curve
        The response until it no longer moves.
    low, high : float
        rad/s, 0 <= low < high; low > 0 where ``final`` is given and not 0.
    final : ndarray, shape (lanes,), optional
        The value that is held after the curve.

    Returns
    -------
    ndarray, shape (lanes,)
        In (unit of the curve)² s, with its derivatives.

    Raises
    ------
    UnresolvedError
        When the band times the length of the response needs more than :data:`MOST_POINTS` frequencies.
    """
    frequencies, weights = quadrature(low, high, _lasting(curve))
    found = transform(curve, frequencies, final=final)
    energy = np.full(curve.edges.shape[1], weights @ np.abs(found.value) ** 2)
    if not len(found.slopes):
        return energy
    return np.asarray(energy + 1j * INFINITESIMAL * (2 * (found.slopes * found.value.conj()).real @ weights))


def quadrature(low: float, high: float, length: float) -> tuple[Real, Real]:
    """Return frequencies (rad/s) and weights with which |Y|² is summed to the energy of a response that lasts ``length`` s.

    Raises
    ------
    UnresolvedError
        When more than :data:`MOST_POINTS` would be needed.
    """
    panels = max(1, int(np.ceil((high - low) * length / (2 * np.pi * _CYCLES))))
    if panels * _POINTS > MOST_POINTS:
        msg = (
            f"the energy of a band must be resolved by at most {MOST_POINTS} frequencies, but {high - low:.3g} rad/s of "
            f"a response that lasts {length:.3g} s need {panels * _POINTS}"
        )
        raise UnresolvedError(msg)
    nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
    edges = np.linspace(low, high, panels + 1)
    half = np.diff(edges)[:, None] / 2
    return (edges[:-1, None] + half * (nodes + 1)).ravel(), (half * weights).ravel() / np.pi


def _lasting(curve: Curve) -> float:
    """Return how long the response lasts before all but a silent rest of its energy has passed, s."""
    times: Real = curve.times
    nodes = curve.values[:, :, 0].real
    energies = np.diff(times) * (np.abs(nodes - nodes[-1, -1]) ** 2).max(axis=1)
    left = np.cumsum(energies[::-1])[::-1]
    loud = np.flatnonzero(left > _SILENT * left[0])
    return float(times[loud[-1] + 1] - times[0]) if loud.size else float(times[1] - times[0])
