"""Where an eigenvalue of a family of maps passes the unit circle.

ln |z_i(q)| = 0;   dq/dp = -(∂ ln|z| / ∂p) / (∂ ln|z| / ∂q),   ∂ ln z = wᴴ ∂Φ v / (z wᴴ v)

A grid of q is refined wherever a branch may touch the circle between two neighbours, as far as the bend of the branch there
tells. That no crossing is missed is not proven: two that lie closer than the finest grid, on a branch that looks straight
on both sides of it, would be.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.linalg import eig

Real = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
Family = Callable[[Real], "Complex | Real"]
"""Maps (k, N, N) at k values of the variable."""

_EPS: Final = float(np.finfo(float).eps)
_FINEST: Final = 9
"""How often an interval of the grid is halved at most."""
_BENT: Final = 4.0
"""A branch touches nothing that is further away than so many times what it bends by between neighbours."""
_NEAR: Final = 0.7
"""A branch is looked at closely where ln|z| is within this of 0."""
_TURNS: Final = 60


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spectrum:
    """Eigenvalues (N,) at one value of the variable, and how far rounding may have moved each; ``known`` is False beyond all numbers.

    The columns of ``vectors`` are the right eigenvectors.
    """

    values: Complex
    uncertainty: Real
    vectors: Complex
    known: bool = True

    @property
    def heights(self) -> Real:
        """The logarithm of each magnitude, negative inside the unit circle."""
        return np.log(np.maximum(np.abs(self.values), 1e-300))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Crossing:
    """The variable and the eigenvalue on the unit circle there, with its left and right eigenvector."""

    at: float
    eigenvalue: complex
    left: Complex
    right: Complex

    def mirrored(self) -> Crossing:
        """Return the crossing at the negative frequency: of a real system the other half."""
        return Crossing(
            at=-self.at, eigenvalue=self.eigenvalue.conjugate(), left=self.left.conj(), right=self.right.conj()
        )


def crossings(family: Family, grid: Real) -> list[Crossing]:
    """Return every crossing between the ends of a rising ``grid``, rising; none where the maps are beyond all numbers."""
    nodes = dict(zip(grid.tolist(), spectra(family(grid)), strict=True))
    brackets: list[tuple[float, float, complex, complex]] = []
    open_ = [(left, right, 0) for left, right in pairwise(grid.tolist())]
    while open_:
        middles = np.array([0.5 * (left + right) for left, right, _ in open_])
        nodes.update(zip(middles.tolist(), spectra(family(middles)), strict=True))
        further: list[tuple[float, float, int]] = []
        for (left, right, depth), middle in zip(open_, middles.tolist(), strict=True):
            first_end, inner, last_end = _evened(nodes[left], nodes[middle], nodes[right])
            if not (first_end.known and last_end.known and inner.known):
                continue
            first, second = _pairs(first_end, inner), _pairs(inner, last_end)
            if depth < _FINEST and _hides(first_end, inner, last_end, first, second):
                further += [(left, middle, depth + 1), (middle, right, depth + 1)]
            else:
                brackets += _brackets(left, middle, first_end, inner, first)
                brackets += _brackets(middle, right, inner, last_end, second)
        open_ = further
    found = [_root(family, *bracket) for bracket in brackets]
    return sorted((one for one in found if one is not None), key=lambda one: one.at)


def spectra(maps: Complex | Real) -> list[Spectrum]:
    """Return the eigenvalues of each map."""
    known = np.asarray(np.isfinite(maps).all(axis=(1, 2)))
    values, right = np.linalg.eig(np.where(known[:, None, None], maps, 0.0))
    try:
        left = np.linalg.inv(right)  # row by row, of product 1 with the right ones
    except np.linalg.LinAlgError:
        left = np.linalg.pinv(right, rcond=_EPS)
    size = ((np.abs(left) @ np.abs(maps)) * np.abs(right).swapaxes(1, 2)).sum(axis=2)
    found = []
    for k in range(len(maps)):
        if known[k]:
            found.append(Spectrum(values=values[k].astype(complex), uncertainty=20 * _EPS * size[k], vectors=right[k]))
        else:
            n = maps.shape[-1]
            nothing = np.full(n, np.nan + 0j)
            found.append(Spectrum(values=nothing, uncertainty=np.full(n, np.inf), vectors=right[k], known=False))
    return found


def _evened(*found: Spectrum) -> list[Spectrum]:
    """Return spectra of one length: eigenvalues that one of them leaves out are small."""
    most = max(len(one.values) for one in found)
    further = [(0, most - len(one.values)) for one in found]
    if not any(by for _, by in further):
        return list(found)
    return [
        replace(one, values=np.pad(one.values, by), uncertainty=np.pad(one.uncertainty, by))
        for one, by in zip(found, further, strict=True)
    ]


def _eigenvectors(whole: Complex | Real) -> tuple[Complex, Complex, Complex]:
    """Return eigenvalues (N,) with their left and right eigenvectors, the columns of (N, N)."""
    found: Any = eig(whole, left=True, right=True)
    values, left, right = found
    return values, left, right


def _pairs(one: Spectrum, other: Spectrum) -> npt.NDArray[np.int64]:
    """Return which eigenvalue of the ``other`` each one has become."""
    from scipy.optimize import linear_sum_assignment  # noqa: PLC0415 - a quarter of a second

    size = np.abs(one.values)[:, None] + np.abs(other.values)[None, :] + 1e-6
    distance = np.abs(one.values[:, None] - other.values[None, :]) / size
    return np.asarray(linear_sum_assignment(distance)[1])


def _hides(
    left: Spectrum, middle: Spectrum, right: Spectrum, first: npt.NDArray[np.int64], second: npt.NDArray[np.int64]
) -> bool:
    """Return whether a branch may pass the circle twice between neighbours, or bends where it passes it."""
    a, b, c = left.heights, middle.heights[first], right.heights[second[first]]
    bend = np.abs(b - 0.5 * (a + c))
    nearest = np.minimum(np.minimum(np.abs(a), np.abs(b)), np.abs(c))
    sure = 10 * (left.uncertainty + middle.uncertainty[first] + right.uncertainty[second[first]])
    near = (nearest < _NEAR) & (bend > sure)
    same = (np.sign(a) == np.sign(b)) & (np.sign(b) == np.sign(c))
    crowded = same & (nearest < _BENT * bend)
    crooked = ~same & (bend > 0.2 * (np.abs(b - a) + np.abs(c - b)))
    return bool((near & (crowded | crooked)).any())


def _brackets(
    left: float, right: float, one: Spectrum, other: Spectrum, pairs: npt.NDArray[np.int64]
) -> list[tuple[float, float, complex, complex]]:
    a, b = one.heights, other.heights[pairs]
    changes = (a < 0) != (b < 0)
    changes &= (np.abs(a) > one.uncertainty) & (np.abs(b) > other.uncertainty[pairs])
    return [(left, right, complex(one.values[k]), complex(other.values[pairs[k]])) for k in np.flatnonzero(changes)]


def _root(family: Family, left: float, right: float, one: complex, other: complex) -> Crossing | None:
    """Return the crossing of the branch between two eigenvalues, by the Illinois method; None where it cannot be followed."""
    low, high = np.log(abs(one)), np.log(abs(other))
    weights = [low, high]
    found = None
    still = 4 * _EPS * max(abs(left), abs(right))
    for _ in range(_TURNS):
        part = weights[0] / (weights[0] - weights[1])
        before, at = found, left + min(max(part, 1e-3), 1 - 1e-3) * (right - left)
        found = nearest(family, at, one + (other - one) * (at - left) / (right - left))
        if found is None:
            return None
        height = float(np.log(abs(found.eigenvalue)))
        if abs(height) < 4 * _EPS or right - left <= still or (before is not None and abs(at - before.at) <= still):
            break
        if (height < 0) == (low < 0):
            left, one, low, weights = at, found.eigenvalue, height, [height, 0.5 * weights[1]]
        else:
            right, other, high, weights = at, found.eigenvalue, height, [0.5 * weights[0], height]
    assert found is not None
    reached = abs(np.log(abs(found.eigenvalue))) < max(1e-9, 1e-3 * max(abs(low), abs(high)))
    return found if reached else None


def nearest(family: Family, at: float, expected: complex) -> Crossing | None:
    """Return the eigenvalue nearest to the ``expected`` one, with its vectors; None where the map is beyond all numbers."""
    whole = np.asarray(family(np.array([at]))[0])
    if not np.isfinite(whole).all():
        return None
    values, left, right = _eigenvectors(whole)
    k = int(np.argmin(np.abs(values - expected)))
    w, v = left[:, k], right[:, k]
    # the quotient of both vectors is wrong to second order only
    better = (w.conj() @ whole @ v) / (w.conj() @ v)
    eigenvalue = better if abs(better - values[k]) < 1e-6 * abs(values[k]) else values[k]
    return Crossing(at=at, eigenvalue=complex(eigenvalue), left=w, right=v)
