"""One element by itself: realised at given values, and its transfer functions."""

from __future__ import annotations

from typing import Any

import numpy as np

from engine.elements import Realization, catalogue


def realized(kind: str, **given: Any) -> Realization:
    """Return the element at ``given`` values and its defaults, checked as a document's would be."""
    element = catalogue()[kind]
    values = {param.name: param.default for param in element.parameters} | given
    element.check(frozenset(given), values)
    return element.realize(values)


def ports(kind: str, **given: Any) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of inputs and outputs at ``given`` values and the defaults."""
    element = catalogue()[kind]
    found = element.ports({param.name: param.default for param in element.parameters} | given)
    return found.inputs, found.outputs


def response(r: Realization, s: complex) -> np.ndarray:
    """Return C (s - A)^-1 B + D, with every delay channel in place."""
    h = r.c @ np.linalg.solve(s * np.eye(len(r.a)) - r.a, r.b) + r.d
    if r.d12 is not None and r.d21 is not None:
        h = h + r.d12 @ np.diag(np.exp(-s * r.delays)) @ r.d21
    return np.asarray(h)


def member(r: Realization, number: int) -> Realization:
    """Return one system of a batch without delay channels."""
    arrays = {key: getattr(r, key) for key in ("a", "b", "c", "d")}
    return Realization(**{key: array[number] if array.ndim > 2 else array for key, array in arrays.items()})
