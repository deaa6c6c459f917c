"""One figure: what was measured beside what two models say, and the step before and after."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure

if TYPE_CHECKING:
    from examples.demo_lab.__main__ import Findings

_MEASURED, _MODEL, _OTHER = "#1b1b1b", "#0072b2", "#d55e00"


def draw(findings: Findings, path: Path) -> None:
    """Write the figure."""
    figure = Figure(figsize=(10, 6.5), layout="constrained")
    (textbook, identified), (step, error) = figure.subplots(2, 2)
    for axes, reply, name in (
        (textbook, findings.textbook, f"textbook: error {findings.errors[0]:.1f} %"),
        (identified, findings.identified, f"identified: error {findings.errors[1]:.2f} %"),
    ):
        _compare(axes, reply, name)
    for measured, colour, label in (
        (findings.before, _OTHER, f"before: {findings.before.response_time * 1e3:.0f} ms"),
        (findings.after, _MODEL, f"after: {findings.after.response_time * 1e3:.0f} ms"),
    ):
        step.plot(measured.time, [1e3 * y for y in measured.position], color=colour, label=label)
    step.set(title="step, measured", xlabel="time (s)", ylabel="position (mm)", xlim=(-0.05, 1.5))
    step.legend(title="response time")
    for reply, colour, label in (
        (findings.textbook, _OTHER, "textbook"),
        (findings.identified, _MODEL, "identified"),
    ):
        curves = reply["outputs"]["position"]["curves"]
        difference = [1e3 * (a - b) for a, b in zip(curves["measured"], curves["simulated"], strict=True)]
        error.plot(curves["time"], difference, color=colour, lw=0.8, label=label)
    error.set(title="measured - simulated", xlabel="time (s)", ylabel="mm")
    error.legend()
    figure.savefig(path, dpi=130)


def _compare(axes: Any, reply: Any, title: str) -> None:
    curves = reply["outputs"]["position"]["curves"]
    axes.plot(curves["time"], [1e3 * y for y in curves["measured"]], color=_MEASURED, lw=1.0, label="measured")
    axes.plot(curves["time"], [1e3 * y for y in curves["simulated"]], color=_MODEL, lw=1.0, ls="--", label="simulated")
    axes.set(title=title, xlabel="time (s)", ylabel="position (mm)")
    axes.legend(loc="upper right")
