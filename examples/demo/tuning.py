"""Steps f, g: two control laws, two aims, two methods; and the proof that the optimum holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import servotune
from examples.demo.analysing import metric
from examples.demo.findings import Behaviour, DemoError, Estimate, Search
from examples.demo.systems import GRID, STEP, VARIABLES, position_loop

METHODS = ("gradient", "grid")

AIMS: Mapping[str, dict[str, Any]] = {
    "response_time": {"metric": "response_time", "experiment": "step", "output": "position", "sense": "minimize"},
    "max_acceleration": {
        "metric": "max_acceleration",
        "experiment": "step",
        "output": "acceleration",
        "sense": "maximize",
    },
}

EFFORT_RATIO = 5.0


def limits(start: Behaviour) -> dict[str, float]:
    """Return the limits of every search: no overshoot, robust, and at most five times the effort of the start."""
    return {
        "overshoot": 0.001,
        "sensitivity_peak": 1.6,
        "control_effort": EFFORT_RATIO * metric(start, "control_effort", 0)["value"],
    }


def goals(aim: str, bounds: Mapping[str, float]) -> list[dict[str, Any]]:
    """Return the goals of a search: its aim, then the limits."""
    return [
        AIMS[aim],
        {"metric": "overshoot", "experiment": "step", "output": "position", "upper": bounds["overshoot"]},
        {"metric": "sensitivity_peak", "open_at": "controller", "upper": bounds["sensitivity_peak"]},
        {"metric": "control_effort", "experiment": "step", "output": "control", "upper": bounds["control_effort"]},
    ]


def start_searches(
    client: servotune.Client, scenarios: Sequence[Estimate], bounds: Mapping[str, float]
) -> list[tuple[str, str, str, servotune.Job[servotune.replies.Optimization]]]:
    """Step f: start a job for each law, aim and method."""
    return [
        (
            law,
            aim,
            method,
            client.optimize(
                position_loop(law),
                variables=VARIABLES[law],
                experiments=[{"name": "step", "input": {"port": "reference", "signal": STEP}}],
                goals=goals(aim, bounds),
                scenarios=[scenario.scenario for scenario in scenarios],
                method=_method(method, law),
            ),
        )
        for method in METHODS  # the longest first, so that no slot of the worker waits at the end
        for law in VARIABLES
        for aim in AIMS
    ]


def _method(kind: str, law: str) -> dict[str, Any]:
    if kind == "grid":
        return {"kind": "grid", "points": GRID[law], "refine": 1}
    return {"kind": "gradient", "starts": 2, "seed": 1, "max_evaluations": 1000}


def finished(law: str, aim: str, method: str, job: servotune.Job[servotune.replies.Optimization]) -> Search:
    """Wait for a search; stop when it has no optimum that holds its limits."""
    reply = job.wait()
    what = f"The {method} search for {aim} with {law}"
    if reply["status"] not in ("converged", "stalled", "budget"):
        raise DemoError(f"{what} ended {reply['status']}: {reply['advice']}")
    if not reply["certificate"]["valid"]:
        worst = reply["certificate"]["worst_violation"]
        raise DemoError(f"{what} found an optimum that the exact engine refuses: worst violation {worst:.3g}.")
    return Search(law=law, aim=aim, method=method, reply=reply)
