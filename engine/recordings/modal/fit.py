"""Modes fitted to frequency response functions by weighted least squares, with the covariance of what is found.

    H_o(jω) ≈ Σ_r A_or/(jω - λ_r) + A*_or/(jω - λ*_r)  +  U_o + L_o/(jω)²,   λ = -ζ ω0 + j ω0 sqrt(1 - ζ²)

U and L stand for the modes above and below the band. Everything but ω0 and ζ is linear and eliminated (variable projection); the Jacobian is that of Kaufman.

References
----------
G. Golub, V. Pereyra, Inverse Problems 19 (2003) R1-R26 (variable projection, Kaufman's Jacobian).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.exact.frequency.fourier import Complex, Real

_LEAST_DAMPED = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Fitted:
    """Undamped frequencies (rad/s), damping ratios, their standard deviations, residues (responses, modes), the cost.

    ``cost`` is the weighted sum of squares; ``model`` (responses, lines) what the modes give.
    """

    frequency: Real
    damping: Real
    frequency_error: Real
    damping_error: Real
    residues: Complex
    model: Complex
    cost: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Lines:
    """What is fitted: ``w`` (lines,) rad/s, ``responses`` and ``weights`` (responses, lines)."""

    w: Real
    responses: Complex
    weights: Real

    @property
    def numbers(self) -> int:
        """Real numbers that are fitted."""
        return 2 * self.responses.size

    def unknowns(self, modes: int) -> int:
        """Return the unknowns of a model with so many modes."""
        return 2 * modes + len(self.responses) * (2 * modes + 2)

    def cost(self, frequency: Real, damping: Real) -> float:
        """Return the weighted sum of squares that modes leave whose residues are the best."""
        return float((_Projection(self, np.log(np.concatenate([frequency, damping]))).residuals() ** 2).sum())


def fit_modes(lines: Lines, frequency: Real, damping: Real, *, line_width: float) -> Fitted:
    """Return the modes nearest to a start.

    Parameters
    ----------
    lines : Lines
        Weights are inverse standard deviations where those are known.
    frequency, damping : ndarray, shape (modes,)
        Start: rad/s, ratios.
    line_width : float
        Lines that share their random error (the noise bandwidth of the window).
    """
    from scipy.optimize import least_squares  # noqa: PLC0415 - a third of a second

    count = len(frequency)
    start = np.log(np.concatenate([frequency, np.maximum(damping, 2 * _LEAST_DAMPED)]))
    low = np.concatenate([np.full(count, np.log(lines.w[0] / 2)), np.full(count, np.log(_LEAST_DAMPED))])
    high = np.concatenate([np.full(count, np.log(lines.w[-1] * 2)), np.full(count, np.log(0.999))])
    start = np.clip(start, low + 1e-9, high - 1e-9)

    def residuals(x: Real) -> Real:
        return _Projection(lines, x).residuals()

    def jacobian(x: Real) -> Real:
        return _Projection(lines, x).jacobian()

    found = least_squares(
        residuals,
        start,
        jac=jacobian,
        bounds=(low, high),
        x_scale="jac",
        xtol=1e-10,
        ftol=1e-10,
        gtol=1e-10,
        max_nfev=200,
    )
    end = _Projection(lines, found.x)
    slopes = end.jacobian()
    cost = float((end.residuals() ** 2).sum())
    spread = cost / max(lines.numbers - lines.unknowns(count), 1)
    covariance = np.linalg.pinv(slopes.T @ slopes) * spread * line_width
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    w0, zeta = np.exp(found.x[:count]), np.exp(found.x[count:])
    return Fitted(
        frequency=w0,
        damping=zeta,
        frequency_error=errors[:count] * w0,
        damping_error=errors[count:] * zeta,
        residues=np.array([c[:count] + 1j * c[count : 2 * count] for c in end.coefficients]),
        model=np.array([end.basis @ c for c in end.coefficients]),
        cost=cost,
    )


class _Projection:
    """The best linear coefficients at ln(ω0), ln(ζ), and how the residuals change with these."""

    def __init__(self, lines: Lines, x: Real) -> None:
        count = len(x) // 2
        self._lines = lines
        self._w0, self._zeta = np.exp(x[:count]), np.exp(x[count:])
        s = 1j * lines.w
        root = np.sqrt(1 - self._zeta**2)
        self._poles = self._w0 * (-self._zeta + 1j * root)
        above = 1 / (s[:, None] - self._poles)
        below = 1 / (s[:, None] - self._poles.conj())
        rest = np.stack([np.ones_like(s), 1 / s**2], axis=1)
        self.basis: Complex = np.concatenate([above + below, 1j * (above - below), rest], axis=1)
        self._scale = np.linalg.norm(self.basis, axis=0)
        self._ranges: list[Real] = []
        self.coefficients: list[Real] = []
        self._left: list[Real] = []
        for response, weight in zip(lines.responses, lines.weights, strict=True):
            columns = _real(self.basis / self._scale * weight[:, None])
            wanted = _real(response * weight)
            orthogonal, triangle = np.linalg.qr(columns)
            solved, *_ = np.linalg.lstsq(triangle, orthogonal.T @ wanted, rcond=None)
            self._ranges.append(orthogonal)
            self.coefficients.append(solved / self._scale)
            self._left.append(wanted - columns @ solved)

    def residuals(self) -> Real:
        """Return the weighted residuals of all responses, real and imaginary."""
        return np.concatenate(self._left)

    def jacobian(self) -> Real:
        """Return their derivatives, shape (numbers, 2 modes)."""
        count = len(self._w0)
        s = 1j * self._lines.w[:, None]
        root = np.sqrt(1 - self._zeta**2)
        # the pole's derivatives by ln(ω0) and by ln(ζ)
        moves = (self._poles, self._w0 * self._zeta * (-1 - 1j * self._zeta / root))
        rows = []
        for weight, orthogonal, c in zip(self._lines.weights, self._ranges, self.coefficients, strict=True):
            residue = c[:count] + 1j * c[count : 2 * count]
            parts = []
            for move in moves:
                above = residue * move / (s - self._poles) ** 2
                below = (residue * move).conj() / (s - self._poles.conj()) ** 2
                parts.append(above + below)
            change = _real(np.concatenate(parts, axis=1) * weight[:, None])
            rows.append(-(change - orthogonal @ (orthogonal.T @ change)))
        return np.concatenate(rows)


def _real(values: Complex) -> Real:
    return np.concatenate([values.real, values.imag])
