"""The table of common units says what the unit library says."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import numpy as np
import pytest

from api.units import common as common_units
from api.units.common import ATOMS
from api.units.conversion import UnitError, _reduced, _reduced_by_library, known, to_si
from engine.elements import catalogue as elements
from engine.signals import catalogue as signals


def _products(count: int) -> Iterator[str]:
    """Return random units of two to five names with powers, some with parentheses."""
    random = np.random.default_rng(20)
    names, powers = list(ATOMS), ["", "", "**2", "**-1", "**(-3)"]
    for _ in range(count):
        parts = [str(random.choice(names)) + str(random.choice(powers)) for _ in range(random.integers(2, 6))]
        signs = random.choice(["*", "/", " * "], len(parts) - 1)
        opened = int(random.integers(1, len(parts)))
        text = parts[0]
        for place, (sign, part) in enumerate(zip(signs, parts[1:], strict=True), start=1):
            text += f"{sign}({part}" if place == opened else f"{sign}{part}"
        yield text + ")"


@pytest.mark.parametrize("unit", [*ATOMS, *_products(150)])
def test_a_unit_is_what_the_library_says(unit: str) -> None:
    assert common_units.reduced(unit) is not None
    assert _reduced(unit) == _reduced_by_library(unit)


def test_units_of_the_catalogues_are_in_the_table() -> None:
    declared = {p.unit for c in (elements(), signals()) for entry in c.values() for p in entry.parameters}
    assert {unit for unit in declared if unit and common_units.reduced(unit) is None} == set()


def test_other_units_are_the_library_s() -> None:
    assert common_units.reduced("inch") is None
    assert to_si(2, "inch/s", "m/s") == 0.0508  # the inch is 25.4 mm by definition
    assert common_units.reduced("m*/s") is None
    assert common_units.reduced("m)/(s") is None


def test_the_power_0_is_a_ratio_or_refused() -> None:
    # the library's own parser loses its way with it
    assert _reduced("V**0").factor == Fraction(1)
    with pytest.raises(UnitError, match="known"):
        known("inch**0")
