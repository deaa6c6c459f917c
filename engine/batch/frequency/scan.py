"""The response of one path of many systems of one structure, and the frequencies between which it peaks or crosses a level.

    G(s) = G11 + G12 (I - Δ G22)⁻¹ Δ G21,   Δ = diag(e^{-s τ}),   G_ij(s) = C_i (s I - A)⁻¹ B_j + D_ij

The eigenvalues of A make a frequency cost n divisions. Where the eigenvectors are nearly dependent, it is solved instead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from engine.model.linear_system import Array

_PER_DECADE = 32
_TURNS = 120
_REACH = 1e-7, 1e5
"""How far the scan goes below the lowest and above the highest corner, where only limits are left to be found."""
_WELL_CONDITIONED = 1e7
_AROUND, _BETWEEN = np.array([-4.0, -1.0, 0.0, 1.0, 4.0]), np.array([-2.5, -0.5, 0.5, 2.5, 8.0])
"""Places around a pole and its conjugate, in parts of how far it is from the axis."""
_AT_NYQUIST = 1e-9
"""A pole of a sampled path that is nearer to z = -1 than this is as fast as that."""
_NUDGE = 1e-10
_LEVEL = 1e-12
"""A curve rises where it does so by more than this part of itself."""
_NARROWED = 5
"""How often the place where a curve turns near to a level is narrowed, to a quarter each time."""
_TOUCHES = 1e-7
"""Nearer to the level than this part of the samples beside it, whether a curve passes it is left to the exact path."""

Level: TypeAlias = Callable[[Array, Array], Array]


@dataclass(frozen=True, kw_only=True, eq=False)
class Path:
    """One path of B systems: ``b`` (B, n, 1 + m), ``c`` (B, 1 + m, n), ``d`` (B, 1 + m, 1 + m); delay channels come last.

    Of a ``sampled`` one ``a`` is A - 1 of x_(k+1) = A x_k + b u_k, and a frequency ω stands for z = (1 + jω)/(1 - jω): the unit circle is
    the imaginary axis, and no slow mode loses digits to the 1 beside it.
    """

    a: Array
    b: Array
    c: Array
    d: Array
    delays: Array
    sampled: bool = False

    def variable(self, omega: Array) -> tuple[Array, Array]:
        """Return what the eigenvalues of ``a`` are subtracted from at frequencies, s or z - 1, and its derivative by ω."""
        if not self.sampled:
            return 1j * omega, np.full(omega.shape, 1j)
        return 2j * omega / (1 - 1j * omega), 2j / (1 - 1j * omega) ** 2

    @property
    def at_the_end(self) -> Array:
        """The response where the axis ends without delays, real, with its infinitesimals, (B,); NaN where a pole lies there."""
        if not self.sampled:
            return self.d[:, 0, 0]
        whole = -2 * np.eye(self.a.shape[1]) - self.a
        there = np.linalg.svd(whole.real, compute_uv=False)[:, -1] > _AT_NYQUIST
        whole[~there] = np.eye(self.a.shape[1])
        found = (self.c @ np.linalg.solve(whole, self.b) + self.d)[:, 0, 0]
        return np.where(there, found, np.nan)

    @property
    def batch(self) -> int:
        """Number of systems."""
        return int(self.a.shape[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class Readings:
    """A metric of many systems: ``value`` (B,) with infinitesimals, NaN where there is none; ``doubtful`` (B,)."""

    value: Array
    doubtful: Array


class Scan:
    """The response of a path, real parts only, wherever it is asked for.

    Parameters
    ----------
    path : Path
    slowest : ndarray, shape (B,), optional
        How slowly what the path belongs to decays, where the scan has to begin far below.
    """

    def __init__(self, path: Path, slowest: Array | None = None) -> None:
        self._path = path
        self._tau = path.delays.real
        a = path.a.real
        batch, n = a.shape[:2]
        self._eigenvalues, vectors, self._modal = _eigenvectors(a)
        # Repeated poles (two integrators in a loop) have dependent eigenvectors; those of a neighbour are good enough to
        # scan with, because what is found is polished on the system itself.
        repeated = np.flatnonzero(~self._modal)
        if repeated.size:
            i, j = np.indices((n, n))
            nudge = _NUDGE * np.abs(a[repeated]).max(axis=(1, 2))[:, None, None] * np.cos(1.0 + 3.0 * i + 7.0 * j)
            self._eigenvalues[repeated], vectors[repeated], self._modal[repeated] = _eigenvectors(a[repeated] + nudge)
        safe = np.where(self._modal[:, None, None], vectors, np.eye(n))
        ports = path.d.shape[1]
        left = np.linalg.solve(safe, path.b.real.astype(complex)) if n else np.zeros((batch, 0, ports))
        right = path.c.real @ safe
        # (B, n, ports * ports): the residue of every entry at every pole
        self._residues = (np.swapaxes(right, 1, 2)[:, :, :, None] * left[:, :, None, :]).reshape(batch, n, -1)
        self._poles = self._eigenvalues
        if path.sampled:
            fast = np.abs(2 + self._poles) < _AT_NYQUIST
            self._poles = self._poles / np.where(fast, _AT_NYQUIST, 2 + self._poles)
        low, high, counts = self._reach(slowest)
        # Each has its own frequencies, whoever is beside it, and their response is computed for those alone that have as many: the order
        # in which sums are taken depends on the number. Whoever has fewer repeats its last one, where nothing happens.
        grids = {int(count): np.flatnonzero(counts == count) for count in np.unique(counts)}
        width = self._grid(low[:1], high[:1], max(grids, default=0), np.arange(1)).shape[1] if batch else 0
        self.frequencies, self.response = np.empty((batch, width)), np.empty((batch, width), dtype=complex)
        for count, rows in grids.items():
            omega = self._grid(low[rows], high[rows], count, rows)
            own, last = omega.shape[1], omega.shape[1] - 1
            self.frequencies[rows, :own], self.response[rows, :own] = omega, self.at(rows, omega)
            self.frequencies[rows, own:] = omega[:, last:]
            self.response[rows, own:] = self.response[rows, last][:, None]

    def at(self, rows: Array, omega: Array) -> Array:
        """Return G(jω) of systems ``rows`` (k,) at their own frequencies ``omega`` (k, q)."""
        path = self._path
        k, q = omega.shape
        ports = path.d.shape[1]
        modal = self._modal[rows]
        with np.errstate(divide="ignore", invalid="ignore"):
            variable, _ = path.variable(omega)
            parts = 1.0 / (variable[:, :, None] - self._eigenvalues[rows, None, :])
            inner = (parts @ self._residues[rows]).reshape(k, q, ports, ports) + path.d.real[rows, None]
        for index in np.flatnonzero(~modal):
            row = rows[index]
            resolvent = variable[index][:, None, None] * np.eye(path.a.shape[1]) - path.a[row].real
            inner[index] = (
                path.c[row].real @ np.linalg.solve(resolvent, path.b[row].real[None].astype(complex)) + path.d[row].real
            )
        if ports == 1:
            return np.asarray(inner[..., 0, 0])
        turn = np.exp(-1j * omega[:, :, None] * self._tau[rows, None, :])
        with np.errstate(divide="ignore", invalid="ignore"):
            if ports == 2:
                e = turn[..., 0]
                return np.asarray(
                    inner[..., 0, 0] + inner[..., 0, 1] * e * inner[..., 1, 0] / (1 - e * inner[..., 1, 1])
                )
        delayed = np.linalg.solve(
            np.eye(ports - 1) - turn[..., :, None] * inner[..., 1:, 1:], turn[..., None] * inner[..., 1:, :1]
        )
        return np.asarray(inner[..., 0, 0] + (inner[..., :1, 1:] @ delayed)[..., 0, 0])

    def _reach(self, slowest: Array | None) -> tuple[Array, Array, Array]:
        """Return the lowest and the highest corner (B,), and how many frequencies are between and about them (B,)."""
        size = np.abs(self._poles)
        top = size.max(axis=1, initial=0.0)
        inverse = self._inverse_delay()
        corner = np.where(size > 1e-9 * top[:, None], size, np.inf).min(axis=1, initial=np.inf)
        low = np.minimum(corner, np.where(inverse > 0, inverse, np.inf))
        low = np.where(np.isfinite(low), low, 1.0)
        low = low if slowest is None else np.minimum(low, slowest)
        high = np.maximum(np.maximum(top, inverse), low)
        decades = np.ceil(np.log10(100 * high / low))
        return low, high, np.clip(_PER_DECADE * decades, 64, 400).astype(int)

    def _inverse_delay(self) -> Array:
        delay = self._tau.sum(axis=1)
        return np.asarray(1.0 / np.where(delay > 0, delay, np.inf))

    def _grid(self, low: Array, high: Array, count: int, rows: Array) -> Array:
        """Return rising frequencies (k, q) of systems ``rows``: a logarithmic sweep, the neighbourhood of every pole, the turns of the delays."""
        poles, inverse = self._poles[rows], self._inverse_delay()[rows]
        inside = np.geomspace(0.05 * low, 10 * high, count, axis=1)
        tails = np.concatenate(
            [
                np.geomspace(_REACH[0] * low, 0.04 * low, 14, axis=1),
                np.geomspace(12 * high, _REACH[1] * high, 14, axis=1),
            ],
            axis=1,
        )
        size = np.abs(poles)
        width = np.maximum(np.abs(poles.real), 1e-9 * size)
        # both poles of a pair have their places: no frequency stands twice, between whose neighbours nothing would be seen to turn
        places = np.where(poles.imag[:, :, None] < 0, _BETWEEN, _AROUND)
        around = np.abs(poles.imag)[:, :, None] + width[:, :, None] * places
        pieces = [inside, tails, around.reshape(len(low), -1)]
        if self._tau.shape[1]:
            pieces.append(np.where(inverse > 0, inverse, low)[:, None] * 0.25 * np.arange(1, _TURNS + 1))
        omega = np.concatenate(pieces, axis=1)
        return np.sort(np.clip(omega, _REACH[0] * low[:, None], _REACH[1] * high[:, None]), axis=1)

    def peak(self, height: Callable[[Array, Array], Array]) -> Array:
        """Return the frequency (B,) at which ``height`` of the response and its frequency is largest."""
        rows = np.arange(self._path.batch)
        heights = height(self.response, self.frequencies)
        heights = np.where(np.isfinite(heights), heights, -np.inf)
        last = heights.shape[1] - 1
        padded = np.pad(heights, ((0, 0), (1, 1)), constant_values=-np.inf)
        with np.errstate(invalid="ignore"):
            rises = heights - padded[:, :-2] > _LEVEL * np.abs(heights)  # a plateau has one summit, its first place
        summits = np.where(rises & (heights >= padded[:, 2:]), heights, -np.inf)
        best_height = np.full(len(rows), -np.inf)
        best = self.frequencies[:, 0].copy()
        for _ in range(2):
            place = summits.argmax(axis=1)
            low = self.frequencies[rows, np.maximum(place - 1, 0)]
            high = self.frequencies[rows, np.minimum(place + 1, last)]
            trial = value = np.zeros((len(rows), 9))
            middle = place
            for _ in range(4):
                trial = low[:, None] * (high / low)[:, None] ** (np.arange(9) / 8)
                value = height(self.at(rows, trial), trial)
                middle = np.where(np.isfinite(value), value, -np.inf).argmax(axis=1)
                low, high = trial[rows, np.maximum(middle - 1, 0)], trial[rows, np.minimum(middle + 1, 8)]
            # The parabola through the last three, on a logarithmic axis.
            centre = np.clip(middle, 1, 7)
            a, b, c = (value[rows, centre + shift] for shift in (-1, 0, 1))
            bend = a - 2 * b + c
            shift = np.where(bend < 0, np.clip(0.5 * (a - c) / np.where(bend < 0, bend, -1.0), -1.0, 1.0), 0.0)
            shift = np.where(centre == middle, shift, middle - centre)
            found = trial[rows, centre] * (trial[:, 1] / trial[:, 0]) ** shift
            found_height = value[rows, middle]
            higher = found_height > best_height
            best_height, best = np.where(higher, found_height, best_height), np.where(higher, found, best)
            np.put_along_axis(summits, place[:, None], -np.inf, axis=1)
        return best

    def hidden(self, size: Array) -> Array:
        """Return for whom (B,) the delays turn by more than a radian between two frequencies, |G| there being at least ``size``."""
        turns = np.diff(self.frequencies, axis=1) * self._tau.sum(axis=1)[:, None] > 1.0
        large = np.abs(self.response) >= size[:, None]
        return np.asarray((turns & (large[:, :-1] | large[:, 1:])).any(axis=1))

    def crossings(self, level: Level, *, first_fall: bool = False) -> tuple[Array, Array, Array]:
        """Return (systems, frequencies) of every sign change of ``level``, or of the first fall only, and who is doubtful, (B,).

        ``level`` gets responses (k, q) and the systems (k,) that they belong to.
        """
        values = level(self.response, np.arange(self._path.batch))
        changes = (values[:, :-1] >= 0) != (values[:, 1:] >= 0)
        changes &= np.isfinite(values[:, :-1]) & np.isfinite(values[:, 1:])
        rows, place = np.nonzero(changes)
        seen = rows, *(part[rows, k] for k in (place, place + 1) for part in (self.frequencies, values))
        unseen, touched = self._unseen(level, values)
        rows, low, at_low, high, at_high = (np.concatenate(parts) for parts in zip(seen, *unseen, strict=True))
        doubtful = np.zeros(self._path.batch, dtype=bool)
        doubtful[touched] = True
        if first_fall:
            falls = np.flatnonzero((at_low >= 0) & (at_high < 0))
            falls = falls[np.lexsort((low[falls], rows[falls]))]
            _, first = np.unique(rows[falls], return_index=True)
            rows, low, at_low, high, at_high = (part[falls[first]] for part in (rows, low, at_low, high, at_high))
        for step in range(16):
            weight = (
                np.clip(at_low / np.where(at_low == at_high, 1.0, at_low - at_high), 0.01, 0.99) if step % 3 else 0.5
            )
            middle = low + (high - low) * weight
            value = level(self.at(rows, middle[:, None]), rows)[:, 0]
            same = (value >= 0) == (at_low >= 0)
            low, at_low = np.where(same, middle, low), np.where(same, value, at_low)
            high, at_high = np.where(same, high, middle), np.where(same, at_high, value)
        return rows, np.where(np.abs(at_low) < np.abs(at_high), low, high), doubtful

    def _unseen(self, level: Level, values: Array) -> tuple[list[tuple[Array, ...]], Array]:
        """Return what encloses crossings of a level that is passed twice between three samples, and who may only touch it.

        The samples are all on one side, the middle one is the nearest, and nearer than the curve bends: its turning point is looked for.
        """
        away = np.abs(values)
        left, middle, right = away[:, :-2], away[:, 1:-1], away[:, 2:]
        same = (np.sign(values[:, :-2]) == np.sign(values[:, 1:-1])) & (
            np.sign(values[:, 2:]) == np.sign(values[:, 1:-1])
        )
        turns = same & (middle <= left) & (middle <= right) & (middle < left - 2 * middle + right)
        rows, place = np.nonzero(turns)
        side = np.sign(values[rows, place + 1])
        ends = self.frequencies[rows, place], self.frequencies[rows, place + 2]
        low, high = ends
        best, depth = self.frequencies[rows, place + 1], middle[rows, place]
        for _ in range(_NARROWED):
            trial = low[:, None] + (high - low)[:, None] * (np.arange(9) / 8)
            height = side[:, None] * level(self.at(rows, trial), rows)
            k = np.where(np.isfinite(height), height, np.inf).argmin(axis=1)
            best, depth = trial[np.arange(len(rows)), k], height[np.arange(len(rows)), k]
            low, high = (trial[np.arange(len(rows)), np.clip(k + step, 0, 8)] for step in (-1, 1))
        touches = np.abs(depth) <= _TOUCHES * np.minimum(left, right)[rows, place]
        twice = (depth < 0) & ~touches
        rows_, at = rows[twice], side[twice] * depth[twice]
        before = rows_, ends[0][twice], values[rows_, place[twice]], best[twice], at
        behind = rows_, best[twice], at, ends[1][twice], values[rows_, place[twice] + 2]
        return [before, behind], rows[touches]


def _eigenvectors(a: Array) -> tuple[Array, Array, Array]:
    """Return eigenvalues (B, n), eigenvectors (B, n, n), and whose eigenvectors are independent (B,)."""
    # complex whether or not some pole of somebody is
    poles, vectors = (found.astype(complex) for found in np.linalg.eig(a))
    if not a.shape[1]:
        return poles, vectors, np.ones(len(a), dtype=bool)
    singular = np.linalg.svd(vectors, compute_uv=False)
    return poles, vectors, singular[:, -1] * _WELL_CONDITIONED > singular[:, 0]
