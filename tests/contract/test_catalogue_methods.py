"""Every method of optimisation keeps the promises of its base class: found by discovery, one problem with a published optimum serves all.

A PI controller for 1 / (s + 1)³ with the largest integral gain at a sensitivity peak of 1.4 at most: ki = 0.32532 (K. J. Åström,
H. Panagopoulos, T. Hägglund, Automatica 34 (1998) 585-601). Methods that want several objectives get the peak as a second one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import optimizers.methods
from bench.optimizers.cases_convex import CHOSEN, LEAST_ERROR, LOAD, PI, gain, loop
from engine.model.parameters import Param
from optimizers.methods import minimize
from optimizers.problem import Goal, Problem, ProblemError, Sense
from optimizers.search.result import Result, Status, Unwatched

METHODS = optimizers.methods.catalogue()
BOUND, BEST = 1.4, 0.32532
SMALL: Mapping[str, Any] = {
    "points": 21, "starts": 2, "max_evaluations": 500, "population": 16, "restarts": 0, "generations": 8, "seed": 5,
}  # fmt: skip
"""What keeps a run short, of the options that a method has."""
OMEGA = np.geomspace(1e-3, 1e3, 20_001)


def options(kind: str) -> dict[str, Any]:
    own = {param.name: param for param in METHODS[kind].options}
    given = {name: value for name, value in SMALL.items() if name in own}
    if kind == "pareto":
        given["points"] = 5
    return given


def problem(kind: str) -> Problem:
    diagram = loop(
        controller=PI, parameters={"kp": gain(0.2), "ki": gain(0.05)}, numerator=[1.0], denominator=np.poly([-1, -1, -1]).tolist()
    )  # fmt: skip
    peak = Goal(metric="sensitivity_peak", open_at="controller", upper=BOUND)
    second = Goal(metric="sensitivity_peak", open_at="controller", sense=Sense.MINIMIZE)
    goals = (LEAST_ERROR, peak, *((second,) if kind == "pareto" else ()))
    variables = tuple(replace(variable, lower=0.01, upper=2.0) for variable in CHOSEN)
    return Problem(diagram=diagram, variables=variables, experiments=(LOAD,), goals=goals)


class Watch(Unwatched):
    """Records what a method reports; cancels as soon as it has reported so many best points."""

    def __init__(self, enough: float = math.inf) -> None:
        self.enough = enough
        self.told = False
        self.fractions: list[float] = []
        self.bests: list[tuple[float, float]] = []

    def progress(self, fraction: float, message: str) -> None:
        assert message
        self.fractions.append(fraction)

    def best(self, evaluation: int, objective: float, violation: float, variables: Mapping[str, float]) -> None:
        assert evaluation > 0
        assert set(variables) == {"kp", "ki"}
        self.bests.append((max(violation - 1e-6, 0.0), objective))

    def cancelled(self) -> bool:
        self.told = len(self.bests) >= self.enough
        return self.told


def run(kind: str, watch: Watch | None = None, given: Problem | None = None) -> Result:
    return minimize(kind, given or problem(kind), options(kind), monitor=watch or Watch())


@pytest.fixture(scope="module", params=METHODS)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def watched(kind: str) -> tuple[Result, Watch]:
    watch = Watch()
    return run(kind, watch), watch


def sensitivity(kp: float, ki: float) -> float:
    s = 1j * OMEGA
    return float(np.abs(1 / (1 + (kp + ki / s) / (s + 1) ** 3)).max())


def test_one_file_is_one_method() -> None:
    files = {path.stem for path in Path(optimizers.methods.__path__[0]).glob("*.py") if not path.stem.startswith("_")}
    homes = {method.__module__.rpartition(".")[2] for method in METHODS.values()}
    assert homes <= files
    assert all(method.__module__.rpartition(".")[2].rstrip("_") == kind for kind, method in METHODS.items())


def test_words(kind: str) -> None:
    method = METHODS[kind]
    assert method.title[0].isupper()
    assert method.doc.endswith(".")
    assert method.source
    names = [param.name for param in method.options]
    assert len(set(names)) == len(names)
    assert "max_seconds" in names
    for param in method.options:
        assert len(param.doc) > 5
        assert not param.doc.endswith(".")


def wrong(param: Param) -> list[Any]:
    if param.choices:
        return ["nonsense", 1]
    return [param.lower - 1, param.upper * 2 + 1, math.nan, "many", True]


def test_options_out_of_range_are_refused_by_name(kind: str) -> None:
    method = METHODS[kind]
    for param in method.options:
        assert method.resolve({})[param.name] == param.default
        for value in wrong(param):
            with pytest.raises(ProblemError) as caught:
                method.resolve({param.name: value})
            assert caught.value.at == ("method", param.name), value
            assert param.name in caught.value.message
    with pytest.raises(ProblemError) as caught:
        method.resolve({"temperature": 1})
    assert caught.value.at == ("method", "temperature")


def test_it_comes_near_the_published_optimum_and_never_beyond_it(kind: str, watched: tuple[Result, Watch]) -> None:
    result, _ = watched
    assert result.certificate.valid
    points = [result.best] if result.front is None else [point.variables for point in result.front.points]
    for point in points:
        assert sensitivity(point["kp"], point["ki"]) <= BOUND * (1 + 1e-5)
        assert point["ki"] <= BEST * (1 + 1e-4)
    # a coarse grid has no point at the optimum, a short front ends near it
    assert max(point["ki"] for point in points) >= BEST * {"pareto": 0.9, "grid": 0.6}.get(kind, 0.999)


def test_its_result_is_what_is_measured_there(watched: tuple[Result, Watch]) -> None:
    result, _ = watched
    error, peak = result.goals[:2]
    # ∫ y dt of a unit load step is 1 / ki, in the sign that a load has
    assert error.after.value is not None
    assert abs(error.after.value) == pytest.approx(1 / result.best["ki"], rel=1e-9)
    assert peak.after.value == pytest.approx(sensitivity(result.best["kp"], result.best["ki"]), rel=1e-5)


def test_it_is_repeatable_to_the_bit(kind: str, watched: tuple[Result, Watch]) -> None:
    first, _ = watched
    second = run(kind)
    assert second.best == first.best
    assert second.evaluations == first.evaluations
    assert [(p.objective, p.violation) for p in second.history] == [(p.objective, p.violation) for p in first.history]


def test_it_reports_its_way(watched: tuple[Result, Watch]) -> None:
    result, watch = watched
    assert watch.fractions == sorted(watch.fractions)
    assert 0.0 <= watch.fractions[0] <= watch.fractions[-1] <= 1.0
    assert watch.bests == sorted(watch.bests, reverse=True)
    assert len(result.history) == len(watch.bests) > 0


def test_it_keeps_to_bounds(kind: str) -> None:
    narrow = problem(kind)
    narrow = replace(narrow, variables=tuple(replace(v, upper=0.1) for v in narrow.variables))
    result = run(kind, given=narrow)
    for name in ("kp", "ki"):
        assert 0.01 <= result.best[name] <= 0.1
    if kind != "pareto":
        assert result.best["ki"] == pytest.approx(0.1, rel=1e-9)


@pytest.mark.parametrize("enough", [0, 1])
def test_a_cancel_keeps_the_best_so_far(kind: str, enough: int) -> None:
    watch = Watch(enough)
    result = run(kind, watch)
    for name in ("kp", "ki"):
        assert 0.01 <= result.best[name] <= 2.0
    assert result.certificate.goals
    assert watch.told or enough  # one that is done with its first look has nothing left to be cancelled
    if watch.told:
        assert result.status is Status.CANCELLED
        assert "cancelled" in result.advice.lower()
