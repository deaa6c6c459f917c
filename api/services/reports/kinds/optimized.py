"""The report of an optimisation: what was chosen, what was wanted, what came out, and the proof."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from api.convert.goals import goal_from_wire
from api.convert.values import opening, overrides_from_wire
from api.problems.documents import Problem
from api.problems.exceptions import KNOWN
from api.schemas.optimizations import GoalDocument
from api.services.reports import responses
from api.services.reports.common import chosen, commands, pairs, sentences, written
from api.services.reports.drawing import Line, Panel, numbers, panels
from api.services.reports.kinds.fronts import front
from api.services.reports.kinds.naming import place_of, title
from api.services.reports.kinds.variables import chosen_variables
from api.services.reports.language import choice, label, said_of, say, word
from api.services.reports.matrices import matrix
from api.services.reports.model import Figure, Part, Section, Sentence, Table, table
from api.services.reports.origins import Asked
from api.services.reports.quantities import NOTHING, measured, metric_value, plain, quantity
from engine.analysis.study import frequency_response
from engine.diagram.diagram import Diagram
from optimizers import methods
from optimizers.problem import Goal, Sense

_BEFORE, _AFTER = "before", "after"
_MOST_LOOPS = 3
_UNREADABLE: tuple[type[Exception], ...] = (ValueError, *KNOWN)


def sections(asked: Asked) -> Iterator[Section]:
    """Yield what is said of an optimisation; the recordings that it used need not be there any more."""
    assert asked.diagram is not None
    goals = _goals(asked, asked.diagram)
    yield Section(say("Outcome"), [*_outcome(asked), *_alternatives(asked)])
    yield Section(say("Design variables"), chosen_variables(asked, asked.diagram))
    yield Section(say("Goals"), [_goal_table(asked, goals)])
    yield Section(say("Certificate"), list(_certificate(asked)))
    yield from front(asked)
    yield from _figures(asked, asked.diagram)
    yield Section(say("Influence at the optimum"), list(_elasticities(asked)))
    yield Section(say("Search"), list(_search(asked)))
    yield Section(say("How it was asked"), [_settings(asked), *_experiments(asked), *_scenarios(asked)])


def _goals(asked: Asked, diagram: Diagram) -> list[Goal | None]:
    """Return the goals in SI, None for one that this version does not read any more."""
    experiments = [str(one.get("name")) for one in asked.request.get("experiments", [])]
    found: list[Goal | None] = []
    for i, given in enumerate(asked.request.get("goals", [])):
        try:
            document = GoalDocument.model_validate(given)
            found.append(goal_from_wire(document, diagram, ("goals", i), experiments=experiments))
        except _UNREADABLE:
            found.append(None)
    return found


def _outcome(asked: Asked) -> list[Part]:
    result = asked.result
    met = sum(bool(goal.get("met")) for goal in result["goals"])
    good = result["status"] == "converged" and met == len(result["goals"])
    ended = say("The search has converged")
    if result["status"] != "converged":
        ended = say("The search ended as {status}", status=word(result["status"]))
    first = say("{ended}; {met} of {count} goals are met.", ended=ended, met=met, count=len(result["goals"]))
    valid = result["certificate"]["valid"]
    worst = result["certificate"].get("worst_violation")
    proof = say("The certificate is valid: the exact path confirms every hard goal.")
    if not valid:
        proof = say("The certificate is NOT valid: the worst violation is {violation}.", violation=plain(worst))
    return [
        Sentence(first, "good" if good else "warning"),
        Sentence(proof, "good" if valid else "bad"),
        *sentences([result.get("advice") or ""]),
    ]


def _alternatives(asked: Asked) -> Iterator[Part]:
    found = asked.result.get("alternatives")
    if found:
        yield Sentence(
            say(
                "Of {count} structures, {chosen} was chosen; what follows is about it.",
                count=len(found),
                chosen=asked.result.get("chosen"),
            )
        )
        rows = (
            (
                one["name"],
                word(one["status"]),
                plain(one.get("objective"), 5),
                say("valid") if one["certificate"]["valid"] else say("not valid"),
            )
            for one in found
        )
        yield table(
            (say("Structure"), say("Ended as"), say("Objective"), say("Certificate")),
            rows,
            numeric=[2],
            total=len(found),
        )


def _goal_table(asked: Asked, goals: Sequence[Goal | None]) -> Table:
    rows = []
    for i, found in enumerate(asked.result["goals"]):
        goal = goals[i] if i < len(goals) else None
        rows.append(
            (
                title(found["metric"]),
                place_of(found, goal),
                NOTHING if goal is None else _wanted(goal, (found.get("after") or {}).get("unit", "")),
                measured(found["metric"], found.get("before")),
                measured(found["metric"], found.get("after")),
                (say("✓ met") if found["met"] else say("✗ not met"))
                + (say(", decides") if found.get("active") else ""),
            )
        )
    return table(
        (say("Metric"), say("Of"), say("Wanted"), say("Before"), say("After"), ""),
        rows,
        numeric=[3, 4],
        total=len(rows),
    )


def _wanted(goal: Goal, unit: str) -> str:
    """Return the bounds and the sense of a goal: "minimised, ≤ 20 ms"."""
    shown = partial(metric_value, goal.metric, unit=unit)
    told = [] if goal.sense is None else [say("minimised") if goal.sense is Sense.MINIMIZE else say("maximised")]
    if goal.lower is not None:
        told.append(f"≥ {shown(goal.lower)}")
    if goal.upper is not None:
        told.append(f"≤ {shown(goal.upper)}")
    if goal.aim is not None:
        told.append(f"{shown(goal.aim)}" + ("" if goal.tolerance is None else f" ± {shown(goal.tolerance)}"))
    if goal.mask is not None:
        told.append(say("within its curves"))
    return ", ".join([*told, *([] if goal.hard else [say("soft")])])


def _certificate(asked: Asked) -> Iterator[Part]:
    yield Sentence(
        say(
            "Every goal at the optimum, computed again by the exact path, and where it exists by a measurement that shares no code with it."
        )
    )
    proofs, goals = asked.result["certificate"]["goals"], asked.result["goals"]
    rows = []
    for proof in proofs:
        goal = goals[proof["goal"]]
        unit = (goal.get("after") or {}).get("unit", "")
        again = proof.get("independent")
        at = proof.get("at") or {}
        rows.append(
            (
                title(goal["metric"]),
                measured(goal["metric"], {**proof, "unit": unit}),
                NOTHING if again is None else metric_value(goal["metric"], again, unit),
                plain(proof.get("violation")),
                str(proof.get("scenario_name") or proof.get("scenario", 0) + 1),
                next((f"{quantity(v, 's' if k == 'time' else 'rad/s')}" for k, v in at.items()), ""),
            )
        )
    columns = (say("Metric"), say("Exact"), say("Independent"), say("Violation"), say("Scenario"), say("Read at"))
    yield table(columns, rows, numeric=[1, 2, 3, 5], total=len(rows))


def _figures(asked: Asked, diagram: Diagram) -> Iterator[Section]:
    curves = asked.result.get("curves") or {}
    wanted = [str(goal["output"]) for goal in asked.result["goals"] if goal.get("output")]
    parts: list[Part] = []
    for name in curves.get("after", {}):
        both = {say(when): curves[when][name] for when in (_BEFORE, _AFTER) if name in curves.get(when, {})}
        parts += responses.over_time(
            both, diagram.output_units, say("Responses under “{name}”, before and after.", name=name), first=wanted
        )
    if parts:
        yield Section(say("Responses"), parts)
    parts = list(_over_frequency(asked, diagram))
    if parts:
        yield Section(say("Frequency responses"), parts)


def _over_frequency(asked: Asked, diagram: Diagram) -> Iterator[Part]:
    """Yield Bode and Nyquist diagrams of every loop that a goal opens; else of the path from the first command."""
    loops = list(dict.fromkeys(opening(g["open_at"]) for g in asked.request.get("goals", []) if g.get("open_at")))
    first = _first_values(asked, diagram)
    changed = {path: value for path, value in asked.result["best"].items() if path in diagram.parameters}
    values = {_BEFORE: first, _AFTER: {**first, **changed}}
    for loop in loops[:_MOST_LOOPS]:
        found, said = _studies(diagram, values, open_at=loop)
        where = written(list(loop) if isinstance(loop, tuple) else loop)
        figures = (
            responses.bode(found, say("Bode diagram of the open loop at {place}, before and after.", place=where)),
            responses.nyquist(
                found, say("Nyquist diagram of the open loop at {place}, before and after.", place=where)
            ),
        )
        yield from (figure for figure in figures if figure)
        yield from said
    path = None if loops else _first_path(asked, diagram)
    if path is not None:
        found, said = _studies(diagram, values, source=path[0], target=path[1])
        figure = responses.bode(
            found, say("Bode diagram from {start} to {end}, before and after.", start=path[0], end=path[1])
        )
        yield from [figure] if figure else []
        yield from said


def _studies(
    diagram: Diagram, values: Mapping[str, Mapping[str, float]], **where: Any
) -> tuple[dict[str, Any], list[Part]]:
    """Return the responses that there are, and of the others why not."""
    found, said = {}, []
    for when, overrides in values.items():
        try:
            found[say(when)] = responses.spectra_of(
                frequency_response(diagram, overrides=overrides, metrics=(), **where)
            )
        except KNOWN as error:
            detail = error.detail if isinstance(error, Problem) else str(error)
            said.append(say("There is no frequency response {when}: {detail}", when=say(when), detail=detail))
    return found, sentences(said)


def _first_values(asked: Asked, diagram: Diagram) -> dict[str, float]:
    """Return the first scenario, under which the curves were computed."""
    scenarios = asked.request.get("scenarios") or [{}]
    first = scenarios[0]
    given = first["parameters"] if set(first) == {"name", "parameters"} else first
    return overrides_from_wire(given, diagram, place=("scenarios", 0))


def _first_path(asked: Asked, diagram: Diagram) -> tuple[str, str] | None:
    for one in asked.request.get("experiments", []):
        given = one.get("input")
        port = (given[0] if isinstance(given, list) else given or {}).get("port")
        outputs = [str(goal["output"]) for goal in asked.result["goals"] if goal.get("output")]
        if port in diagram.inputs and outputs:
            return str(port), outputs[0]
    return None


def _elasticities(asked: Asked) -> Iterator[Part]:
    yield Sentence(say("By how many per cent a metric changes when a variable grows by one per cent, at the optimum."))
    rows = {
        f"{title(goal['metric'])} {place_of(goal, None)}".strip(): goal.get("elasticities") or {}
        for goal in asked.result["goals"]
    }
    yield from matrix(rows, say("Metric"))


def _search(asked: Asked) -> Iterator[Part]:
    result = asked.result
    told = [
        (say("Evaluations"), str(result.get("evaluations", NOTHING))),
        (say("Processor time"), quantity(result.get("seconds"), "s", 3)),
        (say("Objective"), plain(result.get("objective"), 6)),
        (say("Bound on the objective"), plain(result.get("bound"), 6)),
        (say("Stationarity"), plain(result.get("stationarity"))),
    ]
    share = result.get("yield")
    if share:
        shares = {key: plain(100 * share[key]) for key in ("share", "lower95", "upper95")}
        text = say(
            "{share} % of {samples} draws meet every goal (95 %: {lower95} … {upper95} %)",
            samples=share["samples"],
            **shares,
        )
        told.append((say("Yield"), text))
    worst = (result.get("robustness") or {}).get("worst")
    if worst:
        told.append((say("Worst of the uncertain parameters"), written(worst["parameters"])))
    yield pairs([pair for pair in told if pair[1] != NOTHING])
    checks = result.get("cross_check") or []
    if checks:
        rows = (
            (word(one["method"]), word(one["status"]), plain(one.get("objective"), 6), plain(one.get("gap")))
            for one in checks
        )
        yield table(
            (say("Checked by"), say("Ended as"), say("Objective"), say("Gap")), rows, numeric=[2, 3], total=len(checks)
        )
    history = result.get("history") or []
    if len(history) > 1:
        yield _convergence(history)


def _convergence(history: Sequence[Mapping[str, Any]]) -> Figure:
    steps = numbers([point["evaluation"] for point in history])
    curves = {name: numbers([point.get(name) for point in history]) for name in ("objective", "violation")}
    drawn = [
        Panel(
            label(name),
            say("evaluations"),
            word(name),
            [Line(say("best so far"), steps, values)],
            logarithmic=True,
            steps=True,
        )
        for name, values in curves.items()
        if np.isfinite(values).any() and (name == "objective" or np.nanmax(values) > 0)
    ]
    return panels(drawn, say("The best point after so many evaluations."), height=1.9)


def _settings(asked: Asked) -> Table:
    """Return the method with every option, its defaults among them: the seed makes the run repeatable."""
    given = dict(asked.request.get("method") or {"kind": "auto"})
    kind = str(given.pop("kind", "auto"))
    known = methods.catalogue().get(kind)
    options = {} if known is None else {param.name: param for param in known.options}
    rows = [
        (say("Method"), said_of(kind, kind if known is None else known.title), "" if known is None else say(known.doc))
    ]
    for name in {**options, **given}:
        value = given.get(name, options[name].default if name in options else None)
        rows.append(
            (
                label(name),
                chosen(name, value),
                say(options[name].doc) if name in options else "",
            )
        )
    across = asked.request.get("across_scenarios", "worst")
    meaning = {
        "worst": say("the worst objective of the scenarios counts"),
        "mean": say("the mean objective of the scenarios counts"),
    }
    rows.append((label("across_scenarios"), choice("across_scenarios", across), meaning[across]))
    if asked.request.get("yield_samples"):
        rows.append(
            (label("yield_samples"), str(asked.request["yield_samples"]), say("draws of the uncertain parameters"))
        )
    return table((say("Option"), say("Value"), say("Meaning")), rows, total=len(rows))


def _experiments(asked: Asked) -> Iterator[Part]:
    given = asked.request.get("experiments") or []
    if given:
        rows = (
            (
                str(one.get("name", "")),
                commands(one.get("input")),
                chosen("duration", one.get("duration", "auto")),
            )
            for one in given
        )
        yield table((say("Experiment"), say("Commands"), say("Duration")), rows, total=len(given))


def _scenarios(asked: Asked) -> Iterator[Part]:
    given = asked.request.get("scenarios") or []
    if any(given):
        rows = []
        for i, one in enumerate(given):
            has_name = set(one) == {"name", "parameters"}
            values = written(one["parameters"] if has_name else one) or say("as they are")
            rows.append((one["name"] if has_name else str(i + 1), values))
        yield table((say("Scenario"), say("Parameters")), rows, total=len(rows))
    ranges = asked.request.get("uncertain") or []
    if ranges:
        lines = ((one["parameter"], written(one["lower"]), written(one["upper"])) for one in ranges)
        yield table((say("Uncertain"), say("Lower"), say("Upper")), lines, numeric=[1, 2], total=len(ranges))
