"""The reports of spectra and of measured frequency response functions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import Any

import numpy as np

from api.services.reports.common import pairs, sentences, written
from api.services.reports.drawing import Line, Panel, numbers, panels
from api.services.reports.kinds.studied import variant_names
from api.services.reports.model import Part, Section, Sentence, table
from api.services.reports.origins import Asked
from api.services.reports.quantities import NOTHING, plain, pretty_unit, quantity, words
from api.services.reports.responses import MOST_LINES, MOST_PANELS, named

_OMEGA = "ω [rad/s]"
_QUANTITIES = {"amplitude": "Amplitude", "density": "Spectral density", "transform": "Fourier transform"}


def spectrum(asked: Asked) -> Iterator[Section]:
    """Yield what is said of a spectrum, of a recording or of a simulated output."""
    result, request = asked.result, asked.request
    variants = result["variants"]
    names = variant_names(variants)
    what = _QUANTITIES[result["quantity"]]
    of = str(request.get("channel") or request.get("output") or "")
    yield Section("Spectrum", list(_lines_of(what, of, result["unit"], names, variants)))
    parts = [
        part
        for name, one in zip(names, variants, strict=True)
        for part in _harmonics(name, one, several=len(names) > 1)
    ]
    if parts:
        yield Section("Harmonics", parts)
    bands = [(name, one["band"]) for name, one in zip(names, variants, strict=True) if one.get("band")]
    if bands:
        rows = ((name, f"{plain(one['value'], 5)} {pretty_unit(one['unit'])}".rstrip()) for name, one in bands)
        measure = "Energy" if result["quantity"] == "transform" else "Mean square"
        yield Section("In the band", [table(("Variant", measure), rows, numeric=[1], total=len(bands))])
    first = variants[0]
    facts = [("Averages", written(first.get("averages")))] if first.get("averages") is not None else []
    if first.get("resolution") is not None:
        facts.append(("Distance of lines", quantity(first["resolution"], "rad/s")))
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
        yield panels([panel], f"{what} over frequency.", height=2.8)
    else:
        yield Sentence("There is nothing to draw.")
    yield from sentences((str(one.get("advice") or "") for one in variants), "warning")
    if len(variants) > MOST_LINES:
        yield Sentence(f"The first {MOST_LINES} of {len(variants)} variants; the result holds all of them.")


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
        ("Fundamental", quantity(found["fundamental"], "rad/s")),
        ("Mean", quantity(found["mean"], unit)),
        ("Total harmonic distortion", thd),
    )
    yield pairs(about)
    amplitudes, phases = numbers(found["amplitude"]), numbers(found["phase"])
    rows = (
        (str(i + 1), quantity(float(size), unit), f"{plain(float(np.degrees(angle)))} °")
        for i, (size, angle) in enumerate(zip(amplitudes, phases, strict=True))
    )
    yield table(("Order", "Amplitude", "Phase"), rows, numeric=[0, 1, 2], total=amplitudes.size)


def frf(asked: Asked) -> Iterator[Section]:
    """Yield what is said of measured frequency response functions."""
    result = asked.result
    outputs: Mapping[str, Mapping[str, Any]] = result["outputs"]
    doubts = [f"{output}: {doubt['detail']}" for output, one in outputs.items() for doubt in one["doubts"]]
    yield Section(
        "Doubts",
        sentences(doubts, "warning") or [Sentence("No systematic error was found in the measurement.", "good")],
    )
    yield Section("Frequency responses", list(_responses(result, outputs)))
    compared = {output: one["simulated"] for output, one in outputs.items() if one.get("simulated")}
    if compared:
        yield Section("Model and measurement", [_model(compared)])
    if result.get("modes"):
        yield Section("Modes", list(_modes(result["modes"])))
    facts = [
        ("Averages", written(result["averages"])),
        ("Effective averages", plain(result["effective_averages"])),
        ("Distance of lines", quantity(result["resolution"], "rad/s")),
        ("Confidence of the bands", f"{plain(100 * result['confidence'])} %"),
    ]
    yield _asked(asked, facts)


def _responses(result: Mapping[str, Any], outputs: Mapping[str, Mapping[str, Any]]) -> Iterator[Part]:
    """Yield magnitude, phase and coherence of each output, with the bounds that hold the truth and the model beside it."""
    level = f"{plain(100 * result['confidence'])} % bounds"
    for output, one in islice(outputs.items(), MOST_PANELS):
        simulated = one.get("simulated") or {}
        curves = [
            ("measured", one["magnitude"], one["phase"]),
            (level, _around(one["magnitude_lower"], one["magnitude_upper"]), _around(one["phase_lower"], one["phase_upper"])),
            ("model", simulated.get("magnitude"), simulated.get("phase")),
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
            Panel("Phase", _OMEGA, "phase [°]", phases, logarithmic=True),
        ]
        coherence = _line("measured", result["frequency"], one.get("coherence"))
        drawn += [] if coherence is None else [Panel("Coherence", _OMEGA, "coherence", [coherence], logarithmic=True)]
        yield panels([panel for panel in drawn if panel.lines], f"{words(output)} over {words(result['input'])}.")
    if len(outputs) > MOST_PANELS:
        yield Sentence(f"{len(outputs) - MOST_PANELS} more outputs are not drawn; the result holds their curves.")


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
    columns = ("Output", "Median deviation", "Worst deviation", "At", "Relative error", "Lines within the bounds")
    return table(columns, rows, numeric=range(1, 6), total=len(compared))


def _modes(found: Mapping[str, Any]) -> Iterator[Part]:
    modes = found["modes"]
    if not modes:
        yield Sentence("No mode was found.")
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
    columns = ("Natural frequency [rad/s]", "[Hz]", "Interval [rad/s]", "Damping ratio", "Interval", "Doubt")
    yield table(columns, rows, numeric=range(5), total=len(modes))
    yield Sentence(f"The modes give the responses on their lines with a relative error of {plain(found['relative_error_percent'])} %.")  # fmt: skip


def _between(lower: float | None, upper: float | None) -> str:
    return NOTHING if lower is None or upper is None else f"{plain(lower)} … {plain(upper)}"


def _asked(asked: Asked, facts: Sequence[tuple[str, str]]) -> Section:
    left = {"system", "variants", "keep"}
    told = [(words(name).capitalize(), written(value)) for name, value in asked.request.items() if name not in left]
    return Section("How it was asked", [pairs([*told, *facts])])
