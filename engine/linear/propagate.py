"""From the state at the start of a segment to the state everywhere on it, by a matrix exponential or by collocation.

    x(t0 + θh) = e^{Aθh} x0 + ∫₀^θ e^{Ah(θ-σ)} h B v(σ) dσ,   θ in [0, 1]

Two propagators with one interface. :class:`Exponential` is exact whatever h is and takes inputs that are constant or
linear on the segment. :class:`Collocation` takes any input given at the nodes (delayed signals, chirps); it is exact to
rounding once the states are resolved by the polynomial, which the march verifies.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from engine.linear.chebyshev import DEGREE, NODES, integration_matrix
from engine.linear.system import Array
from engine.linear.tangent import solve


class Propagator(Protocol):
    """What the march needs of a segment of given length."""

    def states(self, x0: Array, inputs: Array) -> Array:
        """Return the states at the nodes.

        Parameters
        ----------
        x0 : ndarray, shape (lanes, n)
            State at the start.
        inputs : ndarray, shape (lanes, N + 1, m)
            v at the nodes.

        Returns
        -------
        ndarray, shape (lanes, N + 1, n)
        """
        ...


def exponentials(matrices: Array) -> Array:
    """Return e^M for a stack of matrices by scaling, a Taylor series of degree 20 and squaring.

    Written here because the result must be analytic in the lanes and cheap for a stack; scaled to a norm of at most 1/2
    the series' remainder is below 1e-26.
    """
    norm = float(np.abs(matrices).sum(axis=-1).max()) if matrices.size else 0.0
    squarings = max(0, int(np.ceil(np.log2(norm / 0.5)))) if norm > 0.5 else 0
    scaled = matrices / 2.0**squarings
    identity = np.broadcast_to(np.eye(matrices.shape[-1]), matrices.shape)
    result = identity + scaled / 20
    for k in range(19, 0, -1):
        result = identity + scaled @ result / k
    for _ in range(squarings):
        result = result @ result
    return np.asarray(result)


class Exponential:
    """Exact propagation for inputs that are constant or linear on the segment."""

    def __init__(self, a: Array, b: Array, width: Array) -> None:
        lanes, n, _ = a.shape
        m = b.shape[-1]
        # x and the two coefficients of the inputs c0 + c1 θ as one autonomous system
        joint = np.zeros((lanes, n + 2 * m, n + 2 * m), dtype=np.result_type(a, b, width))
        h = np.asarray(width)[:, None, None]
        # inputs in units (powers of two) that make B as large as A: the exponential would lose what a larger norm costs
        size = max(float(np.abs(a[0]).max(initial=0.0)), 1e-300)
        strength = np.maximum(np.abs(b[0]).max(axis=0, initial=0.0), 1e-300)
        self._units = 2.0 ** np.round(np.log2(strength / size))
        joint[:, :n, :n] = h * a
        joint[:, :n, n : n + m] = h * (b / self._units)
        joint[:, n : n + m, n + m :] = np.eye(m)
        stack = exponentials(joint[:, None] * NODES[None, :, None, None])
        self._maps = stack[:, :, :n, :]

    def states(self, x0: Array, inputs: Array) -> Array:
        """See :class:`Propagator`; only the end values of ``inputs`` are used."""
        start, end = inputs[:, 0] * self._units, inputs[:, -1] * self._units
        joint = np.concatenate([x0, start, end - start], axis=-1)
        return np.asarray((self._maps @ joint[:, None, :, None])[..., 0])


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

    def states(self, x0: Array, inputs: Array) -> Array:
        """See :class:`Propagator`."""
        lanes = x0.shape[0]
        joint = np.concatenate([x0, inputs.reshape(lanes, -1)], axis=-1)
        inner = (self._map @ joint[..., None]).reshape(lanes, DEGREE, self._n)
        return np.concatenate([x0[:, None, :], inner], axis=1)
