"""Units that drives and robots are described in, without the unit library, which takes a third of a second to load.

    unit = Π atom**power,   atom = factor * Π base**power

The factors and the order of the bases are the library's own: a test holds every atom and random products against it. What is
not in the table is left to the library.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

DIMENSIONS: Final[Mapping[str, str]] = {
    "kg": "[mass]", "m": "[length]", "s": "[time]", "A": "[current]", "K": "[temperature]",
}  # fmt: skip
"""What each base measures; an angle is a base that stays named but measures a ratio."""

_PI = Fraction("3.1415926535897932384626433832795028841971693993751")
_PREFIXES: Final = {
    "": Fraction(1), "n": Fraction(1, 10**9), "µ": Fraction(1, 10**6), "u": Fraction(1, 10**6), "m": Fraction(1, 1000),
    "c": Fraction(1, 100), "da": Fraction(10), "h": Fraction(100), "k": Fraction(1000), "M": Fraction(10**6), "G": Fraction(10**9),
}  # fmt: skip
_FORCE: Final = (("kg", 1), ("m", 1), ("s", -2))
_PRESSURE: Final = (("kg", 1), ("m", -1), ("s", -2))
_ENERGY: Final = (("kg", 1), ("m", 2), ("s", -2))
_SINGLE: Final[tuple[tuple[str, tuple[str, ...], Fraction, tuple[tuple[str, int], ...]], ...]] = (
    ("1", ("",), Fraction(1), ()),
    ("%", ("",), Fraction(1, 100), ()),
    ("m", ("n", "µ", "u", "m", "c", "", "k"), Fraction(1), (("m", 1),)),
    ("g", ("m", "", "k"), Fraction(1, 1000), (("kg", 1),)),
    ("t", ("",), Fraction(1000), (("kg", 1),)),
    ("s", ("n", "µ", "u", "m", ""), Fraction(1), (("s", 1),)),
    ("min", ("",), Fraction(60), (("s", 1),)),
    ("h", ("",), Fraction(3600), (("s", 1),)),
    ("A", ("m", ""), Fraction(1), (("A", 1),)),
    ("K", ("",), Fraction(1), (("K", 1),)),
    ("rad", ("m", ""), Fraction(1), (("rad", 1),)),
    ("deg", ("",), _PI / 180, (("rad", 1),)),
    ("rpm", ("",), _PI / 30, (("rad", 1), ("s", -1))),
    ("Hz", ("m", "", "k", "M"), Fraction(1), (("s", -1),)),
    ("N", ("m", "", "da", "k", "M"), Fraction(1), _FORCE),
    ("Pa", ("", "h", "k", "M", "G"), Fraction(1), _PRESSURE),
    ("bar", ("m", ""), Fraction(10**5), _PRESSURE),
    ("J", ("m", "", "k"), Fraction(1), _ENERGY),
    ("W", ("m", "", "k"), Fraction(1), (("kg", 1), ("m", 2), ("s", -3))),
    ("V", ("m", "", "k"), Fraction(1), (("kg", 1), ("m", 2), ("s", -3), ("A", -1))),
    ("ohm", ("m", "", "k"), Fraction(1), (("kg", 1), ("m", 2), ("s", -3), ("A", -2))),
    ("H", ("µ", "u", "m", ""), Fraction(1), (("kg", 1), ("m", 2), ("s", -2), ("A", -2))),
    ("F", ("n", "µ", "u", "m", ""), Fraction(1), (("A", 2), ("s", 4), ("kg", -1), ("m", -2))),
    ("l", ("m", ""), Fraction(1, 1000), (("m", 3),)),
)  # fmt: skip
ATOMS: Final = {
    prefix + name: (_PREFIXES[prefix] * factor, bases)
    for name, prefixes, factor, bases in _SINGLE
    for prefix in prefixes
}
"""Factor and bases of every unit of the table."""

_TOKEN: Final = re.compile(r"\*\*|[*/()]|-?\d|[^\W\d_]+|%")


@dataclass(frozen=True, kw_only=True)
class Reduced:
    """A unit in terms of its bases."""

    factor: Fraction
    bases: tuple[tuple[str, int], ...]
    hertz: int
    """Power of hertz in it: a frequency that is meant to be angular has its 2π to come."""


def reduced(unit: str) -> Reduced | None:
    """Return a unit in terms of its bases, None where a name is not in the table.

    Parameters
    ----------
    unit : str
        Names joined by * and /, with powers of one digit and parentheses, such as "cm**5/(daN*s)".
    """
    tokens = _TOKEN.findall(unit)
    try:
        powers = _product(tokens)
    except (KeyError, IndexError, ValueError):
        return None
    if tokens:
        return None
    factor, hertz, bases = Fraction(1), 0, dict[str, int]()
    for atom, power in powers.items():
        scale, own = ATOMS[atom]
        factor *= scale**power
        hertz += power if atom.endswith("Hz") else 0
        for base, each in own:
            bases[base] = bases.get(base, 0) + each * power
    return Reduced(factor=factor, bases=tuple((base, power) for base, power in bases.items() if power), hertz=hertz)


def _product(tokens: list[str]) -> dict[str, int]:
    """Take a product from the front of the tokens; return the power of every name."""
    total = _factor(tokens)
    while tokens and tokens[0] in ("*", "/"):
        sign = 1 if tokens.pop(0) == "*" else -1
        for atom, power in _factor(tokens).items():
            total[atom] = total.get(atom, 0) + sign * power
            if total[atom] == 0:
                del total[atom]
    return total


def _factor(tokens: list[str]) -> dict[str, int]:
    """Take a name with its power, or a product in parentheses."""
    first = tokens.pop(0)
    if first == "(":
        inner = _product(tokens)
        _closed(tokens)
        return inner
    if first not in ATOMS:
        raise KeyError(first)
    if not tokens or tokens[0] != "**":
        return {first: 1}
    tokens.pop(0)
    inside = tokens[0] == "("
    if inside:
        tokens.pop(0)
    power = int(tokens.pop(0))
    if inside:
        _closed(tokens)
    return {first: power} if power else {}


def _closed(tokens: list[str]) -> None:
    if tokens.pop(0) != ")":
        raise ValueError
