"""Random searches on loops of low order, and an independent search of each: differential evolution, then a local search."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import differential_evolution, minimize

from engine.signals import make
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable
from tests.reference.optimizers._measures import Loop
from tests.reference.systems import block, system

LOW = ("settling_time", "response_time", "sensitivity_peak", "control_effort", "overshoot")
"""Metrics that are to be small; the other ones are to be large."""
HIGH = ("gain_margin", "phase_margin", "damping_ratio", "bandwidth")
_NO_VALUE = 1e3
_TRIES = 200


@dataclass(frozen=True, kw_only=True)
class Bound:
    """A metric that is to stay below ``at`` where it is to be small, above it where it is to be large."""

    metric: str
    at: float

    def excess(self, value: float) -> float:
        """Return by how much the bound is broken, relative to it."""
        return _NO_VALUE if math.isnan(value) else (value - self.at) / self.at * (1 if self.metric in LOW else -1)


@dataclass(frozen=True, kw_only=True)
class Search:
    """``objective`` at its best over all scenarios' worst; ``ranges`` of the gains, scenarios as (k, T)."""

    seed: int
    kind: str
    plant: tuple[tuple[float, ...], tuple[float, ...]]
    filter_time: float
    scenarios: tuple[tuple[float, float], ...]
    ranges: tuple[tuple[float, float], ...]
    centre: tuple[float, ...]
    objective: str
    bounds: tuple[Bound, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Return what the gains are called."""
        return {"p": ("kp",), "pi": ("kp", "ki"), "pd": ("kp", "kd")}[self.kind]

    def loops(self, gains: np.ndarray, *, exact: bool = False, lenient: float = 0.0) -> list[Loop]:
        """Return the loop of every scenario."""
        first, second = gains[0], gains[-1]
        controller = {
            "p": ([first], [1.0]),
            "pi": ([first, second], [1.0, 0.0]),
            "pd": ([second, first], [self.filter_time, 1.0]),
        }[self.kind]
        return [
            Loop(
                controller=(np.array(controller[0]), np.array(controller[1])),
                plant=(k * np.array(self.plant[0]), np.convolve(self.plant[1], [lag, 1.0])),
                exact=exact,
                lenient=lenient,
            )
            for k, lag in self.scenarios
        ]

    def judged(self, gains: np.ndarray, *, exact: bool = False, lenient: float = 0.0) -> tuple[float, float]:
        """Return the objective (to be made small) in the worst scenario, and the largest excess over any bound."""
        objective, excess = self.rows(gains, exact=exact, lenient=lenient)
        return max(objective), max(excess)

    def rows(self, gains: np.ndarray, *, exact: bool = False, lenient: float = 0.0) -> tuple[list[float], list[float]]:
        """Return the objective in every scenario and the excess of every bound in each."""
        loops = self.loops(gains, exact=exact, lenient=lenient)
        sign = 1.0 if self.objective in LOW else -1.0
        values = [sign * loop.measure(self.objective) for loop in loops]
        excess = [_NO_VALUE if math.isnan(value) else -math.inf for value in values]
        excess += [bound.excess(loop.measure(bound.metric)) for bound in self.bounds for loop in loops]
        return [math.inf if math.isnan(value) else value for value in values], excess

    def problem(self) -> Problem:
        """Return the same search as a problem."""
        step = Experiment(name="step", signals={"r": make("step", {})})
        bounds = [_goal(b.metric, **{"upper" if b.metric in LOW else "lower": b.at}) for b in self.bounds]
        sense = Sense.MINIMIZE if self.objective in LOW else Sense.MAXIMIZE
        return Problem(
            diagram=self._diagram(),
            variables=tuple(
                Variable(parameter=name, lower=low, upper=high)
                for name, (low, high) in zip(self.names, self.ranges, strict=True)
            ),
            experiments=(step,),
            goals=(_goal(self.objective, sense=sense), *bounds),
            scenarios=tuple({"k": k, "T": lag} for k, lag in self.scenarios),
        )

    def _diagram(self):
        form = {
            "p": block("gain", gain="=kp"),
            "pi": block("transfer_function", numerator=["=kp", "=ki"], denominator=[1.0, 0.0]),
            "pd": block("transfer_function", numerator=["=kd", "=kp"], denominator=[self.filter_time, 1.0]),
        }
        numerator, denominator = (list(part) for part in self.plant)
        k, lag = self.scenarios[0]
        return system(
            {
                "r": block("input"),
                "error": block("sum", signs="+-"),
                "controller": form[self.kind],
                "lag": block("transfer_function", numerator=["=k"], denominator=["=T", 1.0]),
                "plant": block("transfer_function", numerator=numerator, denominator=denominator),
            },
            [
                "r -> error.in1", "plant -> error.in2", "error -> controller", "controller -> lag", "lag -> plant",
            ],
            {"y": "plant", "u": "controller"},
            {**dict(zip(self.names, self.centre, strict=True)), "k": k, "T": lag},
        )  # fmt: skip


def _goal(metric: str, **wanted) -> Goal:
    if metric in {"settling_time", "response_time", "overshoot"}:
        return Goal(metric=metric, experiment="step", output="y", **wanted)
    if metric == "control_effort":
        return Goal(metric=metric, experiment="step", output="u", **wanted)
    if metric == "bandwidth":
        return Goal(metric=metric, source="r", target="y", **wanted)
    return Goal(metric=metric, **({} if metric == "damping_ratio" else {"open_at": "error"}), **wanted)


def _plant(rng: np.random.Generator) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return a plant of first to third order: with lags, an integrator, a resonance, an unstable pole or three integrators."""
    lag, zeta, omega = 10 ** rng.uniform(-0.7, 0.3), 10 ** rng.uniform(-1.3, 0.0), 10 ** rng.uniform(0.0, 1.0)
    shapes = [
        ([1.0], [1.0, 1.0]),
        ([1.0], [lag, 1.0, 0.0]),
        ([1.0], [1 / omega**2, 2 * zeta / omega, 1.0]),
        ([1.0], np.convolve([1.0, 1.0], [lag**2, 2 * lag, 1.0])),
        ([1.0, 2 * omega, omega**2], [1.0, 0.0, 0.0, 0.0]),  # only stable with enough gain
        ([1.0], np.convolve([1.0, -0.5], [0.2 * lag, 1.0])),
        ([1.0], [1 / omega**2, 2 * zeta / omega, 1.0, 0.0]),
    ]
    numerator, denominator = shapes[rng.integers(len(shapes))]
    return tuple(float(n) for n in numerator), tuple(float(d) for d in denominator)


def search(seed: int) -> Search:
    """Return a random search whose bounds all hold, or almost, at one point of the ranges."""
    rng = np.random.default_rng([20, seed])
    while True:
        kind = str(rng.choice(["p", "pi", "pd"]))
        lag = 10 ** rng.uniform(-2.0, -1.0)
        scenarios = tuple(
            (float(10 ** rng.uniform(-0.12, 0.12)), float(lag * 10 ** rng.uniform(-0.2, 0.2)))
            for _ in range(rng.integers(1, 4))
        )
        made = Search(
            seed=seed, kind=kind, plant=_plant(rng), filter_time=float(lag * 0.5), scenarios=scenarios,
            ranges=(), centre=(), objective="damping_ratio", bounds=(),
        )  # fmt: skip
        for _ in range(40):
            centre = 10 ** rng.uniform(-1.5, 1.5, len(made.names))
            if max(loop.measure("sensitivity_peak") for loop in made.loops(centre)) < 4:  # no NaN is
                return _with_goals(replace(made, centre=tuple(float(c) for c in centre)), rng)


def _with_goals(made: Search, rng: np.random.Generator) -> Search:
    metrics = [str(metric) for metric in rng.permutation([*LOW[:-1], *HIGH])]
    centre, loops = np.array(made.centre), made.loops(np.array(made.centre))
    finite = [m for m in metrics if all(math.isfinite(loop.measure(m)) for loop in loops)]
    objective, *others = finite
    bounds = []
    for metric in [*(["overshoot"] if rng.random() < 0.4 else []), *others][: rng.integers(1, 3)]:
        values = [loop.measure(metric) for loop in loops]
        room = rng.uniform(0.97, 1.4)
        at = max(*values, 0.02) * room if metric in LOW else min(values) / room
        bounds.append(Bound(metric=metric, at=float(f"{at:.4g}")))
    ranges = tuple((float(c / 10), float(c * 10)) for c in centre)
    return replace(made, objective=objective, bounds=tuple(bounds), ranges=ranges)


def solved(made: Search) -> tuple[np.ndarray, float, float]:
    """Return the gains, the objective and the excess of an independent search on a logarithmic scale."""
    low, high = np.log(np.array(made.ranges)).T

    def rank(x: np.ndarray) -> float:
        objective, excess = made.judged(np.exp(low + x * (high - low)))
        return 1e6 + excess if excess > 0 else objective

    def smooth(x: np.ndarray) -> np.ndarray:
        objective, excess = made.rows(np.exp(low + np.clip(x, 0, 1) * (high - low)))
        return np.clip([*objective, *excess], -1e3, 1e3)

    count = len(low)
    best = differential_evolution(
        rank, [(0, 1)] * count, seed=made.seed, popsize=12, maxiter=20, tol=1e-8, polish=False
    )
    x, known = best.x, float(best.fun)
    rng = np.random.default_rng(made.seed)
    if known < 1e5:
        scenarios, size = len(made.scenarios), abs(known) or 1.0
        found = minimize(
            lambda z: z[-1], [*x, known / size], method="SLSQP", bounds=[(0, 1)] * count + [(-1e3, 1e3)],
            constraints={
                "type": "ineq",
                "fun": lambda z: np.concatenate([z[-1] - smooth(z[:-1])[:scenarios] / size, -smooth(z[:-1])[2 * scenarios :]]),
            },
        )  # fmt: skip
        for candidate in (found.x[:-1], 0.999999 * found.x[:-1] + 1e-6 * x):
            value = rank(np.clip(candidate, 0, 1))
            if value < known:
                x, known = np.clip(candidate, 0, 1), value
    width = 0.03
    for _ in range(_TRIES):
        trial = np.clip(x + width * rng.standard_normal(count), 0, 1)
        value = rank(trial)
        width = max(width * (1.5 if value < known else 0.9), 1e-7)
        if value < known:
            x, known = trial, value
    gains = np.exp(low + x * (high - low))
    return gains, *made.judged(gains)
