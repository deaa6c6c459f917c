"""The catalogue of elements: one file is one element, found by looking into this folder."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType

from engine.elements._base import Element, Ports, Realization

__all__ = ["Element", "Ports", "Realization", "catalogue"]


@cache
def catalogue() -> Mapping[str, type[Element]]:
    """Return every kind of element by name, in alphabetical order."""
    found: dict[str, type[Element]] = {}
    for name in sorted(module.name for module in pkgutil.iter_modules(__path__) if not module.name.startswith("_")):
        module = importlib.import_module(f"{__name__}.{name}")
        for element in vars(module).values():
            if isinstance(element, type) and issubclass(element, Element) and element.__module__ == module.__name__:
                found[element.kind] = element
    return MappingProxyType(found)
