"""How far any linear controller can go: a lower bound of a peak by Youla's parametrisation and convex duality.

    H_j(Q) = H_j + T_j Q,   Q stable,   T_j = G_yv M² G_zu:   every closed loop with a stabilising controller, of any order

Let z = (a - s)/(a + s) and let the h_j be functions on the axis with Σ_j h_j T_j = Σ_{k ≥ 1} c_k z^k. That annihilates every
stable Q (the mean value of an analytic function), so from |H_j + T_j Q| ≤ γ m_j (goal) or ≤ m_j (bounds) follows

    γ ≥ (Σ_j ∫ Re(h_j H_j) dθ - Σ_bounds ∫ |h_j| m_j dθ) / Σ_goal ∫ |h_j| m_j dθ

for whatever h: a rigorous bound but for the quadrature. The best h is found by a second-order cone program on a grid of
θ and the bound then evaluated on a finer one. M holds the unstable poles of the plant. Q may be improper here; what that
adds to the controllers lowers the bound at most.

References
----------
S. Boyd, C. Barratt, "Linear Controller Design: Limits of Performance", Prentice Hall 1991, chapters 7, 14 and 15;
D. Luenberger, "Optimization by Vector Space Methods", Wiley 1969, section 5.8.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.analysis.evaluation import Evaluation
from engine.diagram.diagram import Block, compile_system
from engine.model.errors import EngineError
from optimizers.convex.solvers import Solved, solve
from optimizers.convex.transfer import Transfer
from optimizers.problem import Across

if TYPE_CHECKING:
    from engine.diagram.diagram import Diagram, System
    from optimizers.convex.linear_controller import LinearLoop
    from optimizers.convex.ratios import Ratio
    from optimizers.problem import Problem, Vector

Real = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

_ORDER = 40
"""Terms of the series in z."""

_GRID = 240
_FINER = 8
_CENTRES = 5
_ON_AXIS = 1e-9
_SMALLEST = 1e-9
_FAR = np.array([1e3, 1e4])
_INPUT = "controller_input"


@dataclass(frozen=True, kw_only=True, eq=False)
class _Row:
    """|H + T Q| ≤ level (times γ where it is the goal) on a grid: all divided by the level already."""

    h: Complex
    t: Complex
    goal: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class _Plant:
    """The diagram with its controller taken out: an input in its place, and its own input an output."""

    diagram: Diagram
    controller: str


def best_linear(problem: Problem, loops: Sequence[LinearLoop], x: Vector) -> float | None:
    """Return what no linear controller in the place of the problem's own can beat, None where nothing can be said.

    Parameters
    ----------
    problem : Problem
        With one objective, the peak of a response; bounds that are not convex in Q are left out, which lowers the bound.
    loops : sequence of LinearLoop
        One for each scenario.
    x : ndarray, shape (V,)
        Parameters of a stabilising controller.
    """
    if len(problem.objectives) != 1 or problem.approached:
        return None
    plant = _plant_of(problem, loops[0])
    if plant is None:
        return None
    found = [_bound(problem, loop, plant, x) for loop in loops]
    known = [bound for bound in found if bound is not None]
    if not known or (len(known) < len(found) and problem.across is Across.MEAN):
        return None
    bound = float(np.mean(known)) if problem.across is Across.MEAN else max(known)
    return problem.goals[problem.objectives[0]].weight * bound


def _plant_of(problem: Problem, loop: LinearLoop) -> _Plant | None:
    """Return the plant that is left when the one block with all variables is taken out."""
    system = problem.diagram.system
    for name in system.blocks:
        into = [c for c in system.connections if c.target.split(".")[0] == name]
        if len(into) != 1:
            continue
        try:
            diagram = compile_system(_without(system, name, into[0].source))
        except EngineError:  # a block with several outputs, or something else than an input can stand for
            continue
        if not _depends(diagram, problem, loop):
            return _Plant(diagram=diagram, controller=name)
    return None


def _without(system: System, name: str, source: str) -> System:
    return replace(
        system,
        blocks={**system.blocks, name: Block(kind="input")},
        connections=tuple(c for c in system.connections if c.target.split(".")[0] != name),
        outputs={**system.outputs, _INPUT: source},
    )


def _overrides(diagram: Diagram, problem: Problem, loop: LinearLoop, x: Vector) -> dict[str, float]:
    values = {axis.parameter: float(value) for axis, value in zip(problem.axes, x, strict=True)}
    together = {**loop.scenario, **values, **problem.tied(values, loop.scenario)}
    return {path: value for path, value in together.items() if path in diagram.parameters}


def _depends(diagram: Diagram, problem: Problem, loop: LinearLoop) -> bool:
    """Return whether a plant still depends on the variables."""
    omega = np.geomspace(0.1 * loop.slowest, 10 * loop.fastest, 5)
    ends = [np.array([getattr(axis, end) for axis in problem.axes]) for end in ("lower", "upper")]
    first, second = (Transfer(diagram, _overrides(diagram, problem, loop, x))(omega) for x in ends)
    return not np.allclose(first, second, rtol=1e-9, atol=0.0)


def _bound(problem: Problem, loop: LinearLoop, plant: _Plant, x: Vector) -> float | None:
    """Return the bound for one scenario: the best for different centres of the transformation."""
    family = _Family(problem, loop, plant, x)
    if not family.complete:
        return None
    found = [family.bound(float(centre)) for centre in np.geomspace(loop.slowest, loop.fastest, _CENTRES)]
    return max((bound for bound in found if bound is not None), default=None)


class _Family:
    """All closed loops of one scenario: H_j + T_j Q for every goal that has this form.

    Parameters
    ----------
    problem : Problem
    loop : LinearLoop
    plant : _Plant
    x : ndarray, shape (V,)
        Parameters of a stabilising controller: its closed loop is that of Q = 0.
    """

    def __init__(self, problem: Problem, loop: LinearLoop, plant: _Plant, x: Vector) -> None:
        self._problem = problem
        self._loop = loop
        self._controller = plant.controller
        self._x = x
        overrides = _overrides(plant.diagram, problem, loop, x)
        self._transfer = Transfer(plant.diagram, overrides)
        poles = Evaluation(plant.diagram, overrides).poles.values
        self._unstable = poles[poles.real >= -_ON_AXIS * np.abs(poles).max(initial=0.0)]
        self._affine = [r for r, ratio in enumerate(loop.ratios) if self._is_affine(ratio)]

    @property
    def complete(self) -> bool:
        """Whether the objective is among the goals that have the form."""
        wanted = [r for r, ratio in enumerate(self._loop.ratios) if self._problem.goals[ratio.goal].sense is not None]
        return all(r in self._affine for r in wanted)

    def bound(self, centre: float) -> float | None:
        """Return the bound for z = (a - s)/(a + s), evaluated on a finer grid than the one it is found on."""
        rolloff = self._rolloff(centre)
        theta, fine = _angles(_GRID), _angles(_FINER * _GRID)
        coarse = self._rows(centre * np.tan(theta / 2), centre, rolloff)
        moved = [k for k, row in enumerate(coarse) if row.t.any()]
        if not any(coarse[k].goal for k in moved):
            return None
        exact = self._rows(centre * np.tan(fine / 2), centre, rolloff)
        if not np.all(np.abs([exact[k].t for k in moved]).max(axis=0) > 0):
            return 0.0  # frequencies at which nothing is asked take everything
        found = _dual([coarse[k] for k in moved], theta)
        if found is None:
            return None
        series, multipliers = found
        between = [np.interp(fine, theta, h.real) + 1j * np.interp(fine, theta, h.imag) for h in multipliers]
        return _value([exact[k] for k in moved], fine, series, between)

    def _rolloff(self, centre: float) -> int:
        """Return by how many powers of s the effect of Q fades where it fades least: by so many Q may be improper."""
        rows = self._rows(_FAR * max(self._loop.fastest, centre), centre, 0)
        falls = [-float(np.log10(abs(row.t[1] / row.t[0]))) for row in rows if np.all(row.t != 0)]
        return max(round(min(falls, default=0.0)), 0)

    def _rows(self, omega: Real, centre: float, rolloff: int) -> list[_Row]:
        s = 1j * omega
        m = np.ones_like(s)
        for pole in self._unstable:
            away = 2 * pole.real if pole.real > _ON_AXIS * abs(pole) else centre
            m = m * (s - pole) / (s - pole + away)
        improper = m * m * (1 + s / centre) ** rolloff
        response = self._transfer(omega)
        known = self._loop.coefficients(omega)
        rows = []
        for r in self._affine:
            ratio = self._loop.ratios[r]
            goal = self._problem.goals[ratio.goal]
            wanted = goal.sense is not None
            level = 1.0 if wanted or goal.upper is None else goal.upper
            low, high = ratio.band
            scale = np.where((omega >= low) & (omega <= high), 1 / level, 0.0)
            mask = 1.0 if ratio.mask is None else ratio.mask(np.clip(omega, low, high))
            h = known.valued(known.n[:, r], self._x) / known.valued(known.m[:, r], self._x)
            rows.append(_Row(h=h * scale, t=self._effect(ratio, response) * improper * scale / mask, goal=wanted))
        return rows

    def _effect(self, ratio: Ratio, response: Complex) -> Complex:
        """Return ∂H/∂R, where R = C/(1 - C G_zv) takes the place of Q before M is put in."""
        outputs, inputs = self._transfer.outputs, self._transfer.inputs
        v, z = inputs.index(self._controller), outputs.index(_INPUT)
        if ratio.open_at is not None:
            back = response[:, z, v]
            return back if ratio.response == "sensitivity" else -back
        assert ratio.source is not None
        assert ratio.target is not None
        u, y = inputs.index(ratio.source), outputs.index(ratio.target)
        effect = response[:, y, v] * response[:, z, u]
        return effect if ratio.response == "path" else -effect

    def _is_affine(self, ratio: Ratio) -> bool:
        """Return whether a goal is affine in Q: no lower bound, no open loop, and no loop but the controller's own."""
        if ratio.inverted or ratio.response not in {"sensitivity", "complementary", "path", "error"}:
            return False
        if ratio.open_at is None:
            return True
        omega = np.geomspace(self._loop.slowest, self._loop.fastest, 5)
        places = (self._controller, ratio.open_at)
        own, other = (self._loop.cut(self._x, place)(omega)[:, -1, -1] for place in places)
        return bool(np.allclose(own, other, rtol=1e-6, atol=0.0))


def _angles(count: int) -> Real:
    """Return the middles of equal parts of 0…π."""
    return np.asarray((np.arange(count) + 0.5) * np.pi / count)


def _powers(theta: Real) -> Complex:
    """Return z^k on the axis, k = 1…order, shape (grid, order)."""
    return np.asarray(np.exp(-1j * theta[:, None] * np.arange(1, _ORDER + 1)))


def _dual(rows: Sequence[_Row], theta: Real) -> tuple[Real, list[Complex]] | None:
    """Return the coefficients of the series and the h of each row that give the best bound on a grid."""
    import cvxpy as cp  # noqa: PLC0415 - costs a second, and only this method needs it

    powers, width = _powers(theta), 1.0 / len(theta)
    # each h in units of 1/T, where that is finite: the rows are then of one size
    units = np.array([1 / np.maximum(np.abs(row.t), _SMALLEST * np.abs(row.t).max()) for row in rows])
    t, h = np.array([row.t for row in rows]) * units, np.array([row.h for row in rows]) * units
    goal = np.array([row.goal for row in rows])[:, None]
    series = cp.Variable(_ORDER)
    x, y, size = (cp.Variable(t.shape) for _ in range(3))
    gain = cp.sum(cp.multiply(h.real, x) - cp.multiply(h.imag, y)) * width
    paid = cp.multiply(units * width, size)
    limits = [
        cp.SOC(cp.vec(size, order="F"), cp.vstack([cp.vec(x, order="F"), cp.vec(y, order="F")]), axis=0),
        cp.sum(cp.multiply(t.real, x) - cp.multiply(t.imag, y), axis=0) == powers.real @ series,
        cp.sum(cp.multiply(t.real, y) + cp.multiply(t.imag, x), axis=0) == powers.imag @ series,
        cp.sum(cp.multiply(goal, paid)) <= 1,
    ]
    problem = cp.Problem(cp.Maximize(gain - cp.sum(cp.multiply(~goal, paid))), limits)
    if solve(problem) is not Solved.OPTIMAL or series.value is None:
        return None
    return np.asarray(series.value), list((x.value + 1j * y.value) * units)


def _value(rows: Sequence[_Row], theta: Real, series: Real, multipliers: Sequence[Complex]) -> float:
    """Return the bound that the series and approximate h prove: what is missing in Σ h T goes to the row that pays least."""
    total = _powers(theta) @ series
    missing = total - sum(h * row.t for h, row in zip(multipliers, rows, strict=True))
    effect = np.array([np.abs(row.t) for row in rows])
    payer = effect.argmax(axis=0)
    width = 1.0 / len(theta)
    gain = cost = goal_size = 0.0
    for k, (row, h) in enumerate(zip(rows, multipliers, strict=True)):
        mine = payer == k
        whole = h + np.where(mine, missing / np.where(mine, row.t, 1.0), 0.0)
        gain += float((whole * row.h).real.sum()) * width
        paid = float(np.abs(whole).sum()) * width
        goal_size += paid if row.goal else 0.0
        cost += 0.0 if row.goal else paid
    return max((gain - cost) / goal_size, 0.0) if goal_size > 0 else 0.0
