"""Poles of a linear system with delays, how sure each one is, how it moves, and what they say of stability.

    F(s) = [[s I - A, -B2], [-C2, diag(e^{s τ}) - D22]],   poles: det F(s) = 0,   ds/dp = -(wᴴ F_p v) / (wᴴ F_s v)

The poles are those of the parts whose states and delayed signals act on each other in a circle; what only follows on
makes none. Without delays these are the eigenvalues of A. With delays there are infinitely many; the rightmost ones come
from the eigenvalues of the spectrally discretised transport along the delay lines, each polished by Newton on F.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.linalg import eig

from engine.exact.frequency.neutral import neutral
from engine.exact.frequency.pole_guesses import guesses
from engine.model.linear_system import balancing
from engine.model.strongly_connected_components import circles
from engine.model.tangent import slopes
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.model.linear_system import LaneSystem

Complex = npt.NDArray[np.complex128]

_EPS = float(np.finfo(float).eps)
_NEARLY_DEFECTIVE = 1e-3
_LEFT = 32.0  # and the bound of a single pole adds 4
_DEAD = 10.0
"""A pole that is not known to its own size and decays by so many time constants within one delay is rounding."""
_SHARES = np.linspace(0.05, 0.99, 95)


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
    delay : ndarray, shape (poles,), s
        The longest delay of the loop whose endless chain of poles one belongs to; 0 of others.
    neutral : bool
        True when an undamped echo (a loop of delays and direct gains alone, of gain >= 1) makes the system unstable.
    """

    values: Complex
    uncertainty: npt.NDArray[np.float64]
    motion: Complex
    delay: npt.NDArray[np.float64]
    neutral: bool = False

    @property
    def endless(self) -> npt.NDArray[np.bool_]:
        """Which poles belong to the endless chain of a loop with a delay. Its damping ratios go to 0 far from the origin."""
        return np.asarray(self.delay > 0)

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
    def lifetime(self) -> float:
        """How long a response follows all decaying poles in a row, s: until e^-36 of it is left of a single one.

        Chernoff's bound on what is left of Π 1/(s/λ + 1) at T: e^(-θT) Π 1/(1 - θ/λ) for every θ below the slowest λ.
        Of a loop with a delay the slowest pole counts; those of its endless chain are in no row.
        """
        decaying = (self.values.real < 0) & ~self.on_axis & ~self.at_zero & (self.values.imag >= 0)
        rates = -self.values.real[decaying & ~self.endless]
        chained = -self.values.real[decaying & self.endless]
        rates = np.append(rates, chained.min()) if len(chained) else rates
        if not len(rates):
            return 0.0
        slowest = float(rates.min())
        left = np.log1p(-np.outer(_SHARES, slowest / rates)).sum(axis=1)
        return float(((_LEFT - left) / _SHARES).min()) / slowest

    @property
    def slowest(self) -> float:
        """Decay rate of the slowest decaying pole, 1/s (infinite without such a pole)."""
        decaying = -self.values.real[(self.values.real < 0) & ~self.on_axis & ~self.at_zero]
        return float(decaying.min()) if len(decaying) else np.inf


def poles(system: LaneSystem) -> Poles:
    """Return the poles of ``system`` with their motion along its lanes."""
    parts = [_poles_of_part(part) for part in _circles(system)]
    values = np.concatenate([np.zeros(0, complex), *(part.values for part in parts)])
    order = np.lexsort((values.imag, -values.real))
    return Poles(
        values=values[order],
        uncertainty=np.concatenate([np.zeros(0), *(part.uncertainty for part in parts)])[order],
        motion=np.concatenate([np.zeros((0, system.lanes), complex), *(part.motion for part in parts)])[order],
        delay=np.concatenate([np.zeros(0), *(part.delay for part in parts)])[order],
        neutral=any(part.neutral for part in parts),
    )


def _circles(system: LaneSystem) -> list[LaneSystem]:
    """Return the parts in which everything acts on everything: the diagonal blocks of the block triangular form."""
    n = system.n
    pattern = {name: np.any(getattr(system, name) != 0, axis=0) for name in ("a", "b2", "c2", "d22")}
    acts = np.block([[pattern["a"], pattern["b2"]], [pattern["c2"], pattern["d22"]]])
    if not len(acts):
        return []
    parts = []
    for circle in circles([np.flatnonzero(row).tolist() for row in acts]):
        members = np.array(circle)
        x, w = members[members < n], members[members >= n] - n
        if len(x) or acts[n + w, n + w].any() or len(w) > 1:
            whole = len(x) == n and len(w) == system.m
            parts.append(system if whole else system.part(x, w))
    return parts


def _poles_of_part(system: LaneSystem) -> Poles:
    values, left, right, uncertainty = _with_delays(system) if system.m else _eigenvalues(system)
    motion = np.zeros((len(values), system.lanes), dtype=complex)
    if system.dtype is np.complex128:
        for k, s in enumerate(values):
            motion[k] = _motion(system, s, left[:, k], right[:, k])
    delay = np.full(len(values), system.delays[0].real.max(initial=0.0))
    echoes = neutral(system.d22[0].real, system.delays[0].real)
    return Poles(values=values, uncertainty=uncertainty, motion=motion, delay=delay, neutral=echoes)


def _eigenvalues(system: LaneSystem) -> tuple[Complex, Complex, Complex, npt.NDArray[np.float64]]:
    a = system.a[0].real
    scale = balancing(a)
    balanced = a * (scale[None, :] / scale[:, None])
    values, left, right = eig(balanced, left=True, right=True)
    overlap = np.abs(np.einsum("ik,ik->k", left.conj(), right))
    whole = float(np.linalg.norm(balanced))
    # the QR algorithm leaves rounding of the fastest pole in all; the quotient of both vectors is wrong to second order
    moved = np.einsum("ik,ik->k", left.conj(), balanced @ right - right * values) / np.maximum(overlap, _EPS)
    moved *= np.exp(-1j * np.angle(np.einsum("ik,ik->k", left.conj(), right)))
    moved = np.where(values.imag == 0, moved.real, moved)
    values = values + np.where(np.abs(moved) <= 20 * _EPS * whole / np.maximum(overlap, _EPS), moved, 0)
    # what rounding of every entry does to a pole: a slow one hardly feels the fast ones
    size = np.einsum("ik,ij,jk->k", np.abs(left), np.abs(balanced), np.abs(right))
    uncertainty = 20 * _EPS * size / np.maximum(overlap, _EPS)
    # a defective cluster of k poles is only known to the k-th root of rounding; two suffice for what drives are made of
    uncertainty = np.minimum(uncertainty, 20 * np.sqrt(_EPS) * size)
    # vectors that are nearly at right angles are themselves moved: then the quotient tells how far, and no better
    uncertainty = uncertainty + np.where(overlap < _NEARLY_DEFECTIVE, 20 * np.abs(moved), 0.0)
    # the quotient is wrong to second order in the errors of the vectors, however small the entries are that make the pole; those of slow
    # poles side by side are themselves some times less well known
    unseen = (100 * _EPS) ** 2 * whole / np.maximum(overlap, _EPS)
    uncertainty = np.where(np.abs(values) <= unseen, np.maximum(uncertainty, unseen), uncertainty)
    return values, left / scale[:, None], right * scale[:, None], uncertainty


def _characteristic(system: LaneSystem, s: Complex) -> tuple[Complex, Complex]:
    """Return F(s) and its derivative at each s of shape (k,), shapes (k, n + m, n + m) and (k, n + m) (a diagonal)."""
    n, m = system.n, system.m
    tau = system.delays[0].real
    turns = np.exp(s[:, None] * tau)
    f = np.zeros((len(s), n + m, n + m), dtype=complex)
    f[:, :n, :n] = s[:, None, None] * np.eye(n) - system.a[0].real
    f[:, :n, n:] = -system.b2[0].real
    f[:, n:, :n] = -system.c2[0].real
    f[:, n:, n:] = turns[:, :, None] * np.eye(m) - system.d22[0].real
    return f, np.concatenate([np.ones((len(s), n)), tau * turns], axis=1)


def _with_delays(system: LaneSystem) -> tuple[Complex, Complex, Complex, npt.NDArray[np.float64]]:
    tau = float(system.delays[0].real.max())
    upper = _polished(system, guesses(system))
    paired = np.abs(upper.imag) > 1e-7 * np.maximum(np.abs(upper), _slowest_rate(system))
    upper = np.where(paired, upper, upper.real)
    f, slope = _characteristic(system, upper)
    # Units that are far apart (m³/s beside 1/s) would make rounding look larger than the poles themselves.
    balance = _balance(system)
    f = f * balance[None, None, :] / balance[None, :, None]
    scale = np.maximum(np.abs(f).max(axis=2), 1e-300)
    u, _, vh = np.linalg.svd(f / scale[:, :, None])
    left, right = u[:, :, -1] / scale, vh[:, -1].conj()
    overlap = np.abs(np.einsum("ki,ki,ki->k", left.conj(), slope, right))
    # the backward error of every entry, which no scaling of rows or columns changes
    spread = np.einsum("ki,kij,kj->k", np.abs(left), np.abs(f), np.abs(right))
    turns = np.maximum(1.0, np.abs(upper) * tau)
    uncertainty = 20 * _EPS * turns * spread / np.maximum(overlap, 1e-300)
    # where e^{s τ} is rounding beside D22, F is singular at any s if D22 is
    known = (uncertainty <= np.abs(upper)) | (upper.real * tau > -_DEAD)
    upper, uncertainty, paired, left, right = (part[known] for part in (upper, uncertainty, paired, left, right))
    left, right = left / balance, right * balance
    return (
        np.concatenate([upper, upper[paired].conj()]),
        np.concatenate([left, left[paired].conj()]).T,
        np.concatenate([right, right[paired].conj()]).T,
        np.concatenate([uncertainty, uncertainty[paired]]),
    )


def _slowest_rate(system: LaneSystem) -> float:
    """Return a rate, 1/s, below which two poles of the part are one."""
    size = float(np.linalg.norm(system.a[0].real)) if system.n else np.inf
    return 1e-3 * min(1 / float(system.delays[0].real.max()), size)


def _balance(system: LaneSystem) -> npt.NDArray[np.float64]:
    """Return the scales (n + m,), powers of 2, that balance states and delayed signals against each other."""
    n, m = system.n, system.m
    whole = np.zeros((n + m, n + m))
    whole[:n, :n], whole[:n, n:] = system.a[0].real, system.b2[0].real
    whole[n:, :n], whole[n:, n:] = system.c2[0].real, system.d22[0].real
    return balancing(whole)


def _polished(system: LaneSystem, begun: Complex) -> Complex:
    """Return the distinct poles that Newton on det F, s -= 1 / tr(F⁻¹ F_s), reaches from where it has ``begun``."""
    tau, rate = float(system.delays[0].real.max()), _slowest_rate(system)
    s = begun.copy()
    step = np.full(len(s), np.inf + 0j)
    moving = np.arange(len(s))
    with np.errstate(all="ignore"):
        for _ in range(50):
            f, slope = _characteristic(system, s[moving])
            finite = np.isfinite(f).all(axis=(1, 2))
            step[moving[~finite]] = np.inf  # left the plane: no pole
            moving, f, slope = moving[finite], f[finite], slope[finite]
            newton = 1 / np.einsum("kii,ki->k", _inverses(f), slope)
            newton = np.where(np.isfinite(newton), newton, 0.0)
            s[moving] -= newton
            step[moving] = newton
            moving = moving[np.abs(newton) > 4e-15 * np.maximum(np.abs(s[moving]), 1e-12)]
            if not len(moving):
                break
        near = np.abs(s - begun) <= 0.5 * np.maximum(np.abs(begun), 1 / tau)
        still = np.abs(step) <= 1e-6 * np.maximum(np.abs(s), 1e-3 * rate)
    kept: list[complex] = []
    for value in s[near & still]:
        if not any(abs(value - other) < 1e-7 * max(abs(value), rate) for other in kept):
            kept.append(complex(value))
    return np.array(kept, dtype=complex)


def _inverses(f: Complex) -> Complex:
    """Return the inverses; infinite where a guess is a pole already, so that Newton stays there."""
    try:
        return np.asarray(np.linalg.inv(f), dtype=complex)
    except np.linalg.LinAlgError:
        found = np.full_like(f, np.inf)
        for k, matrix in enumerate(f):
            try:
                found[k] = np.linalg.inv(matrix)
            except np.linalg.LinAlgError:
                continue
        return found


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
