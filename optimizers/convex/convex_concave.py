"""The convex-concave procedure: bounds |N| ≤ m |M| restricted to convex ones around a point, solved, and restricted again.

    |M| ≥ Re(M conj(M₀))/|M₀|   gives the second-order cone   |N/M₀|/m ≤ Re(M/M₀)

which no point outside of the bound satisfies, so that all iterates keep it. D = 1 + L stays in a half plane around D₀: it
does not pass 0 on the way, and a stable loop remains stable. A goal f = max |N/M| to be minimised has its present value
for m and a slack: |N/M₀|/f₀ ≤ Re(M/M₀) + τ, f ≈ f₀ (1 + τ), by which a single one falls in every round. Of several that are
traded for each other the products φ r of φ = f/f₀ and r = Re(M/M₀) are restricted, too: φ r ≥ φ + r - 1 - (φ - r)²/4.
Frequencies are added where the exact response between them turns out to peak.

References
----------
M. Hast, K. J. Åström, B. Bernhardsson, S. Boyd, "PID design by convex-concave optimization", European Control Conference
2013, 4460-4465.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from optimizers.convex.point import FEASIBLE, LEAST, Point, hard_bounds, objective_around, wanted
from optimizers.convex.solvers import Solved, solve
from optimizers.convex.summits import Summits, at_rest, grid, height, stable, summits
from optimizers.problem import Across

if TYPE_CHECKING:
    from collections.abc import Callable

    from optimizers.convex.linear_controller import Coefficients, Complex, LinearLoop, Real
    from optimizers.evaluation.evaluate import Evaluator
    from optimizers.problem import Vector

_MOST_ROUNDS = 60
_SAME = 1e-7
"""Relative change of the objective below which two rounds are one."""

_GUARD = 0.1
"""D may turn and shrink to this part of itself in one round."""

_SMALL = 1e-3
"""A violation that a step may bring, because frequencies are still missing; above it, it is what is minimised."""

_EXCHANGE = 100.0
"""Relative change of the objective that the removal of a relative violation of 1 may cost."""

_REPAIRS = 4
_FURTHEST = 20.0
_HALVINGS = 6

_AMPLE = 1e3
_BOUND = -1
"""What a row belongs to where it is no slack of an objective."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Cones:
    """Second-order cones |n + N z| ≤ 1 + D z (+ slack), a row each; ``owner`` is a slack's number or -1: a bound."""

    n0: Complex
    n: Complex
    d: Real
    owner: npt.NDArray[np.int64]


class Procedure:
    """The convex-concave procedure for the loops of all scenarios together.

    Parameters
    ----------
    evaluator : Evaluator
        Says what the goals' values mean for objective and violation.
    loops : sequence of LinearLoop
        One for each scenario.
    watch : callable
        Told every point that is looked at; may raise to stop.
    """

    def __init__(self, evaluator: Evaluator, loops: Sequence[LinearLoop], watch: Callable[[Point], None]) -> None:
        self._evaluator = evaluator
        self._loops = tuple(loops)
        self._watch = watch
        axes = evaluator.problem.axes
        self._bounds = hard_bounds(evaluator)
        self._slacks = wanted(evaluator)
        self._traded = len(self._slacks) > len(self._loops) or evaluator.problem.across is Across.MEAN
        self._lower = np.array([axis.lower for axis in axes])
        self._upper = np.array([axis.upper for axis in axes])
        self._grids: list[Real] = []

    def run(self, start: Vector) -> tuple[Point, str]:
        """Descend from a stable point; return the last one and why it is none of convergence ("" where it is).

        Parameters
        ----------
        start : ndarray, shape (V,)
            Parameter values, SI.
        """
        here = self.look(start)
        if not here.stable:
            return here, "the start is unstable"
        self._grids = [grid(loop, start) for loop in self._loops]
        calm = 0
        moves: list[Vector] = []
        for _ in range(_MOST_ROUNDS):
            self._add(here)
            moved = self._step(here, here.x + self._further(moves))
            if isinstance(moved, str):
                return here, moved
            calm = calm + 1 if _change(here, moved) <= _SAME else 0
            moves = [*moves[-1:], moved.x - here.x]
            here = moved
            if calm == 2:
                return here, ""
        return here, "it was still getting better slowly"

    def look(self, x: Vector) -> Point:
        """Return a point with its largest magnitudes on the continuous frequency axis."""
        found = self._judged(x, tuple(summits(loop, x) for loop in self._loops))
        self._watch(found)
        return found

    def stable(self, x: Vector) -> bool:
        """Return whether a point is stable in every scenario."""
        return all(stable(loop, x) for loop in self._loops)

    def ranking(self, points: Real, at: Vector) -> list[int]:
        """Return the order of points (B, V), the most promising first, as they look on the frequencies of the point ``at``."""
        known = [(loop.coefficients(grid(loop, at)), loop.coefficients(at_rest(loop))) for loop in self._loops]
        ranks = []
        for x in points:
            found = []
            for loop, (whole, rest) in zip(self._loops, known, strict=True):
                tops = [height(rest if one.at_rest else whole, x, r).max() for r, one in enumerate(loop.ratios)]
                found.append(Summits(values=np.array(tops), frequencies=np.zeros(0), stable=True))
            ranks.append(self._judged(x, tuple(found)).rank)
        return sorted(range(len(points)), key=lambda k: ranks[k])

    def _judged(self, x: Vector, found: tuple[Summits, ...]) -> Point:
        goals = np.zeros((len(found), len(self._evaluator.problem.goals)))
        for s, (loop, one) in enumerate(zip(self._loops, found, strict=True)):
            for ratio, value in zip(loop.ratios, one.values, strict=True):
                goals[s, ratio.goal] = max(goals[s, ratio.goal], value)
        return Point(
            x=x, goals=goals, objective=float(self._evaluator.objectives(goals).max()),
            violation=float(self._evaluator.violations(goals).max()),
            stable=all(one.stable for one in found), frequencies=tuple(one.frequencies for one in found),
        )  # fmt: skip

    def _add(self, point: Point) -> None:
        """Let the cones see where the response peaks."""
        self._grids = [
            np.unique(np.concatenate([old, new])) for old, new in zip(self._grids, point.frequencies, strict=True)
        ]

    def _further(self, moves: Sequence[Vector]) -> Vector:
        """Return how much further two moves point: the rounds converge linearly, and any centre gives a restriction."""
        if len(moves) < 2:
            return np.zeros(len(self._lower))
        first, second = (float(np.linalg.norm(move / (self._upper - self._lower))) for move in moves)
        ratio = second / first if first > 0 else 0.0
        return min(ratio / max(1 - ratio, 1e-3), _FURTHEST) * moves[1]

    def _step(self, here: Point, ahead: Vector) -> Point | str:
        """Return the next point, or the word why there is none; ``ahead`` is tried as the centre first."""
        ahead = np.clip(ahead, self._lower, self._upper)
        if (ahead != here.x).any():
            found = self._solve(here, ahead)
            there = None if isinstance(found, str) else self.look(found)
            if there is not None and _better(here, there):
                return there
        there = here
        for _ in range(_REPAIRS):
            found = self._solve(here, here.x)
            if isinstance(found, str):
                return found
            there = self.look(found)
            if _better(here, there):
                return there
            self._add(there)  # what the cones did not see lies between their frequencies
        for halving in range(1, _HALVINGS + 1):
            between = self.look(here.x + (there.x - here.x) / 2**halving)
            if _better(here, between):
                return between
        return there if there.stable and there.violation < here.violation else here

    def _solve(self, here: Point, centre: Vector) -> Vector | str:
        """Return the optimum of the problem restricted around ``centre``, or the word why there is none."""
        import cvxpy as cp  # noqa: PLC0415 - costs a second, and only this method needs it

        cones, guard = self._cones(here, centre)
        scale = self._scale(cones, guard)
        seeking = here.violation > _SMALL
        z, tau, worst = cp.Variable(len(scale)), cp.Variable(len(self._slacks)), cp.Variable(nonneg=True)
        owned = (cones.owner[:, None] == np.arange(len(self._slacks))).astype(float)
        near, turned = cones.d * scale, cones.n * scale
        right = 1 + near @ z + owned @ tau
        if seeking:
            right = right + (cones.owner == _BOUND).astype(float) * worst
        limits = [
            z >= (self._lower - centre) / scale, z <= (self._upper - centre) / scale, 1 + (guard * scale) @ z >= _GUARD
        ]  # fmt: skip
        if self._traded and not seeking:
            mine = cones.owner >= 0
            excess = cp.Variable(int(mine.sum()))
            gap = owned[mine] @ tau - near[mine] @ z
            limits.append(cp.SOC(1 + excess, cp.vstack([gap, excess - 1]), axis=0))
            right = right - np.eye(len(mine))[:, mine] @ excess
        left = cp.vstack([cones.n0.real + turned.real @ z, cones.n0.imag + turned.imag @ z])
        limits.append(cp.SOC(right, left, axis=0))
        if seeking:
            problem = cp.Problem(cp.Minimize(worst), [*limits, tau <= _AMPLE])
        else:
            gamma = cp.Variable()
            levels, slopes = objective_around(self._evaluator, here, self._slacks)
            problem = cp.Problem(cp.Minimize(gamma), [*limits, gamma >= levels + slopes @ tau])
        answer = solve(problem)
        if answer is not Solved.OPTIMAL or z.value is None:
            return f"the conic solver ended with '{answer}'"
        return np.asarray(np.clip(centre + scale * z.value, self._lower, self._upper))

    def _cones(self, here: Point, centre: Vector) -> tuple[Cones, Real]:
        """Return the cones around ``centre``, and Re(D/D₀) - 1 at all frequencies by the variables."""
        parts: list[Cones] = []
        guard: list[Real] = []
        for s, (loop, omega) in enumerate(zip(self._loops, self._grids, strict=True)):
            whole, rest = loop.coefficients(omega), loop.coefficients(at_rest(loop))
            guard.append((whole.d[1:] / whole.valued(whole.d, centre)).T.real)
            for r, ratio in enumerate(loop.ratios):
                known = rest if ratio.at_rest else whole.at((omega >= ratio.band[0]) & (omega <= ratio.band[1]))
                n, m, g = known.n[:, r], known.m[:, r], ratio.goal
                if g in self._bounds:
                    parts.append(_cones_of(known, n, m, centre, level=self._bounds[g], owner=_BOUND))
                if (s, g) in self._slacks:
                    level = max(here.goals[s, g], LEAST)
                    parts.append(_cones_of(known, n, m, centre, level=level, owner=self._slacks.index((s, g))))
        names = ("n0", "n", "d", "owner")
        cones = Cones(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})
        return cones, np.concatenate(guard)

    def _scale(self, cones: Cones, guard: Real) -> Vector:
        """Return for each variable the change that moves some response by its own size, its range where none moves."""
        size = np.max([np.abs(part).max(axis=0) for part in (guard, cones.d, cones.n)], axis=0)
        span = self._upper - self._lower
        return np.asarray(np.where(size * span > 1, 1 / np.maximum(size, LEAST), span))


def _cones_of(known: Coefficients, n: Complex, m: Complex, centre: Vector, *, level: float, owner: int) -> Cones:
    around = known.valued(m, centre)
    return Cones(
        n0=known.valued(n, centre) / (around * level), n=(n[1:] / (around * level)).T, d=(m[1:] / around).T.real,
        owner=np.full(len(around), owner),
    )  # fmt: skip


def _better(here: Point, there: Point) -> bool:
    """Return whether a point is worth going to: nearer to the bounds, or within them and no worse."""
    if not there.stable:
        return False
    if here.violation > _SMALL:
        return there.violation < here.violation
    if there.violation > max(FEASIBLE, 0.5 * here.violation):
        # more than before only where that opens a way which more frequencies will bring back to the bounds
        return here.violation <= FEASIBLE and there.violation <= _SMALL and there.objective < here.objective
    return there.objective <= here.objective + (_SAME + _EXCHANGE * here.violation) * abs(here.objective)


def _change(here: Point, there: Point) -> float:
    """Return the relative change from one round to the next."""
    if there.violation > FEASIBLE:
        return abs(there.violation - here.violation) / there.violation
    if here.violation > FEASIBLE:
        return float("inf")
    return abs(there.objective - here.objective) / max(abs(here.objective), LEAST)
