"""Functions of frequency from vectors of numbers: parts are put together, coherences and densities told by their names.

value = re + i im,   magnitude e^(i phase),   10^(dB / 20) e^(i phase)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from api.formats import DamagedFileError, SpectralFunction, Values
from api.formats.spectral.names import Meaning, angle_unit, frequency_scale, meaning_of, points_of, units_of

_TURN = 6.5
"""Angles beyond it are in degrees where their unit is not said: a turn has 6.28 rad."""
KINDS = {"coherence": "coherence", "density": "power spectral density", "whole": "spectrum", "magnitude": "spectrum"}
"""What a vector of real numbers is that stands alone."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Vector:
    """Numbers, one on each line.

    Parameters
    ----------
    name : str
        Without the structure or folder that it lies in.
    read : callable
        Returns them, real or complex.
    points : tuple of str, optional
        Response and reference, where the file says them otherwise than by the name.
    """

    name: str
    unit: str
    is_complex: bool
    read: Callable[[], npt.NDArray[Any]]
    points: tuple[str, str] | None = None


def over_frequency(vectors: Sequence[Vector]) -> tuple[list[SpectralFunction], list[str]]:
    """Return the functions that vectors of one length are, and remarks; none where the first is no frequency.

    A vector that is only called f may be a force: it is a frequency where what stands beside it is complex, a magnitude,
    a coherence or the like.
    """
    if len(vectors) < 2 or vectors[0].is_complex:
        return [], []
    first, *others = vectors
    scale = frequency_scale(first.name, first.unit)
    meant = [meaning_of(one.name, one.unit) for one in others]
    telling = any(one.is_complex or meaning.part != "whole" for one, meaning in zip(others, meant, strict=True))
    if scale is None or (len(first.name.strip()) == 1 and not first.unit and not telling):
        return [], []
    frequency = np.asarray(first.read(), dtype=np.float64)
    if not is_axis(frequency):
        return [], [f"{first.name} does not rise strictly, from 0 or more: its columns are no functions of frequency"]
    found, remarks = functions_of(scale * frequency, others)
    unit = first.unit or ("Hz" if scale == 1.0 else "rad/s")
    said = f"{first.name} rises and is a frequency ({unit}): what is beside it are functions of it (say time or sample_rate where not)"
    return found, [said, *remarks]


def is_axis(frequency: Values) -> bool:
    """Whether numbers may be the frequencies of lines: at least two, not negative, strictly rising or falling."""
    steps = np.diff(frequency)
    return bool(frequency.size > 1 and frequency.min() >= 0 and ((steps > 0).all() or (steps < 0).all()))


def functions_of(frequency: Values, vectors: Sequence[Vector]) -> tuple[list[SpectralFunction], list[str]]:
    """Return the functions that vectors on some frequencies (Hz) are, and remarks on what was not said by the file."""
    meant = [(meaning_of(one.name, one.unit), one) for one in vectors]
    parts: dict[str, dict[str, Vector]] = {}
    for meaning, one in meant:
        if not one.is_complex:
            parts.setdefault(meaning.stem.lower(), {}).setdefault(meaning.part, one)
    found: list[SpectralFunction] = []
    remarks: list[str] = []
    used: set[int] = set()
    for meaning, one in meant:
        if id(one) in used:
            continue
        made, members = _made(meaning, one, parts[meaning.stem.lower()] if not one.is_complex else {}, remarks)
        used |= {id(member) for member in members}
        found.append(_function(frequency, meaning, one, made))
    return _named(_shared(found)), remarks


@dataclass(frozen=True, slots=True, kw_only=True)
class _Made:
    """A function: what it is, its unit, and how its values come about."""

    kind: str
    unit: str
    read: Callable[[], npt.NDArray[np.complex128]]


def _made(
    meaning: Meaning, one: Vector, there: Mapping[str, Vector], remarks: list[str]
) -> tuple[_Made, Sequence[Vector]]:
    """Return the function that a vector is, with the other part of it where there is one."""
    label = meaning.stem or one.name
    if one.is_complex:
        return _Made(kind=_kind(one.name), unit=one.unit, read=lambda: one.read().astype(np.complex128)), [one]
    if meaning.part in {"real", "imaginary"} and {"real", "imaginary"} <= set(there):
        real, imaginary = there["real"], there["imaginary"]
        made = _Made(kind=_kind(label), unit=real.unit, read=lambda: real.read() + 1j * imaginary.read())
        return made, [real, imaginary]
    size = there.get("magnitude") or there.get("whole")
    if meaning.part in {"magnitude", "phase", "whole"} and size is not None and "phase" in there:
        phase = there["phase"]
        if not _angle(phase):
            remarks.append(
                f"{phase.name} has no unit: it is taken in degrees where it goes beyond a turn of 6.28, otherwise in rad"
            )
        if _decibels(size):
            remarks.append(f"{size.name} is in dB: 20 log10 of the magnitude, in units that the file does not say")
        unit = "" if _decibels(size) else size.unit
        return _Made(kind=_kind(label), unit=unit, read=lambda: _polar(size, phase)), [size, phase]
    if meaning.part in {"real", "imaginary", "phase"}:
        remarks.append(f"{one.name} has no other part beside it: it is kept as a spectrum of its own")
    unit = "" if _decibels(one) else one.unit
    kind = "power spectral density" if unit.lower().endswith("/hz") else KINDS.get(meaning.part, "spectrum")
    return _Made(kind=kind, unit=unit, read=lambda: _size(one).astype(np.complex128)), [one]


def _polar(size: Vector, phase: Vector) -> npt.NDArray[np.complex128]:
    angle = np.asarray(phase.read(), dtype=np.float64)
    known = _angle(phase)
    if known == "deg" or (not known and np.nanmax(np.abs(angle), initial=0.0) > _TURN):
        angle = np.deg2rad(angle)
    return np.asarray(_size(size) * np.exp(1j * angle), dtype=np.complex128)


def _size(one: Vector) -> Values:
    values = np.asarray(one.read(), dtype=np.float64)
    return np.asarray(10.0 ** (values / 20.0), dtype=np.float64) if _decibels(one) else values


def _decibels(one: Vector) -> bool:
    return one.unit.strip().lower() == "db" or (not one.unit and one.name.lower().rstrip(")] ").endswith("db"))


def _angle(one: Vector) -> str:
    words = one.name.lower().replace("_", " ").replace("(", " ").replace(")", " ").split()
    return angle_unit(one.unit) or next((angle_unit(word) for word in words if angle_unit(word)), "")


def _kind(name: str) -> str:
    plain = name.lower()
    if "cross" in plain or "csd" in plain:
        return "cross spectrum"
    return "spectrum" if "spectrum" in plain or "fft" in plain else "frequency response"


def _function(frequency: Values, meaning: Meaning, one: Vector, made: _Made) -> SpectralFunction:
    response, reference = one.points or points_of(meaning.stem)
    above, below = units_of(made.unit) if made.kind == "frequency response" else (made.unit, "")

    order = slice(None, None, -1) if frequency[-1] < frequency[0] else slice(None)

    def read() -> tuple[Values, npt.NDArray[np.complex128]]:
        values = made.read()
        if values.shape != frequency.shape:
            raise DamagedFileError(f"{one.name} must have a value on each of {frequency.size} lines, got {values.size}")
        return frequency[order], values[order]

    return SpectralFunction(
        name="",
        kind=made.kind,
        response=response[:200],
        reference=reference[:200],
        response_unit=above[:64],
        reference_unit=below[:64],
        count=frequency.size,
        read=read,
    )


def _shared(found: Sequence[SpectralFunction]) -> list[SpectralFunction]:
    """Give a coherence that names no points those of the only response."""
    responses = [one for one in found if one.kind == "frequency response"]
    if len(responses) != 1:
        return list(found)
    (only,) = responses
    return [
        replace(one, response=only.response, reference=only.reference)
        if one.kind == "coherence" and one.reference == "reference"
        else one
        for one in found
    ]


def _named(found: Sequence[SpectralFunction]) -> list[SpectralFunction]:
    """Give each function a name of its own."""
    names: set[str] = set()
    named = []
    for number, one in enumerate(found, start=1):
        plain = f"{one.response} over {one.reference}, {one.kind}"
        name = plain if plain not in names else f"{plain} ({number})"
        names.add(name)
        named.append(replace(one, name=name))
    return named
