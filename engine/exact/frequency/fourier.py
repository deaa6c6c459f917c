"""The Fourier integral of a continuous response in closed form: no sampling, no leakage, no aliasing.

    Y(jω) = ∫₀^∞ y(t) e^{-jωt} dt = Σ_k h_k e^{-jωc_k} Σ_n a_kn 2 (-j)^n j_n(ωh_k)  +  y(∞) e^{-jωT} / (jω)

Piece k has the centre c_k, the half width h_k and the Legendre coefficients a_kn; j_n are spherical Bessel functions
(the last term is what a response that settles at y(∞) ≠ 0 adds after its last piece, for ω > 0).

References
----------
NIST Digital Library of Mathematical Functions, 10.54.2 (Poisson's integral, the transform of a Legendre polynomial).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt
from numpy.polynomial import legendre

from engine.exact.time.chebyshev import DEGREE, NODES
from engine.exact.time.curve import Curve
from engine.model.linear_system import Array
from engine.model.tangent import slopes

Real = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

_MOST_NUMBERS = 2_000_000
"""Complex numbers at once, pieces times frequencies: 32 MB."""

_SAME_WIDTH = 11  # decimals of ln h: halving leaves widths that differ by rounding only


@dataclass(frozen=True, kw_only=True, eq=False)
class Transform:
    """Y(jω): ``value`` (frequencies,) in output·s; ``slopes`` (lanes, frequencies) by what the lanes carry."""

    value: Complex
    slopes: Complex


def transform(curve: Curve, frequencies: Real, *, final: Array | None = None) -> Transform:
    """Return the Fourier integral of a response from the curve's beginning to infinity.

    Parameters
    ----------
    curve : Curve
        The response until it no longer moves, or all there is of it.
    frequencies : ndarray, shape (frequencies,)
        rad/s, >= 0; > 0 where ``final`` is given and not 0.
    final : ndarray, shape (lanes,), optional
        The value that is held for ever after the curve; without it the response is 0 there.

    Returns
    -------
    Transform
        Unit of the curve times s.
    """
    lanes = curve.edges.shape[1]
    carried = lanes if np.iscomplexobj(curve.values) or np.iscomplexobj(curve.edges) else 0
    value = np.zeros(len(frequencies), dtype=np.complex128)
    slope = np.zeros((carried, len(frequencies)), dtype=np.complex128)
    pieces = _Pieces.of(curve)
    chunk = max(1, _MOST_NUMBERS // len(curve.values))
    for start in range(0, len(frequencies), chunk):
        span = slice(start, start + chunk)
        for group in pieces.alike():
            here = group.integral(frequencies[span], carried)
            value[span] += here.value
            slope[:, span] += here.slopes
    if final is not None and np.any(final != 0):
        held = np.exp(-1j * frequencies * curve.end) / (1j * frequencies)
        value += float(np.ravel(final)[0].real) * held
        slope += np.multiply.outer(np.broadcast_to(slopes(np.asarray(final)), (lanes,))[:carried], held)
    return Transform(value=value, slopes=slope)


@cache
def _to_legendre() -> Real:
    """Return the matrix from node values to Legendre coefficients, shape (N + 1, N + 1)."""
    return np.asarray(np.linalg.inv(legendre.legvander(2 * NODES - 1, DEGREE)))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pieces:
    """Pieces as Legendre series: ``a`` (pieces, N + 1), ``h`` and ``c`` (pieces,), and what the lanes carry of each."""

    a: Real
    h: Real
    c: Real
    da: Real
    dh: Real
    dc: Real

    @classmethod
    def of(cls, curve: Curve) -> _Pieces:
        h, c = np.diff(curve.edges, axis=0) / 2, (curve.edges[1:] + curve.edges[:-1]) / 2
        a = np.einsum("nj,kjp->knp", _to_legendre(), curve.values)
        return cls(a=a[:, :, 0].real.copy(), h=h[:, 0].real, c=c[:, 0].real, da=slopes(a), dh=slopes(h), dc=slopes(c))

    def alike(self) -> list[_Pieces]:
        """Return the pieces in groups of one width, which share their Bessel functions."""
        _, group = np.unique(np.round(np.log(self.h), _SAME_WIDTH), return_inverse=True)
        return [
            _Pieces(a=self.a[k], h=self.h[k], c=self.c[k], da=self.da[k], dh=self.dh[k], dc=self.dc[k])
            for k in (np.flatnonzero(group == number) for number in range(group.max() + 1))
        ]

    def integral(self, w: Real, carried: int) -> Transform:
        """Return the integral over these pieces, all of the same width, with the slopes of ``carried`` lanes."""
        from scipy.special import spherical_jn  # noqa: PLC0415 - a twentieth of a second

        n = np.arange(DEGREE + 1)[:, None]
        turn, angle = 2 * (-1j) ** n, w * self.h[0]
        bessel = turn * spherical_jn(n, angle[None])
        wave = self.h[:, None] * np.exp(-1j * np.multiply.outer(self.c, w))
        series = self.a @ bessel
        value = np.einsum("kf,kf->f", wave, series)
        found = np.zeros((carried, len(w)), dtype=np.complex128)
        if carried:
            found += np.einsum("kf,knp,nf->pf", wave, self.da, bessel, optimize=True)
        if carried and (self.dh.any() or self.dc.any()):
            bend = self.a @ (turn * spherical_jn(n, angle[None], derivative=True))
            widening = self.dh / self.h[:, None]
            found += np.einsum("kp,kf->pf", widening, wave * (series + angle * bend))
            found += np.einsum("kp,kf->pf", self.dc, -1j * w * wave * series)
        return Transform(value=value, slopes=found)
