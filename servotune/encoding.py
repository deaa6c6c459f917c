"""What a script passes becomes JSON: numpy's numbers and arrays, dataclasses and quantities as well as plain values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

from servotune.errors import DocumentError


def encoded(value: Any, pointer: str = "") -> Any:
    """Return a value as JSON knows it; numpy need not be there for it.

    Whatever has `tolist` (arrays and scalars of numpy, pandas, torch) becomes numbers or lists, a complex number
    `[real, imaginary]`, a quantity with `magnitude` and `units` (pint) `{"value", "unit"}`, a dataclass an object.

    Parameters
    ----------
    value : Any
    pointer : str
        Where the value stands in the request, as a JSON pointer.

    Raises
    ------
    DocumentError
        Naming the place of a number that is not finite, or of what JSON has no word for.
    """
    if value is None or isinstance(value, str | bool):
        return value
    if is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, Mapping):
        return {_key(key, pointer): encoded(entry, f"{pointer}/{key}") for key, entry in value.items()}
    if hasattr(value, "magnitude") and hasattr(value, "units"):
        return {"value": encoded(value.magnitude, pointer), "unit": str(value.units)}
    if hasattr(value, "tolist"):
        return encoded(value.tolist(), pointer)
    if isinstance(value, Sequence) and not isinstance(value, bytes | bytearray | memoryview):
        return [encoded(entry, f"{pointer}/{index}") for index, entry in enumerate(value)]
    return _number(value, pointer)


def _number(value: Any, pointer: str) -> Any:
    if hasattr(value, "__index__"):
        return int(value)
    if isinstance(value, complex):
        return [_number(value.real, pointer), _number(value.imag, pointer)]
    if not hasattr(value, "__float__"):
        rule = "a number, a text, a list, a mapping or None"
        raise DocumentError(f"{pointer or '/'} must be {rule}, got {type(value).__module__}.{type(value).__name__}")
    number = float(value)
    if not math.isfinite(number):
        raise DocumentError(f"{pointer or '/'} must be finite, got {number}")
    return number


def _key(key: Any, pointer: str) -> str:
    if not isinstance(key, str):
        raise DocumentError(f"names in {pointer or '/'} must be texts, got {key!r}")
    return key
