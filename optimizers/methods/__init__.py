"""The catalogue of optimisation methods: every public module in this package holds one."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np

from optimizers.methods._base import Method
from optimizers.problem import Problem, ProblemError
from optimizers.search.limits import Limited
from optimizers.search.result import Monitor, Result, Unwatched

__all__ = ["Method", "catalogue", "minimize"]


@cache
def catalogue() -> Mapping[str, type[Method]]:
    """Return every method by its kind, found by looking into this package's modules."""
    found: dict[str, type[Method]] = {}
    for info in sorted(pkgutil.iter_modules(__path__), key=lambda module: module.name):
        if info.name.startswith("_"):
            continue
        module = importlib.import_module(f"{__name__}.{info.name}")
        for _, member in inspect.getmembers(module, inspect.isclass):
            if issubclass(member, Method) and member.__module__ == module.__name__ and not inspect.isabstract(member):
                found[member.kind] = member
    return MappingProxyType(found)


def minimize(
    kind: str, problem: Problem, options: Mapping[str, Any] | None = None, *, monitor: Monitor | None = None
) -> Result:
    """Solve a problem by the method of this kind.

    Parameters
    ----------
    kind : str
        A key of :func:`catalogue`.
    problem : Problem
    options : mapping, optional
        The method's options; what is absent gets its default. ``seed`` makes the run repeatable.
    monitor : Monitor, optional

    Raises
    ------
    ProblemError
        An unknown method or option.
    """
    methods = catalogue()
    if kind not in methods:
        raise ProblemError(f"kind must be one of {', '.join(methods)}, got {kind!r}", at=("method", "kind"))
    resolved = methods[kind].resolve(options or {})
    rng = np.random.default_rng(resolved.get("seed", 0))
    watch = Limited(monitor or Unwatched(), resolved["max_seconds"] or None)
    return watch.told(methods[kind]().minimize(problem, resolved, rng=rng, monitor=watch))
