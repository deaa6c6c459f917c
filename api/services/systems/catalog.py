"""The catalogues as lists: every element, signal, metric and method with all that a form or a page needs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any

from engine import elements, metrics, signals
from engine.model.parameters import Param
from optimizers import methods


def _param(param: Param) -> dict[str, Any]:
    body: dict[str, Any] = {
        "name": param.name,
        "symbol": param.symbol,
        "unit": param.unit,
        "default": param.default,
        "required": param.required and param.default is None,
        "lower": param.lower if math.isfinite(param.lower) else None,
        "upper": param.upper if math.isfinite(param.upper) else None,
        "lower_open": param.lower_open,
        "scale": param.scale,
        "shape": param.shape,
        "doc": param.doc,
    }
    if param.choices:
        body["choices"] = list(param.choices)
    return body


def _params(parameters: Iterable[Param]) -> list[dict[str, Any]]:
    return [_param(param) for param in parameters]


def _ports(element: type[elements.Element]) -> elements.Ports:
    """Return the ports of a minimal block of this kind; those of some kinds follow from their parameters."""
    defaults = {param.name: param.default for param in element.parameters}
    return element.ports({**defaults, **element.example})


@cache
def element_list() -> dict[str, Any]:
    """Return every kind of block; ports are those of the example."""
    listed: list[dict[str, Any]] = [
        {
            "kind": kind,
            "title": element.title,
            "inputs": list(_ports(element).inputs),
            "outputs": list(_ports(element).outputs),
            "output_units": dict(zip(_ports(element).outputs, _ports(element).output_units, strict=True)),
            "parameters": _params(element.parameters),
            "equation": element.equation,
            "source": element.source,
            "example": {"kind": kind, **element.example},
        }
        for kind, element in elements.catalogue().items()
    ]
    listed.append(dict(_SUBSYSTEM))
    return {"items": listed, "next_cursor": None}


_SUBSYSTEM: Mapping[str, Any] = {
    "kind": "subsystem",
    "title": "System inside a system",
    "inputs": [],
    "outputs": [],
    "output_units": {},
    "parameters": [],
    "equation": "the system in `system`; its input blocks and outputs are the ports",
    "source": "",
    "example": {"kind": "subsystem", "system": {}},
}


@cache
def signal_list() -> dict[str, Any]:
    """Return every kind of command."""
    listed: list[dict[str, Any]] = [
        {
            "kind": kind,
            "title": signal.title,
            "parameters": _params(signal.parameters),
            "equation": signal.equation,
            "source": signal.source,
            "example": {"kind": kind, **signal.example},
        }
        for kind, signal in signals.catalogue().items()
    ]
    return {"items": listed, "next_cursor": None}


_NEEDS = {"time": ["input", "output"], "path": ["from", "to"], "loop": ["open_at"], "system": []}


@cache
def metric_list() -> dict[str, Any]:
    """Return every metric with its definition."""
    listed = [
        {
            "kind": kind,
            "title": metric.title,
            "unit": metric.unit,
            "domain": metric.domain,
            "needs": _NEEDS[metric.domain],
            "better": metric.better,
            "definition": metric.definition,
            "source": metric.source,
        }
        for kind, metric in metrics.catalogue().items()
    ]
    return {"items": listed, "next_cursor": None}


@cache
def method_list() -> dict[str, Any]:
    """Return every optimisation method with its options."""
    listed = [
        {
            "kind": kind,
            "title": method.title,
            "doc": method.doc,
            "parameters": _params(method.options),
            "source": method.source,
        }
        for kind, method in methods.catalogue().items()
    ]
    return {"items": listed, "next_cursor": None}
