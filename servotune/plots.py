"""Replies as plots of matplotlib, for whoever has it: each returns what it drew on, so that it can be changed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from servotune.optional import needed

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from servotune.replies.datasets import ChannelData
    from servotune.replies.fits import Validation
    from servotune.replies.influence import Influence
    from servotune.replies.optimizations import Optimization
    from servotune.replies.spectra import Spectrum
    from servotune.replies.studies import FrequencyResponse, Simulation

_LONGEST_LABEL = 60


def new(rows: int = 1, *, together: bool = True) -> list[Axes]:
    """Return axes one above the other on a new figure, with one scale of time or frequency if they go together."""
    plt = needed("matplotlib.pyplot", "plot()")
    _, axes = plt.subplots(rows, 1, sharex=together, squeeze=False, figsize=(7, 1.2 + 2.6 * rows), layout="constrained")
    return list(axes[:, 0])


def responses(reply: Simulation, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw the outputs over time, one below the other, the variants in one."""
    outputs = list(reply.variants[0].outputs)
    drawn = list(axes) if axes is not None else new(len(outputs))
    for place, output in zip(drawn, outputs, strict=True):
        for number, variant in enumerate(reply.variants):
            place.plot(variant.time, variant.outputs[output], label=_label(number, variant.parameters))
        place.set_ylabel(_named(output, reply.variants[0].unit_of(output)))
        _finish(place, legend=len(reply.variants) > 1)
    drawn[-1].set_xlabel("time (s)")
    return drawn


def bode(reply: FrequencyResponse, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw magnitude (dB) and phase (degrees) over the frequency (rad/s)."""
    drawn = list(axes) if axes is not None else new(2)
    for number, variant in enumerate(reply.variants):
        label = _label(number, variant.parameters)
        decibels = [20 * math.log10(m) if m else math.nan for m in variant.magnitude]
        drawn[0].semilogx(variant.frequency, decibels, label=label)
        drawn[1].semilogx(variant.frequency, [math.degrees(_number(p)) for p in variant.phase], label=label)
    for place, name in zip(drawn, ("magnitude (dB)", "phase (°)"), strict=True):
        place.set_ylabel(name)
        _finish(place, legend=len(reply.variants) > 1)
    drawn[1].set_xlabel("frequency (rad/s)")
    return drawn


def nyquist(reply: FrequencyResponse, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw the imaginary part over the real one, and the point -1."""
    drawn = list(axes) if axes is not None else new()
    for number, variant in enumerate(reply.variants):
        real, imag = ([_number(part) for part in parts] for parts in (variant.real, variant.imag))
        drawn[0].plot(real, imag, label=_label(number, variant.parameters))
    drawn[0].plot([-1], [0], "+", color="black")
    drawn[0].set_aspect("equal", adjustable="datalim")
    drawn[0].set_xlabel("real part")
    drawn[0].set_ylabel("imaginary part")
    _finish(drawn[0], legend=len(reply.variants) > 1)
    return drawn


def spectrum(reply: Spectrum, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw values over the frequency (rad/s), both logarithmic."""
    drawn = list(axes) if axes is not None else new()
    for number, variant in enumerate(reply.variants):
        drawn[0].loglog(variant.frequency, variant["value"], label=_label(number, variant.parameters))
    drawn[0].set_xlabel("frequency (rad/s)")
    drawn[0].set_ylabel(_named(reply.quantity, reply.unit))
    _finish(drawn[0], legend=len(reply.variants) > 1)
    return drawn


def influence(reply: Influence, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw the elasticities of each metric as bars, the strongest parameter first."""
    metrics = list(reply.elasticities)
    drawn = list(axes) if axes is not None else new(len(metrics), together=False)
    for place, metric in zip(drawn, metrics, strict=True):
        known = {name: e.value for name, e in reply.elasticities[metric].items() if e.value is not None}
        ranked = sorted(known, key=lambda name: abs(known[name]))
        place.barh(ranked, [known[name] for name in ranked])
        place.axvline(0.0, color="black", linewidth=0.8)
        place.set_title(metric, loc="left", fontsize="medium")
        _finish(place, legend=False)
    drawn[-1].set_xlabel("elasticity: relative change of the metric per relative change of the parameter")
    return drawn


def channel(reply: ChannelData, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw samples over time; thinned ones as the band between the smallest and the largest."""
    drawn = list(axes) if axes is not None else new()
    if reply.values_ is not None:
        drawn[0].plot(reply.time, reply.values_)
    else:
        drawn[0].fill_between(reply.time, reply.min or [], reply.max or [], step="post")
    drawn[0].set_xlabel("time (s)")
    drawn[0].set_ylabel(_named("value", reply.unit))
    _finish(drawn[0], legend=False)
    return drawn


def validation(reply: Validation, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw measured and simulated values over time."""
    drawn = list(axes) if axes is not None else new(len(reply.outputs))
    for place, (name, output) in zip(drawn, reply.outputs.items(), strict=True):
        place.plot(output.curves.time, output.curves.measured, label="measured", linewidth=1.0)
        place.plot(output.curves.time, output.curves.simulated, label="simulated", linewidth=1.0)
        place.set_ylabel(_named(name, output.unit))
        place.set_title(f"FIT {output.fit_percent:.2f} %", loc="left", fontsize="medium")
        _finish(place, legend=True)
    drawn[-1].set_xlabel("time (s)")
    return drawn


def before_and_after(reply: Optimization, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw the responses of the system as it was, and with what was found."""
    panels = [(name, output) for name, curve in reply.curves["after"].items() for output in curve["outputs"]]
    drawn = list(axes) if axes is not None else new(len(panels), together=False)
    for place, (name, output) in zip(drawn, panels, strict=True):
        for when in ("before", "after"):
            curve = reply.curves[when].get(name)
            if curve is not None and output in curve["outputs"]:
                place.plot(curve["time"], curve["outputs"][output], label=when)
        place.set_ylabel(output)
        place.set_title(name, loc="left", fontsize="medium")
        _finish(place, legend=True)
    drawn[-1].set_xlabel("time (s)")
    return drawn


def history(reply: Optimization, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw the best objective so far over the evaluations."""
    drawn = list(axes) if axes is not None else new()
    known = [(point.evaluation, point.objective) for point in reply.history if point.objective is not None]
    drawn[0].step([number for number, _ in known], [value for _, value in known], where="post")
    drawn[0].set_xlabel("evaluations")
    drawn[0].set_ylabel("best objective so far")
    _finish(drawn[0], legend=False)
    return drawn


def _label(number: int, parameters: Mapping[str, Any]) -> str:
    told = ", ".join(
        f"{name} = {value:.4g}" if isinstance(value, int | float) else f"{name} = {value}"
        for name, value in parameters.items()
    )
    return told if 0 < len(told) <= _LONGEST_LABEL else f"variant {number}"


def _named(name: str, unit: str) -> str:
    return f"{name} ({unit})" if unit else name


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _finish(place: Axes, *, legend: bool) -> None:
    place.grid(visible=True, linewidth=0.4)
    if legend:
        place.legend()
