"""Responses over time and over frequency as figures of a report, before and after, or variant by variant."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import islice
from typing import Any

import numpy as np

from api.services.reports.drawing import COLORS, QUIET, Curve, Line, Panel, figure_of, numbers, panels, text
from api.services.reports.language import say, words
from api.services.reports.model import Figure, Part, Sentence
from api.services.reports.quantities import pretty_unit
from engine.analysis.frequency_study import FrequencyStudy

MOST_PANELS = 8
MOST_LINES = 12
_MOVES, _WORTH = 0.01, 0.67


def named(name: str, unit: str) -> str:
    """Return what an axis is called."""
    pretty = pretty_unit(unit)
    return f"{words(name)} [{pretty}]" if pretty else words(name)


def over_time(
    curves: Mapping[str, Mapping[str, Any]], units: Mapping[str, str], caption: str, *, first: Sequence[str] = ()
) -> list[Part]:
    """Return a figure with a panel for each output, those of ``first`` in front.

    Parameters
    ----------
    curves : mapping
        Name of a curve -> {"time": [...], "outputs": {output: [...]}}, s and the outputs' units.
    units : mapping
        Output -> unit.
    """
    shown = dict(islice(curves.items(), MOST_LINES))
    there = dict.fromkeys(name for one in shown.values() for name in one.get("outputs", {}))
    outputs = list(dict.fromkeys([*(name for name in first if name in there), *there]))
    found = {output: [line for name, one in shown.items() for line in _line(name, one, output)] for output in outputs}
    end = _settled([line for lines in found.values() for line in lines])
    drawn = [
        Panel(words(output), say("time [s]"), named(output, units.get(output, "")), lines, end=end)
        for output, lines in found.items()
        if lines
    ]
    parts: list[Part] = []
    if drawn:
        parts.append(panels(drawn[:MOST_PANELS], caption))
    left = [say("{count} more outputs", count=len(drawn) - MOST_PANELS)] if len(drawn) > MOST_PANELS else []
    left += [say("{count} more variants", count=len(curves) - MOST_LINES)] if len(curves) > MOST_LINES else []
    if left:
        parts.append(
            Sentence(say("{what} are not drawn; the result holds their curves.", what=say(" and ").join(left)))
        )
    return parts


def _settled(lines: Sequence[Line]) -> float | None:
    """Return the time (s) after which nothing moves any more, None where that would hide less than a third of the longest curve."""
    ends = []
    for line in lines:
        moves = np.abs(line.y - line.y[-1]) > _MOVES * np.nanmax(np.abs(line.y - line.y[-1]), initial=0.0)
        last = np.flatnonzero(moves)
        ends.append(float(line.x[last[-1]]) if last.size else 0.0)
    longest = max((float(line.x[-1]) for line in lines), default=0.0)
    end = 1.25 * max(ends, default=0.0)
    return end if 0 < end < _WORTH * longest else None


def _line(name: str, one: Mapping[str, Any], output: str) -> Iterable[Line]:
    time, values = numbers(one.get("time")), numbers(one.get("outputs", {}).get(output))
    if time.size and time.size == values.size and np.isfinite(values).any():
        yield Line(name, time, values)


def spectra_of(study: FrequencyStudy) -> Mapping[str, Any]:
    """Return a frequency response as a result has it."""
    response = np.asarray(study.response)
    return {"frequency": study.frequency, "magnitude": np.abs(response), "phase": study.phase, "real": response.real, "imag": response.imag}  # fmt: skip


def bode(curves: Mapping[str, Mapping[str, Any]], caption: str) -> Figure | None:
    """Return gain and phase over frequency, None where nothing can be drawn.

    Parameters
    ----------
    curves : mapping
        Name -> {"frequency" (rad/s), "magnitude", "phase" (rad)}.
    """
    gains, phases = [], []
    for name, one in islice(curves.items(), MOST_LINES):
        frequency, magnitude, phase = (numbers(one.get(key)) for key in ("frequency", "magnitude", "phase"))
        keep = (frequency > 0) & (magnitude > 0)
        if keep.any():
            gains.append(Line(name, frequency[keep], 20 * np.log10(magnitude[keep])))
            phases.append(Line(name, frequency[keep], np.degrees(phase[keep])))
    if not gains:
        return None
    both = [
        Panel(say("Gain"), "ω [rad/s]", say("gain [dB]"), gains, logarithmic=True),
        Panel(say("Phase"), "ω [rad/s]", say("phase [°]"), phases, logarithmic=True),
    ]
    return panels(both, caption, height=2.4)


def nyquist(curves: Mapping[str, Mapping[str, Any]], caption: str) -> Figure | None:
    """Return open loops in the complex plane around -1, None where nothing can be drawn."""
    lines: list[tuple[str, Curve, Curve]] = []
    for name, one in islice(curves.items(), MOST_LINES):
        real, imag = numbers(one.get("real")), numbers(one.get("imag"))
        if np.isfinite(real).any():
            lines.append((name, real, imag))
    if not lines:
        return None

    def draw(figure: Any) -> None:
        axes = figure.subplots()
        around = np.linspace(0, 2 * np.pi, 181)
        axes.plot(np.cos(around), np.sin(around), color=QUIET, linewidth=0.6, linestyle=(0, (4, 3)))
        for number, (name, real, imag) in enumerate(lines):
            look = {"color": COLORS[number % len(COLORS)], "label": text(name)}
            axes.plot(real, imag, **look)
            axes.plot(real, -imag, color=look["color"], linewidth=0.6, linestyle=(0, (2, 2)))
        axes.plot([-1], [0], "+", color=COLORS[1], markersize=9, markeredgewidth=1.6)
        axes.set(xlabel=say("real part"), ylabel=say("imaginary part"), xlim=(-3, 2), ylim=(-2.2, 2.2))
        axes.set_aspect("equal", adjustable="box")
        if len(lines) > 1:
            axes.legend(loc="center left", bbox_to_anchor=(1.02, 0.5))

    return figure_of(draw, caption, (7.1, 3.4))
