"""Scalings of raw DAQmx values, as the properties of a TDMS channel describe them: a chain, each fed by another.

    linear: y = slope x + intercept,   polynomial: y = c0 + c1 x + c2 x^2 + ...

Scalings by sensor laws (thermocouple, resistance thermometer, thermistor, strain gauge) are those of npTDMS.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Scaling = Callable[[npt.NDArray[Any]], npt.NDArray[np.float64]]

_OWN = {"Linear", "Polynomial", "Add", "Subtract", "AdvancedAPI"}
_BY_LIBRARY = {"RTD", "Strain", "Table", "Thermistor", "Thermocouple"}
_RAW = 0xFFFFFFFF
_TYPE = re.compile(r"NI_Scale\[(\d+)\]_Scale_Type")
_MOST = 100


def scaling_of(*levels: Mapping[str, Any]) -> tuple[Scaling | None, str]:
    """Return the scaling of a channel, and why there is none that can be used.

    Parameters
    ----------
    levels : mapping
        Properties of the channel, of its group and of the file: the first that have scalings count.
    """
    for properties in levels:
        count = _count(properties)
        if not count or properties.get("NI_Scaling_Status") == "scaled":
            continue
        kinds = {str(properties.get(f"NI_Scale[{i}]_Scale_Type", "")) for i in range(count)} - {""}
        if unknown := kinds - _OWN - _BY_LIBRARY:
            return None, f"its scaling is of the kind {min(unknown)!r}, which is not known"
        if kinds & _BY_LIBRARY:
            return _by_library(properties, min(kinds & _BY_LIBRARY))
        try:
            chain = _Chain.of(properties, count)
        except (KeyError, TypeError, ValueError) as error:
            return None, f"its scaling is not complete ({error})"
        return chain, ""
    return None, ""


def _count(properties: Mapping[str, Any]) -> int:
    stated = properties.get("NI_Number_Of_Scales")
    if stated is not None:
        return min(int(stated), _MOST)
    return max((int(found[1]) + 1 for key in properties if (found := _TYPE.fullmatch(key))), default=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Link:
    """One scaling and what feeds it; without a kind it hands on the raw values."""

    kind: str
    sources: tuple[int, ...] = ()
    coefficients: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class _Chain:
    links: tuple[_Link, ...]

    @staticmethod
    def of(properties: Mapping[str, Any], count: int) -> _Chain:
        links = tuple(_link(properties, i) for i in range(count))
        for i, link in enumerate(links):
            if any(source != _RAW and not 0 <= source < i for source in link.sources):
                raise ValueError(f"scaling {i} must be fed by one before it")
        return _Chain(links)

    def __call__(self, raw: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        done: dict[int, npt.NDArray[np.float64]] = {_RAW: raw.astype(np.float64)}
        for i, link in enumerate(self.links):
            inputs = [done[source] for source in link.sources] or [done[_RAW]]
            if link.kind == "Linear":
                done[i] = inputs[0] * link.coefficients[0] + link.coefficients[1]
            elif link.kind == "Polynomial":
                done[i] = np.asarray(
                    np.polynomial.polynomial.polyval(inputs[0], link.coefficients or (0.0,)), dtype=np.float64
                )
            elif link.kind == "Add":
                done[i] = inputs[0] + inputs[1]
            elif link.kind == "Subtract":
                done[i] = inputs[1] - inputs[0]
            else:
                done[i] = inputs[0]
        return done[len(self.links) - 1]


def _link(properties: Mapping[str, Any], i: int) -> _Link:
    prefix = f"NI_Scale[{i}]"
    kind = str(properties.get(f"{prefix}_Scale_Type", ""))
    if kind in {"Add", "Subtract"}:
        sources = tuple(int(properties[f"{prefix}_{kind}_{side}_Operand_Input_Source"]) for side in ("Left", "Right"))
        return _Link(kind=kind, sources=sources)
    if not kind:
        return _Link(kind="")
    source = int(properties.get(f"{prefix}_{kind}_Input_Source", _RAW))
    numbers: tuple[float, ...] = ()
    if kind == "Linear":
        numbers = float(properties[f"{prefix}_Linear_Slope"]), float(properties[f"{prefix}_Linear_Y_Intercept"])
    elif kind == "Polynomial":
        size = min(int(properties.get(f"{prefix}_Polynomial_Coefficients_Size", 4)), _MOST)
        numbers = tuple(float(properties[f"{prefix}_Polynomial_Coefficients[{k}]"]) for k in range(size))
    return _Link(kind=kind, sources=(source,), coefficients=numbers)


@dataclass(frozen=True, slots=True)
class _RawData:
    """Raw values as the library's scalings take them."""

    data: npt.NDArray[Any]
    scaler_data: Mapping[int, npt.NDArray[Any]]


def _by_library(properties: Mapping[str, Any], kind: str) -> tuple[Scaling | None, str]:
    try:
        from nptdms import scaling  # noqa: PLC0415 - an optional extra (LGPL), needed for few files
    except ImportError:
        return None, f"its scaling ({kind}) needs the package npTDMS: install servotune-server[formats]"
    try:
        found = scaling.get_scaling(dict(properties), {}, {})
    except (KeyError, TypeError, ValueError) as error:
        return None, f"its scaling ({kind}) is not complete ({error})"

    def apply(raw: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        scalers = dict.fromkeys(range(_count(properties)), raw)
        return np.asarray(found.scale(_RawData(raw, scalers)), dtype=np.float64)

    return apply, ""
