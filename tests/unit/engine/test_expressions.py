"""Expressions: what the grammar reads, what it refuses, and derivatives that come with the values."""

from __future__ import annotations

import math

import numpy as np
import pytest

from engine.model.errors import ExpressionError
from engine.model.expressions import parse

STEP = 1e-30


def value(text: str, **names: complex) -> complex:
    expression = parse(text)
    return expression.evaluate([names[name] for name in expression.names])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("=2+3*4", 14.0),
        ("=(2+3)*4", 20.0),
        ("=-2**2", -4.0),  # as in mathematics and Python: the power binds tighter than the sign
        ("=2**-1", 0.5),
        ("=2**3**2", 512.0),  # right-associative
        ("=7-2-3", 2.0),  # left-associative
        ("=16/4/2", 2.0),
        ("=+-+1", -1.0),
        ("=1.5e-3 + .5 + 2.", 2.5015),
        ("= sqrt( 16 ) ", 4.0),
        ("=sin(pi/6)", 0.5),
        ("=cos(0)", 1.0),
        ("=log(exp(2))", 2.0),
        ("=(-2)**3", -8.0),
        ("=0**0", 1.0),
        ("2", 2.0),  # the leading = may be absent
    ],
)
def test_reads(text, expected):
    assert value(text) == pytest.approx(expected, rel=1e-15)


def test_names_are_listed_once_in_order():
    assert parse("=b*a + b/c_2").names == ("b", "a", "c_2")


def test_a_bare_name_is_recognised():
    assert parse("= kp ").is_name
    assert not parse("=kp*1").is_name
    assert not parse("=-kp").is_name


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("=", "expected a number, a name or '\\(', got 'end of the expression' at character 2"),
        ("=2+", "got 'end of the expression' at character 4"),
        ("=2 3", "unexpected '3' at character 4"),
        ("=(1+2", "expected '\\)'"),
        ("=1)", "unexpected '\\)' at character 3"),
        ("=a^2", "unexpected '\\^' \\(a power is written \\*\\*\\) at character 3"),
        ("=a $ b", "unexpected '\\$' at character 4"),
        ("=sqrt 2", "expected '\\(' after sqrt"),
        ("=tan(1)", "unknown function 'tan'"),
        ("=a.__class__(1)", "unknown function 'a.__class__'"),
        ("=[1,2]", "unexpected '\\['"),
        ("=a==b", "unexpected '='"),
        ("=1 if a else 2", "unexpected 'if'"),
        ("='text'", "unexpected"),
        ("=1e999", "1e999 is too large"),
        ("=" + "(" * 60 + "1" + ")" * 60, "at most 50 deep"),
        ("=" + "-" * 60 + "1", "at most 50 deep"),
        ("=" + "2**" * 60 + "1", "at most 50 deep"),
        ("=" + "1+" * 600 + "1", "at most 1000 characters long, got 1202"),
    ],
)
def test_refuses_to_read(text, message):
    with pytest.raises(ExpressionError, match=message):
        parse(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("=1/(a-1)", "divides by zero"),
        ("=0**-1", "divides by zero"),
        ("=log(a-1)", "log needs a value > 0, got 0"),
        ("=log(-a)", "log needs a value > 0, got -1"),
        ("=sqrt(-a)", "sqrt needs a value >= 0, got -1"),
        ("=(-2)**0.5", "a negative number \\(-2\\) has no power 0.5"),
        ("=exp(1000*a)", "overflows"),
        ("=9**9**9", "overflows"),
        ("=1e308*10*a", "must be finite, got inf"),
        ("=1e308*10 - 1e308*10", "must be finite, got nan"),
        ("=sin(1e308*10)", "no value"),
        ("=2**(1e308*10-1e308*10)", "no value"),
    ],
)
@pytest.mark.parametrize("one", [1.0, 1.0 + 0j])
def test_has_no_value(text, message, one):
    expression = parse(text)
    with pytest.raises(ExpressionError, match=f"{message}|overflows|must be finite|no value"):
        expression.evaluate([one] * len(expression.names))
    if isinstance(one, float):
        with pytest.raises(ExpressionError, match=message):
            expression.evaluate([one] * len(expression.names))


@pytest.mark.parametrize("text", ["=sqrt(a-2)", "=(a-2)**0.5", "=log(a-2)", "=1/(a-2)"])
def test_refuses_a_derivative_that_does_not_exist(text):
    with pytest.raises(ExpressionError):
        value(text, a=2.0 * (1 + STEP * 1j))


# d/da of each text at a = 2, in closed form
DERIVATIVES = {
    "=a**3": 12.0,
    "=a**-2": -0.25,
    "=a**0.5": 0.5 / math.sqrt(2),
    "=2**a": 4 * math.log(2),
    "=a**a": 4 * (math.log(2) + 1),
    "=(-a)**3": -12.0,
    "=(a-2)**2": 0.0,
    "=sqrt(a)": 0.5 / math.sqrt(2),
    "=exp(a)": math.exp(2),
    "=log(a)": 0.5,
    "=sin(a)*cos(a)": math.cos(4),
    "=1/(1+a)": -1 / 9,
    "=-a + 3*a/7 - pi": -4 / 7,
    "=a**200/1e60": 200 * 2**199 / 1e60,
}


@pytest.mark.parametrize("text", DERIVATIVES)
def test_an_infinitesimal_comes_out_as_the_derivative(text):
    stepped = value(text, a=2.0 + STEP * 1j)
    assert stepped.real == pytest.approx(value(text, a=2.0), rel=1e-13)
    assert stepped.imag / STEP == pytest.approx(DERIVATIVES[text], rel=1e-13)


@pytest.mark.parametrize("text", DERIVATIVES)
def test_a_batch_gives_the_single_values(text):
    a = np.array([0.5, 2.0, 3.0])
    for step in (0.0, STEP * 1j):
        batch = np.broadcast_to(value(text, a=a + step), a.shape)
        single = [value(text, a=x + step) for x in a.tolist()]
        np.testing.assert_allclose(batch.real, np.real(single), rtol=1e-13)
        np.testing.assert_allclose(batch.imag, np.imag(single), rtol=1e-13)


@pytest.mark.parametrize("text", ["=sqrt(a)", "=log(a)", "=a**0.5", "=1/a"])
def test_a_member_without_a_value_spoils_only_itself(text):
    with np.errstate(all="ignore"):
        result = value(text, a=np.array([-1.0 if text != "=1/a" else 0.0, 4.0]))
    assert not np.isfinite(result[0])
    assert result[1] == pytest.approx(value(text, a=4.0), rel=1e-15)


@pytest.mark.parametrize("base", [-2.0, 0.0, STEP * 1j, 2.0])
@pytest.mark.parametrize("exponent", [-1.0, -0.5, 0.0, 0.5, 2.0, 2.0 + STEP * 1j])
def test_powers_exist_for_a_batch_where_they_exist_alone(base, exponent):
    try:
        single = value("=a**b", a=base, b=exponent)
    except ExpressionError:
        single = None
    with np.errstate(all="ignore"):
        batch = value("=a**b", a=np.array([base, 1.0]), b=np.array([exponent, 1.0]))[0]
    assert np.isfinite(batch) == (single is not None)
    assert single is None or batch == pytest.approx(single, rel=1e-14)


def test_a_real_expression_stays_real():
    assert isinstance(value("=sqrt(a)**2 + exp(a)", a=2.0), float)
