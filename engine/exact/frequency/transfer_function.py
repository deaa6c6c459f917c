"""The transfer function of one path at given frequencies, delays included, and its slope.

    G(jω) = C1 x + D12 w + D11,   F(jω) [x; w] = [B1; D21],   F(s) = [[s I - A, -B2], [-C2, diag(e^{s τ}) - D22]]

Real and imaginary part are computed as two real quantities, so that both carry their infinitesimals.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.linalg import schur

from engine.exact.frequency.roots import SAME
from engine.model.tangent import INFINITESIMAL, evened, solve, solve_each

if TYPE_CHECKING:
    from engine.exact.frequency.shapes import Shape
    from engine.model.linear_system import Array, LaneSystem

Real = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

_SILENT = 1e-100  # below, the curve of many lags in a row is rounding, and then 0
_FEW_STATES = 40
_EPS = float(np.finfo(float).eps)
_MOST_NUMBERS = 2_000_000
"""Complex numbers in one chunk of an evaluation: 32 MB."""


class TransferFunction:
    """The transfer function of a system with one input and one output.

    Parameters
    ----------
    system : LaneSystem
        One input, one output.
    solved : LaneSystem, optional
        The same in equations that keep more digits (see :mod:`engine.diagram.rates`).
    """

    def __init__(self, system: LaneSystem, *, solved: LaneSystem | None = None) -> None:
        self.system = system
        self._solved = system if solved is None else solved

    def __call__(self, frequencies: Real) -> Complex:
        """Return G(jω) for ``frequencies`` in rad/s, shape (k,); infinite at a pole on the axis."""
        return self.with_rounding(frequencies)[0]

    def with_rounding(self, frequencies: Real) -> tuple[Complex, Real]:
        """Return G(jω) and the size of what rounding may have made of it, both of shape (k,)."""
        size = self._solved.n + self._solved.m
        if not size:
            direct_gain = complex(self.system.d11[0, 0, 0].real)
            return np.full(len(frequencies), direct_gain), np.zeros(len(frequencies))
        # a whole factorisation for each frequency holds the relative accuracy far down a roll-off; many states cost too much
        direct = size <= _FEW_STATES
        solve_some = self._factorised if direct else self._triangular
        step = max(1, int(_MOST_NUMBERS / (size * size if direct else size * (1 + self.system.m))))
        chunks = np.split(frequencies, range(step, len(frequencies), step))
        with np.errstate(all="ignore"):
            values, terms = map(np.concatenate, zip(*map(solve_some, chunks), strict=True))
        return np.where(np.isnan(values), np.inf + 0j, values), size * _EPS * terms

    def _factorised(self, frequencies: Real) -> tuple[Complex, Real]:
        """Return G(jω) from F(jω) [x; w] = [B1; D21], factorised for each frequency, and the size of the terms of its sum."""
        s = self._solved
        f, right, read, _ = self._equations(frequencies)
        try:
            inner = solve_each(f, right)[..., 0]
        except np.linalg.LinAlgError:  # one of them is exactly a pole
            return self._triangular(frequencies)
        through = complex(s.d11[0, 0, 0].real)
        return np.asarray(inner @ read + through), np.asarray(np.abs(inner) @ np.abs(read) + abs(through))

    def _equations(self, frequencies: Real) -> tuple[Complex, Complex, Real, Real]:
        """Return F(jω) and its right side at each frequency, what is read of the solution, and what made the rows of one size.

        A weak coupling must not drown in the pivot of a strong one.
        """
        s = self._solved
        n, m, k = s.n, s.m, len(frequencies)
        f = np.zeros((k, n + m, n + m), dtype=complex)
        f[:, :n, :n] = 1j * frequencies[:, None, None] * np.eye(n) - s.a[0].real
        f[:, :n, n:] = -s.b2[0].real
        f[:, n:, :n] = -s.c2[0].real
        turns = np.exp(1j * frequencies[:, None] * s.delays[0].real)
        f[:, n:, n:] = turns[:, :, None] * np.eye(m) - s.d22[0].real
        rows = evened(f)
        right = rows * np.concatenate([s.b1[0].real, s.d21[0].real])
        return rows * f, right, np.concatenate([s.c1[0].real, s.d12[0].real], axis=1)[0], rows

    def slope(self, shape: Shape, frequencies: Real) -> Real:
        """Return the derivative of ``shape`` of the real response with respect to ω, shape (k,)."""
        size = self._solved.n + self._solved.m
        if not size:
            return np.zeros(len(frequencies))
        step = max(1, int(_MOST_NUMBERS / (2 * size * size)))
        parts = [self._slope(shape, frequencies[k : k + step]) for k in range(0, len(frequencies), step)]
        return np.concatenate(parts) if parts else np.zeros(0)

    def _slope(self, shape: Shape, frequencies: Real) -> Real:
        s = self._solved
        f, right, read, rows = self._equations(frequencies)
        try:
            inner = solve_each(f, right)[..., 0]
        except np.linalg.LinAlgError:  # one of them is exactly a pole: beside it, where nothing is infinite
            return self._slope(shape, frequencies * (1 + SAME))
        outer = solve_each(f.swapaxes(1, 2), np.broadcast_to(read[:, None], (len(f), len(read), 1)))[..., 0]
        tau = s.delays[0].real
        rate = (
            np.concatenate([np.full((len(f), s.n), 1j), 1j * tau * np.exp(1j * frequencies[:, None] * tau)], axis=1)
            * rows[..., 0]
        )  # dF/dω, a diagonal
        value = inner @ read + complex(s.d11[0, 0, 0].real)
        change = -(outer * rate * inner).sum(axis=1) * INFINITESIMAL
        return np.imag(shape(value.real + 1j * change.real, value.imag + 1j * change.imag)) / INFINITESIMAL

    def _triangular(self, frequencies: Real) -> tuple[Complex, Real]:
        """Return the same with A reduced to triangular form once: n² operations for each frequency in place of n³."""
        s = self.system
        n, m = s.n, s.m
        triangle, basis = self._schur
        right = basis.conj().T @ np.concatenate([s.b1[0].real, s.b2[0].real], axis=1)
        x = np.zeros((n, len(frequencies) * (1 + m)), dtype=complex)
        for row in range(n - 1, -1, -1):
            known = (triangle[row, row + 1 :] @ x[row + 1 :]).reshape(-1, 1 + m)
            x[row] = ((right[row] + known) / (1j * frequencies - triangle[row, row])[:, None]).ravel()
            x[row][np.abs(x[row]) < _SILENT] = 0.0  # processors are slow with numbers near their smallest
        read = np.concatenate([s.c1[0].real, s.c2[0].real]) @ basis
        through = np.block([[s.d11[0].real, s.d12[0].real], [s.d21[0].real, s.d22[0].real]])
        transfer = (read @ x).reshape(1 + m, -1, 1 + m).swapaxes(0, 1) + through
        terms = (np.abs(read) @ np.abs(x)).reshape(1 + m, -1, 1 + m).swapaxes(0, 1) + np.abs(through)
        if not m:
            return np.asarray(transfer[:, 0, 0]), np.asarray(terms[:, 0, 0])
        turns = np.exp(1j * frequencies[:, None] * s.delays[0].real)
        inner = turns[:, :, None] * np.eye(m) - transfer[:, 1:, 1:]
        back = np.linalg.solve(inner, transfer[:, 1:, :1])
        values = transfer[:, 0, 0] + (transfer[:, :1, 1:] @ back)[:, 0, 0]
        return np.asarray(values), np.asarray(terms[:, 0, 0] + (terms[:, :1, 1:] @ np.abs(back))[:, 0, 0])

    @cached_property
    def _schur(self) -> tuple[Complex, Complex]:
        triangle, basis = schur(self.system.a[0].real.astype(complex), output="complex")
        return triangle, basis

    def pair(self, frequency: Array) -> tuple[Array, Array]:
        """Return (Re G, Im G) at one frequency, each of shape (lanes,) with its infinitesimals.

        Parameters
        ----------
        frequency : ndarray, shape (lanes,) or ()
            rad/s; may itself carry infinitesimals.
        """
        s = self._solved
        n, m = s.n, s.m
        omega = np.broadcast_to(np.asarray(frequency), (s.lanes,))
        kind = np.result_type(s.dtype, omega)
        re = np.zeros((s.lanes, n + m, n + m), dtype=kind)
        im = np.zeros_like(re)
        re[:, :n, :n], re[:, :n, n:], re[:, n:, :n] = -s.a, -s.b2, -s.c2
        angle = omega[:, None] * s.delays
        re[:, n:, n:] = np.cos(angle)[:, :, None] * np.eye(m) - s.d22
        im[:, n:, n:] = np.sin(angle)[:, :, None] * np.eye(m)
        im[:, :n, :n] = omega[:, None, None] * np.eye(n)
        matrix = np.concatenate([np.concatenate([re, -im], axis=2), np.concatenate([im, re], axis=2)], axis=1)
        right = np.concatenate([s.b1, s.d21, np.zeros((s.lanes, n + m, 1))], axis=1).astype(kind)
        rows = evened(matrix[0].real) if n + m else np.ones((0, 1))
        inner = solve(matrix * rows, right * rows)[:, :, 0] if n + m else right[:, :, 0]
        read = np.concatenate([s.c1[:, 0], s.d12[:, 0]], axis=1)
        real = np.einsum("pi,pi->p", read, inner[:, : n + m]) + s.d11[:, 0, 0]
        imaginary = np.einsum("pi,pi->p", read, inner[:, n + m :])
        return np.broadcast_to(real, (s.lanes,)), np.broadcast_to(imaginary, (s.lanes,))

    def shape(self, shape: Shape, frequency: Array) -> Array:
        """Return ``shape`` of the response at one frequency, shape (lanes,)."""
        return shape(*self.pair(frequency))

    @property
    def direct(self) -> Array:
        """The gain at infinite frequency (delays have none of their own), shape (lanes,)."""
        return np.asarray(self.system.d11[:, 0, 0])
