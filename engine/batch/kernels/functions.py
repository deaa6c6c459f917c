"""Elementary functions of vectors of candidates, as machine instructions without branches.

    e^x = 2^k e^r,  k = round(x/ln 2), |r| <= ln 2 / 2;   tanh x = m/(m + 2),  m = e^(2x) - 1 = 2^k (e^r - 1) + (2^k - 1)

e^r - 1 is its Taylor polynomial of degree 13, which is exact to rounding. The same instructions are used by compiled kernels
and by code that is generated for a diagram, so that both give the same results.
"""

from __future__ import annotations

import math
from typing import Any, Final

from llvmlite import ir

from engine.batch.kernels.compiled import LANES, instruction
from engine.batch.kernels.vector import vector

DOUBLES: Final = ir.VectorType(ir.DoubleType(), LANES)
_WHOLE: Final = ir.VectorType(ir.IntType(64), LANES)
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_ROUNDING: Final = 1.5 * 2.0**52
"""Added to a small number, it leaves the nearest whole number in the lowest bits."""
_LARGEST: Final = 709.0
_SATURATED: Final = 44.0
"""Beyond this e^x - 1 is e^x, and tanh is 1, to rounding."""
_DEGREE: Final = 13


def spread(number: float) -> Any:
    """Return a vector constant."""
    return ir.Constant(DOUBLES, [number] * LANES)


def called(builder: Any, name: str, *operands: Any) -> Any:
    """Return an instruction of the compiler that has a name, such as ``sqrt``."""
    kind = ir.FunctionType(DOUBLES, [DOUBLES] * len(operands))
    whole = f"llvm.{name}.v{LANES}f64"
    function = builder.module.globals.get(whole) or ir.Function(builder.module, kind, name=whole)
    return builder.call(function, operands)


def product_and_sum(builder: Any, a: Any, b: Any, c: Any) -> Any:
    """Return a b + c, rounded once where the processor can: always the same way, whatever code is around it."""
    return called(builder, "fmuladd", a, b, c)


def positive(builder: Any, x: Any) -> Any:
    """Return which lanes are above 0."""
    return builder.fcmp_ordered(">", x, spread(0.0))


def larger(builder: Any, x: Any, y: Any) -> Any:
    """Return the larger of two numbers."""
    return builder.select(builder.fcmp_ordered(">", x, y), x, y)


def smaller(builder: Any, x: Any, y: Any) -> Any:
    """Return the smaller of two numbers."""
    return builder.select(builder.fcmp_ordered("<", x, y), x, y)


def exponential(builder: Any, x: Any) -> Any:
    """Return e^x; beyond e^±709 it stays what it is there."""
    power, rest = _reduced(builder, _limited(builder, x, _LARGEST))
    return product_and_sum(builder, power, rest, power)


def hyperbolic_tangent(builder: Any, x: Any) -> Any:
    """Return tanh x, exact to rounding for small x, too."""
    power, rest = _reduced(builder, _limited(builder, builder.fadd(x, x), _SATURATED))
    less = product_and_sum(builder, power, rest, builder.fsub(power, spread(1.0)))
    return builder.fdiv(less, builder.fadd(less, spread(2.0)))


def _limited(builder: Any, x: Any, limit: float) -> Any:
    """Return x between ± limit; what is no number stays none."""
    x = builder.select(builder.fcmp_ordered(">", x, spread(limit)), spread(limit), x)
    return builder.select(builder.fcmp_ordered("<", x, spread(-limit)), spread(-limit), x)


def _reduced(builder: Any, x: Any) -> tuple[Any, Any]:
    """Return 2^k and e^r - 1."""
    shifted = product_and_sum(builder, x, spread(1 / math.log(2)), spread(_ROUNDING))
    k = builder.fsub(shifted, spread(_ROUNDING))
    r = product_and_sum(builder, k, spread(-_LN2_HIGH), x)
    r = product_and_sum(builder, k, spread(-_LN2_LOW), r)
    series = spread(1 / math.factorial(_DEGREE))
    for order in range(_DEGREE - 1, 0, -1):
        series = product_and_sum(builder, series, r, spread(1 / math.factorial(order)))
    exponent = builder.add(builder.bitcast(shifted, _WHOLE), ir.Constant(_WHOLE, [1023] * LANES))
    power = builder.bitcast(builder.shl(exponent, ir.Constant(_WHOLE, [52] * LANES)), DOUBLES)
    return power, builder.fmul(series, r)


def _of_one(emit: Any) -> Any:
    def typed(_context: Any, value: Any) -> Any:
        return vector(value), lambda _, builder, __, args: emit(builder, *args)

    return typed


def _of_two(emit: Any) -> Any:
    def typed(_context: Any, x: Any, y: Any) -> Any:
        return vector(x, y), lambda _, builder, __, args: emit(builder, *args)

    return typed


@instruction
def multiply_add(_context: Any, a: Any, b: Any, c: Any) -> Any:
    """Return a b + c of vectors."""
    return vector(a, b, c), lambda _, builder, __, args: product_and_sum(builder, *args)


@instruction
def exp(context: Any, value: Any) -> Any:
    """Return e^x."""
    return _of_one(exponential)(context, value)


@instruction
def tanh(context: Any, value: Any) -> Any:
    """Return tanh x."""
    return _of_one(hyperbolic_tangent)(context, value)


@instruction
def log(context: Any, value: Any) -> Any:
    """Return ln x."""
    return _of_one(lambda builder, x: called(builder, "log", x))(context, value)


@instruction
def sin(context: Any, value: Any) -> Any:
    """Return sin x."""
    return _of_one(lambda builder, x: called(builder, "sin", x))(context, value)


@instruction
def cos(context: Any, value: Any) -> Any:
    """Return cos x."""
    return _of_one(lambda builder, x: called(builder, "cos", x))(context, value)


@instruction
def maximum(context: Any, x: Any, y: Any) -> Any:
    """Return the larger of two numbers."""
    return _of_two(larger)(context, x, y)


@instruction
def minimum(context: Any, x: Any, y: Any) -> Any:
    """Return the smaller of two numbers."""
    return _of_two(smaller)(context, x, y)
