"""Vectors of eight candidates as numbers that compiled kernels calculate with: one processor instruction for all lanes.

`Vector` and `Mask` are types of their own in compiled code, with the usual operators between vectors and with plain numbers.
They live in registers; `load` and `store` move them from and to arrays whose last axis holds the lanes.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import register_model

from engine.batch.kernels.compiled import LANES, align_stack, allocating, compiled, instruction

_DOUBLE: Final = ir.DoubleType()
_VECTOR: Final = ir.VectorType(_DOUBLE, LANES)
_MASK: Final = ir.VectorType(ir.IntType(1), LANES)
_FLAGS: Final = ("nsz", "arcp", "contract", "reassoc")


class _VectorType(types.Type):
    def __init__(self) -> None:
        super().__init__(name="Vector")


class _MaskType(types.Type):
    def __init__(self) -> None:
        super().__init__(name="Mask")


vector: Final = _VectorType()
mask: Final = _MaskType()


@register_model(_VectorType)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


@register_model(_MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _MASK)


def _spread(builder: Any, scalar: Any) -> Any:
    one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), scalar, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(one, ir.Constant(_VECTOR, ir.Undefined), zeros)


def _as_vector(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if kind is vector or kind == vector:
        return value
    return _spread(builder, context.cast(builder, value, kind, types.float64))


def _binary(symbol: Any, result: Any, code: Callable[[Any, Any, Any], Any]) -> None:
    """Teach compiled code an operator between vectors, and between a vector and a number."""

    class Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            if len(args) == 2 and any(isinstance(a, _VectorType) for a in args):
                kinds = [
                    vector if isinstance(a, _VectorType) else types.float64 if isinstance(a, types.Number) else None
                    for a in args
                ]
                return None if None in kinds else signature(result, *kinds)
            return None

    infer_global(symbol)(Template)
    for left, right in ((vector, vector), (vector, types.float64), (types.float64, vector)):

        def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            first, second = (_as_vector(context, builder, k, a) for k, a in zip(sig.args, args, strict=True))
            return code(builder, first, second)

        lower_builtin(symbol, left, right)(lower)


def _comparison(name: str) -> Callable[[Any, Any, Any], Any]:
    return lambda builder, x, y: builder.fcmp_ordered(name, x, y)


_binary(operator.add, vector, lambda b, x, y: b.fadd(x, y, flags=_FLAGS))
_binary(operator.sub, vector, lambda b, x, y: b.fsub(x, y, flags=_FLAGS))
_binary(operator.mul, vector, lambda b, x, y: b.fmul(x, y, flags=_FLAGS))
_binary(operator.truediv, vector, lambda b, x, y: b.fdiv(x, y, flags=_FLAGS))
for _symbol, _name in ((operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">="),
                       (operator.eq, "==")):  # fmt: skip
    _binary(_symbol, mask, _comparison(_name))


def _masks(symbol: Any, code: Callable[[Any, Any, Any], Any]) -> None:
    class Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            both = len(args) == 2 and all(isinstance(a, _MaskType) for a in args)
            return signature(mask, mask, mask) if both else None

    infer_global(symbol)(Template)

    @lower_builtin(symbol, mask, mask)
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return code(builder, *args)


_masks(operator.and_, lambda b, x, y: b.and_(x, y))
_masks(operator.or_, lambda b, x, y: b.or_(x, y))
_masks(operator.xor, lambda b, x, y: b.xor(x, y))


class _Negate(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(vector, vector) if isinstance(args[0], _VectorType) else None


infer_global(operator.neg)(_Negate)


@lower_builtin(operator.neg, vector)
def _lower_negate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.fsub(ir.Constant(_VECTOR, [-0.0] * LANES), args[0], flags=_FLAGS)


def _place(context: Any, builder: Any, kind: Any, array: Any, indices: Any) -> Any:
    """Return the pointer to the vector at the given indices of a C-ordered array whose last axis holds the lanes."""
    align_stack(builder)
    made = context.make_array(kind)(context, builder, array)
    sizes = cgutils.unpack_tuple(builder, made.shape)
    offset = indices[0]
    for index, size in zip(indices[1:], sizes[1:], strict=False):
        offset = builder.add(builder.mul(offset, size), index)
    return builder.gep(builder.bitcast(made.data, _VECTOR.as_pointer()), [offset])


def _loader() -> Any:
    def typed(_context: Any, array: Any, *indices: Any) -> Any:
        def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            numbers = [context.cast(builder, a, k, types.intp) for k, a in zip(sig.args[1:], args[1:], strict=True)]
            return builder.load(_place(context, builder, sig.args[0], args[0], numbers), align=8)

        return vector(array, *indices), code

    return typed


@instruction
def load(_context: Any, array: Any, i: Any) -> Any:
    """Return the vector array[i]."""
    return _loader()(_context, array, i)


@instruction
def load2(_context: Any, array: Any, i: Any, j: Any) -> Any:
    """Return the vector array[i, j]."""
    return _loader()(_context, array, i, j)


def _storer(_context: Any, array: Any, value: Any, *indices: Any) -> Any:
    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        numbers = [context.cast(builder, a, k, types.intp) for k, a in zip(sig.args[2:], args[2:], strict=True)]
        content = _as_vector(context, builder, sig.args[1], args[1])
        builder.store(content, _place(context, builder, sig.args[0], args[0], numbers), align=8)
        return context.get_dummy_value()

    return types.void(array, value, *indices), code


@instruction
def store(_context: Any, array: Any, value: Any, i: Any) -> Any:
    """Put a vector or a number to array[i]."""
    return _storer(_context, array, value, i)


@instruction
def store2(_context: Any, array: Any, value: Any, i: Any, j: Any) -> Any:
    """Put a vector or a number to array[i, j]."""
    return _storer(_context, array, value, i, j)


@instruction
def spread(_context: Any, value: Any) -> Any:
    """Return a vector with the same number in all lanes."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _as_vector(context, builder, sig.args[0], args[0])

    return vector(value), code


@instruction
def select(_context: Any, condition: Any, yes: Any, no: Any) -> Any:
    """Return ``yes`` where the condition holds, ``no`` elsewhere."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        first, second = (_as_vector(context, builder, sig.args[k], args[k]) for k in (1, 2))
        return builder.select(args[0], first, second)

    return vector(condition, yes, no), code


def _called(name: str) -> Any:
    def typed(_context: Any, *values: Any) -> Any:
        def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            numbers = [_as_vector(context, builder, k, a) for k, a in zip(sig.args, args, strict=True)]
            kind = ir.FunctionType(_VECTOR, [_VECTOR] * len(numbers))
            function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}f64")
            return builder.call(function, numbers)

        return vector(*values), code

    return typed


@instruction
def magnitude(_context: Any, value: Any) -> Any:
    """Return the absolute values."""
    return _called("fabs")(_context, value)


@instruction
def root(_context: Any, value: Any) -> Any:
    """Return the square roots."""
    return _called("sqrt")(_context, value)


@instruction
def anywhere(_context: Any, condition: Any) -> Any:
    """Whether the condition holds in any lane."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        bits = builder.bitcast(args[0], ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(ir.IntType(LANES), 0))

    return types.boolean(condition), code


@instruction
def lanes_of(_context: Any, condition: Any) -> Any:
    """Return the condition as an integer, lane k in bit k."""

    def code(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.zext(builder.bitcast(args[0], ir.IntType(LANES)), ir.IntType(64))

    return types.int64(condition), code


@compiled
def copy(to: Any, first_to: int, source: Any, first: int, count: int) -> None:
    """Copy ``count`` vectors, counted through from the start of each array."""
    for k in range(count):
        store(to, load(source, first + k), first_to + k)


@compiled
def clear(to: Any, count: int) -> None:
    """Put zeros in the first ``count`` vectors of an array."""
    for k in range(count):
        store(to, 0.0, k)


@allocating
def room(shape: Any) -> Any:
    """Return an array of any content whose vectors each lie in one line of the cache; the last size is the lanes."""
    count = 1
    for size in shape:
        count *= size
    raw = np.empty(count + LANES - 1)
    skip = (-(raw.ctypes.data >> 3)) & (LANES - 1)
    return raw[skip : skip + count].reshape(shape)


@allocating
def zeros(shape: Any) -> Any:
    """Return such an array full of zeros."""
    made = room(shape)
    made[...] = 0.0
    return made
