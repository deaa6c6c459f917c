"""Bounded nonlinear least squares from several starts: the trust-region reflective method with exact Jacobians.

    minimize  ½ ||r(x)||²   subject to   lower <= x <= upper

A start where the residuals do not exist (an unstable trial model) is passed over; a trial step into such a place is
taken back by the trust region. The best of the local minima counts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

Vector = npt.NDArray[np.float64]

_NOTHING = 1e-6
"""Part of the cost,"""
_ROUNDING = 1e-12
"""and of that at the start, that a bound may cost more than a point beside it."""

Evaluation = Callable[[Vector], tuple[Vector, Vector]]
"""x -> (residuals (m,), Jacobian (m, n)); not finite where the residuals do not exist."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Minimum:
    """A local minimum: where, what is left, the slopes there, and whether the method says that it is one."""

    x: Vector
    residuals: Vector
    jacobian: Vector
    converged: bool
    evaluations: int

    @property
    def cost(self) -> float:
        """Half the sum of squared residuals."""
        return 0.5 * float(np.sum(self.residuals**2))


@dataclass(frozen=True, kw_only=True)
class Reached:
    """How far a search is: which start it is at, the best point on the way from there, and the best of the minima before.

    The trust region is not part of it: a search that goes on from here opens a new one.
    """

    start: int
    here: tuple[float, ...] | None = None
    spent: int = 0
    best: tuple[float, ...] | None = None
    converged: bool = False


def minimize_squares(
    evaluate: Evaluation,
    starts: npt.NDArray[np.float64],
    *,
    lower: Vector,
    upper: Vector,
    max_evaluations: int = 100,
    least_gain: float = 1e-9,
    reached: Reached | None = None,
    tell: Callable[[Reached], None] | None = None,
    others: Callable[[Vector], Iterator[Minimum | None] | None] = lambda _: None,
) -> Minimum | None:
    """Return the best local minimum of the sum of squares, None when the residuals exist at no start.

    Parameters
    ----------
    evaluate : callable
        Residuals with their Jacobian.
    starts : ndarray, shape (starts, n)
        Within the bounds.
    lower, upper : ndarray, shape (n,)
        May be infinite.
    max_evaluations : int
        For each start.
    least_gain : float
        A minimum is one where the next step lowers the cost by less than this part of it.
    reached : Reached, optional
        Where an earlier run of the same search was cut off.
    tell : callable, optional
        Is told how far the search is, whenever it got further.
    others : callable, optional
        Is asked, when the first start has been followed, for the minima of those that are left; None to follow them here.

    References
    ----------
    M. Branch, T. Coleman, Y. Li, "A subspace, interior, and conjugate gradient method for large-scale
    bound-constrained minimization problems", SIAM J. Sci. Comput. 21 (1999) 1-23, as implemented in SciPy.
    """
    now = reached or Reached(start=0)
    best: Minimum | None = None
    if now.best is not None:
        x = np.array(now.best)
        residuals, jacobian = evaluate(x)
        best = Minimum(x=x, residuals=residuals, jacobian=jacobian, converged=now.converged, evaluations=1)

    first, minima = now.start, None
    for number in range(first, len(starts)):
        if number == first + 1:
            minima = others(starts[number:])
        if minima is None:
            begin, spent = starts[number], 0
            if number == first and now.here is not None:
                begin, spent = np.array(now.here), min(now.spent, max_evaluations - 1)
            note = _Note(replace(now, start=number), spent, tell)
            minimum = _local(evaluate, begin, lower, upper, max_evaluations - spent, least_gain=least_gain, note=note)
        else:
            minimum = next(minima)
        if minimum is not None and (best is None or minimum.cost < best.cost):
            best = minimum
        found = None if best is None else tuple(best.x.tolist())
        now = Reached(start=number + 1, best=found, converged=best is not None and best.converged)
        if tell is not None:
            tell(now)
    return best


@dataclass(frozen=True)
class _Note:
    """Tells of the way from one start."""

    before: Reached
    spent: int
    tell: Callable[[Reached], None] | None

    def __call__(self, x: Vector, count: int) -> None:
        """Tell of the best point until here, after so many evaluations."""
        if self.tell is not None:
            self.tell(replace(self.before, here=tuple(x.tolist()), spent=self.spent + count))


def _local(
    evaluate: Evaluation,
    start: Vector,
    lower: Vector,
    upper: Vector,
    max_evaluations: int,
    *,
    least_gain: float,
    note: Callable[[Vector, int], None],
) -> Minimum | None:
    last: dict[bytes, tuple[Vector, Vector]] = {}
    lowest, count = np.inf, 0

    def at(x: Vector) -> tuple[Vector, Vector]:
        # the residuals of a step and, if it is taken, its slopes are asked for one after the other
        nonlocal lowest, count
        key = x.tobytes()
        if key not in last:
            found = evaluate(x)
            last.clear()
            last[key] = found
            count += 1
            cost = float(np.sum(found[0] ** 2))
            if cost < lowest:
                lowest = cost
                note(x, count)
        return last[key]

    def residuals_at(x: Vector) -> Vector:
        return at(x)[0]

    def jacobian_at(x: Vector) -> Vector:
        return at(x)[1]

    inside = _strictly_inside(start, lower, upper)
    if not np.isfinite(at(inside)[0]).all():
        return None
    first = float(np.sum(at(inside)[0] ** 2))
    result = least_squares(
        residuals_at, inside, jac=jacobian_at, bounds=(lower, upper), x_scale="jac",
        xtol=1e-8, ftol=least_gain, gtol=1e-12, max_nfev=max_evaluations,
    )  # fmt: skip
    # the model may exist beside the bound but not on it: its cost is infinite there
    x = _snapped(result.x, lower, upper, lambda point: float(np.sum(at(point)[0] ** 2)), _ROUNDING * first)
    # the slopes are those beside the bound: on it a delay of 0 is no delay any more
    return Minimum(
        x=x,
        residuals=at(x)[0],
        jacobian=np.asarray(result.jac),
        converged=result.status > 0,
        evaluations=int(result.nfev),
    )


def _strictly_inside(x: Vector, lower: Vector, upper: Vector) -> Vector:
    """Return the point with coordinates on a bound moved off it a little: an interior method cannot start there.

    One that is not on its bound stays where it is, however near: a delay of 0.01 s may have bounds of 0 and 100 s.
    """
    step = 1e-3 * np.minimum(upper - lower, np.maximum(np.abs(x), 1.0))
    x = np.where(x <= _beside(lower, 1e-10), lower + step, x)
    return np.where(x >= _beside(upper, -1e-10), upper - step, x)


def _beside(bound: Vector, part: float) -> Vector:
    """Return the point that is so small a part of a bound's size above it (below it: negative)."""
    return bound + part * np.where(np.isfinite(bound), np.abs(bound), 0.0)


def _snapped(x: Vector, lower: Vector, upper: Vector, cost: Callable[[Vector], float], spare: float) -> Vector:
    """Return the point with coordinates that came to rest beside a bound put on it, where that costs nothing.

    What is near beside the distance of the bounds may be far from the bound by itself.
    """
    scale = np.where(np.isfinite(upper - lower), upper - lower, np.maximum(np.abs(x), 1.0))
    found, least = x, cost(x)
    for bound in (lower, upper):
        for k in np.flatnonzero(np.abs(x - bound) <= 1e-6 * scale):
            on = found.copy()
            on[k] = bound[k]
            if cost(on) <= least * (1 + _NOTHING) + spare:
                found = on
    return found
