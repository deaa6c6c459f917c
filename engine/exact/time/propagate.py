"""From the state at the start of a segment to the state everywhere on it, by a matrix exponential or by collocation.

    x(t0 + θh) = e^{Aθh} x0 + ∫₀^θ e^{Ah(θ-σ)} h B v(σ) dσ,   θ in [0, 1]

Three propagators with one interface. :class:`Exponential` is exact whatever h is and takes inputs that are constant or
linear on the segment. :class:`Collocation` takes any input given at the nodes (delayed signals, chirps); it is exact to
rounding once the states are resolved by the polynomial, which the march verifies.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from engine.exact.time.chebyshev import DEGREE, NODES, integration_matrix, weights
from engine.model.linear_system import Array, LaneSystem
from engine.model.tangent import INFINITESIMAL, solve

_TRACE = 1e-150


class Propagator(Protocol):
    """What the march needs of a segment of given length."""

    def solve(self, x0: Array, inputs: Array, delayed: Array) -> tuple[Array, Array]:
        """Return states and delayed signals at the nodes.

        Parameters
        ----------
        x0 : ndarray, shape (lanes, n)
            State at the start.
        inputs : ndarray, shape (lanes, N + 1, inputs)
            u at the nodes.
        delayed : ndarray, shape (lanes, N + 1, m)
            w at the nodes, as far as it comes from before the segment.

        Returns
        -------
        (ndarray of shape (lanes, N + 1, n), ndarray of shape (lanes, N + 1, m))
        """
        ...


def stride(maps: Array, joint: Array, count: int) -> Array:
    """Return the states at the nodes of ``count`` equal segments under a linear input, shape (count, lanes, N + 1, n).

    Parameters
    ----------
    maps : ndarray, shape (lanes, N + 1, n, n + 2 inputs)
        From [x0; c0; c1] to the states at the nodes, where the inputs are c0 + c1 θ and there are no delays.
    joint : ndarray, shape (lanes, n + 2 inputs)
        State, inputs and their change over one segment, at the start of the first.
    """
    lanes, nodes, n, size = maps.shape
    inputs = (size - n) // 2
    step = np.zeros((lanes, size, size), dtype=maps.dtype)
    step[:, :n] = maps[:, -1]
    step[:, n:, n:] = np.eye(2 * inputs) + np.eye(2 * inputs, k=inputs)
    states = maps.reshape(lanes, nodes * n, size) @ powers(step, joint, count)
    return np.asarray(states.reshape(lanes, nodes, n, count).transpose(3, 0, 1, 2))


def powers(step: Array, first: Array, count: int) -> Array:
    """Return v, M v, M² v ... of ``step`` M (lanes, d, d) and ``first`` v (lanes, d), shape (lanes, d, count), by log2(count) products."""
    found = first[:, :, None]
    while found.shape[2] < count:
        found = np.concatenate([found, step @ found], axis=2)
        step = without_traces(step @ step)
    return np.asarray(found[:, :, :count])


def exponentials(matrices: Array) -> Array:
    """Return e^M for a stack of matrices; see :func:`growths`."""
    return np.asarray(growths(matrices) + np.eye(matrices.shape[-1]))


def growths(matrices: Array) -> Array:
    """Return e^M - 1 for a stack of matrices by scaling, a Taylor series of degree 16 and squaring.

    Written here because the result must be analytic in the lanes and cheap for a stack; scaled to a norm of at most 1/2
    the series' remainder is below 1e-19. Squared as e^2M - 1 = 2 (e^M - 1) + (e^M - 1)², what a slow mode changes by is
    not lost in the rounding of the 1 beside it.
    """
    norm = float(np.abs(matrices).sum(axis=-1).max()) if matrices.size else 0.0
    squarings = max(0, int(np.ceil(np.log2(norm / 0.5)))) if norm > 0.5 else 0
    scaled = matrices / 2.0**squarings
    identity = np.eye(matrices.shape[-1])
    result = identity + scaled / 16
    for k in range(15, 1, -1):
        result = identity + without_traces(scaled @ result) / k
    result = without_traces(scaled @ result)
    for _ in range(squarings):
        result = twice(result)
    return np.asarray(result)


def twice(growth: Array) -> Array:
    """Return e^2M - 1 from e^M - 1."""
    return without_traces(growth @ growth + 2 * growth)


def without_traces(values: Array) -> Array:
    """Return the array with 0 for what is smaller than 1e-150: processors are slow with numbers near their smallest.

    What comes through hundreds of lags in a row is that small at first. An infinitesimal is 1e-30 times smaller.
    """
    if np.iscomplexobj(values):
        parts = values.view(np.float64)
        parts[np.abs(parts) < _TRACE * INFINITESIMAL] = 0.0
    else:
        values[np.abs(values) < _TRACE] = 0.0
    return values


class Exponential:
    """Exact propagation for inputs that are constant or linear on the segment."""

    def __init__(self, growth: Array, units: Array) -> None:
        self._growth = growth  # of [x; c0; c1] where the inputs are c0 + c1 θ, (lanes, N + 1, ·, ·)
        self._units = units
        n = growth.shape[-1] - 2 * len(units)
        self.maps: Array = (growth[:, :, :n, :] + np.eye(n, growth.shape[-1])) * np.concatenate(
            [np.ones(n), units, units]
        )
        """What :func:`stride` wants."""

    @classmethod
    def of(cls, a: Array, b: Array, width: Array) -> Exponential:
        """Return the propagation of x' = a x + b u over segments of ``width``."""
        lanes, n, _ = a.shape
        m = b.shape[-1]
        # x and the two coefficients of the inputs c0 + c1 θ as one autonomous system
        joint = np.zeros((lanes, n + 2 * m, n + 2 * m), dtype=np.result_type(a, b, width))
        h = np.asarray(width)[:, None, None]
        # inputs in units (powers of two) that make B as large as A: the exponential would lose what a larger norm costs
        # (an integrator alone has no A to compare with: then as large as the segment is short)
        size = float(np.abs(a[0]).max(initial=0.0)) or 1.0 / float(np.real(width).max())
        strength = np.maximum(np.abs(b[0]).max(axis=0, initial=0.0), 1e-300)
        units = 2.0 ** np.round(np.log2(strength / size))
        joint[:, :n, :n] = h * a
        joint[:, :n, n : n + m] = h * (b / units)
        joint[:, n : n + m, n + m :] = np.eye(m)
        return cls(growths(joint[:, None] * NODES[None, :, None, None]), units)

    def doubled(self) -> Exponential:
        """Return the propagation over segments of twice the width: one squaring."""
        growth = twice(self._growth)
        growth[..., growth.shape[-1] - len(self._units) :] /= 2  # c1 is now the change over two segments
        growth[..., growth.shape[-1] - len(self._units) :, :] *= 2
        return Exponential(growth, self._units)

    def solve(self, x0: Array, inputs: Array, delayed: Array) -> tuple[Array, Array]:
        """See :class:`Propagator`; only the end values of ``inputs`` are used, and there are no delays."""
        joint = np.concatenate([x0, inputs[:, 0], inputs[:, -1] - inputs[:, 0]], axis=-1)
        return np.asarray((self.maps @ joint[:, None, :, None])[..., 0]), delayed


class Collocation:
    """Spectral solution on the nodes: x = x0 + h S (A x + B v), S the integration matrix."""

    def __init__(self, a: Array, b: Array, width: Array) -> None:
        lanes, n, _ = a.shape
        s = integration_matrix()
        h = np.asarray(width)[:, None, None]
        size = DEGREE * n
        matrix = np.eye(size) - np.einsum("jl,pab->pjalb", s[1:, 1:], h * a).reshape(lanes, size, size)
        first = np.einsum("j,pab->pjab", s[1:, 0], h * a) + np.eye(n)
        forced = np.einsum("jl,pam->pjalm", s[1:], h * b).reshape(lanes, size, (DEGREE + 1) * b.shape[-1])
        right = np.concatenate([first.reshape(lanes, size, n), forced], axis=-1)
        self._map = solve(matrix, right)
        self._n = n

    def solve(self, x0: Array, inputs: Array, delayed: Array) -> tuple[Array, Array]:
        """See :class:`Propagator`."""
        lanes = x0.shape[0]
        joint = np.concatenate([x0, np.concatenate([inputs, delayed], axis=-1).reshape(lanes, -1)], axis=-1)
        inner = (self._map @ joint[..., None]).reshape(lanes, DEGREE, self._n)
        return np.concatenate([x0[:, None, :], inner], axis=1), delayed


class DelayedCollocation:
    """Spectral solution on a segment longer than a delay: part of what returns through the delay lies on the segment itself.

        x = x0 + h S (A x + B1 u + B2 w),   w_i = past_i + L_i z_i,   z = C2 x + D21 u + D22 w

    L_i interpolates the segment's own nodes at θ - τ_i / h and is zero where that is before the segment.
    """

    def __init__(self, system: LaneSystem, width: Array) -> None:
        s = integration_matrix()
        lanes, n, m, nodes = system.lanes, system.n, system.m, DEGREE + 1
        h = np.asarray(width)[:, None, None]
        back = np.stack([own_part(system.delays[:, i], width) for i in range(m)])  # (m, lanes, nodes, nodes)
        # delayed signals in units (powers of two) in which h B2 is 1: on a short segment x would drown in their rounding
        reach = np.abs(float(width[0].real) * system.b2[0]).max(axis=0, initial=0.0)
        self._units = 2.0 ** np.round(np.log2(np.where(reach > 0, reach, 1.0)))
        b2, c2, d21 = system.b2 / self._units, system.c2 * self._units[:, None], system.d21 * self._units[:, None]
        d22 = system.d22 * (self._units[:, None] / self._units)
        x_x = np.eye(DEGREE * n) - np.einsum("jl,pab->pjalb", s[1:, 1:], h * system.a).reshape(
            lanes, DEGREE * n, DEGREE * n
        )
        x_w = -np.einsum("jl,pai->pjali", s[1:], h * b2).reshape(lanes, DEGREE * n, nodes * m)
        w_x = -np.einsum("ipjl,pia->pjila", back[..., 1:], c2).reshape(lanes, nodes * m, DEGREE * n)
        w_w = np.eye(nodes * m) - np.einsum("ipjl,pik->pjilk", back, d22).reshape(lanes, nodes * m, nodes * m)
        matrix = np.concatenate([np.concatenate([x_x, x_w], axis=2), np.concatenate([w_x, w_w], axis=2)], axis=1)
        # columns: x0, u at the nodes, what of w comes from before the segment
        x_start = np.einsum("j,pab->pjab", s[1:, 0], h * system.a) + np.eye(n)
        x_forced = np.einsum("jl,pau->pjalu", s[1:], h * system.b1)
        w_start = np.einsum("ipj,pia->pjia", back[..., 0], c2)
        w_forced = np.einsum("ipjl,piu->pjilu", back, d21)
        size, forced = DEGREE * n + nodes * m, nodes * system.n_in
        right = np.zeros((lanes, size, n + forced + nodes * m), dtype=matrix.dtype)
        right[:, : DEGREE * n, :n] = x_start.reshape(lanes, DEGREE * n, n)
        right[:, DEGREE * n :, :n] = w_start.reshape(lanes, nodes * m, n)
        right[:, : DEGREE * n, n : n + forced] = x_forced.reshape(lanes, DEGREE * n, forced)
        right[:, DEGREE * n :, n : n + forced] = w_forced.reshape(lanes, nodes * m, forced)
        right[:, DEGREE * n :, n + forced :] = np.eye(nodes * m)
        self._map = solve(matrix, right)
        self._n, self._m = n, m

    def solve(self, x0: Array, inputs: Array, delayed: Array) -> tuple[Array, Array]:
        """See :class:`Propagator`; ``delayed`` is zero where a delayed signal is read from the segment itself."""
        lanes = x0.shape[0]
        joint = np.concatenate([x0, inputs.reshape(lanes, -1), (delayed * self._units).reshape(lanes, -1)], axis=-1)
        found = (self._map @ joint[..., None])[..., 0]
        inner = found[:, : DEGREE * self._n].reshape(lanes, DEGREE, self._n)
        w = found[:, DEGREE * self._n :].reshape(lanes, -1, self._m) / self._units
        return np.concatenate([x0[:, None, :], inner], axis=1), w


def own_part(delay: Array, width: Array) -> Array:
    """Return the interpolation from a segment's nodes to θ - delay / width, zero rows where that is before the segment."""
    theta = NODES - (delay / width)[:, None]  # (lanes, nodes)
    return np.asarray(np.where((theta[0].real > 0)[None, :, None], weights(theta), 0.0))
