"""The report of a validation: measured against simulated, the verdict, and what would make the error smaller."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from api.services.reports import responses
from api.services.reports.common import pairs, request_rows, sentences
from api.services.reports.kinds.identified import fit_table
from api.services.reports.language import say, word, words
from api.services.reports.model import Part, Section, Sentence, table
from api.services.reports.origins import Asked
from api.services.reports.quantities import plain, quantity


def sections(asked: Asked) -> Iterator[Section]:
    """Yield what is said of a validation."""
    result = asked.result
    passed = result["verdict"] == "pass"
    grade = word(result["grade"])
    text = say("The validation has failed; its grade is {grade}.", grade=grade)
    if passed:
        text = say("The validation has passed; its grade is {grade}.", grade=grade)
    first = Sentence(text, "good" if passed else "bad")
    yield Section(say("Outcome"), [first, *sentences([result.get("advice") or "", *(result.get("remarks") or [])])])
    rows: list[tuple[str, str, Mapping[str, Any]]] = []
    for output, found in result["outputs"].items():
        rows.append((say("simulated"), output, found))
        rows += [
            (say("without a model: {kind}", kind=word(kind)), output, fit)
            for kind, fit in (found.get("baselines") or {}).items()
        ]
    yield Section(say("Agreement with the recording"), [fit_table(rows)])
    yield Section(say("Measured and simulated"), list(_curves(result["outputs"])))
    adjustment = result.get("adjustment")
    if adjustment:
        yield Section(say("Adjusted values"), [_adjusted(adjustment)])
    left = {"system", "parameters", "keep", "points", "queue"}
    yield Section(say("How it was asked"), [pairs(request_rows(asked.request, left))])


def _curves(outputs: Mapping[str, Any]) -> Iterator[Part]:
    for output, found in list(outputs.items())[: responses.MOST_PANELS]:
        curves = found.get("curves") or {}
        both = {
            said: {"time": curves.get("time", ()), "outputs": {output: curves.get(name, ())}}
            for name, said in (("measured", say("measured")), ("simulated", say("simulated")))
        }
        yield from responses.over_time(
            both, {output: found.get("unit", "")}, say("Measured and simulated {output}.", output=words(output))
        )
        begin, end = found["worst_interval"]
        yield Sentence(
            say(
                "{output} is worst from {begin} to {end}.",
                output=output,
                begin=quantity(begin, "s"),
                end=quantity(end, "s"),
            )
        )


def _adjusted(adjustment: Mapping[str, Any]) -> Part:
    rows = []
    for one in adjustment["parameters"]:
        change = one.get("change_percent")
        limited = one.get("lower95") is not None and one.get("upper95") is not None
        rows.append(
            (
                one["parameter"],
                quantity(one.get("theoretical"), one["unit"], 5),
                quantity(one.get("adjusted"), one["unit"], 5),
                "–" if change is None else f"{plain(change, 3)} %",
                f"{plain(one['lower95'])} … {plain(one['upper95'])}" if limited else "–",
            )
        )
    columns = (say("Parameter"), say("Theoretical"), say("Adjusted"), say("Change"), say("95 % interval"))
    return table(columns, rows, numeric=[1, 2, 3, 4], total=len(rows))
