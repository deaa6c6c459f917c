"""The reports of simulations and frequency responses: their curves and metrics, variant by variant."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from api.services.reports import responses
from api.services.reports.common import pairs, sentences, written
from api.services.reports.kinds.naming import title
from api.services.reports.model import Part, Section, Sentence, table
from api.services.reports.origins import Asked
from api.services.reports.quantities import measured, metric_value, plain, quantity, words

_ACROSS = 4
"""Variants beside each other."""


def simulation(asked: Asked) -> Iterator[Section]:
    """Yield what is said of a simulation."""
    variants = asked.result["variants"]
    names = variant_names(variants)
    units = {} if asked.diagram is None else asked.diagram.output_units
    yield Section("Variants", list(_variants(names, variants)))
    curves = dict(zip(names, variants, strict=True))
    yield Section("Responses", responses.over_time(curves, units, "The outputs over time."))
    outputs = list(dict.fromkeys(name for one in variants for name in one.get("metrics", {})))
    for output in outputs:
        found = [one.get("metrics", {}).get(output, {}) for one in variants]
        parts = list(_metrics(names, found))
        if parts:
            yield Section(f"Metrics of {output}", parts)
    yield _asked(asked)


def frequency(asked: Asked) -> Iterator[Section]:
    """Yield what is said of a frequency response."""
    variants = asked.result["variants"]
    names = variant_names(variants)
    yield Section("Variants", list(_variants(names, variants)))
    curves = dict(zip(names, variants, strict=True))
    loop = asked.request.get("open_at")
    path = f"from {asked.request.get('from')} to {asked.request.get('to')}"
    where = f"of the open loop at {written(loop)}" if loop else path
    figures = [responses.bode(curves, f"Bode diagram {where}.")]
    figures += [responses.nyquist(curves, f"Nyquist diagram {where}.")] if loop else []
    for i in range(len(variants[0].get("paths") or [])):
        further = {name: one["paths"][i] for name, one in curves.items() if len(one.get("paths") or []) > i}
        one = next(iter(further.values()))
        figures.append(responses.bode(further, f"Bode diagram from {one['from']} to {one['to']}."))
    drawn: list[Part] = [figure for figure in figures if figure is not None]
    yield Section("Frequency responses", drawn or [Sentence("There is nothing to draw.")])
    parts = list(_metrics(names, [one.get("metrics", {}) for one in variants]))
    if parts:
        yield Section("Metrics", parts)
    for name, one in curves.items():
        parts = [*_margins(one), *_roots(one)]
        if parts:
            yield Section(f"Margins and poles: {name}" if len(curves) > 1 else "Margins and poles", parts)
    yield _asked(asked)


def variant_names(variants: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a short and different name for each variant: its values, else its number."""
    names: list[str] = []
    for i, one in enumerate(variants):
        values = ", ".join(f"{path} = {written(value)}" for path, value in (one.get("parameters") or {}).items())
        name = values if 0 < len(values) <= 40 else f"variant {i + 1}" if len(variants) > 1 else "as it is"
        names.append(name if name not in names else f"{name} ({i + 1})")
    return names


def _variants(names: Sequence[str], variants: Sequence[Mapping[str, Any]]) -> Iterator[Part]:
    rows = [
        (name, written(one.get("parameters") or {}) or "as it is", words(str(one.get("verdict", ""))))
        for name, one in zip(names, variants, strict=True)
    ]
    yield table(("Variant", "Values", "Verdict"), rows, total=len(rows))
    yield from sentences((str(one.get("advice", "")) for one in variants), "warning")


def _metrics(names: Sequence[str], found: Sequence[Mapping[str, Any]]) -> Iterator[Part]:
    metrics = list(dict.fromkeys(name for one in found for name in one))
    if not metrics:
        return
    most = 6 * _ACROSS
    for start in range(0, min(len(names), most), _ACROSS):
        part = range(start, min(start + _ACROSS, len(names)))
        rows = ((title(metric), *(measured(metric, found[i].get(metric)) for i in part)) for metric in metrics)
        yield table(("Metric", *(names[i] for i in part)), rows, numeric=range(1, len(part) + 1), total=len(metrics))
    if len(names) > most:
        yield Sentence(f"The first {most} of {len(names)} variants; the result holds all of them.")


def _margins(one: Mapping[str, Any]) -> Iterator[Part]:
    margins = one.get("margins")
    if margins:
        kinds = (("gain", "gain_margin", "1"), ("phase", "phase_margin", "rad"), ("delay", "delay_margin", "s"))
        rows = [
            (f"{kind} margin", quantity(crossing["frequency"], "rad/s"), metric_value(metric, crossing["value"], unit))
            for kind, metric, unit in kinds
            for crossing in margins.get(kind) or []
            if crossing.get("value") is not None
        ]
        yield table(("Margin", "At", "Value"), rows, numeric=[1, 2], total=len(rows))


def _roots(one: Mapping[str, Any]) -> Iterator[Part]:
    for kind in ("poles", "zeros"):
        roots = one.get(kind) or []
        if roots:
            rows = ((kind[:-1].capitalize(), plain(root["real"]), plain(root["imag"])) for root in roots)
            yield table(("", "Real part [1/s]", "Imaginary part [1/s]"), rows, numeric=[1, 2], total=len(roots))


def _asked(asked: Asked) -> Section:
    left = {"system", "variants", "keep"}
    told = [(words(name).capitalize(), written(value)) for name, value in asked.request.items() if name not in left]
    return Section("How it was asked", [pairs(told)] if told else [Sentence("With nothing but its defaults.")])
