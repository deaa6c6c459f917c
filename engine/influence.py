"""Influence coefficients: how strongly each parameter moves each metric, in the limit and for a finite change.

    elasticity  E = (∂M/∂p) (p / M)
    C = R_PCD / R_PCF,   R_PCD = (M_i - M_f) / M_i,   R_PCF = (p_i - p_f) / p_i        (the paper's eq. (4), sign kept)

The elasticity is the limit of C for a vanishing change and has no step size. Read by rows a table of them tells which
metric a parameter moves most; read by columns, which parameter is the strongest lever on a metric.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from engine.errors import EngineError
from engine.study import MetricRequest, measure
from engine.verdicts import Measured, Verdict

if TYPE_CHECKING:
    from engine.diagram import Diagram


@dataclass(frozen=True, slots=True, kw_only=True)
class Elasticity:
    """The limit of the influence coefficient; ``one_sided`` where the metric jumps here."""

    value: float | None
    one_sided: bool
    verdict: Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Coefficient:
    """The influence coefficient of a finite relative change, with the metric before and after."""

    value: float | None
    change: float
    initial: float | None
    final: float | None
    verdict: Verdict


@dataclass(frozen=True, kw_only=True)
class Influence:
    """The whole table: ``elasticities[metric][parameter]``, ``coefficients[metric][parameter]``, and how to read it."""

    base: Mapping[str, Measured]
    elasticities: Mapping[str, Mapping[str, Elasticity]]
    coefficients: Mapping[str, Mapping[str, Coefficient]]
    by_parameter: Mapping[str, str]
    by_metric: Mapping[str, str]


def coefficient(initial: float, final: float, parameter_initial: float, parameter_final: float) -> float:
    """Return C of eq. (4) for one change.

    Parameters
    ----------
    initial, final : float
        The dynamic-behaviour parameter before and after.
    parameter_initial, parameter_final : float
        The constructive-functional parameter before and after.

    Raises
    ------
    ZeroDivisionError
        When an initial value is 0 or the parameter does not change.

    Examples
    --------
    >>> round(coefficient(1.0, 0.72, 1.0, 1.15), 4)
    -1.8667
    """
    return ((initial - final) / initial) / ((parameter_initial - parameter_final) / parameter_initial)


def influence(
    diagram: Diagram,
    requests: Mapping[str, MetricRequest],
    parameters: Sequence[str],
    *,
    change: float = 0.1,
    overrides: Mapping[str, float] | None = None,
) -> Influence:
    """Return elasticities and finite-change coefficients of every metric in every parameter.

    Parameters
    ----------
    diagram : Diagram
    requests : mapping of str to MetricRequest
        Metrics by the name they have in the table.
    parameters : sequence of str
        Parameter paths.
    change : float
        Relative change for the coefficients of eq. (4), not 0.
    overrides : mapping, optional
        Parameter values, SI.
    """
    found = measure(diagram, list(requests.values()), overrides=overrides, gradient=parameters)
    base = {name: measured for name, (measured, _) in zip(requests, found, strict=True)}
    values = {p: float((overrides or {}).get(p, diagram.parameters[p].value)) for p in parameters}
    elasticities: dict[str, dict[str, Elasticity]] = {}
    for name, (measured, gradient) in zip(requests, found, strict=True):
        row: dict[str, Elasticity] = {}
        for k, p in enumerate(parameters):
            if measured.value is None or gradient is None:
                row[p] = Elasticity(value=None, one_sided=False, verdict=measured.verdict)
            elif measured.value == 0:
                row[p] = Elasticity(value=None, one_sided=False, verdict=Verdict.ZERO_BASE)
            elif not np.isfinite(gradient.values[k]):
                row[p] = Elasticity(value=None, one_sided=True, verdict=Verdict.DISCONTINUOUS)
            else:
                verdict = Verdict.DISCONTINUOUS if gradient.one_sided else Verdict.OK
                elasticity = float(gradient.values[k]) * values[p] / measured.value
                row[p] = Elasticity(value=elasticity, one_sided=gradient.one_sided, verdict=verdict)
        elasticities[name] = row
    coefficients: dict[str, dict[str, Coefficient]] = {name: {} for name in requests}
    for p in parameters:
        cells = _changed(diagram, requests, base, p, value=values[p], change=change, overrides=overrides)
        for name, cell in cells.items():
            coefficients[name][p] = cell
    by_parameter, by_metric = _strongest(elasticities, parameters)
    return Influence(
        base=base, elasticities=elasticities, coefficients=coefficients, by_parameter=by_parameter, by_metric=by_metric
    )


def _changed(
    diagram: Diagram,
    requests: Mapping[str, MetricRequest],
    base: Mapping[str, Measured],
    parameter: str,
    *,
    value: float,
    change: float,
    overrides: Mapping[str, float] | None,
) -> dict[str, Coefficient]:
    """Return the coefficients of every metric for one parameter changed by the relative amount ``change``."""

    def absent(name: str, verdict: Verdict, final: float | None = None) -> Coefficient:
        return Coefficient(value=None, change=change, initial=base[name].value, final=final, verdict=verdict)

    if value == 0:
        return {name: absent(name, Verdict.ZERO_BASE) for name in requests}
    stepped = {**(overrides or {}), parameter: value * (1 + change)}
    try:
        after = measure(diagram, list(requests.values()), overrides=stepped)
    except EngineError:
        return {name: absent(name, Verdict.NOT_APPLICABLE) for name in requests}
    cells: dict[str, Coefficient] = {}
    for name, (measured, _) in zip(requests, after, strict=True):
        initial, final = base[name].value, measured.value
        if initial is None or final is None:
            cells[name] = absent(name, base[name].verdict if initial is None else measured.verdict, final)
        elif initial == 0:
            cells[name] = absent(name, Verdict.ZERO_BASE, final)
        else:
            c = coefficient(initial, final, value, value * (1 + change))
            cells[name] = Coefficient(value=c, change=change, initial=initial, final=final, verdict=Verdict.OK)
    return cells


def _strongest(
    elasticities: Mapping[str, Mapping[str, Elasticity]], parameters: Sequence[str]
) -> tuple[dict[str, str], dict[str, str]]:
    """Return the metric that each parameter moves most, and the strongest parameter for each metric."""

    def size(metric: str, parameter: str) -> float:
        value = elasticities[metric][parameter].value
        return -1.0 if value is None else abs(value)

    by_parameter, by_metric = {}, {}
    for p in parameters:
        best = max(elasticities, key=lambda metric: size(metric, p), default=None)
        if best is not None and size(best, p) >= 0:
            by_parameter[p] = best
    for metric in elasticities:
        strongest = max(parameters, key=lambda p: size(metric, p), default=None)
        if strongest is not None and size(metric, strongest) >= 0:
            by_metric[metric] = strongest
    return by_parameter, by_metric
