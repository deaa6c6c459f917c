"""The report of a validation: measured against simulated, the verdict, and what would make the error smaller."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from api.services.reports import responses
from api.services.reports.common import pairs, sentences, written
from api.services.reports.kinds.identified import fit_table
from api.services.reports.model import Part, Section, Sentence, table
from api.services.reports.origins import Asked
from api.services.reports.quantities import plain, quantity, words


def sections(asked: Asked) -> Iterator[Section]:
    """Yield what is said of a validation."""
    result = asked.result
    passed = result["verdict"] == "pass"
    first = Sentence(f"The validation has {'passed' if passed else 'failed'}; its grade is {result['grade']}.", "good" if passed else "bad")  # fmt: skip
    yield Section("Outcome", [first, *sentences([result.get("advice") or "", *(result.get("remarks") or [])])])
    rows: list[tuple[str, str, Mapping[str, Any]]] = []
    for output, found in result["outputs"].items():
        rows.append(("simulated", output, found))
        rows += [
            (f"without a model: {words(kind)}", output, fit) for kind, fit in (found.get("baselines") or {}).items()
        ]
    yield Section("Agreement with the recording", [fit_table(rows)])
    yield Section("Measured and simulated", list(_curves(result["outputs"])))
    adjustment = result.get("adjustment")
    if adjustment:
        yield Section("Adjusted values", [_adjusted(adjustment)])
    left = {"system", "parameters", "keep", "points", "queue"}
    told = [(words(k).capitalize(), written(v)) for k, v in asked.request.items() if k not in left and v is not None]
    yield Section("How it was asked", [pairs(told)])


def _curves(outputs: Mapping[str, Any]) -> Iterator[Part]:
    for output, found in list(outputs.items())[: responses.MOST_PANELS]:
        curves = found.get("curves") or {}
        both = {
            name: {"time": curves.get("time", ()), "outputs": {output: curves.get(name, ())}}
            for name in ("measured", "simulated")
        }
        yield from responses.over_time(
            both, {output: found.get("unit", "")}, f"Measured and simulated {words(output)}."
        )
        begin, end = found["worst_interval"]
        yield Sentence(f"{output} is worst from {quantity(begin, 's')} to {quantity(end, 's')}.")


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
    columns = ("Parameter", "Theoretical", "Adjusted", "Change", "95 % interval")
    return table(columns, rows, numeric=[1, 2, 3, 4], total=len(rows))
