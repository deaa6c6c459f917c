"""The figures of the report; every curve and mark in them is a number of one of the service's replies."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.ticker import LogLocator, NullLocator, ScalarFormatter

from examples.demo.findings import PLACES, Behaviour, Check, Findings
from examples.demo.report.style import BAD, BEFORE, GOOD, INK, LAWS, MEASURED, QUIET, drawing, legend_above, svg
from examples.demo.systems import MAP_ACROSS
from examples.demo.units import words

_HALF_STYLE: Mapping[str, Any] = {"second": "-", "first": (0, (3.5, 1.6))}
_SHOWN_POINTS = 2500


def overlay(findings: Findings) -> Markup:
    """Draw measured over simulated on the whole active part, its residual, and two moments close up."""
    with drawing(10.6, 6.6) as (figure, _):
        whole, rest, early, late = figure.subplot_mosaic("WW;RR;EL", height_ratios=[2.1, 0.8, 2.0]).values()
        for check in findings.checks:
            time, real, model = _curves(check)
            keep = slice(None, None, max(1, len(time) // _SHOWN_POINTS))
            whole.plot(time[keep], real[keep], color=MEASURED, linewidth=1.4)
            whole.plot(time[keep], model[keep], color=LAWS["PID"], linewidth=0.6)
            rest.plot(time[keep], (real - model)[keep], color=BAD, linewidth=0.6)
        for axes, check in zip((early, late), sorted(findings.checks, key=lambda c: c.half.window), strict=True):
            _close_up(axes, check)
        for start, end in (half.window for half in findings.recording.halves):
            whole.axvspan(start, end, color="#eef3fa" if start > findings.recording.active[0] else "#f7f8fa", zorder=0)
        whole.set(title="Both halves, each simulated with the estimate of the other", ylabel="position (mm)")
        rest.set(ylabel="residual (mm)", xlabel="time (s)")
        for axes in (whole, rest):
            axes.set_xlim(*findings.recording.active)
        handles = [
            Line2D([], [], color=MEASURED, linewidth=3, label="measured"),
            Line2D([], [], color=LAWS["PID"], linewidth=1.3, label="simulated"),
        ]
        legend_above(whole, handles=handles)
        return svg(figure, "overlay", "Measured and simulated position over time, their difference, and two close-ups")


def _curves(check: Check) -> tuple[np.ndarray[Any, Any], ...]:
    curves = check.reply["outputs"]["measured"]["curves"]
    return (
        np.asarray(curves["time"]),
        1e3 * np.asarray(curves["measured"]),
        1e3 * np.asarray(curves["simulated"]),
    )


def _close_up(axes: Axes, check: Check) -> None:
    """Show the worst interval of a half with as much around it as makes one second or two periods."""
    time, real, model = _curves(check)
    low, high = check.reply["outputs"]["measured"]["worst_interval"]
    margin = max(0.0, (0.8 - (high - low)) / 2)
    near = (time >= low - margin) & (time <= high + margin)
    axes.plot(time[near], real[near], color=MEASURED, linewidth=4, solid_capstyle="round")
    axes.plot(time[near], model[near], color=LAWS["PID"], linewidth=1.3)
    axes.axvspan(low, high, color=BAD, alpha=0.07, linewidth=0)
    axes.set(
        title=f"Close up: the worst interval of the {check.half.name} half", xlabel="time (s)", ylabel="position (mm)"
    )
    axes.set_xlim(time[near][0], time[near][-1])


def steps(findings: Findings) -> Markup:
    """Draw the step before and after, in every scenario: position, valve command, acceleration."""
    shown = {"P": findings.start} | {law: findings.tuned[f"{law} response_time"] for law in ("PID", "PD2")}
    places = [place for place in PLACES if any(s.place == place for s in findings.scenarios)]
    rows = (
        ("position", "position (mm)", 1e3),
        ("control", "valve command (1 = open)", 1.0),
        ("acceleration", "acceleration (m/s²)", 1.0),
    )
    with drawing(
        10.6, 8.2, nrows=3, ncols=len(places), sharex=True, sharey="row", squeeze=False, height_ratios=[1.7, 1, 1]
    ) as (figure, axes):
        for column, place in enumerate(places):
            for row, (output, label, factor) in enumerate(rows):
                for law, behaviour in shown.items():
                    _step_curves(
                        axes[row][column],
                        findings,
                        behaviour,
                        place=place,
                        output=output,
                        factor=factor,
                        color=LAWS[law],
                    )
                if column == 0:
                    axes[row][column].set_ylabel(label)
            axes[0][column].set_title(PLACES[place].capitalize())
            axes[-1][column].set(xlabel="time (ms)", xlim=(0, 120))
        handles = [
            Line2D([], [], color=LAWS[law], linewidth=2.2, label="P, before" if law == "P" else law) for law in shown
        ]
        handles += [
            Line2D([], [], color=INK, linestyle=style, linewidth=1.2, label=f"from the {half} half")
            for half, style in _HALF_STYLE.items()
        ]
        figure.legend(handles=handles, loc="outside upper center", ncols=5)
        return svg(figure, "steps", "Step responses before and after, in every scenario")


def _step_curves(
    axes: Axes, findings: Findings, behaviour: Behaviour, *, place: str, output: str, factor: float, color: str
) -> None:
    for scenario, variant in zip(findings.scenarios, behaviour.steps["variants"], strict=True):
        if scenario.place == place:
            time, curve = np.asarray(variant["time"]), np.asarray(variant["outputs"][output])
            axes.plot(1e3 * time, factor * curve, color=color, linestyle=_HALF_STYLE[scenario.half.name], linewidth=1.3)


def bode(findings: Findings) -> Markup:
    """Draw the open loop over frequency in the base scenario, with the margins where they are read."""
    with drawing(5.4, 5.6, nrows=2, sharex=True) as (figure, (gain, phase)):
        for law, behaviour in _base_loops(findings).items():
            loop = behaviour.loops["variants"][0]
            frequency = np.asarray(loop["frequency"])
            shown = (frequency >= 3) & (frequency <= 3000)
            angle = np.degrees(np.asarray(loop["phase"]))
            gain.loglog(frequency[shown], np.asarray(loop["magnitude"])[shown], color=LAWS[law], label=_named(law))
            visible = shown & (angle > -540)
            phase.semilogx(frequency[visible], angle[visible], color=LAWS[law])
            _mark_margins(gain, phase, loop, LAWS[law])
        gain.axhline(1, color=QUIET, linewidth=0.8)
        phase.axhline(-180, color=QUIET, linewidth=0.8)
        gain.set(title="Bode diagram of L", ylabel="|L|", ylim=(1e-2, 30), xlim=(3, 3000))
        phase.set(ylabel="phase (°)", xlabel="frequency (rad/s)", ylim=(-400, -60), yticks=range(-360, -59, 60))
        legend_above(gain)
        return svg(figure, "bode", "Bode diagram of the open loop before and after, with gain and phase margins")


def _mark_margins(gain: Axes, phase: Axes, loop: Mapping[str, Any], color: str) -> None:
    """Mark the margins that the service reports: its gain margins divide 1, its phase margins stand on -180°."""
    margins = loop.get("margins") or {"gain": [], "phase": []}
    metrics = loop["metrics"]
    for crossing in margins["gain"]:
        if crossing["value"] == metrics["gain_margin"]["value"]:
            at = crossing["frequency"]
            gain.plot([at, at], [1 / crossing["value"], 1], color=color, linewidth=2.4, alpha=0.55)
            gain.plot([at], [1 / crossing["value"]], "o", color=color, markersize=4)
    for crossing in margins["phase"]:
        if crossing["value"] == metrics["phase_margin"]["value"]:
            at, margin = crossing["frequency"], math.degrees(crossing["value"])
            phase.plot([at, at], [-180, -180 + margin], color=color, linewidth=2.4, alpha=0.55)
            phase.plot([at], [-180 + margin], "o", color=color, markersize=4)


def nyquist(findings: Findings) -> Markup:
    """Draw the open loop in the complex plane on equal axes, with the circle that the sensitivity limit keeps free."""
    limit = findings.limits["sensitivity_peak"]
    with drawing(5.4, 5.6, nrows=1) as (figure, axes):
        axes.add_patch(Circle((-1, 0), 1 / limit, facecolor="#f8e9e7", edgecolor=BAD, linewidth=0.9))
        axes.add_patch(Circle((0, 0), 1, facecolor="none", edgecolor=QUIET, linewidth=0.7, linestyle=(0, (4, 3))))
        for law, behaviour in _base_loops(findings).items():
            loop = behaviour.loops["variants"][0]
            axes.plot(loop["real"], loop["imag"], color=LAWS[law], label=_named(law))
            for crossing in (loop.get("margins") or {"phase": []})["phase"]:
                if crossing["value"] == loop["metrics"]["phase_margin"]["value"]:
                    angle = crossing["value"] - math.pi
                    axes.plot([math.cos(angle)], [math.sin(angle)], "o", color=LAWS[law], markersize=4)
        axes.plot([-1], [0], "+", color=BAD, markersize=9, markeredgewidth=1.6)
        axes.annotate(
            f"Ms = {limit:g}",
            (-1, 1 / limit),
            xytext=(0, 5),
            textcoords="offset points",
            ha="center",
            color=BAD,
            fontsize=8.5,
        )
        axes.set(
            title="Nyquist diagram", xlabel="real part", ylabel="imaginary part", xlim=(-1.9, 1.15), ylim=(-2.2, 1.2)
        )
        axes.set_aspect("equal", adjustable="box")
        return svg(figure, "nyquist", "Nyquist diagram of the open loop before and after, with the sensitivity circle")


def _base_loops(findings: Findings) -> dict[str, Behaviour]:
    return {"P": findings.start} | {law: findings.tuned[f"{law} response_time"] for law in ("PID", "PD2")}


def _named(law: str) -> str:
    return "P, before" if law == "P" else law


def grid_map(findings: Findings, law: str, aim: str) -> Markup:
    """Draw what the grid saw around its best point, and the way that the gradient took."""
    grid, gradient = findings.search(law, aim, "grid").reply, findings.search(law, aim, "gradient").reply
    found = grid.get("map")
    assert found is not None, "a grid search returns its map"
    vertical, across = "controller.kp", MAP_ACROSS[law]
    objective, violation = (_slice(found, key, grid["best"], (vertical, across)) for key in ("objective", "violation"))
    x, y = np.asarray(found["axes"][across]), np.asarray(found["axes"][vertical])
    factor, unit = (1e3, "ms") if aim == "response_time" else (1.0, "m/s²")
    with drawing(5.4, 4.7, nrows=1) as (figure, axes):
        met = np.where(violation <= 1e-6, np.abs(objective) * factor, np.nan)
        colours = axes.pcolormesh(x, y, met, shading="nearest", cmap="YlGnBu_r" if aim == "response_time" else "YlGnBu")
        figure.colorbar(colours, ax=axes, label=f"{words(aim)} ({unit})", pad=0.02).outline.set_visible(False)
        path = [point["variables"] for point in gradient["history"] if point.get("variables")]
        way = [p[across] for p in path], [p[vertical] for p in path]
        tried, reached = (([best[across]], [best[vertical]]) for best in (grid["best"], gradient["best"]))
        # Each mark twice, white below dark: it must be seen on every colour of the map.
        axes.plot(*way, color="white", linewidth=3, marker="o", markersize=6)
        axes.plot(*way, color=INK, linewidth=1.2, marker="o", markersize=3)
        axes.plot(*tried, "s", color="none", markeredgecolor="white", markeredgewidth=3, markersize=10)
        axes.plot(*tried, "s", color="none", markeredgecolor=INK, markeredgewidth=1.2, markersize=10)
        axes.plot(*reached, "*", color="#ffd24a", markeredgecolor=INK, markersize=14)
        axes.set(title=f"{law}: {words(aim)}", xlabel=across, ylabel=vertical, yscale="log", facecolor="#f1f2f4")
        axes.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))
        _plain_log(axes.yaxis)
        axes.grid(visible=False)
        return svg(
            figure,
            f"map-{law}-{aim}".lower(),
            f"Map of {words(aim)} over the parameters of {law}, with the gradient's path",
        )


def _slice(found: Any, key: str, best: Mapping[str, float], keep: tuple[str, str]) -> np.ndarray[Any, Any]:
    """Cut the map at the best value of every axis that is not drawn, and turn it so that `keep` are rows and columns."""
    names = list(found["axes"])
    values = np.array([math.nan if v is None else v for v in found[key]]).reshape(
        [len(found["axes"][n]) for n in names]
    )
    cut = tuple(
        slice(None) if name in keep else int(np.argmin(np.abs(np.asarray(found["axes"][name]) - best[name])))
        for name in names
    )
    kept = [name for name in names if name in keep]
    plane = values[cut]
    return plane if kept == list(keep) else plane.T


def _plain_log(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 3.0, 5.0, 7.0)))
    axis.set_major_formatter(ScalarFormatter())
    axis.set_minor_locator(NullLocator())


def convergence(findings: Findings) -> Markup:
    """Draw the best objective that holds its limits after so many evaluations, for each law, aim and method."""
    aims = {"response_time": ("response time (ms)", 1e3), "max_acceleration": ("max acceleration (m/s²)", 1.0)}
    with drawing(10.6, 3.3, ncols=2) as (figure, axes):
        for place, (aim, (label, factor)) in zip(axes, aims.items(), strict=True):
            for search in findings.searches:
                points = [
                    p for p in search.reply["history"] if (p["violation"] or 0.0) <= 1e-6 and p["objective"] is not None
                ]
                if search.aim != aim or not points:
                    continue
                x = [max(1, p["evaluation"]) for p in points] + [search.reply["evaluations"]]
                y = [abs(p["objective"] or 0.0) * factor for p in points]
                style = "-" if search.method == "gradient" else (0, (2, 1.5))
                place.step(
                    x,
                    [*y, y[-1]],
                    where="post",
                    color=LAWS[search.law],
                    linestyle=style,
                    label=f"{search.law}, {search.method}",
                )
            place.set(xscale="log", xlabel="evaluations", ylabel=label)
            _plain_log(place.xaxis)
            legend_above(place)
        return svg(figure, "convergence", "Best objective after so many evaluations, for each search")


def accelerations(findings: Findings) -> Markup:
    """Draw the acceleration of the base scenario, tuned for speed and tuned for acceleration."""
    with drawing(10.6, 3.3, ncols=2, sharey=True) as (figure, axes):
        for place, law in zip(axes, ("PID", "PD2"), strict=True):
            shown = {
                "before": (findings.start, BEFORE, "-"),
                "fastest": (findings.tuned[f"{law} response_time"], LAWS[law], "-"),
                "strongest acceleration": (findings.tuned[f"{law} max_acceleration"], GOOD, "-"),
            }
            for label, (behaviour, color, style) in shown.items():
                variant = behaviour.steps["variants"][0]
                place.plot(
                    1e3 * np.asarray(variant["time"]),
                    variant["outputs"]["acceleration"],
                    color=color,
                    linestyle=style,
                    label=label,
                    linewidth=1.3,
                )
            place.set(xlim=(0, 60), xlabel="time (ms)", title=law)
            legend_above(place)
        axes[0].set_ylabel("acceleration (m/s²)")
        return svg(figure, "accelerations", "Acceleration after the step, before and after both optimisations")
