"""The tables of the report: replies of the service, arranged and given display units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from examples.demo.analysing import CHANGE, existing, metric, parameters
from examples.demo.findings import PLACES, Findings
from examples.demo.systems import CONSTRUCTIVE
from examples.demo.units import METRICS, measured, parameter, signed, words

START_METRICS = (
    "rise_time",
    "response_time",
    "overshoot",
    "max_velocity",
    "max_acceleration",
    "control_effort",
    "bandwidth",
    "sensitivity_peak",
    "gain_margin",
    "phase_margin",
    "delay_margin",
)
_DASH = "–"


def percent(value: float | None, digits: int = 2) -> str:
    """Return a percentage of the service as text."""
    return _DASH if value is None else f"{value:.{digits}f} %".replace("-", "\N{MINUS SIGN}")


def headline(findings: Findings) -> list[dict[str, str]]:
    """Return the four numbers that a hurried reader takes away."""
    fits = [check.reply["outputs"]["measured"]["fit_percent"] for check in findings.checks]
    tuned = {aim: [s for s in findings.searches if (s.aim, s.method) == (aim, "gradient")] for _, aim in findings.aims}
    best = min(tuned["response_time"], key=lambda search: search.reached)
    strongest = max(tuned["max_acceleration"], key=lambda search: search.reached)
    count = range(len(findings.scenarios))
    slow = max((metric(findings.start, "response_time", i) for i in count), key=lambda found: found["value"])
    weak = min((metric(findings.start, "max_acceleration", i) for i in count), key=lambda found: found["value"])
    proven = sum(search.reply["certificate"]["valid"] for search in findings.searches)
    return [
        {
            "value": " / ".join(percent(fit, 1) for fit in sorted(fits, reverse=True)),
            "label": "FIT on the half of the recording that the model has not seen",
        },
        {
            "value": f"{measured('response_time', slow)} → {METRICS['response_time'](best.reached)}",
            "label": f"response time in the worst scenario, P law → {best.law}",
        },
        {
            "value": f"{measured('max_acceleration', weak)} → {METRICS['max_acceleration'](strongest.reached)}",
            "label": f"acceleration within the same limits, P law → {strongest.law}",
        },
        {"value": f"{proven} of {len(findings.searches)}", "label": "optima confirmed by the exact engine"},
    ]


def fits(findings: Findings) -> list[dict[str, Any]]:
    """Return, for each half, how our model, the published one and no model at all predict it."""
    rows = []
    for check in findings.checks:
        ours, published = (reply["outputs"]["measured"] for reply in (check.reply, check.published))
        candidates = [
            (f"this model, estimated on the {check.estimate.half.name} half", ours, check.reply["verdict"]),
            ("published model, fitted by its authors to the whole recording", published, check.published["verdict"]),
            ("no model: output = command", ours["baselines"]["input"], _DASH),
        ]
        rows.append(
            {
                "half": check.half.name,
                "window": check.half.window,
                "worst": ours["worst_interval"],
                "candidates": [
                    {
                        "name": name,
                        "fit": percent(entry["fit_percent"]),
                        "error": percent(entry["relative_error_percent"]),
                        "vaf": percent(entry["vaf_percent"]),
                        "nrmse": percent(entry["nrmse_percent"]),
                        "verdict": verdict,
                    }
                    for name, entry, verdict in candidates
                ],
            }
        )
    return rows


def estimates(findings: Findings) -> list[dict[str, Any]]:
    """Return every identification: its parameters with confidence intervals, its offset and its fits."""
    rows = []
    for estimate in findings.estimates:
        cells = {path.partition(".")[0]: _interval(path, entry) for path, entry in estimate.reply["parameters"].items()}
        rows.append(
            {
                "place": PLACES[estimate.place],
                "half": estimate.half.name,
                "gain": _interval("valve.flow_gain", estimate.reply["parameters"]["valve.flow_gain"]),
                "lag": _interval("valve.time_constant", estimate.reply["parameters"]["valve.time_constant"]),
                "delay": cells[estimate.place],
                "offset": _offset(estimate.reply["offsets"]),
                "own": percent(estimate.own_fit),
                "other": percent(estimate.other_fit),
                "base": estimate is findings.scenarios[0],
                "kept": estimate in findings.scenarios,
            }
        )
    return rows


def _interval(path: str, entry: Mapping[str, Any]) -> dict[str, str]:
    low, high = (parameter(path, entry[key], with_unit=False) for key in ("lower95", "upper95"))
    return {"value": parameter(path, entry["value"]), "interval": f"{low} … {high}"}


def _offset(offsets: Mapping[str, Any]) -> str:
    value = offsets["measured"]
    metres = value["value"] if isinstance(value, Mapping) else value
    return f"{1e3 * metres:.3f} mm".replace("-", "\N{MINUS SIGN}")


def starting_point(findings: Findings) -> list[dict[str, Any]]:
    """Return every metric of the proportional law, one column for each scenario."""
    return [
        {
            "name": words(name),
            "title": str(findings.catalog.get(name, {}).get("definition", "")),
            "values": [measured(name, metric(findings.start, name, i)) for i in range(len(findings.scenarios))],
        }
        for name in START_METRICS
    ]


def influence(findings: Findings) -> dict[str, Any]:
    """Return the heat table: elasticities, eq. (4) below them, and which is the strongest of its row and column."""
    study = findings.influence
    names = existing(study)
    rows = []
    for path in parameters(study):
        cells = []
        for name in names:
            entry, finite = study["elasticities"][name][path], study["coefficients"][name][path]
            cells.append(
                {
                    "value": signed(entry["value"]) if entry["value"] is not None else words(entry["verdict"]),
                    "finite": signed(finite["value"]),
                    "shade": _shade(entry["value"]),
                    "dark": abs(entry["value"] or 0.0) > 0.6,
                    "row": study["strongest"]["by_parameter"].get(path) == name,
                    "column": study["strongest"]["by_metric"].get(name) == path,
                }
            )
        rows.append({"name": path, "kind": "machine" if path in CONSTRUCTIVE else "law", "cells": cells})
    heads = [{"name": words(name), "base": measured(name, study["base"][name])} for name in names]
    absent = [
        f"{words(name)} is {measured(name, study['base'][name])}: it has no relative change"
        for name in study["elasticities"]
        if name not in names
    ]
    return {"heads": heads, "rows": rows, "absent": absent, "change": f"{CHANGE:+.0%}"}


def _shade(value: float | None) -> str:
    """Return the colour of an elasticity: blue rises, red falls, the deeper the stronger, full at 1."""
    if value is None:
        return "transparent"
    strength = min(1.0, abs(value)) ** 0.7
    red, green, blue = (31, 95, 191) if value > 0 else (185, 50, 44)
    return f"rgba({red}, {green}, {blue}, {0.88 * strength:.3f})"


def influence_in_words(findings: Findings) -> dict[str, list[str]]:
    """Return the table read as the paper reads it: by rows and by columns."""
    study = findings.influence
    by_row = [
        f"{path} moves {words(name)} most ({signed(study['elasticities'][name][path]['value'])})"
        for path, name in study["strongest"]["by_parameter"].items()
    ]
    by_column = [
        f"the strongest lever on {words(name)} is {path} ({signed(study['elasticities'][name][path]['value'])})"
        for name, path in study["strongest"]["by_metric"].items()
    ]
    return {"rows": by_row, "columns": by_column}


def searches(findings: Findings) -> list[dict[str, Any]]:
    """Return every search: what it found, at which cost."""
    return [
        {
            "law": search.law,
            "aim": words(search.aim),
            "method": search.method,
            "before": measured(search.aim, search.reply["goals"][0]["before"]),
            "after": measured(search.aim, search.reply["goals"][0]["after"]),
            "best": ", ".join(
                f"{path.partition('.')[2]} = {parameter(path, value)}" for path, value in search.reply["best"].items()
            ),
            "evaluations": f"{search.reply['evaluations']:,}".replace(",", "\N{NARROW NO-BREAK SPACE}"),
            "seconds": f"{search.reply['seconds']:.2f} s",
            "status": search.reply["status"],
            "proven": search.reply["certificate"]["valid"],
        }
        for search in findings.searches
    ]


def agreement(findings: Findings) -> list[dict[str, str]]:
    """Return how far grid and gradient agree on each optimum."""
    rows = []
    for law, aim in findings.aims:
        grid, gradient = findings.search(law, aim, "grid"), findings.search(law, aim, "gradient")
        a, b = (grid.reached, gradient.reached)
        better = "gradient" if (b < a) == (aim == "response_time") else "grid"
        rows.append(
            {
                "what": f"{law}, {words(aim)}",
                "apart": percent(100 * abs(a - b) / abs(b)),
                "better": better if a != b else "equal",
                "ratio": f"{grid.reply['evaluations'] / gradient.reply['evaluations']:.1f}",
            }
        )
    return rows


def before_after(findings: Findings) -> list[dict[str, Any]]:
    """Return the goals of each gradient search before and after, worst scenario, with what they were limited to."""
    tables = []
    for law, aim in findings.aims:
        reply = findings.search(law, aim, "gradient").reply
        proofs = {proof["goal"]: proof for proof in reply["certificate"]["goals"]}
        rows = []
        for index, goal in enumerate(reply["goals"]):
            name, proof = goal["metric"], proofs.get(index)
            rows.append(
                {
                    "name": words(name),
                    "limit": f"≤ {METRICS[name](findings.limits[name])}" if name in findings.limits else "the aim",
                    "before": measured(name, goal["before"]),
                    "after": measured(name, goal["after"]),
                    "certified": _DASH if proof is None else METRICS[name](proof["value"]),
                    "where": _where(findings, proof),
                    "met": goal["met"],
                    "active": goal["active"],
                }
            )
        tables.append({"title": f"{law}, {words(aim)}", "rows": rows, "valid": reply["certificate"]["valid"]})
    return tables


def _where(findings: Findings, proof: Mapping[str, Any] | None) -> str:
    """Say in which scenario, and when or at which frequency, a goal is at its worst."""
    if proof is None:
        return _DASH
    at = proof.get("at") or {}
    moment = f", {1e3 * at['time']:.1f} ms" if at.get("time") is not None else ""
    moment = f", {at['frequency']:.0f} rad/s" if at.get("frequency") is not None else moment
    return f"{findings.scenarios[proof['scenario']].name}{moment}"


def certificates(findings: Findings) -> dict[str, Any]:
    """Return how many optima are proven, and the largest violation among them."""
    worst = [search.reply["certificate"]["worst_violation"] or 0.0 for search in findings.searches]
    return {
        "valid": sum(search.reply["certificate"]["valid"] for search in findings.searches),
        "of": len(findings.searches),
        "worst": f"{max(worst):.1e}",
    }


def definitions(findings: Findings) -> list[dict[str, str]]:
    """Return what each number of the report means, in the words of the service's catalogue."""
    names = dict.fromkeys([*START_METRICS, *findings.influence["elasticities"]])
    return [
        {"name": words(name), "definition": str(findings.catalog[name].get("definition", ""))}
        for name in names
        if name in findings.catalog
    ]
