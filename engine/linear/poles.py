"""Poles of a linear system with delays, how sure each one is, how it moves, and what they say of stability.

    F(s) = [[s I - A, -B2], [-C2, diag(e^{s τ}) - D22]],   poles: det F(s) = 0,   ds/dp = -(wᴴ F_p v) / (wᴴ F_s v)

Without delays these are the eigenvalues of A. With delays there are infinitely many; the rightmost ones come from the
eigenvalues of the spectrally discretised transport along the delay lines, each polished by Newton on F.

References
----------
D. Breda, S. Maset, R. Vermiglio, "Stability of Linear Delay Differential Equations", Springer 2015, chapter 5.
J. Hale, S. Verduyn Lunel, "Strong stabilization of neutral functional differential equations", IMA J. Math. Control
Inf. 19 (2002): a neutral loop is stable only if max over phases of ρ(D22 e^{jφ}) < 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.linalg import eig, matrix_balance

from engine.linear.tangent import slopes
from engine.verdicts import Verdict

if TYPE_CHECKING:
    from engine.linear.system import Array, LaneSystem

Complex = npt.NDArray[np.complex128]

_EPS = float(np.finfo(float).eps)


@dataclass(frozen=True, kw_only=True, eq=False)
class Poles:
    """Poles of one system.

    Parameters
    ----------
    values : ndarray, shape (poles,), complex, rad/s
        Sorted by falling real part. With delays the rightmost ones only.
    uncertainty : ndarray, shape (poles,)
        How far rounding may have moved each pole.
    motion : ndarray, shape (poles, lanes), complex
        Derivative of each pole along each lane.
    neutral : bool
        True when an undamped echo (a loop of delays and direct gains alone, of gain >= 1) makes the system unstable.
    """

    values: Complex
    uncertainty: npt.NDArray[np.float64]
    motion: Complex
    neutral: bool = False

    @property
    def at_zero(self) -> npt.NDArray[np.bool_]:
        """Which poles cannot be told from s = 0."""
        return np.asarray(np.abs(self.values) <= self.uncertainty)

    @property
    def on_axis(self) -> npt.NDArray[np.bool_]:
        """Which poles cannot be told from the imaginary axis."""
        return np.asarray(np.abs(self.values.real) <= np.maximum(self.uncertainty, 1e-11 * np.abs(self.values)))

    @property
    def verdict(self) -> Verdict:
        """``ok`` when all poles decay, else why not."""
        if self.neutral or np.any((self.values.real > 0) & ~self.on_axis & ~self.at_zero):
            return Verdict.UNSTABLE
        if np.any(self.at_zero):
            return Verdict.INTEGRATING
        return Verdict.MARGINAL if np.any(self.on_axis) else Verdict.OK

    @property
    def slowest(self) -> float:
        """Decay rate of the slowest decaying pole, 1/s (infinite without such a pole)."""
        decaying = -self.values.real[(self.values.real < 0) & ~self.on_axis & ~self.at_zero]
        return float(decaying.min()) if len(decaying) else np.inf


def poles(system: LaneSystem) -> Poles:
    """Return the poles of ``system`` with their motion along its lanes."""
    if not system.n and not system.m:
        return Poles(values=np.zeros(0, complex), uncertainty=np.zeros(0), motion=np.zeros((0, system.lanes), complex))
    values, left, right, uncertainty = _with_delays(system) if system.m else _eigenvalues(system)
    order = np.lexsort((values.imag, -values.real))
    values, left, right, uncertainty = values[order], left[:, order], right[:, order], uncertainty[order]
    motion = np.zeros((len(values), system.lanes), dtype=complex)
    if system.dtype is np.complex128:
        for k, s in enumerate(values):
            motion[k] = _motion(system, s, left[:, k], right[:, k])
    return Poles(values=values, uncertainty=uncertainty, motion=motion, neutral=_neutral(system))


def _eigenvalues(system: LaneSystem) -> tuple[Complex, Complex, Complex, npt.NDArray[np.float64]]:
    a = system.a[0].real
    balanced, transform = matrix_balance(a, permute=False)
    scale = np.diag(transform)
    values, left, right = eig(balanced, left=True, right=True)
    overlap = np.abs(np.einsum("ik,ik->k", left.conj(), right))
    size = float(np.linalg.norm(balanced))
    uncertainty = 20 * _EPS * size / np.maximum(overlap, _EPS)
    # a defective cluster of k poles is only known to the k-th root of rounding; two suffice for what drives are made of
    uncertainty = np.minimum(uncertainty, 20 * np.sqrt(_EPS) * size)
    return values, left / scale[:, None], right * scale[:, None], uncertainty


def _characteristic(system: LaneSystem, s: complex) -> tuple[Complex, Complex]:
    """Return F(s) and its derivative with respect to s."""
    n, m = system.n, system.m
    tau = system.delays[0].real
    f = np.zeros((n + m, n + m), dtype=complex)
    f[:n, :n] = s * np.eye(n) - system.a[0].real
    f[:n, n:] = -system.b2[0].real
    f[n:, :n] = -system.c2[0].real
    f[n:, n:] = np.diag(np.exp(s * tau)) - system.d22[0].real
    return f, np.diag(np.concatenate([np.ones(n), tau * np.exp(s * tau)])).astype(complex)


def _with_delays(system: LaneSystem) -> tuple[Complex, Complex, Complex, npt.NDArray[np.float64]]:
    guesses = _discretised(system)
    found: list[tuple[complex, Complex, Complex, float]] = []
    tau = float(system.delays[0].real.max())
    limit = guesses.real.max() - 60.0 / tau  # poles that decay so fast within one delay leave nothing behind
    for guess in guesses[np.argsort(-guesses.real)][:80]:
        if guess.real < limit or guess.imag < -1e-9 * abs(guess):
            continue
        polished = _polish(system, complex(guess))
        if polished is None:
            continue
        s = polished[0]
        close = 1e-7 * max(abs(s), 1e-3 / tau)
        if any(abs(s - other[0]) < close for other in found):
            continue
        found.append(polished)
        if abs(s.imag) > close:
            found.append((s.conjugate(), polished[1].conj(), polished[2].conj(), polished[3]))
    if not found:
        empty = np.zeros((system.n + system.m, 0), complex)
        return np.zeros(0, complex), empty, empty, np.zeros(0)
    return (
        np.array([s for s, *_ in found]),
        np.stack([w for _, w, *_ in found], axis=1),
        np.stack([v for _, _, v, _ in found], axis=1),
        np.array([u for *_, u in found]),
    )


def _discretised(system: LaneSystem) -> Complex:
    """Return the eigenvalues of the system with each delay line as a Chebyshev-collocated transport equation."""
    n, m = system.n, system.m
    points = int(np.clip(240 // max(m, 1), 24, 60))
    theta = np.cos(np.pi * np.arange(points + 1) / points)
    c = np.ones(points + 1)
    c[[0, -1]] = 2
    c *= (-1.0) ** np.arange(points + 1)
    d = np.outer(c, 1 / c) / (theta[:, None] - theta[None, :] + np.eye(points + 1))
    d -= np.diag(d.sum(axis=1))
    size = n + m * points
    big = np.zeros((size, size))
    read = np.zeros((m, size))  # w_i = end of line i
    for i in range(m):
        read[i, n + i * points + points - 1] = 1
    z = np.zeros((m, size))
    z[:, :n] = system.c2[0].real
    z += system.d22[0].real @ read
    big[:n, :n] = system.a[0].real
    big[:n] += system.b2[0].real @ read
    for i, tau in enumerate(system.delays[0].real):
        rows = slice(n + i * points, n + (i + 1) * points)
        big[rows, rows] = 2 / tau * d[1:, 1:]
        big[rows] += 2 / tau * np.outer(d[1:, 0], z[i])
    return np.asarray(np.linalg.eigvals(matrix_balance(big, permute=False)[0]))


def _polish(system: LaneSystem, s: complex) -> tuple[complex, Complex, Complex, float] | None:
    """Return (pole, left, right null vector, uncertainty) near ``s``, or None when Newton goes elsewhere."""
    start = s
    reach = 500.0 / float(system.delays[0].real.max())
    for _ in range(40):
        if s.real > reach:
            return None  # Newton left the half-plane where poles are: e^{s τ} would overflow
        f, slope = _characteristic(system, s)
        if not np.all(np.isfinite(f)):
            return None
        scale = np.maximum(np.abs(f).max(axis=1), 1e-300)
        u, _, vh = np.linalg.svd(f / scale[:, None])
        w, v = u[:, -1] / scale, vh[-1].conj()
        denominator = complex(w.conj() @ slope @ v)
        if denominator == 0:
            return None
        step = complex(w.conj() @ f @ v) / denominator
        s -= step
        if abs(step) <= 1e-14 * max(abs(s), 1e-12):
            break
    else:
        return None
    if abs(s - start) > 0.5 * max(abs(start), 1 / float(system.delays[0].real.max())):
        return None
    spread = float(np.linalg.norm(np.abs(w) @ np.abs(f)))
    return s, w, v, 20 * _EPS * spread / abs(denominator)


def _motion(system: LaneSystem, s: complex, left: Complex, right: Complex) -> Complex:
    """Return ds along every lane."""
    n = system.n
    x, w = right[:n], right[n:]
    top, bottom = left[:n].conj(), left[n:].conj()
    moved = -(slopes(system.a) @ x) @ top
    denominator = top @ x
    if system.m:
        tau = system.delays[0].real
        grown = np.exp(s * tau)
        moved = moved - (slopes(system.b2) @ w) @ top - (slopes(system.c2) @ x) @ bottom
        moved = moved + (s * slopes(system.delays) * grown * w - slopes(system.d22) @ w) @ bottom
        denominator = denominator + bottom @ (tau * grown * w)
    return np.asarray(-moved / denominator)


def _neutral(system: LaneSystem) -> bool:
    """Return whether echoes through delays and direct gains alone do not die out, whatever the delays' exact ratio."""
    d22 = system.d22[0].real
    if not d22.size or not d22.any():
        return False
    if float(np.abs(np.linalg.eigvals(np.abs(d22))).max()) < 1:
        return False
    m = len(d22)
    turns = np.exp(2j * np.pi * np.arange(24) / 24)
    phases = np.stack(np.meshgrid(*([turns] * (m - 1)), indexing="ij"), -1).reshape(-1, m - 1) if m > 1 else np.ones((1, 0))
    phases = phases[:4096]
    rotated = d22 * np.concatenate([np.ones((len(phases), 1)), phases], axis=1)[:, None, :]
    return bool(np.abs(np.linalg.eigvals(rotated)).max() >= 1 - 1e-12)


def static_gain(system: LaneSystem) -> Array:
    """Return the gain at s = 0, shape (lanes, outputs, inputs).

    Raises
    ------
    numpy.linalg.LinAlgError
        When the system has a pole at s = 0.
    """
    from engine.linear.tangent import solve

    n, m = system.n, system.m
    top = np.concatenate([system.a, system.b2], axis=-1)
    bottom = np.concatenate([system.c2, system.d22 - np.eye(m)], axis=-1)
    matrix = np.concatenate([top, bottom], axis=-2)
    right = -np.concatenate([system.b1, system.d21], axis=-2)
    inner = solve(matrix, right) if n + m else np.zeros((system.lanes, 0, system.n_in))
    return np.asarray(np.concatenate([system.c1, system.d12], axis=-1) @ inner + system.d11)
