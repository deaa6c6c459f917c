"""Table 1 of the seed paper: eq. (4) on its printed relative changes gives its printed coefficients.

The paper truncates (0.28/0.15 = 1.8667 is printed 1.86) and prints magnitudes only: one unit of the last printed digit.
"""

from __future__ import annotations

import pytest

from engine.analysis.influence import coefficient

TABLE = [
    # parameter, its relative change, then the relative change of the metric and C as printed
    ("A", "0.15", "t_r", "0.28", "1.86"),
    ("A", "0.15", "a_max", "0.11", "0.73"),
    ("A", "0.15", "v", "0.30", "2.0"),
    ("A", "0.15", "nu_c", "1.0", "6.66"),
    ("V", "0.40", "t_r", "0.50", "1.25"),
    ("V", "0.40", "a_max", "0.11", "0.275"),
    ("V", "0.40", "v", "0.25", "0.625"),
    ("V", "0.40", "nu_c", "0.16", "0.4"),
    ("m", "1.0", "t_r", "0.33", "0.33"),
    ("m", "1.0", "a_max", "0.22", "0.22"),
    ("m", "1.0", "v", "0.25", "0.25"),
    ("m", "1.0", "nu_c", "0.33", "0.33"),
]


@pytest.mark.parametrize(("parameter", "change", "metric", "effect", "printed"), TABLE)
def test_printed_coefficient(parameter: str, change: str, metric: str, effect: str, printed: str) -> None:
    last_digit = 10.0 ** -len(printed.split(".")[1])
    got = coefficient(1.0, 1.0 + float(effect), 1.0, 1.0 + float(change))
    assert abs(got - float(printed)) <= last_digit * (1 + 1e-9), (parameter, metric)


def test_the_sign_is_kept() -> None:
    # The metric falls by a quarter when the parameter doubles
    assert coefficient(4.0, 3.0, 1.0, 2.0) == -0.25


def test_it_does_not_depend_on_units() -> None:
    assert coefficient(4.0, 5.0, 2.0, 3.0) == pytest.approx(coefficient(4e3, 5e3, 2e-6, 3e-6), rel=1e-15)
