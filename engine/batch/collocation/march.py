"""Step responses of many parameter sets of one structure at once, as piecewise polynomials in time.

One *interval* has the length H of the delay (or a share of the horizon where there is none). On each of its pieces the
states follow collocation at the 8 Radau points, solved by partial fractions of the collocation matrix W, in which the
conjugate pairs d = a ± ib of eigenvalues leave only real, n by n inverses:

    (I - W ⊗ hA)⁻¹ = Σ_d P_d ⊗ (I - d hA)⁻¹,   (I - d hA)⁻¹ = (I - d* hA) (I - 2a hA + |d|² h²A²)⁻¹

What a delay channel brings in during an interval is what went into it during the one before. So an interval is one linear
map T of the vector of states and channel values at the nodes, the march is a power of T, and the powers are found by
squaring. With deviations from the final value there is no forcing left:  d_{k+1} = T d_k.

Everything is analytic in the system's coefficients: complex lanes carry exact derivatives through.

References
----------
E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, IV.5 (Radau IIA) and IV.8 (partial fractions).
D. Breda, S. Maset, R. Vermiglio, Stability of Linear Delay Differential Equations, Springer 2015 (the map T).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.polynomial import legendre, polynomial

from engine.model.linear_system import Array

STAGES = 8
POINTS = STAGES + 1
"""Samples of a piece: its start (right limit) and the Radau points, the last of which is its end."""


def _radau() -> tuple[Array, Array, Array, Array]:
    """Return nodes in (0, 1], eigenvalues with Im > 0, and the partial-fraction weights of start and forcing."""
    characteristic = np.zeros(STAGES + 1)
    characteristic[STAGES], characteristic[STAGES - 1] = 1.0, -1.0
    roots = np.sort(legendre.legroots(characteristic).real)
    for _ in range(3):
        roots -= legendre.legval(roots, characteristic) / legendre.legval(roots, legendre.legder(characteristic))
    roots[-1] = 1.0
    integrals = np.stack([legendre.legval(roots, legendre.legint(row, lbnd=-1)) / 2 for row in np.eye(STAGES)], axis=1)
    w = integrals @ np.linalg.inv(legendre.legvander(roots, STAGES - 1))
    eigenvalues, vectors = np.linalg.eig(w)
    inverse = np.linalg.inv(vectors)
    upper = np.flatnonzero(eigenvalues.imag > 0)
    start = np.empty((STAGES, STAGES))
    force = np.empty((STAGES, STAGES, STAGES))
    for pair, index in enumerate(upper):
        d = eigenvalues[index]
        projector = np.outer(vectors[:, index], inverse[index])
        # 2 Re[P (I - d* M)] K  =  2 Re(P) K - 2 Re(P d*) M K, and the forcing carries one more factor d.
        for target, matrix in ((start, projector.sum(axis=1)), (force, d * projector)):
            target[..., 2 * pair] = 2 * matrix.real
            target[..., 2 * pair + 1] = -2 * (matrix * np.conj(d)).real
    return (roots + 1) / 2, eigenvalues[upper], start, force


NODES, _EIGENVALUES, _START, _FORCE = _radau()
GRID = np.concatenate(([0.0], NODES))
TO_POLYNOMIAL = np.linalg.inv(polynomial.polyvander(2 * GRID - 1, STAGES))
"""Samples of a piece -> coefficients in 2θ - 1, lowest power first."""
_TOP = np.linalg.inv(legendre.legvander(2 * GRID - 1, STAGES))[-1]
_LEFT = legendre.legvander(np.array([-1.0]), STAGES - 1)[0] @ np.linalg.inv(
    legendre.legvander(2 * NODES - 1, STAGES - 1)
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Mesh:
    """The pieces of an interval, as shares of it: small ones first, because transients begin where the interval begins."""

    starts: Array
    lengths: Array

    @classmethod
    def graded(cls, octaves: int, split: int = 1) -> Self:
        """Return 2^-octaves, then octaves up to 1, each piece cut in ``split`` equal parts."""
        bounds = np.concatenate(([0.0], 2.0 ** np.arange(-octaves, 1)))
        fine = np.concatenate([np.linspace(lo, hi, split, endpoint=False) for lo, hi in pairwise(bounds)])
        return cls(starts=fine, lengths=np.diff(np.append(fine, 1.0)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Lanes:
    """A stack reduced to what a march needs: step sizes applied, states balanced, outputs chosen.

    Shapes: ``a`` (B, n, n), ``b`` (B, n, E), ``b2`` (B, n, m), ``c`` (B, o + m, n), ``d`` (B, o + m, E), ``dw`` (B, o + m, m),
    ``width`` (B,). The m last rows of c, d, dw are what enters the delay channels; E counts experiments, o outputs.
    """

    a: Array
    b: Array
    b2: Array
    c: Array
    d: Array
    dw: Array
    width: Array

    def take(self, index: Array) -> Self:
        """Return the candidates at ``index``."""
        return type(self)(**{item.name: getattr(self, item.name)[index] for item in fields(self)})

    @property
    def channels(self) -> int:
        """Number of delay channels."""
        return int(self.b2.shape[2])


def balance(a: Array) -> Array:
    """Return powers of two (B, n) that bring rows and columns of each matrix to equal size: a[i, j] s[j] / s[i]."""
    size = np.abs(a.real)
    n = size.shape[1]
    size[:, np.arange(n), np.arange(n)] = 0.0
    scale = np.ones(size.shape[:2])
    for _ in range(3):
        for i in range(n):
            row, column = size[:, i].sum(axis=1), size[:, :, i].sum(axis=1)
            usable = (row > 0) & (column > 0)
            factor = np.exp2(np.round(0.5 * np.log2(np.where(usable, row, 1.0) / np.where(usable, column, 1.0))))
            size[:, :, i] *= factor[:, None]
            size[:, i] /= factor[:, None]
            scale[:, i] *= factor
    return scale


@dataclass(frozen=True, kw_only=True, eq=False)
class Interval:
    """The linear map of one interval: ``step`` is T, ``read`` gives the output samples of the interval.

    Shapes: ``step`` (B, D, D), ``read`` (B, J * POINTS * o, D), with D = n + J * STAGES * m.
    """

    step: Array
    read: Array


def interval(lanes: Lanes, mesh: Mesh) -> Interval:
    """Return the map of one interval for every candidate, for deviations from the final value (no forcing)."""
    batch, n, m = lanes.a.shape[0], lanes.a.shape[1], lanes.channels
    rows = lanes.c.shape[1]
    pieces = len(mesh.lengths)
    lengths, which = np.unique(np.round(mesh.lengths, 15), return_inverse=True)
    h = lanes.width[:, None] * lengths
    dtype = np.result_type(lanes.a, lanes.b2, lanes.c, lanes.dw, lanes.width)

    m1 = h[..., None, None] * lanes.a[:, None]
    quadratic = np.eye(n) - 2 * _EIGENVALUES.real[:, None, None] * m1[:, :, None]
    quadratic = quadratic + (np.abs(_EIGENVALUES) ** 2)[:, None, None] * (m1 @ m1)[:, :, None]
    inverse = np.linalg.inv(quadratic)
    factors = np.stack([inverse, m1[:, :, None] @ inverse], axis=3).reshape(batch, len(lengths), STAGES, n, n)

    watched = np.concatenate([lanes.c, np.broadcast_to(np.eye(n), (batch, n, n))], axis=1)[:, None, None] @ factors
    forced = (watched @ lanes.b2[:, None, None]) * h[..., None, None, None]
    # Axes after moving: (B, length, node, row, state) and (B, length, node, row, forcing node, channel).
    free = np.moveaxis(np.tensordot(_START, watched, axes=(1, 2)), 0, 2)
    driven = np.tensordot(_FORCE, forced, axes=(2, 2)).transpose(2, 3, 0, 4, 1, 5)

    size = n + pieces * STAGES * m
    state = np.zeros((batch, n, size), dtype=dtype)
    state[:, np.arange(n), np.arange(n)] = 1.0
    samples = np.zeros((batch, pieces, POINTS, rows, size), dtype=dtype)
    node = np.arange(STAGES)
    for piece in range(pieces):
        u = which[piece]
        span = slice(n + piece * STAGES * m, n + (piece + 1) * STAGES * m)
        here = samples[:, piece]
        here[:, 0] = lanes.c @ state
        here[:, 1:] = (free[:, u, :, :rows].reshape(batch, -1, n) @ state).reshape(batch, STAGES, rows, size)
        if m:
            here[:, 0, :, span] += (_LEFT[:, None] * lanes.dw[:, :, None, :]).reshape(batch, rows, -1)
            inflow = driven[:, u, :, :rows].copy()
            inflow[:, node, :, node, :] += lanes.dw
            here[:, 1:, :, span] += inflow.reshape(batch, STAGES, rows, -1)
        state = free[:, u, -1, rows:] @ state
        if m:
            state[:, :, span] += driven[:, u, -1, rows:].reshape(batch, n, -1)
    into_channels = samples[:, :, 1:, rows - m :].reshape(batch, -1, size)
    return Interval(
        step=np.concatenate([state, into_channels], axis=1),
        read=np.ascontiguousarray(samples[:, :, :, : rows - m]).reshape(batch, -1, size),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Responses:
    """Responses of B candidates as P polynomial pieces.

    ``values`` (B, E, o, P, POINTS) at the points GRID of each piece; ``starts`` and ``lengths`` (P,) of the pieces in units
    of ``width`` (B,) s; ``final`` (B, E, o); ``resolution`` (B, E, o): the highest polynomial coefficient beside the largest
    value, an estimate of the relative error; ``settled`` (B,): followed until it rests; ``growth`` (B,): real part of the
    rightmost characteristic root, about, 1/s, NaN where its sign is open. Only settled responses mean anything.
    """

    starts: Array
    lengths: Array
    values: Array
    final: Array
    width: Array
    resolution: Array
    settled: Array
    growth: Array

    def take(self, index: Array) -> Self:
        """Return the candidates at ``index``."""
        common = {"starts": self.starts, "lengths": self.lengths}
        own = {item.name: getattr(self, item.name)[index] for item in fields(self) if item.name not in common}
        return type(self)(**common, **own)


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # what diverges may overflow; it is never read
def march(lanes: Lanes, mesh: Mesh, *, detail: int = 3, limit: int = 24, tolerance: float = 1e-8) -> Responses:
    """March every candidate until its deviation from the final value has decayed to ``tolerance`` of its largest.

    The first 2**detail intervals are resolved by the mesh. Each later octave of time is cut in 2**detail pieces: what is
    faster has died out by then, or else shows in ``resolution``. Candidates at rest keep their final value from there on.

    Parameters
    ----------
    lanes : Lanes
    mesh : Mesh
    detail : int
    limit : int
        At most 2**limit intervals; a candidate that needs more is not ``settled``.
    tolerance : float
    """
    one = interval(lanes, mesh)
    batch, outputs, experiments = lanes.a.shape[0], lanes.c.shape[1] - lanes.channels, lanes.b.shape[2]
    growth, settled = np.full(batch, -np.inf), np.zeros(batch, dtype=bool)
    steady, final, regular = _steady(lanes, len(mesh.lengths))
    alive = np.arange(batch)
    # powers[k] is T to the power of 2**(span + k): from one coarse piece up to one octave of time.
    powers = [one.step]
    block = -steady
    for step in range(detail):
        block = np.concatenate([block, powers[step] @ block], axis=2)
        powers.append(powers[step] @ powers[step])
    state = powers[detail] @ (-steady)
    count = 2**detail
    parts = [(alive, _samples(one.read, block, outputs, experiments))]
    starts = [(np.arange(count)[:, None] + mesh.starts).ravel()]
    lengths = [np.tile(mesh.lengths, count)]
    largest = np.abs(block.real).reshape(batch, block.shape[1], count, experiments).max(axis=2)
    coarse = _whole_interval(one.read, mesh)
    open_ = np.ones(batch, dtype=bool)
    for stage in range(detail, limit + 1):
        size = np.abs(powers[-1].real).sum(axis=2).max(axis=1)
        watched = np.flatnonzero(open_[alive])
        who = alive[watched]
        rate = np.log(np.where(np.isnan(size), np.inf, size)) / (2.0**stage * lanes.width.real[alive])
        growth[who] = rate[watched]
        # A response at rest proves nothing about modes that it does not excite; the norm of the map does.
        quiet = (np.abs(state.real) <= tolerance * largest).all(axis=(1, 2)) & (size < 0.5) & regular[alive]
        settled[alive[quiet]] = True
        open_[alive[quiet | ~(size <= 1e12)]] = False
        go = np.flatnonzero(open_[alive])
        if not go.size or stage == limit:
            break
        # Leaving candidates out costs a copy of everything, so it must be worth it.
        if go.size < 0.8 * alive.size or not np.isfinite(size).all():
            alive, state, coarse, largest = alive[go], state[go], coarse[go], largest[go]
            powers = [power[go] for power in powers]
        block = state
        for power in powers[:-1]:
            block = np.concatenate([block, power @ block], axis=2)
        span = stage - detail
        parts.append((alive, _samples(coarse, block, outputs, experiments)))
        starts.append(2.0**stage + 2.0**span * np.arange(count))
        lengths.append(np.full(count, 2.0**span))
        coarse = _twice(coarse, powers[0])
        state = powers[-1] @ state
        powers = [*powers[1:], powers[-1] @ powers[-1]]
    # Neither fallen below 1 nor grown beyond all bounds: the norm of the map bounds the rate, and leaves its sign open.
    growth[open_ & (growth >= 0)] = np.nan
    values = _joined(parts, final)
    flat = values.real.reshape(batch, experiments, outputs, -1)
    extent = np.maximum(flat.max(axis=3), -flat.min(axis=3))
    top = np.abs((values.real - final.real[..., None, None]) @ _TOP).max(axis=3)
    return Responses(
        starts=np.concatenate(starts), lengths=np.concatenate(lengths), values=values, final=final, width=lanes.width,
        resolution=top / np.where(extent > 0, extent, 1.0), settled=settled, growth=growth,
    )  # fmt: skip


def _joined(parts: list[tuple[Array, Array]], final: Array) -> Array:
    """Return the outputs (B, E, o, P, POINTS) from deviations of those candidates that were still marching."""
    pieces = np.cumsum([0, *(part.shape[3] for _, part in parts)])
    shape = (*final.shape, int(pieces[-1]), POINTS)
    values = np.zeros(shape, dtype=np.result_type(final, *(part for _, part in parts)))
    for (who, part), (start, end) in zip(parts, pairwise(pieces), strict=True):
        values[who, :, :, start:end] = part
    values += final[..., None, None]
    return values


def _whole_interval(read: Array, mesh: Mesh) -> Array:
    """Return the rows (B, POINTS * o, D) that read the outputs at the points of an interval taken as one piece."""
    batch, size = read.shape[0], read.shape[2]
    fine = read.reshape(batch, len(mesh.lengths), POINTS, -1, size)
    piece = np.searchsorted(mesh.starts, GRID, side="right") - 1
    weights = _weights((GRID - mesh.starts[piece]) / mesh.lengths[piece])
    return np.asarray(np.einsum("gi,bgirk->bgrk", weights, fine[:, piece]).reshape(batch, -1, size))


def _twice(read: Array, step: Array) -> Array:
    """Return the rows for a piece of twice the length, when ``step`` takes the state over the present length."""
    batch, size = read.shape[0], read.shape[2]
    first = GRID < 0.5
    halves = read.reshape(batch, POINTS, -1, size), (read @ step).reshape(batch, POINTS, -1, size)
    shape = (batch, -1, size)
    return np.concatenate(
        [
            np.tensordot(_weights(2 * GRID[first]), halves[0], axes=(1, 1)).swapaxes(0, 1).reshape(shape),
            np.tensordot(_weights(2 * GRID[~first] - 1), halves[1], axes=(1, 1)).swapaxes(0, 1).reshape(shape),
        ],
        axis=1,
    )


def _weights(theta: Array) -> Array:
    """Return the weights (k, POINTS) of a piece's samples for its value at theta in [0, 1]."""
    return polynomial.polyvander(2 * theta - 1, STAGES) @ TO_POLYNOMIAL


def _samples(read: Array, block: Array, outputs: int, experiments: int) -> Array:
    """Return deviations of the outputs (B, E, o, P, POINTS) for interval starts (B, D, K * E)."""
    batch = read.shape[0]
    values = (read @ block).reshape(batch, -1, POINTS, outputs, block.shape[2] // experiments, experiments)
    values = values.transpose(0, 5, 3, 4, 1, 2)
    return values.reshape(*values.shape[:3], -1, POINTS)


def _steady(lanes: Lanes, pieces: int) -> tuple[Array, Array, Array]:
    """Return the final vector (B, D, E), the final outputs (B, E, o) and whether they exist (B,).

    0 = A x + B u + B2 w,  w = C2 x + D21 u + D22 w: at rest a delay passes what it gets.
    """
    n, m = lanes.a.shape[1], lanes.channels
    outputs = lanes.c.shape[1] - m
    matrix = np.concatenate(
        [
            np.concatenate([lanes.a, lanes.b2], axis=2),
            np.concatenate([lanes.c[:, outputs:], lanes.dw[:, outputs:] - np.eye(m)], axis=2),
        ],
        axis=1,
    )
    right = -np.concatenate([lanes.b, lanes.d[:, outputs:]], axis=1)
    sizes = np.abs(matrix.real).max(axis=2, initial=0.0)
    regular = np.isfinite(sizes).all(axis=1) & (sizes > 0).all(axis=1)
    if n + m:
        scaled = matrix.real / np.where(sizes > 0, sizes, 1.0)[:, :, None]
        regular &= np.linalg.cond(np.where(regular[:, None, None], scaled, np.eye(n + m))) < 1e14
    safe = np.where(regular[:, None, None], matrix, np.eye(n + m))
    rest = np.linalg.solve(safe, right)
    x, w = rest[:, :n], rest[:, n:]
    final = lanes.c[:, :outputs] @ x + lanes.dw[:, :outputs] @ w + lanes.d[:, :outputs]
    steady = np.concatenate([x, np.tile(w, (1, pieces * STAGES, 1))], axis=1)
    return steady, np.swapaxes(final, 1, 2), regular
