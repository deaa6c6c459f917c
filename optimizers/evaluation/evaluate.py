"""Candidates -> goals: the one place for scenarios, penalties and the ranking of points.

Values are what goals compare of their metrics (`optimizers.evaluation.compared`).

    objective(p) = max_s or mean_s Σ_g w_g σ_g f_g(p, s) / n_g + max over soft g of w_g max(excess_g, 0)
    violation(p) = max over hard g and s of excess_g,   excess as `optimizers.evaluation.constraint_violation` has it

σ is 1 to minimise, -1 to maximise. Without any sense the objective is the worst weighted excess itself, of the soft goals or
else of all, negative where there is room. It is the largest of several smooth functions, which is how a descent sees it.

A single objective is not normalised (n = 1); of several, each is divided by its size before the optimisation in the
scenario that serves it worst, so that weights compare relative changes. A point that has no value is ranked by why:
an absent metric, an unstable system (by how fast it diverges), a system that does not exist.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np
import numpy.typing as npt

from engine.batch.screening import Screened, Screening, Slopes
from engine.model.errors import EngineError
from engine.model.verdicts import Verdict
from optimizers.evaluation.certificate import TOLERANCE
from optimizers.evaluation.compared import compared, compared_slopes, exactly, numbers_of
from optimizers.evaluation.constraint_violation import BROKEN, excess_slopes, signed_excess
from optimizers.evaluation.exact_values import ExactValues
from optimizers.evaluation.measuring import measured as measured_goals
from optimizers.evaluation.measuring import screened as screened_requests
from optimizers.evaluation.spreading import Parcel, Values, current, joined
from optimizers.problem import Across, Problem, Sense, Vector
from optimizers.problem.ties import resolved

UNSTABLE = 1e3
"""Violation of an unstable system; it grows with the logarithm of the rate at which it diverges."""
IMPOSSIBLE = 1e5
"""Violation of a system that does not exist at these values."""
UNLIMITED = 1e30
"""Stands for the infinite value of a margin or bandwidth that is never crossed, where it is an objective."""
_STEP = 1e-30
_FRAME = 8
"""Candidates that are tried in a batch before each of them is simulated."""
_TRIED, _MOST, _WORTH = 64, 0.75, 8
"""Candidates on which batches are tried, the part of them that they have to answer for, and how many times as many make a trial worth it."""

Matrix = npt.NDArray[np.float64]

_DIVERGES = frozenset({Verdict.UNSTABLE, Verdict.MARGINAL})


class Cost(StrEnum):
    """What a candidate costs: microseconds in compiled kernels, milliseconds in a batch, or a simulation of its own."""

    KERNELS = "kernels"
    BATCHES = "batches"
    SIMULATION = "simulation"


@dataclass(frozen=True, kw_only=True, eq=False)
class Assessment:
    """B points: ``objective`` (B,) (NaN where a metric is absent), ``violation`` (B,), metric ``values`` (B, S, G)."""

    objective: Vector
    violation: Vector
    values: Matrix
    doubtful: npt.NDArray[np.bool_]

    def replace(self, index: int, other: Assessment) -> None:
        """Put the only point of another one into the place of one of its own."""
        self.objective[index], self.violation[index] = other.objective[0], other.violation[0]
        self.values[index], self.doubtful[index] = other.values[0], other.doubtful[0]

    def order(self) -> npt.NDArray[np.intp]:
        """Return indices from the best to the worst: those that meet every goal by objective, then by violation."""
        excess = np.where(self.violation <= TOLERANCE, 0.0, self.violation)
        return np.lexsort((np.where(np.isnan(self.objective), np.inf, self.objective), excess))


@dataclass(frozen=True, kw_only=True, eq=False)
class Local:
    """One point with first derivatives: ``values`` (S, G), ``slopes`` (S, G, V) by the position in the unit cube.

    ``doubtful`` ones show the way, and no more.
    """

    values: Matrix
    slopes: Matrix
    doubtful: bool = False


class Evaluator:
    """Evaluates candidates of a problem, many at a time, and counts them.

    Parameters
    ----------
    problem : Problem
    threads : int, optional
        How many threads compute; as many as there are processors for this process by default.
    exact : ExactValues, optional
        Those of another evaluator of the same problem, so that nothing is measured twice.
    """

    def __init__(self, problem: Problem, *, threads: int | None = None, exact: ExactValues | None = None) -> None:
        self.problem = problem
        self.exact = exact or ExactValues(problem)
        self.evaluations = 0
        #: How long a candidate took in the last call (s), None where nobody has measured it.
        self.seconds_each: float | None = None
        self._screening = Screening(problem.diagram, screened_requests(problem), threads=threads)
        self._settled: dict[bytes, Assessment] = {}
        # of samplers alone nothing is told but by where they act
        self._has_laws = problem.diagram.nonlinear and not problem.diagram.samplers_alone
        self._keys = sorted({name for scenario in problem.scenarios for name in scenario})

    @cached_property
    def norms(self) -> Vector:
        """What each goal is divided by when it is part of the objective, (G,)."""
        norms = np.ones(len(self.problem.goals))
        if len(self.problem.objectives) > 1:
            for goal in self.problem.objectives:
                sizes = np.abs(numbers_of(self.problem.goals, self.exact.before)[:, goal])
                norms[goal] = sizes[np.isfinite(sizes)].max(initial=0.0) or 1.0
        return norms

    @cached_property
    def compiled(self) -> bool:
        """Whether compiled kernels evaluate the goals: a candidate then costs microseconds."""
        return not self.problem.commands and self._screening.compiled(self._varied)

    @cached_property
    def together(self) -> int:
        """How many candidates, from the first one of a call on, are neighbours: a call that is cut between them gives the same numbers to the bit."""
        return self.frame or self._screening.together(self._varied)

    @cached_property
    def frame(self) -> int | None:
        """How many candidates go through everything at a time, None for all: a few where each takes long by itself."""
        slow = self.problem.diagram.nonlinear and self.cost is Cost.SIMULATION
        return min(_FRAME, self._screening.together(self._varied)) if slow else None

    @property
    def batched(self) -> bool:
        """Whether compiled code evaluates most candidates, on as many threads as there are processors."""
        return self.cost is not Cost.SIMULATION

    @cached_property
    def parcel(self) -> Parcel:
        """The problem as it travels to others."""
        return Parcel.of(self.problem)

    @cached_property
    def cost(self) -> Cost:
        """What a candidate costs. Whether batches answer for most candidates is tried on a few that are drawn from the ranges."""
        if self.compiled:
            return Cost.KERNELS
        count = len(self.problem.axes)
        # On a line a search needs fewer candidates than it would take to try.
        if count == 1 or self.problem.commands or not self._screening.batched(self._varied):
            return Cost.SIMULATION
        self.evaluations += _TRIED
        points = self._points(np.random.default_rng(0).random((_TRIED, count)))
        found = self._screened(self._overrides(points), len(self.problem.scenarios) * _TRIED)
        known = (found.growth >= 0) | ~(found.doubtful & np.isnan(found.values)).any(axis=1)
        return Cost.BATCHES if known.mean() >= _MOST else Cost.SIMULATION

    def expect(self, evaluations: int) -> None:
        """Take note of how many evaluations there will be, at most: for few of them batches are not tried."""
        if evaluations < _WORTH * _TRIED and not self.compiled:
            self.cost = Cost.SIMULATION

    @property
    def _varied(self) -> list[str]:
        """The parameters of the system that differ between candidates or scenarios."""
        axes = [axis.parameter for axis in self.problem.axes if axis.parameter not in self.problem.commands]
        return [*axes, *self._keys, *self.problem.ties]

    def assess(self, positions: Matrix, *, roughly: bool = False) -> Assessment:
        """Return the ranking quantities of points (B, V) in the unit cube.

        With ``roughly``, for a first look at many points, what the fast evaluation doubts is not looked at again.
        """
        self.evaluations += len(positions)
        roughly, others = roughly and self.cost is not Cost.SIMULATION, current()
        if others is None:
            found = self.values(positions, roughly=roughly, frame=self.frame)
        else:
            found = others.values(self, positions, roughly=roughly)
        return self._assessment(found.values, found.growth, found.doubtful)

    def settled(self, position: Vector) -> Assessment:
        """Return the ranking quantities of one point as the exact path has them."""
        key = position.tobytes()
        if key not in self._settled:
            point, goals = self.problem.values(position), self.problem.goals
            values = np.full((1, len(self.problem.scenarios), len(goals)), np.nan)
            growth = np.full(values.shape[:2], -1.0)
            for s, scenario in enumerate(self.problem.scenarios):
                try:
                    row = [one for one, _ in measured_goals(self.problem, point, scenario)]
                except EngineError:  # no such system
                    growth[0, s] = np.inf
                    continue
                values[0, s] = numbers_of(goals, [row])[0]
                if any(one.verdict in _DIVERGES for one in row):
                    growth[0, s] = 0.0
            self._settled[key] = self._assessment(values, growth, np.zeros(values.shape, dtype=bool))
        return self._settled[key]

    def refutes(self, position: Vector) -> bool:
        """Return whether the exact path has no value of some goal at a point, whatever the fast evaluation says.

        Marches of a nonlinear system look for no events: where the exact path says that a run ends before its time, it does.
        """
        return self._has_laws and bool(np.isnan(self.settled(position).values).any())

    def local(self, position: Vector) -> Local | None:
        """Return values and exact slopes at one point, or None where a metric has no value in some scenario."""
        axes, count = self.problem.axes, len(self.problem.scenarios)
        point = np.array([float(axis.value(float(x))) for axis, x in zip(axes, position, strict=True)])
        reach = np.array([axis.slope(value) for axis, value in zip(axes, point, strict=True)])
        lanes = point + 1j * _STEP * np.diag(reach)
        overrides = self._overrides(lanes)
        self.evaluations += 1
        compiled = self._compiled_slopes(overrides, len(axes))
        if compiled is not None and not (compiled.doubtful.any(axis=1) & compiled.valid).any():
            growth, valid = compiled.growth, compiled.valid
            values, slopes = compiled.values, compiled.slopes
            doubtful = unsure = compiled.doubtful
        else:
            screened = self._screened(overrides, count * len(axes))
            growth, valid = screened.growth, screened.valid
            shape = (count, len(axes), len(self.problem.goals))
            raw = screened.values.reshape(shape)
            values, slopes = raw[:, 0].real, np.swapaxes(raw.imag, 1, 2) / _STEP
            # A doubtful value still shows the way; what screening cannot measure at all is measured exactly. Where the kernels
            # doubt, the scan over frequencies is not asked whether it does: both look at the same ones, and may miss the same crossing.
            doubtful = screened.doubtful.reshape(shape)[:, 0]
            if compiled is not None:
                doubtful = doubtful | compiled.doubtful
            unsure = doubtful & np.isnan(values)
        if (growth >= 0).any() or not valid.all():
            return None
        # A delay of 0 is a direct connection, from which no infinitesimal leads to a delay: the exact path knows how to leave it.
        silent = ~np.nan_to_num(slopes).any(axis=1) & (point == 0.0)
        unsure = unsure | silent.any(axis=1, keepdims=True)
        values, slopes = (
            compared(self.problem.goals, values),
            compared_slopes(self.problem.goals, values, slopes),
        )
        for scenario in np.flatnonzero(unsure.any(axis=1)):
            asked = np.flatnonzero(unsure[scenario])
            names = [axis.parameter for axis in axes]
            here = dict(zip(names, point.tolist(), strict=True))
            try:
                found = measured_goals(
                    self.problem, here, self.problem.scenarios[scenario], goals=asked.tolist(), gradient=True
                )
            except EngineError:  # no such system, or one without derivatives: of a power that vanishes here, say
                return None
            numbers, moves = exactly([self.problem.goals[goal] for goal in asked], [found], len(axes))
            values[scenario, asked], slopes[scenario, asked] = numbers[0], np.nan_to_num(moves[0]) * reach
        if np.isnan(values).any():
            return None
        slopes[~np.isfinite(values)] = 0.0
        # a parameter at 0 whose own state never comes to rest: there is a value, and nowhere to go from it
        slopes[~np.isfinite(slopes)] = 0.0
        left = bool((doubtful & ~unsure).any())
        return Local(values=values, slopes=np.ascontiguousarray(slopes), doubtful=left)

    def _compiled_slopes(self, lanes: Mapping[str, npt.NDArray[np.number]], variables: int) -> Slopes | None:
        """Return all scenarios with slopes by the compiled kernels; None where these do not answer every request."""
        if self.problem.commands:
            return None
        shape = (len(self.problem.scenarios), variables)
        return self._screening.slopes(
            {name: column.real.reshape(shape)[:, 0] for name, column in lanes.items()},
            {name: column.imag.reshape(shape) / _STEP for name, column in lanes.items()},
        )

    def objectives(self, values: Matrix) -> Matrix:
        """Return the smooth functions whose largest is the objective, (..., R), of metric values (..., S, G).

        One for each scenario, or their mean; then the same with each soft bound's excess in each scenario.
        """
        total = np.zeros(values.shape[:-1])
        for goal in self.problem.objectives:
            total += self.objective_weight(goal) * np.clip(values[..., goal], -UNLIMITED, UNLIMITED)
        if self.problem.across is Across.MEAN:
            total = total.mean(axis=-1, keepdims=True)
        if not self.problem.approached:
            return total
        rows = [total] if self.problem.objectives else []
        for index in self.problem.approached:
            bounded = self.problem.goals[index]
            rows.extend(total + bounded.weight * excess for excess in signed_excess(bounded, values[..., index]))
        return np.concatenate(rows, axis=-1)

    def objective_slopes(self, local: Local) -> Matrix:
        """Return the slopes of :meth:`objectives` by the position, (R, V)."""
        weights = np.zeros(local.values.shape[1])
        for index in self.problem.objectives:
            weights[index] = self.objective_weight(index)
        total = np.asarray(np.einsum("g,sgv->sv", weights, local.slopes))
        if self.problem.across is Across.MEAN:
            total = total.mean(axis=0, keepdims=True)
        if not self.problem.approached:
            return total
        rows = [total] if self.problem.objectives else []
        for index in self.problem.approached:
            goal = self.problem.goals[index]
            values, slopes = local.values[:, index], local.slopes[:, index]
            rows.extend(total + goal.weight * excess_slopes(values, slopes, *bound) for bound in goal.bounds)
        return np.concatenate(rows)

    def objective_weight(self, goal: int) -> float:
        """Return σ w / n of an objective."""
        sign = -1.0 if self.problem.goals[goal].sense is Sense.MAXIMIZE else 1.0
        return sign * self.problem.goals[goal].weight / float(self.norms[goal])

    def violations(self, values: Matrix, margins: Vector | None = None) -> Matrix:
        """Return the violation of each goal, (..., S, G); infinite values meet lower bounds and break upper ones.

        A soft goal is broken only where its metric has no value: then the objective has none either. With ``margins`` (G,), a goal counts as violated as soon as it is nearer to its bound than that.
        """
        result = np.zeros(values.shape)
        for index, goal in enumerate(self.problem.goals):
            here = values[..., index]
            kept = 0.0 if margins is None else margins[index]
            excess = (signed_excess(goal, here) + kept).max(axis=0, initial=0.0) if goal.hard else 0.0
            result[..., index] = np.where(np.isnan(here), BROKEN, excess)
        return result

    def _assessment(self, values: Matrix, growth: Matrix, doubtful: npt.NDArray[np.bool_]) -> Assessment:
        unstable = growth >= 0
        with np.errstate(invalid="ignore"):
            broken = self.violations(values).max(axis=2)
        rate = np.where(np.isfinite(growth), np.maximum(growth, 0.0), 0.0)
        broken = np.where(unstable, UNSTABLE * (1 + np.log10(1 + rate)), broken)
        broken = np.where(np.isposinf(growth), IMPOSSIBLE, broken)
        objective = np.where(
            (unstable | np.isnan(values).any(axis=2)).any(axis=1), np.nan, self.objectives(values).max(axis=1)
        )
        return Assessment(
            objective=objective, violation=broken.max(axis=1), values=values, doubtful=np.asarray(doubtful.any(axis=(1, 2)))
        )  # fmt: skip

    def values(self, positions: Matrix, *, roughly: bool, frame: int | None) -> Values:
        """Return metric values, growth and doubt of points (B, V), computed here; infinite growth: no such system.

        With ``roughly`` no second opinion is asked for. ``frame`` is that of whoever asks.
        """
        if frame is not None and len(positions) > frame:
            firsts = range(0, len(positions), frame)
            return joined([self.values(positions[k : k + frame], roughly=roughly, frame=None) for k in firsts])
        batch, count = len(positions), len(self.problem.scenarios)
        points = self._points(positions)
        screened = self._screened(self._overrides(points), count * batch, second_opinion=not roughly)
        shape = (count, batch, len(self.problem.goals))
        values = compared(self.problem.goals, screened.values.reshape(shape).swapaxes(0, 1))
        doubtful = screened.doubtful.reshape(shape).swapaxes(0, 1).copy()
        growth = np.where(screened.valid, screened.growth, np.inf).reshape(count, batch).T.copy()
        # What screening does not know at all has to be measured one by one.
        unknown = doubtful & np.isnan(values) & ~(growth >= 0)[:, :, None] & (not roughly)
        for b, s in zip(*np.nonzero(unknown.any(axis=2)), strict=True):
            asked = np.flatnonzero(unknown[b, s])
            overrides = dict(zip((axis.parameter for axis in self.problem.axes), points[b].tolist(), strict=True))
            try:
                found = measured_goals(self.problem, overrides, self.problem.scenarios[s], goals=asked.tolist())
            except EngineError:  # no such system: improper at these values, say
                growth[b, s], doubtful[b, s] = np.inf, False
                continue
            asking = [self.problem.goals[goal] for goal in asked]
            values[b, s, asked] = numbers_of(asking, [[measured for measured, _ in found]])[0]
            doubtful[b, s, asked] = False
            if any(measured.verdict in _DIVERGES for measured, _ in found):
                growth[b, s] = 0.0  # where it rests it may be stable
            elif np.isnan(growth[b, s]):
                growth[b, s] = -1.0
        return Values(values=values, growth=growth, doubtful=doubtful)

    def _points(self, positions: Matrix) -> Matrix:
        """Return the values of the variables (B, V) at positions in the unit cube."""
        return np.stack([axis.value(positions[:, i]) for i, axis in enumerate(self.problem.axes)], axis=1)

    def _screened(
        self, overrides: Mapping[str, npt.NDArray[np.number]], members: int, *, second_opinion: bool = True
    ) -> Screened:
        """Screen scenarios together that have the same structure: a delay that is 0 in one and not in another changes it."""
        if not overrides:  # the system stays as it is, and its responses to other commands belong to the exact path
            return Screened.unknown(members, len(self.problem.goals))
        total, count = members, len(self.problem.scenarios)
        rows = np.arange(total).reshape(count, -1)
        groups: dict[tuple[str, ...], list[int]] = {}
        for index, scenario in enumerate(self.problem.scenarios):
            groups.setdefault(tuple(name for name in self._keys if scenario.get(name) == 0.0), []).append(index)
        # Candidate by candidate: who its neighbours are does not depend on how many there are.
        orders = [rows[group].T.ravel() for group in groups.values()]
        parts = [
            self._screening({name: column[order] for name, column in overrides.items()}, second_opinion=second_opinion)
            for order in orders
        ]
        order = np.concatenate(orders)
        back = np.argsort(order)
        return Screened(
            values=np.concatenate([part.values for part in parts])[back],
            doubtful=np.concatenate([part.doubtful for part in parts])[back],
            growth=np.concatenate([part.growth for part in parts])[back],
            valid=np.concatenate([part.valid for part in parts])[back],
        )

    def _overrides(self, points: npt.NDArray[np.number]) -> dict[str, npt.NDArray[np.number]]:
        """Return parameter arrays (S * B,), scenario by scenario, for points (B, V); none where only commands vary."""
        batch, scenarios = len(points), self.problem.scenarios
        columns: dict[str, npt.NDArray[np.number]] = {
            axis.parameter: np.tile(points[:, i], len(scenarios))
            for i, axis in enumerate(self.problem.axes)
            if axis.parameter not in self.problem.commands
        }
        for name in self._keys:
            own = self.problem.diagram.parameters[name].value
            columns[name] = np.repeat([scenario.get(name, own) for scenario in scenarios], batch)
        tied = resolved(self.problem.ties, columns, self.problem.own_value)
        return columns | {
            name: np.broadcast_to(np.asarray(values), batch * len(scenarios)) for name, values in tied.items()
        }
