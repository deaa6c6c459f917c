"""Universal files, dataset 58: functions at nodal degrees of freedom, as text or binary.

Time responses become channels, functions of frequency (responses, coherences, spectra) stay functions.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from api.formats import Recording, Series, SpectralFunction, Values
from api.formats.uff.datasets import Function, functions, points_of

_SPECTRAL = {2, 3, 4, 5, 6, 9, 10, 12}
"""Types of functions that are of frequency where the file does not say what its abscissa is."""
_OVER_TIME = {0, 1, 7, 8}
FUNCTIONS = {
    0: "general", 1: "time response", 2: "auto spectrum", 3: "cross spectrum", 4: "frequency response",
    5: "transmissibility", 6: "coherence", 7: "auto correlation", 8: "cross correlation",
    9: "power spectral density", 10: "energy spectral density", 11: "probability density", 12: "spectrum",
}  # fmt: skip
"""Type of a function -> what it is."""
_FREQUENCY = 18
"""Kind of abscissa, and of what the lines of a function are."""


def open_file(file: BinaryIO, *, allow_truncated: bool = False) -> Recording:
    """Return the time responses and the functions of frequency of a universal file; the rest is refused by name.

    Parameters
    ----------
    file : binary file
    allow_truncated : bool
        Take the whole points of the last function where the file ends within it, and say so.

    Raises
    ------
    FormatError
        For another file, a header that is damaged or claims more ordinates than there are, or a file that ends early.
    """
    found, others, remarks = functions(file, allow_truncated=allow_truncated)
    cut = bool(remarks)
    refused = {
        f"dataset {number}": "only datasets 58 hold recordings and functions: what else is in the file is not needed for them"
        for number in others
    }
    channels = _Channels(file)
    spectral: list[SpectralFunction] = []
    names: set[str] = set()
    for number, function in enumerate(found, start=1):
        over_frequency = function.axis == _FREQUENCY or (function.axis in {0, 1} and function.kind in _SPECTRAL)
        plain = _spectral_name(function) if over_frequency else function.name
        name = plain if plain not in names else f"{plain} ({number})"
        names.add(name)
        if over_frequency:
            spectral.append(_spectral(file, function, name))
        elif reason := _reason(function):
            refused[name] = reason
        else:
            channels.add(function, name)

    def read(wanted: Sequence[int]) -> Iterator[tuple[int, Values]]:
        for position, one in enumerate(wanted):
            function, column = channels.places[one]
            for points in points_of(file, function):
                yield position, np.ascontiguousarray(points[:, column])

    if any(one.sample_rate for one in channels.series):
        remarks.append(
            "the file states the time step with six digits: the sample rate is known to about 3e-6 of itself"
        )
    return Recording(
        series=channels.series,
        read=read,
        refused=refused,
        remarks=remarks,
        functions=spectral,
        complete=not any(one.even and one.start for one in found) and not cut,
    )


class _Channels:
    """The responses over time: those at uneven instants stand behind these, once for all that have the same."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.series: list[Series] = []
        self.places: list[tuple[Function, int]] = []
        self._groups: dict[bytes, str] = {}

    def add(self, function: Function, name: str) -> None:
        """Append the channels of a function: one, or its real and imaginary part."""
        group = "" if function.even else self._instants(function, name)
        first = 0 if function.even else 1
        for column, part in enumerate((" (real)", " (imaginary)") if function.is_complex else ("",), start=first):
            self.places.append((function, column))
            self.series.append(
                Series(
                    name=f"{name}{part}",
                    index=len(self.series),
                    count=function.count,
                    unit=function.unit,
                    quantity=function.quantity,
                    sample_rate=1.0 / function.step if function.even else None,
                    start_time=function.recorded,
                    group=group,
                )
            )

    def _instants(self, function: Function, name: str) -> str:
        """Return the group of those that have the instants of a function."""
        digest = hashlib.sha256()
        for points in points_of(self._file, function):
            digest.update(np.ascontiguousarray(points[:, 0]).tobytes())
        known = self._groups.get(digest.digest())
        if known is not None:
            return known
        self._groups[digest.digest()] = name
        self.places.append((function, 0))
        self.series.append(
            Series(
                name=f"time of {name}",
                index=len(self.series),
                count=function.count,
                unit="s",
                role="time",
                group=name,
            )
        )
        return name


def _spectral_name(function: Function) -> str:
    return f"{function.response} over {function.reference}, {FUNCTIONS.get(function.kind, f'type {function.kind}')}"


def _spectral(file: BinaryIO, function: Function, name: str) -> SpectralFunction:
    def read() -> tuple[Values, npt.NDArray[np.complex128]]:
        points = np.concatenate(list(points_of(file, function)))
        first = 0 if function.even else 1
        values = points[:, first].astype(np.complex128)
        if function.is_complex:
            values += 1j * points[:, first + 1]
        frequency = function.start + function.step * np.arange(function.count) if function.even else points[:, 0]
        return np.asarray(frequency, dtype=np.float64), values

    return SpectralFunction(
        name=name,
        kind=FUNCTIONS.get(function.kind, f"type {function.kind}"),
        response=function.response,
        reference=function.reference,
        response_unit=function.unit,
        reference_unit=function.reference_unit,
        count=function.count,
        read=read,
    )


def _reason(function: Function) -> str | None:
    if function.kind not in _OVER_TIME:
        return f"it is a {FUNCTIONS.get(function.kind, 'function')} (type {function.kind}), neither over time nor over frequency: export time responses or frequency responses of it"
    if function.even and not function.step > 0.0:
        return f"its time step must be > 0 s, got {function.step:g}: write it anew with its step, or with its abscissa"
    return None
