"""The report of an influence study: which parameter moves which metric, and how much."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from api.services.reports.common import pairs, request_rows
from api.services.reports.drawing import bars
from api.services.reports.kinds.naming import title
from api.services.reports.language import say, word
from api.services.reports.matrices import matrix, shown
from api.services.reports.model import Part, Section, Sentence, table
from api.services.reports.origins import Asked
from api.services.reports.quantities import measured, metric_value, plain

_BARS = 15
_MOST_FIGURES = 4


def sections(asked: Asked) -> Iterator[Section]:
    """Yield what is said of an influence study."""
    result = asked.result
    base, found = result["base"], result["elasticities"]
    rows = [(title(name), measured(name, one), str(one.get("advice") or "")) for name, one in base.items()]
    yield Section(
        say("Metrics"), [table((say("Metric"), say("Value"), say("Note")), rows, numeric=[1], total=len(rows))]
    )
    values = {title(metric): {path: one.get("value") for path, one in row.items()} for metric, row in found.items()}
    yield Section(
        say("Elasticities"), [*_strongest(found), *matrix(values, say("Metric")), *_bars(values), *_missing(found)]
    )
    yield Section(say("Finite change"), list(_coefficients(result.get("coefficients") or {}, base)))
    predictions = result.get("predictions") or []
    if predictions:
        yield Section(say("Predictions"), list(_predictions(predictions)))
    left = {"system", "metrics", "parameters", "predict", "keep"}
    yield Section(say("How it was asked"), [pairs(request_rows(asked.request, left))])


def _strongest(found: Mapping[str, Any]) -> Iterator[Part]:
    yield Sentence(
        say("By how many per cent a metric changes when a parameter grows by one per cent; exact derivatives.")
    )
    for metric, row in list(found.items())[:_MOST_FIGURES]:
        sized = {path: abs(one["value"]) for path, one in row.items() if one.get("value") is not None}
        if sized and max(sized.values()) > 0:
            path = max(sized, key=sized.__getitem__)
            yield Sentence(
                say(
                    "{metric} depends most on {path}: {value}.",
                    metric=title(metric),
                    path=path,
                    value=shown(row[path]["value"]),
                )
            )


def _bars(values: Mapping[str, Mapping[str, float | None]]) -> Iterator[Part]:
    for metric, row in list(values.items())[:_MOST_FIGURES]:
        sized = sorted(((path, value) for path, value in row.items() if value), key=lambda one: -abs(one[1]))
        if len(sized) > 1:
            yield bars(
                sized[:_BARS], say("elasticity"), say("Elasticities of “{metric}”, the strongest first.", metric=metric)
            )
    if len(values) > _MOST_FIGURES:
        yield Sentence(say("Of {count} metrics the first {most} are drawn.", count=len(values), most=_MOST_FIGURES))


def _missing(found: Mapping[str, Any]) -> Iterator[Part]:
    rows = [
        (title(metric), path, word(one["verdict"]))
        for metric, row in found.items()
        for path, one in row.items()
        if one.get("verdict") != "ok"
    ]
    if rows:
        yield Sentence(say("Some have no elasticity, or one that is to be read with care:"))
        yield table((say("Metric"), say("Parameter"), say("Verdict")), rows, total=len(rows))


def _coefficients(found: Mapping[str, Any], base: Mapping[str, Any]) -> Iterator[Part]:
    rows = [
        (
            title(metric),
            path,
            f"{plain(100 * one['change'])} %" if one.get("change") is not None else "",
            *(_value(metric, one.get(key), base) for key in ("initial", "final")),
            shown(one.get("value")),
        )
        for metric, row in found.items()
        for path, one in row.items()
    ]
    yield Sentence(say("What becomes of each metric when one parameter alone is changed by so much, computed anew."))
    columns = (say("Metric"), say("Parameter"), say("Change"), say("Before"), say("After"), say("Coefficient"))
    yield table(columns, rows, numeric=[2, 3, 4, 5], total=len(rows))


def _value(metric: str, value: float | None, base: Mapping[str, Any]) -> str:
    return "–" if value is None else metric_value(metric, value, (base.get(metric) or {}).get("unit", ""))


def _predictions(predictions: list[Mapping[str, Any]]) -> Iterator[Part]:
    rows = [
        (
            ", ".join(
                f"{path} {plain(change['initial'])} → {plain(change['final'])}"
                for path, change in one["changes"].items()
            ),
            title(metric),
            metric_value(metric, told["value"], told["exact"].get("unit", ""))
            if told.get("value") is not None
            else "–",
            measured(metric, told["exact"]),
            "–" if told.get("relative_error") is None else f"{plain(100 * told['relative_error'], 3)} %",
        )
        for one in predictions
        for metric, told in one["metrics"].items()
    ]
    yield table(
        (say("Changes"), say("Metric"), say("Predicted"), say("Exact"), say("Error")),
        rows,
        numeric=[2, 3, 4],
        total=len(rows),
    )
