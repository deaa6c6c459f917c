"""Dampers and springs of a structure, placed and sized by linear matrix inequalities, several at a time.

    ||G||∞ ≤ g   if and only if   X > 0,   [ AᵀX + XA   XB   Cᵀ ]
                                           [   BᵀX      -g   D  ]  ≤ 0,      A, B, C, D linear in the parameters x
                                           [    C        D   -g ]

The product of X and x is replaced by its linear part around the present point, where X solves the Riccati equation; the
step that this allows is taken in a region of trust and kept where the exact peaks fall. No frequency grid is involved.
Where several peaks have become equal the steps get short; from there a descent along the exact slopes finishes.

References
----------
A. Hassibi, J. How, S. Boyd, "A path-following method for solving BMI problems in control", American Control Conference
1999, 1385-1389; S. Boyd, L. El Ghaoui, E. Feron, V. Balakrishnan, "Linear Matrix Inequalities in System and Control
Theory", SIAM 1994, section 2.7.3.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_continuous_are

from engine.exact.frequency.path import connected
from engine.model.linear_system import ARRAYS, LaneSystem
from optimizers.convex.point import FEASIBLE, LEAST, Point, hard_bounds, objective_around, wanted
from optimizers.convex.ranges import limits, overrides, ranges_of, within
from optimizers.convex.ratios import PEAKS
from optimizers.convex.solvers import Solved, solve
from optimizers.evaluation.compared import numbers_of
from optimizers.evaluation.measuring import measured

if TYPE_CHECKING:
    from optimizers.evaluation.evaluate import Evaluator
    from optimizers.problem import Problem, Vector

Real = npt.NDArray[np.float64]

_LINEAR = 1e-9
_MOST_STATES = 40
_MOST_ROUNDS = 30
_CREEPS = 0.01
"""Relative progress of a round below which, three times in a row, the inequalities have shown what they can."""

_ABOVE = 1.02
"""The Riccati equation is solved for a peak this much above the true one, where it has no solution."""

_PATIENCE = 3
_TRUST, _WIDEST, _FINEST = 0.3, 3.0, 1e-3
_WIDER, _NARROWER = 2.0, 0.3
_DEFINITE = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class _Path:
    """State space of one path: constant parts at ``base`` first, then the slopes; shapes (1 + V, ...)."""

    base: Vector
    a: Real
    b: Real
    c: Real
    d: Real

    def at(self, x: Vector) -> tuple[Real, Real, Real, float]:
        """Return A, B, C, D at parameter values."""
        steps = np.append(1.0, x - self.base)
        a, b, c = (np.tensordot(steps, part, axes=1) for part in (self.a, self.b, self.c))
        return a, b, c, float(steps @ self.d)


class Placement:
    """The path-following method for the peaks of some paths.

    Parameters
    ----------
    evaluator : Evaluator
        Says what the goals' values mean for objective and violation.
    paths : mapping of (scenario, goal) to path
        As `structure_of` returns them.
    watch : callable
        Told every point that is looked at; may raise to stop.
    """

    def __init__(
        self, evaluator: Evaluator, paths: dict[tuple[int, int], _Path], watch: Callable[[Point], None]
    ) -> None:
        self._evaluator = evaluator
        self._problem = evaluator.problem
        self._paths = paths
        self._watch = watch
        self._lower = np.array([axis.lower for axis in self._problem.axes])
        self._upper = np.array([axis.upper for axis in self._problem.axes])
        self._bounds = hard_bounds(evaluator)
        self._slacks = wanted(evaluator)

    def stable(self, x: Vector) -> bool:
        """Return whether every path is stable."""
        return self.look(x).stable

    def ranking(self, points: Real, at: Vector) -> list[int]:
        """Return the order of points (B, V), the most promising first; ``at`` is not needed here."""
        del at
        axes, scenarios = self._problem.axes, self._problem.scenarios
        kept = [k for k, x in enumerate(points) if all(within(self._problem, one, x) for one in scenarios)]
        positions = [[axis.position(float(v)) for axis, v in zip(axes, points[k], strict=True)] for k in kept]
        found = self._evaluator.assess(np.array(positions).reshape(-1, len(axes)), roughly=True)
        return [kept[k] for k in found.order()]

    def look(self, x: Vector) -> Point:
        """Return a point with the exact peaks of all goals in all scenarios."""
        values = {axis.parameter: float(value) for axis, value in zip(self._problem.axes, x, strict=True)}
        scenarios = self._problem.scenarios
        goals = np.full((len(scenarios), len(self._problem.goals)), np.nan)
        if all(within(self._problem, scenario, x) for scenario in scenarios):
            rows = [measured(self._problem, values, scenario) for scenario in scenarios]
            goals = numbers_of(self._problem.goals, [[one for one, _ in row] for row in rows])
        known = bool(np.isfinite(goals).all())
        found = Point(
            x=x, goals=goals, stable=known,
            objective=float(self._evaluator.objectives(goals).max()) if known else np.inf,
            violation=float(self._evaluator.violations(goals).max()),
        )  # fmt: skip
        self._watch(found)
        return found

    def run(self, start: Vector) -> tuple[Point, str]:
        """Descend from a stable point; return the last one and why it is none of convergence ("" where it is)."""
        here, trust, creeping = self.look(start), _TRUST, 0
        if not here.stable:
            return here, "the start is unstable"
        for _ in range(_MOST_ROUNDS):
            target = self._solve(here, trust)
            there = None if isinstance(target, str) else self.look(target)
            if there is None or not there.stable or there.rank >= here.rank:
                trust *= _NARROWER
                if trust < _FINEST:
                    return here, "" if there is not None else str(target)
                continue
            creeping = creeping + 1 if _change(here, there) <= _CREEPS else 0
            here = there
            if creeping == _PATIENCE:
                break
            trust = min(_WIDER * trust, _WIDEST)
        return here, ""

    def _solve(self, here: Point, trust: float) -> Vector | str:
        """Return the optimum of the matrix inequalities linearised around a point, or the word why there is none."""
        import cvxpy as cp  # noqa: PLC0415 - costs a second, and only this method needs it

        local = {key: _centred(path, here.x, here.goals[key]) for key, path in self._paths.items()}
        if any(one is None for one in local.values()):
            return "the Riccati equation has no solution"
        blocks = {key: one for key, one in local.items() if one is not None}
        size = np.max([one.moves for one in blocks.values()], axis=0)
        scale = np.minimum(1 / np.maximum(size, LEAST), self._upper - self._lower)
        z, tau, worst = cp.Variable(len(scale)), cp.Variable(len(self._slacks)), cp.Variable(nonneg=True)
        rules = [
            z >= np.maximum((self._lower - here.x) / scale, -trust), z <= np.minimum((self._upper - here.x) / scale, trust)
        ]  # fmt: skip
        rules += self._ties(here.x, scale, z)
        seeking = here.violation > FEASIBLE
        for (s, g), block in blocks.items():
            tops = []
            if g in self._bounds:
                tops.append(self._bounds[g] / max(here.goals[s, g], LEAST) + (worst if seeking else 0.0))
            if (s, g) in self._slacks:
                tops.append(1 + tau[self._slacks.index((s, g))])
            for top in tops:
                rules += block.inequalities(scale, z, top)
        if seeking:
            problem = cp.Problem(cp.Minimize(worst), rules)
        else:
            gamma = cp.Variable()
            levels, slopes = objective_around(self._evaluator, here, self._slacks)
            problem = cp.Problem(cp.Minimize(gamma), [*rules, gamma >= levels + slopes @ tau])
        answer = solve(problem)
        if answer is not Solved.OPTIMAL or z.value is None:
            return f"the conic solver ended with '{answer}'"
        return np.asarray(np.clip(here.x + scale * z.value, self._lower, self._upper))

    def _ties(self, x: Vector, scale: Vector, z: Any) -> list[Any]:
        """Return that the tied variables stay within their own bounds."""
        found: list[Any] = []
        for scenario in self._problem.scenarios if self._problem.ties else ():
            here = overrides(self._problem, scenario, x)
            ranges = ranges_of(self._problem, scenario)
            steps = [overrides(self._problem, scenario, ranges.base + move) for move in np.diag(ranges.reach)]
            base = overrides(self._problem, scenario, ranges.base)
            for name, low, high in limits(self._problem):
                slopes = np.array([(one[name] - base[name]) / r for one, r in zip(steps, ranges.reach, strict=True)])
                value = here[name] + (slopes * scale) @ z
                found += [value >= low] if np.isfinite(low) else []
                found += [value <= high] if np.isfinite(high) else []
        return found


@dataclass(frozen=True, kw_only=True, eq=False)
class _Centred:
    """A path around a point, in the states in which the present X is the identity, its peak and its time scale 1.

    ``moves`` (V,) is by how much of the whole the dynamics change for a change of 1 of each parameter.
    """

    a: Real
    b: Real
    c: Real
    d: Real
    moves: Vector

    def inequalities(self, scale: Vector, z: Any, top: Any) -> list[Any]:
        """Return the linearised inequalities for a peak of at most ``top``."""
        import cvxpy as cp  # noqa: PLC0415 - costs a second, and only this method needs it

        n = len(self.b[0])
        change = cp.Variable((n, n), symmetric=True)
        turned = [
            np.tensordot(np.eye(len(scale)) * scale, part[1:], axes=1) for part in (self.a, self.b, self.c, self.d)
        ]

        def moved(part: Real) -> Any:
            """Return Σ z_k part_k."""
            return cp.reshape(part.reshape(len(scale), -1).T @ z, part.shape[1:], order="C")

        half = (np.eye(n) + change) @ self.a[0] + moved(turned[0])
        xb = cp.reshape((np.eye(n) + change) @ self.b[0] + moved(turned[1]), (n, 1), order="C")
        c = cp.reshape(self.c[0] + moved(turned[2]), (1, n), order="C")
        d = cp.reshape(self.d[0] + turned[3] @ z, (1, 1), order="C")
        level = cp.reshape(top, (1, 1), order="C")
        whole = cp.bmat([[half + half.T, xb, c.T], [xb.T, -level, d], [c, d, -level]])
        return [(whole + whole.T) / 2 << 0, np.eye(n) + change >> _DEFINITE * np.eye(n)]


def _centred(path: _Path, x: Vector, peak: float) -> _Centred | None:
    """Return a path around a point, None where its Riccati equation cannot be solved."""
    a, b, c, d = path.at(x)
    pace = float(np.exp(np.mean(np.log(np.abs(np.linalg.eigvals(a))))))
    a, b, c, d = a / pace, b / pace, c / peak, d / peak
    try:
        x0 = (
            solve_continuous_are(a, b[:, None], np.outer(c, c), np.array([[d * d - _ABOVE**2]]), s=c[:, None] * d)
            / _ABOVE
        )
        root = np.linalg.cholesky((x0 + x0.T) / 2 + 1e-10 * np.trace(x0) / len(x0) * np.eye(len(x0))).T
    except np.linalg.LinAlgError:
        return None
    back = np.linalg.inv(root)
    slopes = root @ path.a[1:] @ back / pace
    whole = root @ a @ back
    return _Centred(
        a=np.concatenate([whole[None], slopes]), b=np.concatenate([(root @ b)[None], path.b[1:] @ root.T / pace]),
        c=np.concatenate([(c @ back)[None], path.c[1:] @ back / peak]), d=np.append(d, path.d[1:] / peak),
        moves=np.linalg.norm(slopes, 2, axis=(1, 2)) / np.linalg.norm(whole, 2),
    )  # fmt: skip


def _change(here: Point, there: Point) -> float:
    """Return the relative change from one round to the next."""
    if here.violation > FEASIBLE:
        return abs(there.violation - here.violation) / here.violation
    return abs(there.objective - here.objective) / max(abs(here.objective), LEAST)


def structure_of(problem: Problem) -> dict[tuple[int, int], _Path] | None:
    """Return the paths of all goals in all scenarios, None where this method cannot be used.

    It can where every goal is the peak of a path, and the state space, without delays, is linear in the variables.
    """
    if problem.diagram.nonlinear or any(PEAKS.get(goal.metric) != "path" for goal in problem.goals):
        return None
    found: dict[tuple[int, int], _Path] = {}
    for s, scenario in enumerate(problem.scenarios):
        ranges = ranges_of(problem, scenario)
        points = [ranges.base, *(ranges.base + np.diag(ranges.reach)), ranges.inner]
        values = [overrides(problem, scenario, x) for x in points]
        stack = problem.diagram.realize_stack({name: np.array([one[name] for one in values]) for name in values[0]})
        if stack.delays.size or not stack.valid.all():
            return None
        whole = LaneSystem(
            **{name: getattr(stack, name) for name in ARRAYS}, inputs=stack.inputs, outputs=stack.outputs
        )
        for g, goal in enumerate(problem.goals):
            assert goal.source is not None
            assert goal.target is not None
            ends = whole.inputs.index(goal.source), whole.outputs.index(goal.target)
            path = _linear(connected(whole.balanced(), [ends[0]], [ends[1]]), ranges.base, ranges.reach, ranges.inner)
            if path is None:
                return None
            found[s, g] = path
    return found


def _linear(system: LaneSystem, base: Vector, reach: Vector, inner: Vector) -> _Path | None:
    """Return a path whose last lane lies on the straight lines through the others, None where it does not."""
    if not 0 < system.n <= _MOST_STATES:
        return None
    parts = {"a": system.a, "b": system.b1[:, :, 0], "c": system.c1[:, 0], "d": system.d11[:, 0, 0]}
    found: dict[str, Real] = {}
    for name, lanes in parts.items():
        slopes = (lanes[1:-1] - lanes[0]) / reach.reshape(-1, *([1] * (lanes.ndim - 1)))
        expected = lanes[0] + np.tensordot(inner - base, slopes, axes=1)
        if (np.abs(lanes[-1] - expected) > _LINEAR * np.abs(lanes).max(initial=0.0)).any():
            return None
        found[name] = np.concatenate([lanes[:1], slopes])
    return _Path(base=base, **found)
