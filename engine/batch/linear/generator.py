"""Whether systems with delays decay: eigenvalues of a matrix in which each delay line is its values at Chebyshev's points.

    ∂v_j/∂t = ∂v_j/∂θ on [-τ_j, 0],  v_j(t, 0) = z_j,  w_j = v_j(t, -τ_j)

The rightmost eigenvalues are those of the delay system, but for those too fast for the points. These cannot be unstable where what comes
around through the delays is smaller than 1.

References
----------
D. Breda, S. Maset, R. Vermiglio, Stability of Linear Delay Differential Equations, Springer 2015, chapter 5.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch import stacks

Real = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Array = npt.NDArray[Any]

_POINTS: Final = (16, 40)
_TOLD: Final = 0.3
"""Of a line's points: up to this angle within the delay the eigenvalues are right."""
_LOOKS: Final = 24
_BEYOND: Final = 1e3
_SMALL: Final = 0.9
_STARTS: Final = 6
_STEPS: Final = 12
_CONVERGED: Final = 1e-10


def _differentiation(points: int) -> tuple[Real, Real]:
    """Return Chebyshev's points on [-1, 1] from 1 to -1, (points + 1,), and what differentiates values there (Trefethen)."""
    x = np.cos(np.pi * np.arange(points + 1) / points)
    c = np.where((np.arange(points + 1) % points) == 0, 2.0, 1.0) * (-1.0) ** np.arange(points + 1)
    matrix = np.outer(c, 1.0 / c) / (x[:, None] - x[None, :] + np.eye(points + 1))
    return x, matrix - np.diag(matrix.sum(axis=1))


def _matrix(a: Real, b2: Real, c2: Real, d22: Real, delays: Real, points: int) -> Real:
    """Return the matrices (B, n + m points, n + m points)."""
    members, n, m = b2.shape
    _, derivative = _differentiation(points)
    whole = np.zeros((members, n + m * points, n + m * points))
    whole[:, :n, :n] = a
    ends = n + points * (np.arange(m) + 1) - 1
    whole[:, :n, ends] = b2
    for j in range(m):
        rows = slice(n + j * points, n + (j + 1) * points)
        rate = 2.0 / delays[:, j, None, None]
        whole[:, rows, rows] = rate * derivative[1:, 1:]
        inward = rate * derivative[1:, :1]
        whole[:, rows, :n] += inward * c2[:, j : j + 1]
        whole[:, rows, ends] += inward * d22[:, j : j + 1]
    return whole


def _quiet(a: Real, b2: Real, c2: Real, d22: Real, lowest: Real) -> Flags:
    """Return whose gain through all delays at once is small from a frequency (rad/s) on, (B,)."""
    members, n, _ = b2.shape
    highest = _BEYOND * np.maximum(lowest, np.abs(a).sum(axis=2).max(axis=1, initial=0.0))
    omega = lowest[:, None] * (highest / lowest)[:, None] ** np.linspace(0.0, 1.0, _LOOKS)
    resolvent = 1j * omega[:, :, None, None] * np.eye(n) - a[:, None]
    passed = c2[:, None] @ stacks.solve(resolvent, np.broadcast_to(b2[:, None], (members, _LOOKS, *b2.shape[1:])))
    # Whatever the delays' phases are, nothing comes around larger than by the spectral radius of the absolute values.
    around = np.nan_to_num(np.abs(passed + d22[:, None]), nan=1.0, posinf=1.0)  # exactly at a pole: not small
    size = np.abs(np.linalg.eigvals(around)).max(axis=2)
    return np.asarray((size < _SMALL).all(axis=1))


def eigenvalues_of(a: Real, b2: Real, c2: Real, d22: Real, delays: Real) -> Array:
    """Return the rightmost characteristic roots among other eigenvalues, (B, N), 1/s; NaN where they cannot be told.

    Parameters
    ----------
    a, b2, c2, d22 : ndarray, shapes (B, n, n), (B, n, m), (B, m, n), (B, m, m)
    delays : ndarray, shape (B, m)
        Positive, s.
    """
    members, n, m = b2.shape
    found = np.full((members, n + m * _POINTS[-1]), np.nan + 0j)
    left, lowest = np.arange(members), np.zeros(members)
    for points in _POINTS:
        lowest = _TOLD * points / delays[left].max(axis=1)
        told = _quiet(a[left], b2[left], c2[left], d22[left], lowest)
        those = left[told]
        if those.size:
            values = np.linalg.eigvals(_matrix(a[those], b2[those], c2[those], d22[those], delays[those], points))
            rightmost = np.take_along_axis(values, values.real.argmax(axis=1)[:, None], axis=1)
            found[those, : values.shape[1]] = values
            found[those, values.shape[1] :] = rightmost  # again, so that all have as many
        left, lowest = left[~told], lowest[~told]
    if left.size:
        # Whatever the fast ones do: one that is unstable is enough, be it seen as it is or only enough to begin at.
        values = np.linalg.eigvals(_matrix(a[left], b2[left], c2[left], d22[left], delays[left], _POINTS[-1]))
        told = np.where((np.abs(values) <= lowest[:, None]) & (values.real > 0), values, -np.inf)
        root = np.take_along_axis(told, told.real.argmax(axis=1)[:, None], axis=1)[:, 0]
        unseen = np.flatnonzero(np.isinf(root.real))
        if unseen.size:
            these = left[unseen]
            root[unseen] = _unstable_root(a[these], b2[these], c2[these], d22[these], delays[these], values[unseen])
        found[left] = root[:, None]
    return found


def _unstable_root(a: Real, b2: Real, c2: Real, d22: Real, delays: Real, values: Array) -> Array:
    """Return the characteristic root furthest to the right, (B,), that Newton's method finds from some eigenvalues; NaN where none is unstable.

    Of det F(s), F = [[s - A, -B2], [-e^(-s τ) C2, 1 - e^(-s τ) D22]]:  s ← s - 1 / tr(F⁻¹ F').
    """
    (members, n, m), size = b2.shape, a.shape[1] + b2.shape[2]
    order = np.argsort(np.where(values.real > 0, np.abs(values), np.inf), axis=1)[
        :, :_STARTS
    ]  # the slowest are seen best
    s = np.take_along_axis(values, order, axis=1)
    whole = np.zeros((members, s.shape[1], size, size), dtype=complex)
    slope = np.zeros_like(whole)
    slope[:, :, :n, :n] = np.eye(n)
    whole[:, :, :n, n:] = -b2[:, None]
    step = np.full_like(s, np.inf)
    with np.errstate(all="ignore"):
        for _ in range(_STEPS):
            s = np.where(s.real > 0, s, 0.0)  # e^(-s τ) is of use on the right only
            turn = np.exp(-s[:, :, None] * delays[:, None])[..., None]
            whole[:, :, :n, :n] = s[:, :, None, None] * np.eye(n) - a[:, None]
            whole[:, :, n:, :n], whole[:, :, n:, n:] = -turn * c2[:, None], np.eye(m) - turn * d22[:, None]
            slope[:, :, n:, :n] = delays[:, None, :, None] * turn * c2[:, None]
            slope[:, :, n:, n:] = delays[:, None, :, None] * turn * d22[:, None]
            step = 1.0 / np.trace(stacks.solve(whole, slope), axis1=2, axis2=3)
            s = s - step
    there = (np.abs(step) <= _CONVERGED * np.abs(s)) & (s.real > _CONVERGED * np.abs(s))
    rightmost = np.where(there, s, -np.inf)
    chosen = np.take_along_axis(rightmost, rightmost.real.argmax(axis=1)[:, None], axis=1)[:, 0]
    return np.where(there.any(axis=1), chosen, np.nan)
