"""Numbers of reports: written as the pages write them; expectations are those of web/src/shared/units/units.test.ts."""

from __future__ import annotations

import math

import pytest

from api.services.reports.as_pdf import fitted
from api.services.reports.common import written
from api.services.reports.kinds.variables import end_of
from api.services.reports.quantities import measured, metric_value, plain, pretty_unit, quantity


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [
        (0.0021, "s", "2.1 ms"),
        (1000.0, "s", "1000 s"),
        (0.33, "ohm", "330 mΩ"),
        (5e5, "Pa", "500 kPa"),
        (0.0065, "m**2", "0.0065 m²"),
        (0.0, "V", "0 V"),
        (1.2e-13, "m**5/(N*s)", "1.2e−13 m⁵/(N·s)"),
        (2.0, "1", "2"),
    ],
)
def test_a_quantity_takes_the_prefix_that_makes_it_readable(value, unit, shown) -> None:
    assert quantity(value, unit) == shown


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        # What JavaScript's toPrecision(4) and toExponential(3) give, without trailing zeros.
        (-1.25e-7, "−1.25e−7"),
        (math.inf, "∞"),
        (-math.inf, "−∞"),
        (math.nan, "–"),
        (None, "–"),
        (1000.5, "1001"),
        (9999.6, "1e4"),
        (123456.0, "1.235e5"),
        (1234567.0, "1.235e6"),
        (0.0001, "0.0001"),
        (0.00009999, "9.999e−5"),
        (100.0, "100"),
    ],
)
def test_four_digits_without_trailing_zeros(value, shown) -> None:
    assert plain(value) == shown


def test_margins_in_degrees_and_decibel_and_what_is_below_rounding_as_0() -> None:
    assert metric_value("phase_margin", math.pi / 3, "rad") == "60 °"
    assert metric_value("gain_margin", 10, "1") == "20 dB"
    assert metric_value("overshoot", 0.0873, "1") == "8.73 %"
    assert metric_value("overshoot", 1.56e-24, "1") == "0 %"
    assert metric_value("phase_margin", -4e-17, "rad") == "0 °"
    assert metric_value("gain_margin", 1 + 2**-52, "1") == "0 dB"


def test_what_has_no_value_says_why() -> None:
    assert measured("rise_time", {"value": None, "unit": "s", "verdict": "never_crosses"}) == "never crosses"
    late = {"value": 0.25, "unit": "s", "verdict": "not_settled", "doubt": 0.002}
    assert measured("rise_time", late) == "250 ms ± 2 ms (not settled)"
    assert measured("rise_time", None) == "–"


def test_units_and_values_of_requests_are_written_out() -> None:
    assert pretty_unit("m**-1*kg") == "m⁻¹·kg"
    assert written({"kind": "step", "amplitude": {"value": 10, "unit": "mm"}}) == "step, amplitude 10 mm"
    assert written({"u": "channel 3"}) == "u: channel 3"
    assert written([1.0, 2.5]) == "1, 2.5"
    assert written(list(range(100))) == "100 values"
    assert written({"a": {"b": {"c": {"d": 1}}}}) == "a b c 1 entries"
    assert written(True) == "yes"


@pytest.mark.parametrize(
    ("value", "lower", "upper", "end"),
    [
        # As web/src/features/jobs/optimization/ends.ts tells it.
        (20.0, 0.5, 20.0, "upper"),
        (0.5, 0.5, 20.0, "lower"),
        (3.0, 0.5, 20.0, ""),
        (0.0005, 0.0001, 1.0, ""),
        (0.0, 0.0, 5.0, "lower"),
        (7.0, None, math.inf, ""),
    ],
)
def test_a_value_at_an_end_of_its_range_is_told(value, lower, upper, end) -> None:
    assert end_of(value, lower, upper) == end


def test_the_widest_columns_give_way_first() -> None:
    assert fitted([10.0, 100.0, 80.0], 110.0) == [10.0, 50.0, 50.0]
    assert fitted([10.0, 20.0], 110.0) == [10.0, 20.0]
