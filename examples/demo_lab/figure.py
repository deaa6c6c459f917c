"""One figure: what was measured beside what two models say, in time and in frequency, and the step before and after."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure

if TYPE_CHECKING:
    from examples.demo_lab.__main__ import Findings

_MEASURED, _MODEL, _OTHER = "#1b1b1b", "#0072b2", "#d55e00"
_HZ = 1.0 / (2.0 * math.pi)


def draw(findings: Findings, path: Path) -> None:
    """Write the figure."""
    figure = Figure(figsize=(11, 10), layout="constrained")
    (textbook, identified), (error, response), (step, missing) = figure.subplots(3, 2)
    for axes, reply, name in (
        (textbook, findings.textbook, f"textbook: error {findings.errors[0]:.1f} %"),
        (identified, findings.identified, f"identified: error {findings.errors[1]:.2f} %"),
    ):
        _compare(axes, reply, name)
    _error(error, findings)
    _response(response, findings)
    _missing(missing, findings)
    for measured, colour, label in (
        (findings.before, _OTHER, f"before: {findings.before.response_time * 1e3:.0f} ms"),
        (findings.after, _MODEL, f"after: {findings.after.response_time * 1e3:.0f} ms"),
    ):
        step.plot(measured.time, [1e3 * y for y in measured.position], color=colour, label=label)
    step.set(title="step, measured", xlabel="time (s)", ylabel="position (mm)", xlim=(-0.05, 1.5))
    step.legend(title="response time")
    figure.savefig(path, dpi=130)


def _compare(axes: Any, reply: Any, title: str) -> None:
    curves = reply["outputs"]["position"]["curves"]
    axes.plot(curves["time"], [1e3 * y for y in curves["measured"]], color=_MEASURED, lw=1.0, label="measured")
    axes.plot(curves["time"], [1e3 * y for y in curves["simulated"]], color=_MODEL, lw=1.0, ls="--", label="simulated")
    axes.set(title=title, xlabel="time (s)", ylabel="position (mm)", xlim=(0, 2.5))
    axes.legend(loc="upper right")


def _error(axes: Any, findings: Findings) -> None:
    for reply, colour, label in (
        (findings.textbook, _OTHER, "textbook"),
        (findings.identified, _MODEL, "identified"),
    ):
        curves = reply["outputs"]["position"]["curves"]
        difference = [1e3 * (a - b) for a, b in zip(curves["measured"], curves["simulated"], strict=True)]
        axes.plot(curves["time"], difference, color=colour, lw=0.8, label=label)
    axes.set(title="measured - simulated", xlabel="time (s)", ylabel="mm")
    axes.legend(loc="upper right")


def _response(axes: Any, findings: Findings) -> None:
    """Draw the frequency responses from reference to position."""
    for reply, kind, colour, label in (
        (findings.identified, "measured", _MEASURED, "measured"),
        (findings.textbook, "simulated", _OTHER, "textbook"),
        (findings.identified, "simulated", _MODEL, "identified"),
    ):
        found = reply["outputs"]["position"]["frequency_domain"]
        frequency = [_HZ * w for w in found["frequency"]]
        style = {"marker": ".", "ms": 4, "ls": ""} if kind == "measured" else {"lw": 1.2}
        axes.loglog(frequency, found[kind]["magnitude"], color=colour, label=label, **style)
    axes.set(title="frequency response, position for reference", xlabel="frequency (Hz)", ylabel="m / m")
    _mark(axes, findings)
    axes.legend(loc="lower left")


def _missing(axes: Any, findings: Findings) -> None:
    """Draw how far the models are from the measured response, line by line: 100 |H - G| / |G| %."""
    for reply, colour, label in ((findings.textbook, _OTHER, "textbook"), (findings.identified, _MODEL, "identified")):
        found = reply["outputs"]["position"]["frequency_domain"]
        measured, simulated = found["measured"], found["simulated"]
        distance = [
            100 * math.hypot(a * math.cos(p) - b * math.cos(q), a * math.sin(p) - b * math.sin(q)) / b
            for a, p, b, q in zip(
                measured["magnitude"], measured["phase"], simulated["magnitude"], simulated["phase"], strict=True
            )
        ]
        axes.semilogx([_HZ * w for w in found["frequency"]], distance, color=colour, lw=1.0, label=label)
    axes.set(title="distance of measured and simulated response", xlabel="frequency (Hz)", ylim=(0, 120))
    axes.set_ylabel("% of the simulated one")
    _mark(axes, findings)
    axes.legend(loc="upper left")


def _mark(axes: Any, findings: Findings) -> None:
    for swing in findings.swings:
        axes.axvline(swing.frequency, color=_MODEL, lw=0.8, ls=":", label=f"found: a mode at {swing.frequency:.1f} Hz")
