"""Channels of a container that lie over a frequency: those of one structure or folder, behind its vector of frequencies."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from api.formats import Recording, Series, SpectralFunction, Values
from api.formats.arrays import IMAGINARY, REAL
from api.formats.spectral import Vector, over_frequency
from api.formats.spectral.names import frequency_scale, meaning_of

_INDEXED = re.compile(r"(?P<stem>.*?)\((?P<places>[\d:,]+)\)(?P<part> \((?:real|imaginary)\))?")


def spectral(recording: Recording) -> Recording:
    """Return a recording whose channels over a frequency are functions of it."""
    functions: list[SpectralFunction] = []
    remarks: list[str] = []
    taken: set[int] = set()
    for places in _groups(recording.series):
        names = _names([recording.series[place] for place in places])
        vectors = [
            Vector(
                name=name,
                unit=recording.series[place].unit,
                is_complex=False,
                read=partial(_read, recording, place),
                points=points,
            )
            for place, (name, points) in zip(places, names, strict=True)
        ]
        found, said = over_frequency(vectors)
        if found:
            functions += found
            remarks += said
            taken |= {*places}
    if not functions:
        return recording
    left = [place for place in range(len(recording.series)) if place not in taken]
    return replace(
        recording,
        series=[replace(recording.series[place], index=number) for number, place in enumerate(left)],
        read=lambda wanted: recording.read([left[place] for place in wanted]),
        functions=[*recording.functions, *_distinct(functions)],
        remarks=[*recording.remarks, *remarks],
    )


def _groups(series: Sequence[Series]) -> list[list[int]]:
    """Return places of what may lie over a frequency, which comes first: one length, one group, no time and no rate."""
    found: list[list[int]] = []
    for place, axis in enumerate(series):
        if axis.role != "channel" or axis.sample_rate or frequency_scale(_short(axis), axis.unit) is None:
            continue
        beside = [
            i for i, one in enumerate(series) if (one.group, one.count) == (axis.group, axis.count) and i != place
        ]
        timed = any(series[i].role != "channel" for i in beside)
        parts = [i for i in beside if series[i].role == "channel" and (not timed or _is_part(series[i]))]
        if parts and not any(place in group for group in found):
            found.append([place, *parts])
    return found


def _is_part(one: Series) -> bool:
    return one.name.endswith((REAL, IMAGINARY)) or meaning_of(_short(one), one.unit).part == "coherence"


def _short(one: Series) -> str:
    """Return a name without its structure or folder."""
    return one.name.removeprefix(one.group).lstrip("./") if one.group else one.name


def _names(series: Sequence[Series]) -> list[tuple[str, tuple[str, str] | None]]:
    """Return the name of each, and its points where it is a column of a matrix: H(:,2), H(3,1,:)."""
    matches = [_INDEXED.fullmatch(_short(one)) for one in series]
    stems = {m["stem"] for m in matches if m and meaning_of(m["stem"], "").part != "coherence"}
    named: list[tuple[str, tuple[str, str] | None]] = []
    for one, match in zip(series, matches, strict=True):
        if match is None:
            named.append((_short(one), None))
            continue
        numbers = [place for place in match["places"].split(",") if place != ":"]
        response = numbers[0] if len(stems) < 2 else f"{match['stem']}({numbers[0]})"
        name = f"{match['stem']} {' '.join(numbers)}{match['part'] or ''}"
        named.append((name, (response, numbers[1] if len(numbers) > 1 else "reference")))
    return named


def _read(recording: Recording, place: int) -> Values:
    return np.concatenate([*(values for _, values in recording.read([place])), np.empty(0)])


def _distinct(functions: Sequence[SpectralFunction]) -> list[SpectralFunction]:
    names: set[str] = set()
    distinct = []
    for number, one in enumerate(functions, start=1):
        name = one.name if one.name not in names else f"{one.name} ({number})"
        names.add(name)
        distinct.append(replace(one, name=name))
    return distinct
