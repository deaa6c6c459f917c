"""A search that was cut off goes on from its last state and ends where it would have ended."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from engine.diagram.diagram import compile_system
from engine.exact.time.sampled import simulate_sampled
from engine.model.document import Block, Connection, System
from optimizers.identification import identify
from optimizers.methods.least_squares import Reached, minimize_squares
from optimizers.problem import Uncertain, Variable
from optimizers.recorded.recording import Identification, RecordedExperiment, Recording
from optimizers.search.result import Result, Share, Unwatched
from optimizers.solving.solve import solve
from tests.unit.optimizers.drive import fastest, pid_loop
from tests.unit.optimizers.landscapes import landscape

VALLEYS = landscape(
    {"f": "21 + x*x - 10*cos(2*pi*x) + y*y - 10*cos(2*pi*y)"}, {"x": (-5.0, 4.0), "y": (-4.0, 5.0)}, minimise=["f"]
)


FRONT = landscape(
    {"near": "21 + x*x + y*y", "far": "21 + (x-2)*(x-2) + (y-1)*(y-1)"},
    {"x": (-5.0, 4.0), "y": (-4.0, 5.0)},
    minimise=["near", "far"],
)
STEP = 0.002
TIME = STEP * np.arange(1000)


def _delayed() -> Identification:
    tone = np.where(TIME > 0.1, np.sin(4 * np.pi * (TIME - 0.1)), 0.0)
    diagram = compile_system(
        System(
            name="delay",
            parameters={},
            blocks={"u": Block(kind="input"), "transport": Block(kind="delay", values={"time": 0.7})},
            connections=(Connection(source="u", target="transport"),),
            outputs={"position": "transport"},
        )
    )
    recorded = simulate_sampled(diagram.realize({"transport.time": 0.2}), tone[None], STEP)[0]
    recording = Recording(inputs={"u": tone}, outputs={"position": recorded}, sample_time=STEP)
    unknown = (Variable(parameter="transport.time", lower=0.01, upper=1.2),)
    experiment = RecordedExperiment(recording=recording, split=1.0)
    return Identification(diagram=diagram, experiments=(experiment,), parameters=unknown, starts=6)


DELAYED = _delayed()


class CutError(Exception):
    """The process dies."""


class Memory(Unwatched):
    """Keeps states as a job does, as text, and dies after ``most`` of them."""

    def __init__(self, state: str | None = None, most: int = 10**9) -> None:
        self.state = state
        self.most = most
        self.count = 0
        self.states: list[dict[str, Any]] = []

    def keep(self, state: Mapping[str, Any]) -> None:
        self.state = json.dumps(state, allow_nan=False)
        self.states.append(json.loads(self.state))
        self.count += 1
        if self.count == self.most:
            raise CutError

    def kept(self) -> Mapping[str, Any] | None:
        return None if self.state is None else json.loads(self.state)


def steps(result: Result) -> list[tuple[Any, ...]]:
    """Return the history of a search, but for its times."""
    return [(point.evaluation, point.objective, point.violation, dict(point.variables)) for point in result.history]


@pytest.mark.parametrize(
    ("method", "options", "after"),
    [
        ("global", {"seed": 1, "restarts": 1}, 20),
        ("global", {"seed": 1, "restarts": 1}, 75),
        ("gradient", {"seed": 1, "starts": 4}, 2),
        ("gradient", {"seed": 1, "starts": 4}, 4),
    ],
)
def test_a_search_goes_on_where_it_was(method, options, after) -> None:
    whole = Memory()
    result = solve(method, VALLEYS, options, monitor=whole)
    assert whole.count >= after, "it must get so far"
    first = Memory(most=after)
    with pytest.raises(CutError):
        solve(method, VALLEYS, options, monitor=first)
    second = Memory(first.state)
    resumed = solve(method, VALLEYS, options, monitor=second)
    assert resumed.best == result.best
    assert resumed.objective == result.objective
    assert resumed.evaluations == result.evaluations
    assert steps(resumed) == steps(result)
    assert second.count == whole.count - after


@pytest.mark.parametrize(
    ("problem", "options"),
    [
        (VALLEYS, {"points": 40, "refine": 1}),
        (VALLEYS, {"sampling": "sobol", "samples": 1500}),
        (fastest(pid_loop(), "kp", "kd"), {"points": 20}),
    ],
    ids=["grid", "sample", "loop"],
)
def test_a_grid_goes_on_where_it_was(problem, options) -> None:
    whole = Memory()
    result = solve("grid", problem, options, monitor=whole)
    assert whole.count >= 2, "it must get so far"
    first = Memory(most=2)
    with pytest.raises(CutError):
        solve("grid", problem, options, monitor=first)
    (looked,) = first.states[-1].values()
    second = Memory(first.state)
    resumed = solve("grid", problem, options, monitor=second)
    assert np.array_equal(resumed.map.objective, result.map.objective, equal_nan=True)
    assert np.array_equal(resumed.map.violation, result.map.violation, equal_nan=True)
    assert resumed.best == result.best
    assert resumed.evaluations == result.evaluations
    assert [replace(point, seconds=0.0) for point in resumed.history] == [
        replace(point, seconds=0.0) for point in result.history
    ]
    # What had been looked at is not looked at again.
    assert all(state["0"]["evaluations"] > looked["evaluations"] for state in second.states)


def test_a_yield_goes_on_where_it_was() -> None:
    uncertain = (Uncertain(parameter="y", lower=-1, upper=1),)
    bounded = (*VALLEYS.goals, replace(VALLEYS.goals[0], sense=None, upper=20.0))
    problem = replace(VALLEYS, variables=VALLEYS.variables[:1], uncertain=uncertain, goals=bounded)
    options = {"seed": 4, "points": 3}
    whole = Memory()
    result = solve("grid", problem, options, samples=1500, monitor=whole)
    draws = [state["0.95"]["done"] for state in whole.states if "0.95" in state]
    assert len(draws) > 3
    assert 0 < result.expected.share < 1
    first = Memory(most=whole.count - 3)
    with pytest.raises(CutError):
        solve("grid", problem, options, samples=1500, monitor=first)
    second = Memory(first.state)
    assert solve("grid", problem, options, samples=1500, monitor=second).expected == result.expected
    assert [state["0.95"]["done"] for state in second.states] == draws[-3:]
    # Draws around another point are none of this one's.
    state = json.loads(first.state)
    state["0.95"]["best"] = {"x": 0.123}
    state["0.95"]["good"] = 0
    assert solve("grid", problem, options, samples=1500, monitor=Memory(json.dumps(state))).expected == result.expected


@pytest.mark.parametrize("after", [3, 7, 12])
def test_a_search_for_a_front_goes_on_where_it_was(after: int) -> None:
    """Cut off in the evolution of 6 generations, on the way along the front, and while its points are polished."""
    options = {"seed": 1, "population": 16, "generations": 6, "points": 4, "max_evaluations": 20_000}
    whole = Memory()
    result = solve("pareto", FRONT, options, monitor=whole)
    assert whole.count >= after, "it must get so far"
    first = Memory(most=after)
    with pytest.raises(CutError):
        solve("pareto", FRONT, options, monitor=first)
    second = Memory(first.state)
    resumed = solve("pareto", FRONT, options, monitor=second)
    assert result.front is not None
    assert resumed.front is not None
    assert resumed.front.points == result.front.points
    assert steps(resumed) == steps(result)
    assert resumed.evaluations == result.evaluations
    assert second.count == whole.count - after


@pytest.mark.parametrize("after", [2, 14])
def test_an_identification_goes_on_where_it_was(after: int) -> None:
    """Six starts among the periods of a sine, of which one settles at the delay of 0.2 s that made the recording."""
    whole = Memory()
    result = identify(DELAYED, rng=np.random.default_rng(0), monitor=whole)
    first = Memory(most=after)
    with pytest.raises(CutError):
        identify(DELAYED, rng=np.random.default_rng(0), monitor=first)
    assert first.state is not None
    reached = json.loads(first.state)
    assert 0 < reached["evaluations"] < result.evaluations
    second = Memory(first.state)
    resumed = identify(DELAYED, rng=np.random.default_rng(0), monitor=second)
    found = resumed.parameters["transport.time"].value
    assert found == pytest.approx(0.2, rel=1e-6)
    assert found == pytest.approx(result.parameters["transport.time"].value, rel=1e-6)
    # Starts that were done are not gone through again, and evaluations count from where it was.
    starts = [state["start"] for state in second.states]
    assert starts[0] >= reached["start"]
    assert starts == sorted(starts)
    assert starts[-1] == DELAYED.starts
    assert second.states[0]["evaluations"] > reached["evaluations"]


@pytest.mark.parametrize("after", [20, 51, 53])
def test_an_identification_goes_on_with_the_way_it_was_trying(after: int) -> None:
    """Cut off with straight lines, behind them, and with held inputs."""
    (experiment,) = DELAYED.experiments
    recording = replace(experiment.recording, undecided=("u",))
    problem = replace(DELAYED, experiments=(replace(experiment, recording=recording),))
    whole = Memory()
    result = identify(problem, rng=np.random.default_rng(0), monitor=whole)
    assert whole.count > 53, "it must get so far"
    first = Memory(most=after)
    with pytest.raises(CutError):
        identify(problem, rng=np.random.default_rng(0), monitor=first)
    assert first.state is not None
    done = len(json.loads(first.state)["done"])
    second = Memory(first.state)
    resumed = identify(problem, rng=np.random.default_rng(0), monitor=second)
    assert all(len(state["done"]) >= done for state in second.states)
    assert resumed.between_samples == result.between_samples == "linear"
    for way, one in result.between_tried.items():
        assert resumed.between_tried[way].fit_percent == pytest.approx(one.fit_percent, abs=1e-4)


def test_a_minimum_that_was_reached_is_asked_for_once_again() -> None:
    asked: list[float] = []

    def valleys(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        asked.append(float(x[0]))
        return np.array([x[0] - 3.0, 0.1]), np.array([[1.0], [0.0]])

    bounds = {"lower": np.array([-np.inf]), "upper": np.array([np.inf])}
    told: list[Reached] = []
    starts = np.array([[0.0], [10.0]])
    found = minimize_squares(valleys, starts, **bounds, tell=told.append)
    assert found is not None
    assert found.x == pytest.approx([3.0])
    assert told[-1].start == 2
    asked.clear()
    again = minimize_squares(valleys, starts, **bounds, reached=told[-1])
    assert again is not None
    assert (again.x, again.residuals, again.converged) == (found.x, pytest.approx(found.residuals), found.converged)
    assert asked == [found.x[0]]


def test_searches_beside_each_other_keep_their_states_apart() -> None:
    whole = Memory()
    result = solve("gradient", VALLEYS, {"seed": 1, "starts": 2}, monitor=whole, checks=["global"])
    assert len(whole.kept()) == 2
    first = Memory(most=whole.count - 3)
    with pytest.raises(CutError):
        solve("gradient", VALLEYS, {"seed": 1, "starts": 2}, monitor=first, checks=["global"])
    second = Memory(first.state)
    resumed = solve("gradient", VALLEYS, {"seed": 1, "starts": 2}, monitor=second, checks=["global"])
    assert second.count == 3
    assert resumed.best == result.best
    assert resumed.gaps == result.gaps


def test_a_state_of_another_method_is_none() -> None:
    memory = Memory()
    Share(memory, 0.0, 0.9).keep({"kind": "global", "best": "nonsense"})
    result = solve("gradient", VALLEYS, {"seed": 1, "starts": 2}, monitor=memory)
    assert result.best == solve("gradient", VALLEYS, {"seed": 1, "starts": 2}).best
