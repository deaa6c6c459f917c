"""Goals: the metric, its place, its bounds, and what a whole curve is held against, in SI."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from api.convert.values import band_from_wire, opening, optional_si, options_from_wire, si
from api.problems.documents import invalid
from api.problems.pointers import Place
from api.schemas.optimizations import BoundsDocument, GoalDocument, RationalDocument
from engine.diagram.diagram import Diagram
from engine.metrics import catalogue
from engine.model.errors import MaskError
from engine.model.masks import Corners, Envelope, FrequencyBounds, Magnitude, Mask, Polyline, Rational
from engine.model.verdicts import Verdict
from optimizers.problem import Goal, Sense
from optimizers.problem.goals import only_places


def goal_from_wire(document: GoalDocument, diagram: Diagram, place: Place, *, experiments: Sequence[str] = ()) -> Goal:
    """Return a goal in SI; one that names no experiment, input or output takes the only one there is.

    Raises
    ------
    api.problems.documents.Problem
        422 with the place of a quantity in a wrong unit, or of bounds that make no sense.
    """
    only = only_places(document.metric, diagram, experiments)
    document = document.model_copy(
        update={name: value for name, value in only.items() if getattr(document, name) is None}
    )
    metric = catalogue().get(document.metric)
    unit = _bound_unit(metric.unit if metric is not None else "", document, diagram)
    lower, upper, aim, tolerance = (
        optional_si(getattr(document, name), unit, name=f"{key} of {document.metric}", place=(*place, key))
        for name, key in (("lower", "lower"), ("upper", "upper"), ("aim", "target"), ("tolerance", "tolerance"))
    )
    return Goal(
        metric=document.metric,
        experiment=document.experiment,
        output=document.output,
        source=document.source,
        target=document.target,
        open_at=opening(document.open_at),
        band=band_from_wire(document.band, place=(*place, "band")),
        options=options_from_wire(document, diagram.output_units.get(document.output or "") or "", place=place),
        mask=_mask(document, diagram, metric.domain if metric is not None else "", place),
        sense=Sense(document.sense) if document.sense else None,
        lower=lower,
        upper=upper,
        aim=aim,
        tolerance=tolerance,
        hard=document.hard,
        weight=document.weight,
        accept=Verdict(document.accept),
    )


def _bound_unit(unit: str, document: GoalDocument, diagram: Diagram) -> str:
    """Return the unit of a goal's bounds: the metric's own, or that of the output where the metric takes it from there."""
    output = document.output or document.target
    if unit == "output" and output is not None:
        return diagram.output_units.get(output) or ""
    # Products with the output's unit, and gains of a path, are reduced to SI base units.
    return "" if "output" in unit else unit


def _mask(document: GoalDocument, diagram: Diagram, domain: str, place: Place) -> Mask | None:
    """Return what the curve of a goal is held against; None where it is held against nothing."""
    unit = diagram.output_units.get(document.output or "", "")
    if document.reference is not None:
        if document.bounds is not None:
            raise invalid("bounds must be left out beside a reference, got both", *place, "bounds")
        return _polyline(document.reference, unit, (*place, "reference"))
    if document.bounds is None:
        return None
    where = (*place, "bounds")
    return (
        _envelope(document.bounds, unit, where) if domain == "time" else _frequency_bounds(document.bounds, where)
    )  # fmt: skip


def _envelope(bounds: BoundsDocument, unit: str, place: Place) -> Envelope:
    lines: dict[str, Polyline] = {}
    for key in ("upper", "lower"):
        points = getattr(bounds, key)
        if isinstance(points, RationalDocument):
            raise invalid(f"{key} must be points over time, got a rational function", *place, key)
        if points is not None:
            lines[key] = _polyline(points, unit, (*place, key))
    scale = optional_si(bounds.scale, unit, name="scale", place=(*place, "scale"))
    try:
        return Envelope(**lines, scale=scale)
    except MaskError as error:
        raise invalid(error.message, *place, *error.at) from error


def _frequency_bounds(bounds: BoundsDocument, place: Place) -> FrequencyBounds:
    if bounds.scale is not None:
        raise invalid("scale must be left out for bounds over frequency: they count as ratios", *place, "scale")
    lines: dict[str, Magnitude] = {}
    for key in ("upper", "lower"):
        given = getattr(bounds, key)
        if given is not None:
            lines[key] = _magnitude(given, (*place, key))
    try:
        return FrequencyBounds(**lines)
    except MaskError as error:
        raise invalid(error.message, *place, *error.at) from error


def _polyline(points: Sequence[Any], unit: str, place: Place) -> Polyline:
    times, values = _columns(points, ("s", unit), ("time", "value"), place)
    try:
        return Polyline(times=times, values=values)
    except MaskError as error:
        raise invalid(error.message, *place, *error.at) from error


def _magnitude(given: Sequence[Any] | RationalDocument, place: Place) -> Magnitude:
    try:
        if isinstance(given, RationalDocument):
            return Rational(numerator=tuple(given.numerator), denominator=tuple(given.denominator))
        frequencies, magnitudes = _columns(given, ("rad/s", ""), ("frequency", "magnitude"), place)
        return Corners(frequencies=frequencies, magnitudes=magnitudes)
    except MaskError as error:
        raise invalid(error.message, *place, *error.at) from error


def _columns(
    points: Sequence[Any], units: tuple[str, str], names: tuple[str, str], place: Place
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return places and values of points, in SI."""
    first, second = (
        tuple(si(point[k], units[k], name=names[k], place=(*place, i, k)) for i, point in enumerate(points))
        for k in (0, 1)
    )
    return first, second
