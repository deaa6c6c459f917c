"""Functions of frequency that files hold: listed with their recording, read from the file, taken as measured responses."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from api.convert.recordings import in_si
from api.convert.values import numbers
from api.formats import SpectralFunction, catalogue
from api.problems.documents import Problem, invalid
from api.problems.pointers import Place
from api.services.frequency.measured_parts import Part
from api.services.operation.app_context import Caller, Installation
from api.services.recordings.importing import options, stated
from api.services.recordings.spooling import refusing, spooled
from api.units.conversion import UnitError, known
from engine.recordings.spectra.frf import Doubt, Frf
from storage.errors import NotFoundError
from storage.repositories import DatasetRepository
from storage.session import Database

_LARGEST = 256 << 20
"""Bytes of a file that a request reads."""
_MOST = 1000
_RESPONSES = ("frequency response", "transmissibility")
_SHOWN = 20
_SAME = 1e-6


def described(functions: Sequence[SpectralFunction]) -> list[dict[str, Any]]:
    """Return what is known of functions without their lines, of the first thousand."""
    return [_head(function) for function in functions[:_MOST]]


def _head(function: SpectralFunction) -> dict[str, Any]:
    return {
        "name": function.name,
        "kind": function.kind,
        "response": function.response,
        "reference": function.reference,
        "response_unit": function.response_unit,
        "reference_unit": function.reference_unit,
        "lines": function.count,
    }


def function(service: Installation, caller: Caller, identifier: str, name: str) -> dict[str, Any]:
    """Return a function of a recording's file, in the units of the file; lines in rad/s."""
    with _open(service.database, caller.workspace, identifier) as functions:
        for one in functions:
            if one.name == name:
                frequency, values = one.read()
                return {
                    **_head(one),
                    "frequency": numbers(2 * np.pi * frequency),
                    "real": numbers(values.real),
                    "imag": numbers(values.imag),
                }
    raise NotFoundError("function", name)


def measured_part(database: Database, workspace: str, identifier: str, places: Mapping[Place, str]) -> Part:
    """Return responses of a file as measured, in SI, with their coherences where the file has them; they have no rate.

    Parameters
    ----------
    places : mapping
        Place in the request -> point: of the reference, then of each response.

    Raises
    ------
    Problem
        422 with the place for a response that the file does not hold, or whose lines are not those of the first.
    """
    source, *names = places.values()
    found: dict[str, Frf] = {}
    units: dict[str, str] = {}
    with _open(database, workspace, identifier) as functions:
        for place, name in list(places.items())[1:]:
            one = _picked(functions, source, name, place)
            frf, units[name], unit = _frf(one, functions, place)
            if units.setdefault(source, unit) != unit:
                raise invalid(f"reference {source!r} must be in one unit, got {units[source]} and {unit}", *place)
            first = next(iter(found.values()), frf)
            if first.frequency.shape != frf.frequency.shape or not np.allclose(
                first.frequency, frf.frequency, rtol=_SAME, atol=0.0
            ):
                raise invalid(f"output must have the lines of {names[0]!r}, got others for {name!r}", *place)
            found[name] = frf
    return Part(rate=math.inf, channels={}, units=units, frfs=found)


def _picked(functions: Sequence[SpectralFunction], source: str, name: str, place: Place) -> SpectralFunction:
    responses = [one for one in functions if one.kind in _RESPONSES]
    fitting = [one for one in responses if (one.response, one.reference) == (name, source)]
    if not fitting:
        there = ", ".join(f"{one.response!r} / {one.reference!r}" for one in responses[:_SHOWN]) or "none"
        raise invalid(
            f"output / input must be a response that the file holds ({there}), got {name!r} / {source!r}", *place
        )
    if len(fitting) > 1:
        raise invalid(f"{name!r} / {source!r} must be once in the file, got {len(fitting)} of them", *place)
    return fitting[0]


def _frf(one: SpectralFunction, functions: Sequence[SpectralFunction], place: Place) -> tuple[Frf, str, str]:
    """Return a response in SI, and the SI units of both points."""
    frequency, values = one.read()
    if frequency.size < 2 or not (np.diff(frequency) > 0).all() or frequency[0] < 0:
        raise invalid(f"{one.name!r} must have at least 2 lines with rising frequencies", *place)
    above, unit, doubts = _scale(one.response_unit, place)
    below, reference, more = _scale(one.reference_unit, place)
    steps = np.diff(frequency)
    even = float(np.ptp(steps)) <= _SAME * float(steps.mean())
    frf = Frf(
        frequency=2 * np.pi * frequency,
        value=values * (above / below),
        coherence=_coherence(one, functions),
        resolution=2 * np.pi * float(steps.mean()) if even else None,
        doubts=(*doubts, *more),
    )
    return frf, unit, reference


def _scale(text: str, place: Place) -> tuple[float, str, tuple[Doubt, ...]]:
    """Return the factor from a unit of the file to SI, that unit, and a doubt where nobody knows it."""
    for unit in (text, text.lower()):
        try:
            known(unit)
        except UnitError:
            continue
        scale, si = in_si(np.ones(1), {"name": text, "unit": unit}, place=place)
        return float(scale[0]), si, ()
    return (
        1.0,
        "",
        (Doubt(kind="unit", detail=f"the unit {text!r} of the file is not known: its numbers are left as they are"),),
    )


def _coherence(one: SpectralFunction, functions: Sequence[SpectralFunction]) -> Any:
    """Return the coherence between the points of a response on its lines, None where the file has none."""
    for other in functions:
        pair = {other.response, other.reference} == {one.response, one.reference}
        if other.kind == "coherence" and pair and other.count == one.count:
            return np.asarray(other.read()[1].real, dtype=np.float64)
    return None


@contextmanager
def _open(database: Database, workspace: str, identifier: str) -> Iterator[Sequence[SpectralFunction]]:
    """Give the functions of a committed file."""
    with database.session() as session:
        row = DatasetRepository(session, workspace).get(identifier)
        format_, size, segments = row.format, row.size or 0, list(row.manifest or ())
        there = bool((row.report or {}).get("functions"))
        given = stated((row.description or {}).get("import"))
    if not there:
        raise Problem(
            409, "conflict", f"dataset {identifier!r} must be a file with functions of frequency, it has none"
        )
    if size > _LARGEST:
        raise Problem(413, "too-large", f"a file must be at most {_LARGEST} bytes to be read at once, got {size}")
    with refusing(), spooled(database, workspace, identifier, segments, _silent) as file:
        recording = catalogue.open_file(format_, file, options(format_, given))
        try:
            yield recording.functions
        finally:
            recording.close()


def _silent(share: float, said: str) -> None:
    """Tell nobody."""
