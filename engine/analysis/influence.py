"""Influence coefficients: how strongly each parameter moves each metric, in the limit and for a finite change.

    elasticity  E = (∂M/∂p) (p / M)
    C = R_PCD / R_PCF,   R_PCD = (M_i - M_f) / M_i,   R_PCF = (p_i - p_f) / p_i        (the paper's eq. (4), sign kept)

The elasticity is the limit of C for a vanishing change and has no step size. Read by rows a table of them tells which
metric a parameter moves most; read by columns, which parameter is the strongest lever on a metric.

Where a nonlinear response cannot be differentiated exactly (a limit is only touched, a law is about to become another one,
a number of the command is varied), differences take the place of the limit, and the table says so.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.analysis.differences import Difference, derivatives
from engine.analysis.measuring import MetricRequest, measure
from engine.model.errors import EngineError
from engine.model.verdicts import Measured, Verdict
from engine.signals import Signal, changed

if TYPE_CHECKING:
    from engine.analysis.commanded import CommandParameter
    from engine.diagram.diagram import Diagram


_ROUNDING = 1e-9
"""An elasticity no larger than this is what rounding leaves of none."""


class Method(StrEnum):
    """How a derivative was had: carried through the whole computation, or from differences that converge."""

    EXACT = "exact"
    DIFFERENCES = "differences"


@dataclass(frozen=True, slots=True, kw_only=True)
class Elasticity:
    """The limit of the influence coefficient; ``one_sided`` where the metric jumps here, or the sides differ.

    ``error`` is what a value from differences is estimated to miss.
    """

    value: float | None
    one_sided: bool
    verdict: Verdict
    method: Method = Method.EXACT
    error: float | None = None


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
    commands: Mapping[str, CommandParameter] | None = None,
) -> Influence:
    """Return elasticities and finite-change coefficients of every metric in every parameter.

    Parameters
    ----------
    diagram : Diagram
    requests : mapping of str to MetricRequest
        Metrics by the name they have in the table.
    parameters : sequence of str
        Parameter paths, and names of ``commands``.
    change : float
        Relative change for the coefficients of eq. (4), not 0.
    overrides : mapping, optional
        Parameter values, SI.
    commands : mapping of str to CommandParameter, optional
        Numbers of the requests' commands, by the name they have in the table.
    """
    study = _Study(diagram=diagram, requests=requests, overrides=overrides or {}, commands=commands or {})
    base, slopes = study.derived(parameters)
    elasticities: dict[str, dict[str, Elasticity]] = {name: {} for name in requests}
    coefficients: dict[str, dict[str, Coefficient]] = {name: {} for name in requests}
    for p in parameters:
        for name, elasticity in _elasticities(study, base, slopes, p).items():
            elasticities[name][p] = elasticity
        for name, cell in _coefficients(study, base, p, change).items():
            coefficients[name][p] = cell
    by_parameter, by_metric = _strongest(elasticities, parameters)
    return Influence(
        base=base, elasticities=elasticities, coefficients=coefficients, by_parameter=by_parameter, by_metric=by_metric
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Slope:
    """The exact derivative of one metric by one parameter; NaN where the metric vanishes."""

    value: float
    one_sided: bool


@dataclass(frozen=True, kw_only=True)
class _Study:
    """What is asked for, at any value of any parameter."""

    diagram: Diagram
    requests: Mapping[str, MetricRequest]
    overrides: Mapping[str, float]
    commands: Mapping[str, CommandParameter]

    def value(self, parameter: str) -> float:
        """Return the value of a parameter here."""
        if parameter in self.commands:
            return self.commands[parameter].value
        return float(self.overrides.get(parameter, self.diagram.parameters[parameter].value))

    def derived(self, parameters: Sequence[str]) -> tuple[dict[str, Measured], dict[str, dict[str, _Slope]]]:
        """Return every metric, and its exact derivatives by those parameters for which there are some."""
        nonlinear = self.diagram.nonlinear
        names = [p for p in parameters if p not in self.commands or not nonlinear]
        wanted = list(self.requests.values())
        lanes = [self.commands.get(p, p) for p in names]
        found = measure(self.diagram, wanted, overrides=self.overrides, gradient=lanes)
        if nonlinear and names and any(measured.value is None for measured, _ in found):
            # the derivatives may be what could not be followed
            plain = measure(self.diagram, wanted, overrides=self.overrides)
            found = [one if one[0].value is not None else other for one, other in zip(found, plain, strict=True)]
        base = {name: measured for name, (measured, _) in zip(self.requests, found, strict=True)}
        slopes: dict[str, dict[str, _Slope]] = {name: {} for name in self.requests}
        for name, (_, gradient) in zip(self.requests, found, strict=True):
            if gradient is not None:
                for p, value in zip(names, gradient.values, strict=True):
                    slopes[name][p] = _Slope(value=float(value), one_sided=gradient.one_sided)
        return base, slopes

    def at(self, parameter: str, value: float, names: Iterable[str]) -> list[Measured] | None:
        """Return some of the metrics at another value of one parameter, None where the system refuses it."""
        requests, overrides = [self.requests[name] for name in names], self.overrides
        try:
            if parameter in self.commands:
                requests = _commanded(requests, self.commands[parameter], value)
            else:
                overrides = {**overrides, parameter: value}
            return [measured for measured, _ in measure(self.diagram, requests, overrides=overrides)]
        except EngineError:
            return None

    def differences(self, parameter: str, base: Mapping[str, float]) -> dict[str, Difference]:
        """Return derivatives of some of the metrics by differences."""

        def metrics(value: float) -> npt.NDArray[np.float64]:
            found = self.at(parameter, value, base)
            if found is None:
                return np.full(len(base), np.nan)
            return np.array([np.nan if measured.value is None else measured.value for measured in found])

        value = self.value(parameter)
        found = derivatives(metrics, value, scale=abs(value) or 1.0, base=np.array(list(base.values())))
        return dict(zip(base, found, strict=True))


def _commanded(requests: Sequence[MetricRequest], number: CommandParameter, value: float) -> list[MetricRequest]:
    """Return the requests with another value of one number of a command, every command replaced once."""
    instead = changed(number.signal, number.path, value)

    def signals(request: MetricRequest) -> dict[str, Signal]:
        return {port: instead if own is number.signal else own for port, own in request.signals.items()}

    return [replace(request, signals=signals(request)) for request in requests]


def _elasticities(
    study: _Study, base: Mapping[str, Measured], slopes: Mapping[str, Mapping[str, _Slope]], parameter: str
) -> dict[str, Elasticity]:
    """Return the elasticity of every metric by one parameter: exact where it can be, from differences where not."""
    value = study.value(parameter)
    cells: dict[str, Elasticity] = {}
    inexact: dict[str, float] = {}
    for name, measured in base.items():
        slope = slopes[name].get(parameter)
        if measured.value is None:
            cells[name] = Elasticity(value=None, one_sided=False, verdict=measured.verdict)
        elif measured.value == 0:
            cells[name] = Elasticity(value=None, one_sided=False, verdict=Verdict.ZERO_BASE)
        elif slope is None or (study.diagram.nonlinear and (slope.one_sided or not np.isfinite(slope.value))):
            inexact[name] = measured.value
        elif not np.isfinite(slope.value):
            cells[name] = Elasticity(value=None, one_sided=True, verdict=Verdict.DISCONTINUOUS)
        else:
            verdict = Verdict.DISCONTINUOUS if slope.one_sided else Verdict.OK
            cells[name] = Elasticity(
                value=slope.value * value / measured.value, one_sided=slope.one_sided, verdict=verdict
            )
    if inexact:
        for name, found in study.differences(parameter, inexact).items():
            cells[name] = _from_differences(found, value / inexact[name])
    return {name: _with_doubt(cell, base[name].verdict) for name, cell in cells.items()}


def _with_doubt(cell: Elasticity, verdict: Verdict) -> Elasticity:
    """Return an elasticity with the doubt of the value that it is of: of one that has not settled it has not either."""
    return replace(cell, verdict=verdict) if cell.verdict is Verdict.OK else cell


def _from_differences(found: Difference, factor: float) -> Elasticity:
    return Elasticity(
        value=None if found.value is None else found.value * factor,
        one_sided=found.one_sided,
        verdict=Verdict.DISCONTINUOUS if found.one_sided else Verdict.OK,
        method=Method.DIFFERENCES,
        error=None if found.error is None else found.error * abs(factor),
    )


def _coefficients(study: _Study, base: Mapping[str, Measured], parameter: str, change: float) -> dict[str, Coefficient]:
    """Return the coefficients of every metric for one parameter changed by the relative amount ``change``."""

    def absent(name: str, verdict: Verdict, final: float | None = None) -> Coefficient:
        return Coefficient(value=None, change=change, initial=base[name].value, final=final, verdict=verdict)

    value = study.value(parameter)
    if value == 0:
        return {name: absent(name, Verdict.ZERO_BASE) for name in base}
    after = study.at(parameter, value * (1 + change), base)
    if after is None:
        return {name: absent(name, Verdict.NOT_APPLICABLE) for name in base}
    cells: dict[str, Coefficient] = {}
    for name, measured in zip(base, after, strict=True):
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
    """Return the metric that each parameter moves most, and the strongest parameter for each metric.

    A parameter that moves nothing, and a metric that nothing moves, have none.
    """

    def size(metric: str, parameter: str) -> float:
        value = elasticities[metric][parameter].value
        return 0.0 if value is None else abs(value)

    by_parameter, by_metric = {}, {}
    for p in parameters:
        best = max(elasticities, key=lambda metric: size(metric, p), default=None)
        if best is not None and size(best, p) > _ROUNDING:
            by_parameter[p] = best
    for metric in elasticities:
        strongest = max(parameters, key=lambda p: size(metric, p), default=None)
        if strongest is not None and size(metric, strongest) > _ROUNDING:
            by_metric[metric] = strongest
    return by_parameter, by_metric
