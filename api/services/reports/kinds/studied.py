"""The reports of simulations and frequency responses: their curves and metrics, variant by variant."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from api.services.reports import responses
from api.services.reports.common import pairs, request_rows, sentences, written
from api.services.reports.kinds.naming import title
from api.services.reports.language import label, say, word
from api.services.reports.model import Part, Section, Sentence, table
from api.services.reports.origins import Asked
from api.services.reports.quantities import measured, metric_value, plain, quantity

_ACROSS = 4
"""Variants beside each other."""


def simulation(asked: Asked) -> Iterator[Section]:
    """Yield what is said of a simulation."""
    variants = asked.result["variants"]
    names = variant_names(variants)
    units = {} if asked.diagram is None else asked.diagram.output_units
    yield Section(say("Variants"), list(_variants(names, variants)))
    curves = dict(zip(names, variants, strict=True))
    yield Section(say("Responses"), responses.over_time(curves, units, say("The outputs over time.")))
    outputs = list(dict.fromkeys(name for one in variants for name in one.get("metrics", {})))
    for output in outputs:
        found = [one.get("metrics", {}).get(output, {}) for one in variants]
        parts = list(_metrics(names, found))
        if parts:
            yield Section(say("Metrics of {output}", output=output), parts)
    yield _asked(asked)


def frequency(asked: Asked) -> Iterator[Section]:
    """Yield what is said of a frequency response."""
    variants = asked.result["variants"]
    names = variant_names(variants)
    yield Section(say("Variants"), list(_variants(names, variants)))
    curves = dict(zip(names, variants, strict=True))
    loop = asked.request.get("open_at")
    figures = []
    if loop:
        figures.append(responses.bode(curves, say("Bode diagram of the open loop at {place}.", place=written(loop))))
        figures.append(
            responses.nyquist(curves, say("Nyquist diagram of the open loop at {place}.", place=written(loop)))
        )
    else:
        ends = {"start": asked.request.get("from"), "end": asked.request.get("to")}
        figures.append(responses.bode(curves, say("Bode diagram from {start} to {end}.", **ends)))
    for i in range(len(variants[0].get("paths") or [])):
        further = {name: one["paths"][i] for name, one in curves.items() if len(one.get("paths") or []) > i}
        one = next(iter(further.values()))
        figures.append(
            responses.bode(further, say("Bode diagram from {start} to {end}.", start=one["from"], end=one["to"]))
        )
    drawn: list[Part] = [figure for figure in figures if figure is not None]
    yield Section(say("Frequency responses"), drawn or [Sentence(say("There is nothing to draw."))])
    parts = list(_metrics(names, [one.get("metrics", {}) for one in variants]))
    if parts:
        yield Section(say("Metrics"), parts)
    for name, one in curves.items():
        parts = [*_margins(one), *_roots(one)]
        if parts:
            yield Section(
                say("Margins and poles: {name}", name=name) if len(curves) > 1 else say("Margins and poles"), parts
            )
    yield _asked(asked)


def variant_names(variants: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a short and different name for each variant: its values, else its number."""
    names: list[str] = []
    for i, one in enumerate(variants):
        values = ", ".join(f"{path} = {written(value)}" for path, value in (one.get("parameters") or {}).items())
        name = (
            values
            if 0 < len(values) <= 40
            else say("variant {number}", number=i + 1)
            if len(variants) > 1
            else say("as it is")
        )
        names.append(name if name not in names else f"{name} ({i + 1})")
    return names


def _variants(names: Sequence[str], variants: Sequence[Mapping[str, Any]]) -> Iterator[Part]:
    rows = [
        (name, written(one.get("parameters") or {}) or say("as it is"), word(str(one.get("verdict", ""))))
        for name, one in zip(names, variants, strict=True)
    ]
    yield table((say("Variant"), say("Values"), say("Verdict")), rows, total=len(rows))
    yield from sentences((str(one.get("advice", "")) for one in variants), "warning")


def _metrics(names: Sequence[str], found: Sequence[Mapping[str, Any]]) -> Iterator[Part]:
    metrics = list(dict.fromkeys(name for one in found for name in one))
    if not metrics:
        return
    most = 6 * _ACROSS
    for start in range(0, min(len(names), most), _ACROSS):
        part = range(start, min(start + _ACROSS, len(names)))
        rows = ((title(metric), *(measured(metric, found[i].get(metric)) for i in part)) for metric in metrics)
        yield table(
            (say("Metric"), *(names[i] for i in part)), rows, numeric=range(1, len(part) + 1), total=len(metrics)
        )
    if len(names) > most:
        yield Sentence(
            say("The first {most} of {count} variants; the result holds all of them.", most=most, count=len(names))
        )


def _margins(one: Mapping[str, Any]) -> Iterator[Part]:
    margins = one.get("margins")
    if margins:
        kinds = (("gain", "gain_margin", "1"), ("phase", "phase_margin", "rad"), ("delay", "delay_margin", "s"))
        rows = [
            (label(metric), quantity(crossing["frequency"], "rad/s"), metric_value(metric, crossing["value"], unit))
            for kind, metric, unit in kinds
            for crossing in margins.get(kind) or []
            if crossing.get("value") is not None
        ]
        yield table((say("Margin"), say("At"), say("Value")), rows, numeric=[1, 2], total=len(rows))


def _roots(one: Mapping[str, Any]) -> Iterator[Part]:
    for kind, called in (("poles", say("Pole")), ("zeros", say("Zero"))):
        roots = one.get(kind) or []
        if roots:
            rows = ((called, plain(root["real"]), plain(root["imag"])) for root in roots)
            yield table(
                ("", say("Real part [1/s]"), say("Imaginary part [1/s]")), rows, numeric=[1, 2], total=len(roots)
            )


def _asked(asked: Asked) -> Section:
    left = {"system", "variants", "keep"}
    told = request_rows(asked.request, left)
    return Section(
        say("How it was asked"), [pairs(told)] if told else [Sentence(say("With nothing but its defaults."))]
    )
