"""The continuous system whose samples a discrete one describes, for inputs held or in straight lines between the samples.

    Φ = e^(A h),   φ_1 = (e^z - 1)/z,   φ_2 = (e^z - 1 - z)/z²   at z = A h
    held:     B_d = h φ_1 B,                     D_d = D
    linear:   B_d = h (φ_1 - φ_2 + Φ φ_2) B,     D_d = D + h C φ_2 B

References
----------
G. Franklin, J. Powell, M. Workman, "Digital Control of Dynamic Systems", 3rd ed., Addison-Wesley 1998, section sections 4.3.3
and 6.3.2 (zero-order hold, triangle hold).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm, logm

Matrix = npt.NDArray[np.float64]

_TOGETHER = 256
"""Samples of a piece of a simulation."""
_REAL = 1e-6
"""Imaginary part that a logarithm may have from rounding, relative to its size."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Discrete:
    """x_{k+1} = A x_k + B u_k, y_k = C x_k + D u_k, from the state ``x0``."""

    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix
    x0: Matrix

    def simulate(self, inputs: Matrix) -> Matrix:
        """Return the outputs (outputs, samples) for inputs (inputs, samples)."""
        n, samples = self.x0.size, inputs.shape[1]
        driven = np.zeros((-(-samples // _TOGETHER) * _TOGETHER, n))
        driven[:samples] = inputs.T @ self.b.T
        pieces = driven.reshape(-1, _TOGETHER, n)
        # from the start of each piece all of them go on at once; the starts follow each other
        states = np.zeros_like(pieces)
        for k in range(1, _TOGETHER):
            states[:, k] = states[:, k - 1] @ self.a.T + pieces[:, k - 1]
        ends = states[:, -1] @ self.a.T + pieces[:, -1]
        powers = self.powers(_TOGETHER + 1)
        starts = np.empty((len(pieces), n))
        state = self.x0
        for k, end in enumerate(ends):
            starts[k], state = state, powers[-1] @ state + end
        states += np.einsum("kij,sj->ski", powers[:-1], starts)
        return np.asarray((states.reshape(-1, n)[:samples] @ self.c.T + inputs.T @ self.d.T).T)

    def powers(self, count: int) -> Matrix:
        """Return 1, A, A², ..., shape (count, n, n)."""
        found, step = np.eye(self.x0.size)[None], self.a
        while len(found) < count:
            found, step = np.concatenate([found, found @ step]), step @ step
        return found[:count]

    @property
    def stable(self) -> bool:
        """Whether all poles are inside the unit circle."""
        return bool(np.abs(np.linalg.eigvals(self.a)).max(initial=0.0) < 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Continuous:
    """x' = A x + B u, y = C x + D u."""

    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix

    @property
    def poles(self) -> npt.NDArray[np.complex128]:
        """Poles, rad/s."""
        return np.asarray(np.linalg.eigvals(self.a), dtype=np.complex128)


def continuous(model: Discrete, sample_time: float, *, held: Sequence[bool] | None = None) -> Continuous | None:
    """Return the continuous system, None where there is none of the same order: a pole at or below 0.

    Parameters
    ----------
    model : Discrete
    sample_time : float
        s.
    held : sequence of bool, optional
        Which inputs are held; the others, by default all, are linear.
    """
    n = len(model.a)
    poles = np.linalg.eigvals(model.a)
    if np.any((np.abs(poles.imag) <= 1e-9 * np.abs(poles)) & (poles.real <= 0)):
        return None
    scaled = logm(model.a)
    if np.iscomplexobj(scaled):
        if np.abs(scaled.imag).max() > _REAL * np.abs(scaled).max():
            return None
        scaled = scaled.real
    joint = np.zeros((3 * n, 3 * n))
    joint[:n, :n], joint[:n, n : 2 * n], joint[n : 2 * n, 2 * n :] = scaled, np.eye(n), np.eye(n)
    grown = expm(joint)
    first, second = grown[:n, n : 2 * n], grown[:n, 2 * n :]
    of_held = np.linalg.solve(sample_time * first, model.b)
    of_lines = np.linalg.solve(sample_time * (first - second + model.a @ second), model.b)
    chosen = np.zeros(model.b.shape[1], dtype=bool) if held is None else np.array(held)
    d = np.where(chosen, model.d, model.d - sample_time * model.c @ second @ of_lines)
    return Continuous(a=np.asarray(scaled / sample_time), b=np.where(chosen, of_held, of_lines), c=model.c, d=d)
