"""Conversion of quantities to SI at the edge: the only door to the unit library, which is asked where `common_units` ends.

    value_SI = value * factor(unit, expected),   1 Hz of an angular frequency = 2 pi rad/s,   x dB of a ratio = 10^(x/20)

The unit library takes "Hz" for "rad/s" without the 2 pi (hgrecco/pint issue 1288); this module multiplies by it.
A temperature in degC has no factor and is refused.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any

from api.units import common as common_units
from api.units.common import DIMENSIONS

if TYPE_CHECKING:
    import pint

_SUPERSCRIPTS = str.maketrans({"²": "**2", "³": "**3", "⁴": "**4", "⁵": "**5", "·": "*", "^": "**", "°": "deg"})
# Names with an optional one-digit power, joined by * and /: nothing that could be a computation.
_ATOM = r"(?:1|[^\W\d_][^\W\d_]*|%)(?:\s*\*\*\s*(?:-?\d|\(-?\d\)))?"
_UNIT = re.compile(rf"\s*\(*\s*{_ATOM}\s*\)*(?:\s*[*/]\s*\(*\s*{_ATOM}\s*\)*)*\s*")
_LONGEST = 64
_DECIBEL = "dB"


class UnitError(ValueError):
    """A unit that is unknown, has no factor, or measures something else."""


@cache
def _registry() -> pint.UnitRegistry[Any]:
    # Imported here because building the registry costs a good part of a second, which most processes never need.
    import pint  # noqa: PLC0415 -- see _registry

    # Rational numbers, so that 65 cm**2 is exactly the float64 nearest to 0.0065 m**2.
    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True, non_int_type=Fraction)


def _checked(unit: str) -> str:
    """Return the unit in plain letters, refused where it is more than names with powers."""
    plain = unit.translate(_SUPERSCRIPTS)
    if len(unit) > _LONGEST or plain.count("(") != plain.count(")") or not _UNIT.fullmatch(plain):
        raise UnitError(f"unit must be names joined by * and / with powers like m**2, got {unit[:_LONGEST]!r}")
    return plain


def _parse(unit: str) -> pint.Unit:
    import pint  # noqa: PLC0415 -- see _registry

    plain = _checked(unit)
    try:
        return _registry().parse_units(plain)
    except (pint.errors.PintError, ValueError, AssertionError, TypeError, KeyError) as error:  # KeyError: "V**0", alone
        raise UnitError(f"unit must be known, got {unit!r}") from error


@dataclass(frozen=True, kw_only=True)
class _Reduced:
    """A unit in SI base units: its factor, their name and dimension, and the power of hertz in it."""

    factor: Fraction
    name: str
    dimension: Mapping[str, Any]
    hertz: int


def _reduced(unit: str) -> _Reduced:
    """Return ``unit`` in SI base units; angles stay named."""
    known_ = common_units.reduced(_checked(unit or "1"))
    if known_ is not None:
        dimension = {DIMENSIONS[base]: power for base, power in known_.bases if base in DIMENSIONS}
        return _Reduced(factor=known_.factor, name=_name(known_.bases), dimension=dimension, hertz=known_.hertz)
    return _reduced_by_library(unit)


def _reduced_by_library(unit: str) -> _Reduced:
    registry, parsed = _registry(), _parse(unit or "1")
    try:
        zero, one = (registry.Quantity(Fraction(x), parsed).to_base_units() for x in (0, 1))
        offset = bool(zero.magnitude != 0)
    except (TypeError, AttributeError) as error:  # a logarithm has no rational factor, and none of its own in products
        raise UnitError(f"unit must be linear (dB alone is a ratio), got {unit!r}") from error
    if offset:
        raise UnitError(f"unit must have a zero that is zero (no degC), got {unit!r}")
    items = registry.Quantity(Fraction(1), parsed).unit_items()
    return _Reduced(
        factor=Fraction(one.magnitude),
        name=_name((registry.get_symbol(base), power) for base, power in one.unit_items()),
        dimension=dict(one.dimensionality),
        hertz=sum(int(str(power)) for name, power in items if "hertz" in name),
    )


def _name(items: Iterable[tuple[str, Any]]) -> str:
    """Return "kg*m/s**2" for [("kg", 1), ("m", 1), ("s", -2)]."""
    above: list[str] = []
    below: list[str] = []
    for symbol, power in items:
        side, exponent = (above, power) if power > 0 else (below, -power)
        side.append(symbol + ("" if exponent == 1 else f"**{exponent}"))
    text = "*".join(above) or ("1" if below else "")
    return text + "".join(f"/{part}" for part in below)


@lru_cache(maxsize=4096)
def factor(unit: str, expected: str) -> Fraction:
    """Return what a value in ``unit`` is multiplied by to be in the SI unit ``expected``, exactly.

    Parameters
    ----------
    unit : str
        As the user writes it, e.g. "cm**2", "daN*s**2/cm", "Hz".
    expected : str
        SI unit that is declared; "" for a generic gain, which is reduced to SI base units.

    Raises
    ------
    UnitError
        When ``unit`` is unknown, has no factor, or measures something else.

    Examples
    --------
    >>> factor("cm**2", "m**2")
    Fraction(1, 10000)
    >>> float(factor("Hz", "rad/s")) == 2 * math.pi
    True
    """
    given = _reduced(unit)
    if expected == "":
        if given.hertz:
            raise UnitError(f"unit must be rad/s or 1/s where no unit is declared (Hz leaves out 2 pi), got {unit!r}")
        return given.factor
    wanted = _reduced(expected)
    if given.dimension != wanted.dimension:
        raise UnitError(f"must be in {'a unit of a ratio' if expected == '1' else expected}, got {unit!r}")
    scale = given.factor / wanted.factor
    return scale * Fraction(2 * math.pi) ** given.hertz if _is_angular(expected) else scale


def to_si(value: float, unit: str, expected: str) -> float:
    """Return ``value`` in ``unit`` as a number in the SI unit ``expected`` ("" reduces to base units).

    >>> to_si(65, "cm**2", "m**2"), to_si(20, "dB", "1")
    (0.0065, 10.0)
    """
    try:
        if unit.strip() == _DECIBEL:
            _check_ratio(expected)
            return float(10.0 ** (value / 20.0))
        return float(Fraction(value) * factor(unit, expected))
    except OverflowError as error:
        raise UnitError(f"must be finite in SI units, got {value:g} {unit}") from error


def _check_ratio(expected: str) -> None:
    """Refuse decibels of what is no ratio."""
    if expected and (_reduced(expected).dimension or _is_angular(expected)):
        raise UnitError(f"must be in {expected}, got {_DECIBEL!r}")


@lru_cache(maxsize=4096)
def declared(unit: str) -> str:
    """Return the SI unit that a free parameter given in ``unit`` is kept in; a frequency becomes angular.

    >>> declared("daN*s**2/cm"), declared("kHz")
    ('kg', 'rad/s')
    """
    if unit.strip() == _DECIBEL:
        return ""
    given = _reduced(unit)
    return "rad/s" if given.hertz and given.dimension == _reduced("1/s").dimension else given.name


def known(unit: str) -> None:
    """Raise UnitError for a unit that the library does not know; dB and degC are known."""
    if unit and common_units.reduced(_checked(unit)) is None:
        _parse(unit)


def _is_angular(expected: str) -> bool:
    return "rad" in re.split(r"[^a-z]+", expected)
