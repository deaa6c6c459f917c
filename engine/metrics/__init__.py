"""The catalogue of metrics, found by discovery: one file, one metric.

Adding a file with a final :class:`Metric` class named after it is all that a new metric needs.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType

from engine.metrics._base import Absent, Finding, Found, Metric

__all__ = ["Absent", "Finding", "Found", "Metric", "catalogue"]


@cache
def catalogue() -> Mapping[str, type[Metric]]:
    """Return every metric by its kind, in alphabetical order.

    Raises
    ------
    TypeError
        When a file does not hold exactly one metric named after it.
    """
    found: dict[str, type[Metric]] = {}
    for module in sorted(info.name for info in pkgutil.iter_modules(__path__) if not info.name.startswith("_")):
        loaded = importlib.import_module(f"{__name__}.{module}")
        own = [
            value
            for value in vars(loaded).values()
            if inspect.isclass(value) and issubclass(value, Metric) and value.__module__ == loaded.__name__
        ]
        if len(own) != 1 or own[0].kind != module:
            msg = f"engine/metrics/{module}.py must hold one metric of kind {module!r}, got {[c.__name__ for c in own]}"
            raise TypeError(msg)
        found[module] = own[0]
    return MappingProxyType(found)
