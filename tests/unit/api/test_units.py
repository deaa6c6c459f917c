"""Quantities at the edge: SI, Hz with its 2 pi, and what is refused."""

from __future__ import annotations

import math

import pytest
from pydantic import TypeAdapter, ValidationError

from api.convert.systems import diagram_from_wire
from api.schemas.systems import Parameters, SystemDocument
from api.schemas.values import AutoOrQuantities, AutoOrQuantity, Change, Quantity, Root, Scalar, quantity_of
from api.units.conversion import UnitError, declared, to_si
from engine.elements import catalogue as elements
from engine.signals import catalogue as signals


@pytest.mark.parametrize(
    ("value", "unit", "expected", "si"),
    [
        (65, "cm**2", "m**2", 0.0065),
        (65, "cm²", "m**2", 0.0065),
        (0.3, "daN*s**2/cm", "kg", 300.0),  # 1 daN s2/cm = 1000 kg
        (1.2, "daN*s/cm", "N*s/m", 1200.0),
        (0.4, "cm**5/(daN*s)", "m**3/(s*Pa)", 4e-12),  # 1 cm5/(daN s) = 1e-11 m5/(N s)
        (5, "daN/cm**2", "Pa", 5e5),
        (100, "cm**2/s", "", 0.01),  # a generic gain, to base units
        (1500, "1/min", "rad/s", 25.0),
        (60, "rpm", "rad/s", 2 * math.pi),
        (180, "deg", "rad", math.pi),
        (8.73, "%", "1", 0.0873),
        (180, "°", "rad", math.pi),
        (360, "°/s", "rad/s", 2 * math.pi),
        (20, "dB", "1", 10.0),
        (-40, "dB", "", 0.01),
        (3, "ms", "s", 0.003),
        (25, "µm", "m", 25e-6),
        (1, "bar", "Pa", 1e5),
    ],
)
def test_a_quantity_is_converted_exactly(value, unit, expected, si) -> None:
    assert to_si(value, unit, expected) == si


def test_hertz_of_an_angular_frequency_means_two_pi() -> None:
    # pint itself says 1 Hz = 1 rad/s (hgrecco/pint issue 1288)
    assert to_si(10, "Hz", "rad/s") == 20 * math.pi
    assert to_si(2, "kHz", "rad/s") == 4000 * math.pi
    assert to_si(3, "Hz**2", "rad**2/s**2") == pytest.approx(12 * math.pi**2, rel=1e-15)


def test_a_free_parameter_in_hertz_becomes_angular() -> None:
    assert declared("Hz") == "rad/s"
    assert declared("1/s") == "1/s"
    assert declared("daN*s**2/cm") == "kg"


@pytest.mark.parametrize(
    ("unit", "expected", "says"),
    [
        ("kg", "m**2", "must be in m"),
        ("m", "1", "ratio"),
        ("dB", "rad", "must be in rad"),
        ("dB", "m", "must be in m"),
        ("dB/s", "1/s", "linear"),
        ("degC", "K", "zero"),
        ("degC", "", "zero"),
        ("furlongs_per_fortnight_squared", "m", "joined"),
        ("parrot", "m", "known"),
        ("9**9**9**9**9", "m", "joined"),  # a computation that would never end
        ("m**99", "m", "joined"),
        ("2*m", "m", "joined"),
        ("m*", "m", "joined"),
        ("__import__('os')", "m", "joined"),
        ("m" * 65, "m", "joined"),
        ("Hz", "", "2 pi"),  # a gain in Hz could mean either
    ],
)
def test_a_wrong_unit_is_refused_by_name(unit, expected, says) -> None:
    with pytest.raises(UnitError, match=says):
        to_si(1.0, unit, expected)


def test_a_value_beyond_float64_in_si_is_refused() -> None:
    with pytest.raises(UnitError, match="finite"):
        to_si(1e308, "km", "m")


@pytest.mark.parametrize(
    ("owner", "unit"),
    [
        (f"{kind}.{param.name}", param.unit)
        for catalogue in (elements(), signals())
        for kind, entry in catalogue.items()
        for param in entry.parameters
        if param.unit
    ],
)
def test_every_declared_unit_is_coherent_si(owner, unit) -> None:
    assert to_si(1.0, unit, declared(unit)) == 1.0, owner
    assert "Hz" not in unit, owner


@pytest.mark.parametrize(
    ("text", "value", "unit"),
    [
        ("50 deg", 50.0, "deg"),
        ("50°", 50.0, "°"),
        ("6 dB", 6.0, "dB"),
        ("5 %", 5.0, "%"),
        ("-1.5e-3 m/s", -1.5e-3, "m/s"),
        (" .5 1/s ", 0.5, "1/s"),
        ("2 (N*m)/rad", 2.0, "(N*m)/rad"),
    ],
)
def test_a_text_is_a_number_and_its_unit(text, value, unit) -> None:
    assert quantity_of(text) == {"value": value, "unit": unit}


@pytest.mark.parametrize(
    "text", ["5", "auto", "=kp/20", "0,5 m", "5 5", "deg", "21/s", "1 = 2", "nan m", "", "1 " + "m" * 100]
)
def test_other_texts_are_none(text) -> None:
    assert quantity_of(text) == text


def test_texts_are_taken_wherever_a_quantity_is() -> None:
    wanted = {"value": 50.0, "unit": "deg"}
    for kind in (Quantity, Scalar, Root, Change, AutoOrQuantity):
        assert TypeAdapter(kind).validate_python("50 deg") == wanted
    assert TypeAdapter(AutoOrQuantities).validate_python(["50 deg", 1.0]) == [wanted, 1.0]
    parameters = TypeAdapter(Parameters).validate_python({"a": "50 deg", "b": {"value": "6 dB"}, "c": "=a"})
    assert [parameters[name].value for name in "abc"] == [wanted, {"value": 6.0, "unit": "dB"}, "=a"]


def test_an_infinite_text_is_refused() -> None:
    with pytest.raises(ValidationError, match="must be a number or a quantity"):
        TypeAdapter(Quantity).validate_python("1e999 m")


def test_a_parameter_in_decibels_is_a_ratio() -> None:
    document = {
        "parameters": {"k": {"value": 20, "unit": "dB"}, "l": "-20 dB"},
        "blocks": {"u": {"kind": "input"}, "g": {"kind": "gain", "gain": "=k"}, "h": {"kind": "gain", "gain": "6 dB"}},
        "connections": [{"from": "u", "to": "g"}, {"from": "g", "to": "h"}],
        "outputs": {"y": "h"},
    }
    diagram = diagram_from_wire(SystemDocument.model_validate(document))
    assert [diagram.parameters[name].value for name in ("k", "l", "h.gain")] == pytest.approx([10.0, 0.1, 10**0.3])
