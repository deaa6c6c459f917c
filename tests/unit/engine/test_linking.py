"""Compiled code calls the copies that it carries, whatever else the process has compiled or loaded."""

from __future__ import annotations

from llvmlite.binding import Linkage
from numba import njit

from engine.batch.kernels.compiled import apart


@njit  # kept by nobody: what is loaded has no functions to look at
def inner(x: float) -> float:
    apart()  # it stays a function
    return x * 3.0 + 1.0


@njit
def outer(x: float) -> float:
    return inner(x) - inner(-x)


@njit
def outermost(x: float) -> float:
    return outer(x) + inner(x)


def test_copies_are_hidden_from_the_linker() -> None:
    assert outermost(2.0) == 19.0
    assert outer(2.0) == 12.0
    for function in (outer, outermost):
        ((_, found),) = function.overloads.items()
        defined = {one.name: one for one in found.library._final_module.functions if not one.is_declaration}
        copies = [one for name, one in defined.items() if "inner" in name]
        assert copies
        assert all(one.linkage == Linkage.internal for one in copies)
