"""Numbers and quantities of documents as SI values, and numbers of the core as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from api.problems.documents import invalid
from api.problems.pointers import Place
from api.units.conversion import UnitError, declared, known, to_si
from engine.diagram.connections import Opening
from engine.diagram.diagram import Diagram
from engine.model.errors import EngineError
from engine.model.metric_options import Options
from engine.model.names import no_parameter
from engine.model.verdicts import Measured

_LARGEST = 1e100
"""Curves beyond this are no longer numbers that anything can draw."""


def si(value: Any, unit: str, *, name: str, place: Place) -> float:
    """Return a number or quantity in the SI unit that is declared.

    Raises
    ------
    Problem
        422 naming the parameter, the unit expected and the one got.
    """
    if not isinstance(value, Mapping):
        return _finite(value, name, place)
    try:
        return to_si(value["value"], value["unit"], unit)
    except UnitError as error:
        message = str(error)
        raise invalid(f"{name} {message}" if message.startswith("must") else f"{name}: {message}", *place) from error


def _finite(value: Any, name: str, place: Place) -> float:
    try:
        return float(value)
    except OverflowError as error:
        raise invalid(f"{name} must be below 1.8e308, got a larger number", *place) from error


def optional_si(value: Any, unit: str, *, name: str, place: Place) -> float | None:
    """Return None for None, else what :func:`si` returns."""
    return None if value is None else si(value, unit, name=name, place=place)


def band_from_wire(given: Any, *, place: Place) -> tuple[float, float] | None:
    """Return [low, high] in rad/s, None for None.

    Raises
    ------
    Problem
        422 unless 0 <= low < high.
    """
    if given is None:
        return None
    low, high = (si(value, "rad/s", name="band", place=(*place, i)) for i, value in enumerate(given))
    if not 0.0 <= low < high:
        raise invalid(f"band must be [low, high] with 0 <= low < high rad/s, got [{low:g}, {high:g}]", *place)
    return low, high


def opening(given: str | Sequence[str] | None) -> Opening | None:
    """Return where a loop is opened as the core has it: one place, or several together."""
    if given is None or isinstance(given, str):
        return given
    return given[0] if len(given) == 1 else tuple(given)


def options_from_wire(given: Any, unit: str, *, place: Place) -> Options:
    """Return the numbers that some metrics take, SI; ``unit`` is that of the output, "" reduces to base units.

    Raises
    ------
    Problem
        422 at the number that is out of its range.
    """
    units = {"settling_band": "1", "recovery_band": unit, "noise_density": ""}
    values: dict[str, float] = {}
    for name, expected in units.items():
        value = getattr(given, name, None)
        if name == "noise_density" and isinstance(value, Mapping):  # a density per Hz is one per cycle in a second
            value = {**value, "unit": value["unit"].replace("/Hz", "*s")}
        if value is not None:
            values[name] = si(value, expected, name=name, place=(*place, name))
    derivative = getattr(given, "derivative", None)
    try:
        return Options(**values, derivative=derivative)
    except EngineError as error:
        raise invalid(error.message, *place, *error.at) from error


def nested_si(value: Any, unit: str, *, name: str, place: Place) -> Any:
    """Return a parameter value with every quantity in it converted; expressions, texts and None pass."""
    if isinstance(value, list):
        return [nested_si(item, unit, name=name, place=(*place, i)) for i, item in enumerate(value)]
    if value is None or isinstance(value, str):
        return value
    return si(value, unit, name=name, place=place)


def free_unit(value: Any, unit: str | None, *, name: str, place: Place) -> str:
    """Return the SI unit in which a free parameter is kept: that of its declaration, or of its value."""
    given = unit or (value["unit"] if isinstance(value, Mapping) else "")
    if not given:
        return ""
    try:
        return declared(given)
    except UnitError as error:
        raise invalid(f"{name}: {error}", *place) from error


def check_unit(unit: str, *, name: str, place: Place) -> None:
    """Refuse a unit that the unit library does not know."""
    try:
        known(unit)
    except UnitError as error:
        raise invalid(f"{name}: {error}", *place) from error


def overrides_from_wire(given: Mapping[str, Any], diagram: Diagram, *, place: Place) -> dict[str, float]:
    """Return parameter path -> SI value, every path checked against the diagram.

    Raises
    ------
    Problem
        422 for a path that does not exist, is given by an expression, is out of its bounds, or a wrong unit.
    """
    values: dict[str, float] = {}
    for path, value in given.items():
        info = diagram.parameters.get(path)
        if info is None:
            raise invalid(no_parameter(path, diagram.parameters), *place, path)
        if info.bound:
            raise invalid(
                f"{path} must be a number to be replaced, but an expression gives it (replace what it is made of)",
                *place,
                path,
            )
        values[path] = si(value, info.unit, name=path, place=(*place, path))
    return values


def changes_from_wire(given: Mapping[str, Any], diagram: Diagram, *, place: Place) -> dict[str, float]:
    """Return parameter path -> new SI value; a relative change is taken from the value of the document.

    Raises
    ------
    Problem
        422 as for overrides, and for a relative change of a parameter that is 0.
    """
    absolute: dict[str, Any] = {}
    for path, value in given.items():
        info = diagram.parameters.get(path)
        if info is None or not isinstance(value, Mapping) or "change" not in value:
            absolute[path] = value
        elif info.value == 0:
            raise invalid(f"{path} must not be 0 to be changed relatively, got 0: give the new value", *place, path)
        else:
            absolute[path] = info.value * (1 + value["change"])
    return overrides_from_wire(absolute, diagram, place=place)


def numbers(array: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return a real array in which what is not finite or beyond 1e100 is NaN: :func:`listed` makes that null.

    >>> numbers([1.0, float("inf"), 1e101]).tolist()
    [1.0, nan, nan]
    """
    values = np.array(array, dtype=np.float64)
    values[~(np.abs(values) <= _LARGEST)] = np.nan
    return values


def listed(array: npt.NDArray[Any]) -> list[Any]:
    """Return an array as nested lists of JSON numbers, null for NaN and infinity.

    >>> listed(np.array([[1.0, np.nan]]))
    [[1.0, None]]
    """
    if np.isfinite(array).all():
        plain: list[Any] = array.tolist()
    else:
        plain = [listed(row) if row.ndim else None if not np.isfinite(row) else row.item() for row in array]
    return plain


def number(value: float | None) -> float | None:
    """Return a finite number, or None."""
    return float(value) if value is not None and np.isfinite(value) else None


def measured_to_wire(measured: Measured) -> dict[str, Any]:
    """Return a metric as {"value", "unit", "verdict"[, "advice"][, "reference"][, "doubt", "settled_from"]}."""
    body: dict[str, Any] = {
        "value": number(measured.value),
        "unit": measured.unit,
        "verdict": str(measured.verdict),
    }
    if measured.advice:
        body["advice"] = measured.advice
    if measured.reference:
        body["reference"] = measured.reference
    if measured.settled_from:
        body |= {"doubt": number(measured.doubt), "settled_from": measured.settled_from}
    return body
