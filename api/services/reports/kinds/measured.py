"""The reports of spectra and of measured frequency response functions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import Any

import numpy as np

from api.services.reports.common import pairs, request_rows, sentences, written
from api.services.reports.drawing import Line, Panel, numbers, panels
from api.services.reports.kinds.studied import variant_names
from api.services.reports.language import say, words
from api.services.reports.model import Part, Section, Sentence, table
from api.services.reports.origins import Asked
from api.services.reports.quantities import NOTHING, plain, pretty_unit, quantity
from api.services.reports.responses import MOST_LINES, MOST_PANELS, named

_OMEGA = "ω [rad/s]"
_QUANTITIES = {"amplitude": "Amplitude", "density": "Spectral density", "transform": "Fourier transform"}


def spectrum(asked: Asked) -> Iterator[Section]:
    """Yield what is said of a spectrum, of a recording or of a simulated output."""
    result, request = asked.result, asked.request
    variants = result["variants"]
    names = variant_names(variants)
    what = say(_QUANTITIES[result["quantity"]])
    of = str(request.get("channel") or request.get("output") or "")
    yield Section(say("Spectrum"), list(_lines_of(what, of, result["unit"], names, variants)))
    parts = [
        part
        for name, one in zip(names, variants, strict=True)
        for part in _harmonics(name, one, several=len(names) > 1)
    ]
    if parts:
        yield Section(say("Harmonics"), parts)
    bands = [(name, one["band"]) for name, one in zip(names, variants, strict=True) if one.get("band")]
    if bands:
        rows = ((name, f"{plain(one['value'], 5)} {pretty_unit(one['unit'])}".rstrip()) for name, one in bands)
        measure = say("Energy") if result["quantity"] == "transform" else say("Mean square")
        yield Section(say("In the band"), [table((say("Variant"), measure), rows, numeric=[1], total=len(bands))])
    first = variants[0]
    facts = [(say("Averages"), written(first.get("averages")))] if first.get("averages") is not None else []
    if first.get("resolution") is not None:
        facts.append((say("Distance of lines"), quantity(first["resolution"], "rad/s")))
    yield _asked(asked, facts)


def _lines_of(
    what: str, of: str, unit: str, names: Sequence[str], variants: Sequence[Mapping[str, Any]]
) -> Iterator[Part]:
    """Yield the figure, and why a variant has no curve."""
    drawn = []
    for name, one in islice(zip(names, variants, strict=True), MOST_LINES):
        line = _line(name, one.get("frequency"), one.get("value"))
        drawn += [] if line is None else [line]
    if drawn:
        panel = Panel(words(of), _OMEGA, named(what.lower(), unit), drawn, logarithmic=True)
        yield panels([panel], say("{what} over frequency.", what=what), height=2.8)
    else:
        yield Sentence(say("There is nothing to draw."))
    yield from sentences((str(one.get("advice") or "") for one in variants), "warning")
    if len(variants) > MOST_LINES:
        yield Sentence(
            say(
                "The first {most} of {count} variants; the result holds all of them.",
                most=MOST_LINES,
                count=len(variants),
            )
        )


def _line(name: str, frequency: Any, value: Any) -> Line | None:
    """Return a curve over the frequencies above 0, which is where a logarithmic axis has a place for it."""
    x, y = numbers(frequency), numbers(value)
    keep = x > 0
    return Line(name, x[keep], y[keep]) if x.size == y.size and np.isfinite(y[keep]).any() else None


def _harmonics(name: str, one: Mapping[str, Any], *, several: bool) -> Iterator[Part]:
    found = one.get("harmonics")
    if not found:
        return
    if several:
        yield Sentence(f"{name}:")
    unit = found["unit"]
    thd = NOTHING if found["thd"] is None else f"{plain(100 * found['thd'])} %"
    about = (
        (say("Fundamental"), quantity(found["fundamental"], "rad/s")),
        (say("Mean"), quantity(found["mean"], unit)),
        (say("Total harmonic distortion"), thd),
    )
    yield pairs(about)
    amplitudes, phases = numbers(found["amplitude"]), numbers(found["phase"])
    rows = (
        (str(i + 1), quantity(float(size), unit), f"{plain(float(np.degrees(angle)))} °")
        for i, (size, angle) in enumerate(zip(amplitudes, phases, strict=True))
    )
    yield table((say("Order"), say("Amplitude"), say("Phase")), rows, numeric=[0, 1, 2], total=amplitudes.size)


def frf(asked: Asked) -> Iterator[Section]:
    """Yield what is said of measured frequency response functions."""
    result = asked.result
    outputs: Mapping[str, Mapping[str, Any]] = result["outputs"]
    doubts = [f"{output}: {doubt['detail']}" for output, one in outputs.items() for doubt in one["doubts"]]
    yield Section(
        say("Doubts"),
        sentences(doubts, "warning") or [Sentence(say("No systematic error was found in the measurement."), "good")],
    )
    yield Section(say("Frequency responses"), list(_responses(result, outputs)))
    compared = {output: one["simulated"] for output, one in outputs.items() if one.get("simulated")}
    if compared:
        yield Section(say("Model and measurement"), [_model(compared)])
    if result.get("modes"):
        yield Section(say("Modes"), list(_modes(result["modes"])))
    facts = [
        (say("Averages"), written(result["averages"])),
        (say("Effective averages"), plain(result["effective_averages"])),
        (say("Distance of lines"), quantity(result["resolution"], "rad/s")),
        (say("Confidence of the bands"), f"{plain(100 * result['confidence'])} %"),
    ]
    yield _asked(asked, facts)


def _responses(result: Mapping[str, Any], outputs: Mapping[str, Mapping[str, Any]]) -> Iterator[Part]:
    """Yield magnitude, phase and coherence of each output, with the bounds that hold the truth and the model beside it."""
    level = say("{confidence} % bounds", confidence=plain(100 * result["confidence"]))
    for output, one in islice(outputs.items(), MOST_PANELS):
        simulated = one.get("simulated") or {}
        curves = [
            (say("measured"), one["magnitude"], one["phase"]),
            (level, _around(one["magnitude_lower"], one["magnitude_upper"]), _around(one["phase_lower"], one["phase_upper"])),
            (say("model"), simulated.get("magnitude"), simulated.get("phase")),
        ]  # fmt: skip
        gains, phases = [], []
        for name, magnitude, phase in curves:
            x = numbers(result["frequency"])
            doubled = np.concatenate([x, [np.nan], x]) if name == level else x
            gain = _line(name, doubled, 20 * np.log10(np.where(numbers(magnitude) > 0, numbers(magnitude), np.nan)))
            angle = _line(name, doubled, np.degrees(numbers(phase)))
            gains += [] if gain is None else [gain]
            phases += [] if angle is None else [angle]
        unit = pretty_unit(one["unit"]) or "1"
        drawn = [
            Panel(words(output), _OMEGA, f"|G| [dB, {unit}]", gains, logarithmic=True),
            Panel(say("Phase"), _OMEGA, say("phase [°]"), phases, logarithmic=True),
        ]
        coherence = _line(say("measured"), result["frequency"], one.get("coherence"))
        drawn += (
            []
            if coherence is None
            else [Panel(say("Coherence"), _OMEGA, say("coherence"), [coherence], logarithmic=True)]
        )
        yield panels(
            [panel for panel in drawn if panel.lines],
            say("{output} over {input}.", output=words(output), input=words(result["input"])),
        )
    if len(outputs) > MOST_PANELS:
        yield Sentence(
            say("{count} more outputs are not drawn; the result holds their curves.", count=len(outputs) - MOST_PANELS)
        )


def _around(lower: Any, upper: Any) -> Any:
    """Return both bounds as one curve with a gap between them; nothing where there are none."""
    return None if lower is None or upper is None else np.concatenate([numbers(lower), [np.nan], numbers(upper)])


def _model(compared: Mapping[str, Mapping[str, Any]]) -> Part:
    rows = (
        (
            output,
            f"{plain(one['median_deviation_db'])} dB",
            f"{plain(one['worst_deviation_db'])} dB",
            quantity(one["worst_frequency"], "rad/s"),
            f"{plain(one['relative_error_percent'])} %",
            f"{plain(one['within_percent'])} %",
        )
        for output, one in compared.items()
    )
    columns = (
        say("Output"),
        say("Median deviation"),
        say("Worst deviation"),
        say("At"),
        say("Relative error"),
        say("Lines within the bounds"),
    )
    return table(columns, rows, numeric=range(1, 6), total=len(compared))


def _modes(found: Mapping[str, Any]) -> Iterator[Part]:
    modes = found["modes"]
    if not modes:
        yield Sentence(say("No mode was found."))
        return
    rows = (
        (
            plain(mode["frequency"], 5),
            plain(None if mode["frequency"] is None else mode["frequency"] / (2 * np.pi), 5),
            _between(mode["frequency_lower"], mode["frequency_upper"]),
            plain(mode["damping_ratio"]),
            _between(mode["damping_ratio_lower"], mode["damping_ratio_upper"]),
            str(mode["doubt"]),
        )
        for mode in modes
    )
    columns = (
        say("Natural frequency [rad/s]"),
        "[Hz]",
        say("Interval [rad/s]"),
        say("Damping ratio"),
        say("Interval"),
        say("Doubt"),
    )
    yield table(columns, rows, numeric=range(5), total=len(modes))
    yield Sentence(
        say(
            "The modes give the responses on their lines with a relative error of {error} %.",
            error=plain(found["relative_error_percent"]),
        )
    )


def _between(lower: float | None, upper: float | None) -> str:
    return NOTHING if lower is None or upper is None else f"{plain(lower)} … {plain(upper)}"


def _asked(asked: Asked, facts: Sequence[tuple[str, str]]) -> Section:
    left = {"system", "variants", "keep"}
    return Section(say("How it was asked"), [pairs([*request_rows(asked.request, left), *facts])])
