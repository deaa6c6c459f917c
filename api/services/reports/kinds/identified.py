"""The report of an identification: values with their confidence, how well the model follows, what the residuals still hold."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from api.services.reports.common import pairs, request_rows, sentences, written
from api.services.reports.drawing import Line, Panel, numbers, panels
from api.services.reports.language import choice, say, word, words
from api.services.reports.matrices import matrix
from api.services.reports.model import Part, Section, Sentence, table
from api.services.reports.origins import Asked
from api.services.reports.quantities import NOTHING, plain, pretty_unit

_MOST_OUTPUTS = 8
_MEASURES = {"fit_percent": "FIT", "vaf_percent": "VAF", "relative_error_percent": "Relative error", "nrmse_percent": "NRMSE"}  # fmt: skip


def sections(asked: Asked) -> Iterator[Section]:
    """Yield what is said of an identification, with a system or without."""
    result = asked.result
    good = result["status"] == "converged"
    yield Section(
        say("Outcome"),
        [
            Sentence(
                say("The identification has converged.")
                if good
                else say("The identification ended as {status}.", status=word(result["status"])),
                "good" if good else "warning",
            ),
            *sentences([result.get("advice") or ""]),
        ],
    )
    if result.get("parameters"):
        yield Section(say("Identified values"), list(_values(result)))
    fits = list(fit_rows(result.get("fit") or {}, result.get("one_step_prediction")))
    for name, key in ((say("equation of forces"), "equation_error"), (say("static curve"), "static_fit")):
        if result.get(key):
            fits.append((name, "", result[key]))
    for one in result.get("frequency_responses") or []:
        fits += [
            (say("frequency response {name}", name=one["name"]), output, judged)
            for output, judged in one["outputs"].items()
        ]
    if fits:
        yield Section(say("Agreement with the recordings"), [fit_table(fits)])
    if result.get("tried"):
        yield Section(say("What was tried"), list(_tried(result)))
    figures = _residuals(result.get("residuals") or {})
    if figures:
        yield Section(say("Residuals"), figures)
    yield Section(say("How it was asked"), [pairs(list(_settings(asked)))])


def _values(result: Mapping[str, Any]) -> Iterator[Part]:
    found: Mapping[str, Mapping[str, Any]] = result["parameters"]
    rows = []
    for name, one in found.items():
        lower, upper = one.get("lower95"), one.get("upper95")
        value = one.get("value")
        rows.append(
            (
                name,
                plain(value, 5),
                pretty_unit(one.get("unit") or "") or "1",
                *_interval(value, lower, upper),
                plain(one.get("start")),
            )
        )
    columns = (say("Parameter"), say("Value"), say("Unit"), say("95 % interval"), "", say("Start"))
    yield table(columns, rows, numeric=[1, 3, 4, 5], total=len(rows))
    offsets = result.get("offsets") or {}
    if offsets:
        lines = ((name, plain(value, 5)) for name, value in offsets.items())
        yield table((say("Offset of"), say("Value")), lines, numeric=[1], total=len(offsets))
    if len(found) > 1:
        told = result.get("indistinguishable") or []
        yield from sentences(told, "warning") or [Sentence(say("The recordings tell all of these apart."))]
        correlations = result.get("correlations")
        if correlations:
            names = list(found)
            yield Sentence(say("Correlations of the estimates:"))
            yield from matrix(
                {n: dict(zip(names, row, strict=False)) for n, row in zip(names, correlations, strict=False)}, ""
            )
    between = result.get("between_samples")
    if between:
        tried = ", ".join(
            f"{choice('between_samples', way)} {plain(one.get('fit_percent'), 5)} %"
            for way, one in between["tried"].items()
        )
        yield Sentence(
            say(
                "Between its samples an input is taken as {way}; FIT of each way: {tried}.",
                way=choice("between_samples", between["chosen"]),
                tried=tried,
            )
        )


def _interval(value: float | None, lower: float | None, upper: float | None) -> tuple[str, str]:
    """Return the 95 % interval, and half of it beside the value."""
    if lower is None or upper is None:
        return say("not limited"), NOTHING
    around = f"± {plain(50 * (upper - lower) / abs(value), 2)} %" if value else NOTHING
    return f"{plain(lower, 5)} … {plain(upper, 5)}", around


def fit_rows(
    fit: Mapping[str, Any], one_step: Mapping[str, Any] | None
) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """Yield (part, output, measures) of all outputs, each beside what needs no model to reach it."""
    for output in fit.get("estimation") or fit.get("validation") or {}:
        for part in ("estimation", "validation"):
            if output in (fit.get(part) or {}):
                yield word(part), output, fit[part][output]
        for kind, fits in (fit.get("baselines") or {}).items():
            if output in fits:
                yield say("without a model: {kind}", kind=word(kind)), output, fits[output]
        if one_step and output in one_step:
            yield say("one step ahead"), output, one_step[output]


def fit_table(rows: list[tuple[str, str, Mapping[str, Any]]]) -> Part:
    """Return measures of agreement in per cent."""
    there = [key for key in _MEASURES if any(one.get(key) is not None for _, _, one in rows)]
    lines = ((part, output, *(_percent(one.get(key)) for key in there)) for part, output, one in rows)
    return table(
        (say("Part"), say("Output"), *(say(_MEASURES[key]) for key in there)),
        lines,
        numeric=range(2, 2 + len(there)),
        total=len(rows),
    )


def _percent(value: float | None) -> str:
    return NOTHING if value is None else f"{plain(value)} %"


def _tried(result: Mapping[str, Any]) -> Iterator[Part]:
    tried = result["tried"]
    rows = []
    for one in tried:
        order = one.get("order", one.get("degree"))
        mark = say("chosen") if order == result.get("order", result.get("degree")) else ""
        rows.append((written(order), _percent(one.get("estimation")), _percent(one.get("validation")), mark))
    yield table(
        (say("Order"), say("FIT, estimation"), say("FIT, validation"), ""), rows, numeric=[0, 1, 2], total=len(rows)
    )


def _residuals(residuals: Mapping[str, Mapping[str, Any]]) -> list[Part]:
    drawn, said = [], []
    for output, found in list(residuals.items())[:_MOST_OUTPUTS]:
        white = say("white") if found.get("white") else say("not white: the model leaves dynamics out")
        apart = say("independent of the inputs") if found.get("independent") else say("not independent of the inputs")
        said.append(f"{output}: {white}; {apart}.")
        values = numbers(found.get("autocorrelation"))
        if values.size > 1 and np.isfinite(values[1:]).any():
            lags, bound = np.arange(1.0, values.size), found.get("autocorrelation_bound")
            lines = [Line(say("autocorrelation"), lags, values[1:])]
            if bound is not None:
                lines += [Line(say("99 % bounds of chance"), np.append(lags, [np.nan, *lags]), np.append(np.full(lags.size, bound), [np.nan, *np.full(lags.size, -bound)]))]  # fmt: skip
            drawn.append(Panel(words(output), say("lag [samples]"), say("correlation"), lines))
    parts: list[Part] = sentences(said)
    if drawn:
        parts.append(panels(drawn, say("Autocorrelation of the residuals, lag 0 left out.")))
    if len(residuals) > _MOST_OUTPUTS:
        parts.append(
            Sentence(
                say("{count} more outputs are left out; the result holds them.", count=len(residuals) - _MOST_OUTPUTS)
            )
        )
    return parts


def _settings(asked: Asked) -> Iterator[tuple[str, str]]:
    request, result = asked.request, asked.result
    yield say("Method"), choice("method", str(request.get("method", "grey_box")))
    if request.get("method", "grey_box") == "grey_box":
        yield say("Starts"), written(request.get("starts", 1))
        yield say("Most evaluations"), written(request.get("max_evaluations", 60))
        yield say("Seed"), say("0, always: the same request gives the same answer")
        yield say("Offsets"), choice("offsets", str(request.get("offsets", "none")))
        yield say("Initial states"), choice("initial_states", str(request.get("initial_states", "rest")))
    left = {"system", "queue", "method", "starts", "max_evaluations", "offsets", "initial_states", "parameters"}
    yield from request_rows(request, left)
    for part, window in (result.get("windows") or {}).items():
        if window is not None:
            yield say("Window of {part}", part=word(part)), f"{plain(window[0], 6)} … {plain(window[1], 6)} s"
    if result.get("evaluations") is not None:
        yield say("Evaluations"), str(result["evaluations"])
