"""Numbers with their units as the pages show them (web/src/shared/units/format.ts): both must read alike."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from decimal import ROUND_HALF_UP, Context
from typing import Any

from api.services.reports.language import word

_PREFIXED = frozenset({"s", "m", "V", "A", "N", "Pa", "ohm", "F", "H", "W", "J", "N*m", "m/s", "rad/s", "m/s**2"})
"""Units that take a prefix when they stand alone."""
_STEPS = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
_SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_PERCENT = frozenset({"overshoot", "undershoot"})
_ROUNDING = 1e-9
"""Per cent, degrees and decibel are numbers of sizes about 1: what lies below this is rounding."""
NOTHING = "–"


def pretty_unit(unit: str) -> str:
    """Return a unit as it is printed.

    >>> pretty_unit("m**5/(N*s)")
    'm⁵/(N·s)'
    """
    if unit in {"", "1"}:
        return ""
    raised = re.sub(r"\*\*(-?\d+)", lambda found: found[1].translate(_SUPERSCRIPTS), unit)
    return raised.replace("*", "·").replace("ohm", "Ω")


def plain(value: float | None, digits: int = 4) -> str:
    """Return so many significant digits without trailing zeros, with an exponent only where there must be one.

    >>> plain(-1.25e-7), plain(12.5), plain(0.0), plain(None)
    ('−1.25e−7', '12.5', '0', '–')
    """
    if value is None or math.isnan(value):
        return NOTHING
    if value == 0:
        return "0"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    rounded = Context(prec=digits, rounding=ROUND_HALF_UP).create_decimal_from_float(value)
    exponent = rounded.adjusted()
    size = abs(value)
    if size >= 1e6 or size < 1e-4 or exponent >= digits:
        mantissa = f"{rounded.scaleb(-exponent):f}"
        text = f"{_short(mantissa)}e{exponent}"
    else:
        text = _short(f"{rounded:f}")
    return text.replace("-", "−")


def _short(text: str) -> str:
    return text.rstrip("0").rstrip(".") if "." in text else text


def quantity(value: float | None, unit: str, digits: int = 4) -> str:
    """Return a value in SI with its unit, by the prefix that makes it readable.

    >>> quantity(0.0021, "s"), quantity(1500.0, "m"), quantity(2.0, "1")
    ('2.1 ms', '1500 m', '2')
    """
    if value is None or math.isnan(value):
        return NOTHING
    if unit in _PREFIXED and value != 0 and math.isfinite(value):
        size = abs(value)
        factor, prefix = next((step for step in _STEPS if size >= step[0] * 0.9999995), _STEPS[-1])
        if not (unit == "m" and prefix == "k") and not (unit == "s" and factor > 1):
            return f"{plain(value / factor, digits)} {prefix}{pretty_unit(unit)}"
    return f"{plain(value, digits)} {pretty_unit(unit)}".rstrip()


def metric_value(kind: str, value: float, unit: str) -> str:
    """Return a metric in the unit in which its field speaks of it: per cent, degrees, decibel.

    >>> metric_value("overshoot", 0.0873, "1"), metric_value("phase_margin", 1.0471975511965976, "rad")
    ('8.73 %', '60 °')
    """
    if kind in _PERCENT:
        return f"{_beyond_rounding(100 * value)} %"
    if kind == "phase_margin":
        return f"{_beyond_rounding(math.degrees(value))} °"
    if kind.startswith("gain_margin") and unit == "1" and value > 0:
        return f"{_beyond_rounding(20 * math.log10(value))} dB"
    return quantity(value, unit)


def _beyond_rounding(value: float) -> str:
    return plain(0.0 if abs(value) < _ROUNDING else value)


def measured(kind: str, found: Mapping[str, Any] | None) -> str:
    """Return a metric of a result: its value, or the verdict that stands for it."""
    if found is None:
        return NOTHING
    verdict = str(found.get("verdict", ""))
    if found.get("value") is None:
        return word(verdict) or NOTHING
    text = metric_value(kind, found["value"], found.get("unit", ""))
    if verdict in {"", "ok"}:
        return text
    doubt = found.get("doubt")
    around = "" if doubt is None else f" ± {metric_value(kind, doubt, found.get('unit', ''))}"
    return f"{text}{around} ({word(verdict)})"
