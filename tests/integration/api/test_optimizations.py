"""Optimisations over HTTP beyond the plain case: whole curves, ranges, catalogues, structures, and the script that repeats one."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.integration.api.conftest import Service, finished

OSCILLATOR = {
    "name": "a mass on a spring with a damper",
    "parameters": {
        "m": {"value": 1, "unit": "kg"},
        "c": {"value": 1, "lower": 0.1, "upper": 10},
        "k": {"value": 1},
    },
    "blocks": {
        "force": {"kind": "input", "role": "disturbance"},
        "body": {"kind": "mass_spring_damper", "mass": "=m", "stiffness": "=k", "damping": "=c"},
    },
    "connections": [{"from": "force", "to": "body"}],
    "outputs": {"x": "body.position"},
}
REQUEST = {
    "system": OSCILLATOR,
    "variables": [{"parameter": "c"}],
    "experiments": [{"name": "step", "input": {"port": "force", "signal": {"kind": "step"}}}],
    "goals": [
        {"metric": "bandwidth", "from": "force", "to": "x", "sense": "maximize"},
        {"metric": "overshoot", "experiment": "step", "output": "x", "upper": 0.04},
    ],
    "method": {"kind": "gradient", "starts": 2, "seed": 1, "max_evaluations": 1500},
}
Z = abs(math.log(0.04)) / math.sqrt(math.pi**2 + math.log(0.04) ** 2)  # of an overshoot of 4 %


@pytest.fixture(scope="module")
def client(sqlite_service: Service, sqlite_worker: None) -> Iterator[httpx.Client]:
    with sqlite_service.client() as client:
        yield client


def solved(client: httpx.Client, **changes: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    accepted = client.post("/v1/optimizations", json=REQUEST | changes)
    assert accepted.status_code == 202, accepted.text
    done = finished(client, accepted.json())
    assert done["status"] == "succeeded", done
    return done, client.get(done["result"]).json()


def test_an_envelope_and_a_mask_in_their_own_units(client) -> None:
    goals = [
        REQUEST["goals"][0],
        {"metric": "envelope", "experiment": "step", "output": "x",
         "bounds": {"upper": [[0, {"value": 1040, "unit": "mm"}], [30, {"value": 1.04, "unit": "m"}]]}},
        {"metric": "path_bound", "from": "force", "to": "x",
         "bounds": {"upper": [[{"value": 0.01, "unit": "Hz"}, 2], [10, 2]], "lower": {"numerator": [0.1], "denominator": [1, 2, 1]}}},
        {"metric": "tracking_error", "experiment": "step", "output": "x", "reference": [[0, 0], [0, 1], [40, 1]],
         "upper": 1, "hard": False, "weight": 0.1},
    ]  # fmt: skip
    _, result = solved(client, goals=goals)
    assert result["status"] == "converged"
    assert result["best"]["c"] == pytest.approx(2 * Z, rel=1e-5)
    assert result["goals"][1]["score"] == pytest.approx(1.0, abs=1e-5)
    assert [goal["hard"] for goal in result["goals"]] == [True, True, True, False]
    assert result["certificate"]["valid"]
    for proof in result["certificate"]["goals"]:
        assert proof["independent"] == pytest.approx(proof["value"], rel=1e-8)


def test_ranges_their_yield_and_another_method_as_a_check(client) -> None:
    uncertain = [{"parameter": "m", "lower": {"value": 500, "unit": "g"}, "upper": 2}]
    _, result = solved(client, uncertain=uncertain, yield_samples=300, cross_check=["grid"])
    assert result["best"]["c"] == pytest.approx(2 * Z * math.sqrt(2), rel=1e-5)
    assert result["robustness"]["worst"]["violation"] <= 1e-6
    assert {scenario["m"] for scenario in result["robustness"]["scenarios"]} == {0.5, 1.0, 2.0}
    assert result["yield"]["share"] == 1.0
    (check,) = result["cross_check"]
    assert check["method"] == "grid"
    assert check["gap"] >= -1e-6  # the grid's best is no better


def test_a_catalogue_and_a_tie(client) -> None:
    variables = [
        {"parameter": "k", "choices": [1, 2, 4]},
        {"parameter": "c", "expression": "=2*0.75*sqrt(m*k)"},
    ]
    _, result = solved(client, variables=variables)
    assert result["best"] == pytest.approx({"k": 4.0, "c": 3.0})


def test_structures_are_compared(client) -> None:
    stiff = {"parameters": {"k": {"value": 4}}}
    alternatives = [{"name": "as it is"}, {"name": "stiffer", "add": stiff}, {"name": "own", "system": OSCILLATOR}]
    _, result = solved(client, alternatives=alternatives)
    assert result["chosen"] == "stiffer"
    assert [one["name"] for one in result["alternatives"]] == ["as it is", "stiffer", "own"]
    assert result["best"]["c"] == pytest.approx(2 * Z * 2, rel=1e-5)
    first, _, third = result["alternatives"]
    assert first["best"] == third["best"]


def test_goals_that_fight_are_named(client) -> None:
    goals = [*REQUEST["goals"], {"metric": "bandwidth", "from": "force", "to": "x", "lower": 3}]
    _, result = solved(client, goals=goals)
    assert result["status"] == "infeasible"
    assert {one["goal"] for one in result["conflict"]} == {1, 2}
    assert not result["certificate"]["valid"]


def test_a_job_is_a_script_that_repeats_it(client, sqlite_service, tmp_path) -> None:
    done, result = solved(client)
    reply = client.get(f"/v1/jobs/{done['id']}/script")
    assert reply.status_code == 200
    assert reply.headers["Content-Type"].startswith("text/x-python")
    path = tmp_path / "again.py"
    path.write_text(reply.text, encoding="utf-8")
    root = Path(__file__).parents[3]
    environment = os.environ | {
        "SERVOTUNE_URL": sqlite_service.url,
        "SERVOTUNE_KEY": sqlite_service.keys["run"],
        "PYTHONPATH": str(root),
    }
    ran = subprocess.run([sys.executable, str(path)], capture_output=True, text=True, env=environment, timeout=120, check=False)  # fmt: skip
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "the same as then" in ran.stdout
    assert f"{result['best']['c']:.10g}" in ran.stdout


def bad(**changes: Any) -> Mapping[str, Any]:
    return REQUEST | changes


FAST, CALM = REQUEST["goals"]


@pytest.mark.parametrize(
    ("body", "pointer", "detail"),
    [
        (bad(goals=[FAST, CALM, {**CALM, "upper": None, "lower": 0.1}]), "/goals/2/lower", "upper bound of goal 1"),
        (bad(goals=[FAST, {**CALM, "upper": 0.1, "lower": 0.2}]), "/goals/1/upper", ">= lower"),
        (bad(goals=[FAST, {**CALM, "target": 0.1}]), "/goals/1/target", "without lower and upper"),
        (bad(variables=[{"parameter": "c", "lower": 1, "upper": 1}]), "/variables/0/upper", "zero width"),
        (bad(variables=[{"parameter": "c", "choices": [1, {"value": 2, "unit": "m"}]}]), "/variables/0/choices/1", "m"),
        (bad(variables=[{"parameter": "c", "expression": "=k*2"}]), "/variables/0/expression", "at least one variable"),
        (bad(uncertain=[{"parameter": "m", "lower": 2, "upper": 1}]), "/uncertain/0/upper", "> lower"),
        (bad(uncertain=[{"parameter": "m", "lower": {"value": 1, "unit": "s"}, "upper": 2}]), "/uncertain/0/lower", "s"),
        (bad(scenarios=[{}, {"k": -1}]), "/scenarios/1", "must be >= 0 N/m, got -1"),
        (bad(yield_samples=10), "/yield_samples", "uncertain"),
        (bad(cross_check=["magic"]), "/cross_check/0", "magic"),
        (bad(alternatives=[{"name": "a"}, {"name": "a"}]), "/alternatives/1/name", "twice"),
        (bad(alternatives=[{"name": "a"}, {"name": "b", "remove": {"blocks": ["ghost"]}}]), "/alternatives/1/remove/blocks/0", "ghost"),
        (bad(alternatives=[{"name": "a"}, {"name": "b", "variables": [{"parameter": "q", "lower": 1, "upper": 2}]}]), "/alternatives/1/variables/0/parameter", "'q'"),
        (bad(goals=[FAST, {"metric": "envelope", "experiment": "step", "output": "x", "bounds": {"upper": [[0, 1], [0, 1]]}}]), "/goals/1/bounds/upper/0/0", "one instant"),
        (bad(goals=[FAST, {"metric": "envelope", "experiment": "step", "output": "x", "bounds": {"upper": [[0, 1], [2, {"value": 1, "unit": "s"}]]}}]), "/goals/1/bounds/upper/1/1", "s"),
        (bad(goals=[FAST, {"metric": "path_bound", "from": "force", "to": "x", "bounds": {}}]), "/goals/1/bounds", "neither"),
        (bad(goals=[FAST, {"metric": "tracking_error", "experiment": "step", "output": "x", "upper": 1}]), "/goals/1/reference", "must be given"),
        (
            bad(
                experiments=[{"name": "step", "input": {"port": "force", "signal": {"kind": "sine", "frequency": 2}}}]
            ),
            "/goals/1/metric", "settles at a constant",
        ),
        (bad(method={"kind": "pareto"}), "/goals", "at least two with a sense"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused_at_its_place(client, body, pointer, detail) -> None:
    reply = client.post("/v1/optimizations", json=body)
    assert reply.status_code == 422, reply.text
    (error,) = reply.json()["errors"]
    assert error["pointer"] == pointer
    assert detail in error["detail"]


def test_forty_variables_on_a_full_grid_are_refused_with_the_count(client) -> None:
    system = {**OSCILLATOR, "parameters": {**OSCILLATOR["parameters"], **{f"p{i}": {"value": 1} for i in range(40)}}}
    variables = [{"parameter": f"p{i}", "lower": 1, "upper": 2} for i in range(40)]
    request = bad(system=system, variables=variables, method={"kind": "grid", "points": 3})
    reply = client.post("/v1/optimizations", json=request)
    assert reply.status_code == 422, reply.text
    (error,) = reply.json()["errors"]
    assert error["pointer"] == "/method/points"
    assert "3^40" in error["detail"]
    points = {name["parameter"]: 10**9 for name in variables[:3]}
    reply = client.post(
        "/v1/optimizations", json=bad(system=system, variables=variables[:3], method={"kind": "grid", "points": points})
    )
    assert reply.status_code == 422, reply.text
    assert "1e+27" in reply.json()["detail"]


def test_a_budget_of_nothing_gives_the_start_back(client) -> None:
    _, result = solved(client, method={"kind": "gradient", "max_evaluations": 0})
    assert result["status"] == "budget"
    assert result["best"] == pytest.approx({"c": 1.0})
    assert "max_evaluations" in result["advice"]


def test_a_variable_that_no_goal_depends_on_is_named(client) -> None:
    system = {**OSCILLATOR, "parameters": {**OSCILLATOR["parameters"], "idle": {"value": 1, "lower": 0.5, "upper": 2}}}
    _, result = solved(client, system=system, variables=[{"parameter": "c"}, {"parameter": "idle"}])
    assert any("idle" in warning["detail"] for warning in result["warnings"])


def test_a_scenario_that_is_unstable_is_named(client) -> None:
    # A negative stiffness in one scenario: nothing that c does helps there.
    body = {"kind": "transfer_function", "numerator": [1], "denominator": ["=m", "=c", "=k"]}
    system = {**OSCILLATOR, "blocks": {**OSCILLATOR["blocks"], "body": body}, "outputs": {"x": "body"}}
    _, result = solved(client, system=system, scenarios=[{}, {"k": -1}])
    assert result["status"] == "infeasible"
    assert "scenario 1" in result["advice"]


def test_a_search_that_would_take_longer_returns_its_best_point_when_its_time_is_over(client) -> None:
    # 10⁸ points are evaluated by no machine within a second
    _, result = solved(
        client,
        variables=[{"parameter": "c"}, {"parameter": "k", "lower": 0.5, "upper": 2}, {"parameter": "m", "lower": 0.5, "upper": 2}],
        method={"kind": "global", "population": 10_000, "restarts": 20, "max_evaluations": 10**8, "max_seconds": 1},
    )  # fmt: skip
    assert result["status"] == "budget"
    assert "the time of 1 s is used up" in result["advice"]
    assert len(result["certificate"]["goals"]) == 2


def test_scenarios_have_names_goals_no_sense_and_the_method_is_chosen(client) -> None:
    goals = [
        {"metric": "overshoot", "experiment": "step", "output": "x", "upper": 0.04},
        {"metric": "bandwidth", "from": "force", "to": "x", "lower": 0.3},
    ]
    scenarios = [{}, {"name": "heavy", "parameters": {"m": {"value": 2000, "unit": "g"}}}]
    body = {key: value for key, value in REQUEST.items() if key != "method"}
    accepted = client.post("/v1/optimizations", json=body | {"goals": goals, "scenarios": scenarios})
    assert accepted.status_code == 202, accepted.text
    result = client.get(finished(client, accepted.json())["result"]).json()
    assert result["status"] == "converged"
    assert "was chosen because" in result["advice"]
    assert result["seconds"] == pytest.approx(sum(spent["seconds"] for spent in result["effort"].values()))
    # ζ = c / (2 √(m k)) is least for the largest mass
    assert (result["goals"][0]["scenario"], result["goals"][0]["scenario_name"]) == (1, "heavy")
    assert result["certificate"]["goals"][0]["scenario_name"] == "heavy"
    moved = result["sensitivity"]["c"]["down"]
    assert moved["value"] == pytest.approx(0.99 * result["best"]["c"], rel=1e-9)
    assert moved["goals"][0] > result["goals"][0]["after"]["value"]


@pytest.mark.parametrize(
    ("scenarios", "pointer", "detail"),
    [
        ([{"name": "a", "parameters": {}}, {"name": "a", "parameters": {}}], "/scenarios/1/name", "'a' twice"),
        ([{"name": "a", "parameters": {"nothing": 1}}], "/scenarios/0/parameters/nothing", "nothing"),
        ([{"name": "a", "parameters": {"c": 1}}], "/scenarios/0/parameters/c", "both"),
    ],
)
def test_named_scenarios_are_checked(client, scenarios, pointer: str, detail: str) -> None:
    refused = client.post("/v1/optimizations", json=REQUEST | {"scenarios": scenarios})
    assert refused.status_code == 422
    assert [error["pointer"] for error in refused.json()["errors"]] == [pointer]
    assert detail in refused.json()["errors"][0]["detail"]


def test_texts_with_units_are_bounds_and_doubtful_ones_are_told(client) -> None:
    goals = [REQUEST["goals"][0], REQUEST["goals"][1] | {"upper": "4 %"}, REQUEST["goals"][1] | {"upper": 5}]
    accepted = client.post("/v1/optimizations", json=REQUEST | {"goals": goals})
    assert accepted.status_code == 202, accepted.text
    done = finished(client, accepted.json())
    result = client.get(done["result"]).json()
    assert result["best"]["c"] == pytest.approx(2 * Z, rel=1e-3)
    wanted = {
        "pointer": "/goals/2/upper",
        "detail": "upper 5 of overshoot is a ratio, that is 500 %: did you mean 5 %?",
    }
    assert wanted in accepted.json()["warnings"]
    assert wanted in result["warnings"]


def test_a_bound_that_no_value_keeps_is_refused_with_the_unit_that_was_meant(client) -> None:
    damped = {"metric": "damping_ratio", "lower": 70}
    refused = client.post("/v1/optimizations", json=REQUEST | {"goals": [*REQUEST["goals"], damped]})
    assert refused.status_code == 422
    (error,) = refused.json()["errors"]
    assert error == {
        "pointer": "/goals/2/lower", "detail": "lower of damping_ratio must be <= 1, got 70: did you mean 70 %?"
    }  # fmt: skip
