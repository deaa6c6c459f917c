"""Parameter expressions such as ``=kp/20``: parsed by a grammar of their own, never run as code.

::

    sum     = product { ("+" | "-") product }
    product = unary { ("*" | "/") unary }
    unary   = ("+" | "-") unary | power
    power   = atom [ "**" unary ]                      right-associative, binds tighter than a sign on its left
    atom    = number | name | "pi" | function "(" sum { "," sum } ")" | "(" sum ")"

Every operation is analytic, so that an infinitesimal in the imaginary part of a parameter comes out as the exact
derivative (complex step: Squire and Trapp, SIAM Review 40, 1998), and acts entry by entry on a batch of values.
"""

from __future__ import annotations

import cmath
import math
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Any, ClassVar, Final

import numpy as np

from engine.model.errors import ExpressionError
from engine.model.parameters import Scalar
from engine.model.traced import Op, Traced

MAX_LENGTH: Final = 1000
MAX_DEPTH: Final = 50
_REMEMBERED: Final = 1024
_LONGEST_SHOWN: Final = 200

Values = Sequence[Scalar]
Compute = Callable[[Values], Scalar]

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_][A-Za-z0-9_.]*)|(?P<symbol>\*\*|[-+*/(),]))"
)


class _NotAnalyticError(ValueError):
    """A function is asked for a value where it has none, or no derivative; the text says which."""


def _check_positive(value: complex, name: str) -> None:
    if value.real <= 0:
        raise _NotAnalyticError(f"{name} needs a value > 0, got {value.real:g}")


def _sqrt(value: Scalar) -> Scalar:
    if isinstance(value, Traced):
        return value.apply(Op.SQRT)
    if isinstance(value, np.ndarray):
        return np.sqrt(np.where((value.real > 0) | (value == 0), value, np.nan))
    if value == 0:
        return value
    if value.real < 0:
        raise _NotAnalyticError(f"sqrt needs a value >= 0, got {value.real:g}")
    _check_positive(value, "the derivative of sqrt")
    return cmath.sqrt(value) if isinstance(value, complex) else math.sqrt(value)


def _log(value: Scalar) -> Scalar:
    if isinstance(value, Traced):
        return value.apply(Op.LOG)
    if isinstance(value, np.ndarray):
        return np.asarray(np.log(np.where(value.real > 0, value, np.nan)))
    _check_positive(value, "log")
    return cmath.log(value) if isinstance(value, complex) else math.log(value)


def elementary(
    op: Op, numpy: Any, real: Callable[[float], float], analytic: Callable[[complex], complex]
) -> Callable[[Scalar], Scalar]:
    """Return a function of a number, a batch or a traced number from what it is for each."""

    def apply(value: Scalar) -> Scalar:
        if isinstance(value, Traced):
            return value.apply(op)
        if isinstance(value, np.ndarray):
            return np.asarray(numpy(value))
        return analytic(value) if isinstance(value, complex) else real(value)

    return apply


def _divide(dividend: Scalar, divisor: Scalar) -> Scalar:
    # An infinitesimal alone is no divisor: the quotient would be a large number that no limit has.
    if isinstance(divisor, np.ndarray):
        return np.asarray(dividend / np.where(divisor.real == 0, np.nan, divisor))
    if divisor.real == 0:
        raise ZeroDivisionError
    return dividend / divisor


def _power(base: Scalar, exponent: Scalar) -> Scalar:
    if isinstance(base, Traced) or isinstance(exponent, Traced):
        return base**exponent
    if isinstance(base, np.ndarray) or isinstance(exponent, np.ndarray):
        base, exponent = np.asarray(base), np.asarray(exponent)
        whole = (exponent == np.rint(exponent.real)) & ((exponent.real >= 0) | (base.real != 0))
        zero = (base == 0) & (exponent.imag == 0) & (exponent.real > 0)
        return np.asarray(np.where(whole | zero | (base.real > 0), base, np.nan) ** exponent)
    whole = exponent == int(exponent.real)
    if base.real < 0 and not whole:
        raise _NotAnalyticError(f"a negative number ({base.real:g}) has no power {exponent.real:g}")
    if base.real == 0 and not (whole and exponent.real >= 0) and not (base == 0 and exponent.imag == 0):
        raise _NotAnalyticError(f"0 ** {exponent.real:g} has no derivative")
    result: Scalar = base**exponent
    return result


FUNCTIONS: Final[Mapping[str, Callable[[Scalar], Scalar]]] = {
    "sqrt": _sqrt,
    "exp": elementary(Op.EXP, np.exp, math.exp, cmath.exp),
    "log": _log,
    "sin": elementary(Op.SIN, np.sin, math.sin, cmath.sin),
    "cos": elementary(Op.COS, np.cos, math.cos, cmath.cos),
}
RESERVED: Final = frozenset({*FUNCTIONS, "pi"})
"""Names with a meaning of their own, which no parameter may have."""

Operators = Mapping[str, Callable[[Any, Any], Scalar]]

OPERATORS: Final[Operators] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": _divide,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Expression:
    """A parsed expression; ``names`` are the parameters it needs, in the order in which `evaluate` takes their values."""

    text: str
    names: tuple[str, ...]
    compute: Compute

    @property
    def is_name(self) -> bool:
        """Whether the expression is nothing but one parameter."""
        return len(self.names) == 1 and self.text.lstrip("=").strip() == self.names[0]

    def evaluate(self, values: Values) -> Scalar:
        """Return the value of the expression.

        Parameters
        ----------
        values : sequence of float, complex or ndarray (B,)
            One value for each of ``names``. With arrays, entries without a value become NaN and nothing is raised.

        Raises
        ------
        ExpressionError
            If a single value does not exist or is not finite: division by zero, log(0), overflow, ...
        """
        try:
            result = self.compute(values)
        except ZeroDivisionError:
            raise ExpressionError(f"expression '{self.text}' divides by zero") from None
        except OverflowError:
            raise ExpressionError(f"expression '{self.text}' must be finite, but overflows") from None
        except ValueError as error:  # ours, or math's for the sine of infinity
            raise ExpressionError(f"expression '{self.text}' has no value: {error}") from None
        if not isinstance(result, np.ndarray | Traced) and not cmath.isfinite(result):
            raise ExpressionError(f"expression '{self.text}' must be finite, got {result.real:g}")
        return result


def parse(text: str) -> Expression:
    """Parse ``text``, with or without its leading ``=``.

    Raises
    ------
    ExpressionError
        If the text is not an expression; the message says at which character.

    Examples
    --------
    >>> parse("=kp/20 + sqrt(4)").evaluate([10.0])
    2.5
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"expression must be at most {MAX_LENGTH} characters long, got {len(text)}")
    return _parsed(text)


@lru_cache(maxsize=_REMEMBERED)
def _parsed(text: str) -> Expression:
    # a document comes again and again, with another value or another block, and most of its expressions with it
    return Parser(text).expression()


class Parser:
    """Recursive descent; what it returns are nested closures over a list of values.

    ``functions`` says how many arguments each function has.
    """

    functions: Mapping[str, int] = MappingProxyType(dict.fromkeys(FUNCTIONS, 1))
    operators: ClassVar[Operators] = OPERATORS

    def __init__(self, text: str) -> None:
        self._text = text
        self._names: dict[str, int] = {}
        self._depth = 0
        self._position = 1 if text.startswith("=") else 0
        self._advance()

    def expression(self) -> Expression:
        """Return what the text says; see :func:`parse`."""
        compute = self._sum()
        if self._kind != "end":
            raise self._error(f"unexpected '{self._word}'")
        return Expression(text=self._text, names=tuple(self._names), compute=compute)

    def _error(self, what: str) -> ExpressionError:
        long = len(self._text) > _LONGEST_SHOWN
        shown = f"{self._text[:_LONGEST_SHOWN]}..." if long else self._text
        return ExpressionError(f"expression '{shown}' cannot be read: {what} at character {self._start + 1}")

    def _advance(self) -> None:
        match = _TOKEN.match(self._text, self._position)
        if match is not None and match.lastgroup is not None:
            self._kind, self._word = match.lastgroup, match.group(match.lastgroup)
            self._start, self._position = match.start(match.lastgroup), match.end()
            return
        rest = self._text[self._position :]
        self._start = self._position + len(rest) - len(rest.lstrip())
        self._kind, self._word = "end", "end of the expression"
        if rest.strip():
            character = rest.strip()[0]
            hint = " (a power is written **)" if character == "^" else ""
            raise self._error(f"unexpected '{character}'{hint}")

    def _take(self, *symbols: str) -> str | None:
        if self._kind == "symbol" and self._word in symbols:
            token = self._word
            self._advance()
            return token
        return None

    def _sum(self) -> Compute:
        return self._chain(self._product, "+", "-")

    def _product(self) -> Compute:
        return self._chain(self._unary, "*", "/")

    def _chain(self, operand: Callable[[], Compute], *symbols: str) -> Compute:
        # A long chain is evaluated in a loop: nested closures would recurse once for each of its terms.
        first = operand()
        rest: list[tuple[Callable[[Any, Any], Scalar], Compute]] = []
        while (symbol := self._take(*symbols)) is not None:
            rest.append((self.operators[symbol], operand()))
        if not rest:
            return first

        def compute(values: Values) -> Scalar:
            result = first(values)
            for apply, term in rest:
                result = apply(result, term(values))
            return result

        return compute

    def _unary(self) -> Compute:
        # Every way of nesting (sign, power, parentheses) comes through here.
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise self._error(f"nesting must be at most {MAX_DEPTH} deep")
        symbol = self._take("+", "-")
        operand = self._power() if symbol is None else self._unary()
        self._depth -= 1
        return (lambda values: -operand(values)) if symbol == "-" else operand

    def _power(self) -> Compute:
        base = self._atom()
        if self._take("**") is None:
            return base
        exponent = self._unary()
        return lambda values: _power(base(values), exponent(values))

    def _atom(self) -> Compute:
        kind, token = self._kind, self._word
        if kind == "number":
            constant = float(token)
            if not math.isfinite(constant):
                raise self._error(f"{token} is too large")
            self._advance()
            return lambda _: constant
        if kind == "name":
            return self._name(token)
        if self._take("("):
            inner = self._sum()
            if self._take(")") is None:
                raise self._error(f"expected ')', got '{self._word}'")
            return inner
        raise self._error(f"expected a number, a name or '(', got '{token}'")

    def _name(self, name: str) -> Compute:
        if name == "pi":
            self._advance()
            return lambda _: math.pi
        if name in self.functions:
            self._advance()
            return self.call(name, self._arguments(name))
        start = self._start
        self._advance()
        if self._kind == "symbol" and self._word == "(":
            self._start = start
            raise self._error(f"unknown function '{name}' (known: {', '.join(self.functions)})")
        return self.named(name)

    def named(self, name: str) -> Compute:
        """Return the value of a name."""
        index = self._names.setdefault(name, len(self._names))
        return lambda values: values[index]

    def _arguments(self, name: str) -> list[Compute]:
        if self._take("(") is None:
            raise self._error(f"expected '(' after {name}")
        arguments = [self._sum()]
        while self._take(",") is not None:
            arguments.append(self._sum())
        if len(arguments) != self.functions[name]:
            raise self._error(f"{name} takes {self.functions[name]} argument(s), got {len(arguments)}, ended")
        if self._take(")") is None:
            raise self._error(f"expected ')', got '{self._word}'")
        return arguments

    def call(self, name: str, arguments: Sequence[Compute]) -> Compute:
        """Return a function applied to its arguments."""
        function, (argument,) = FUNCTIONS[name], arguments
        return lambda values: function(argument(values))
