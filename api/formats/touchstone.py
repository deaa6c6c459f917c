"""Touchstone files (.s1p, .s2p ...) and FRD files of loudspeakers: responses between ports, over frequency, as text.

    # Hz S RI R 50     unit, parameter, form (RI, MA, DB) and resistance;  then f, and two numbers for each pair of ports

A record may go on over several lines: it begins where the count of numbers is odd. S21 is the response of port 2 to port 1.
Version 1 has what is no S normalised: Z, h11 and g22 are in units of R, Y, h22 and g11 in units of 1/R. In version 2 numbers that
stand before [Network Data] belong to keywords.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from api.formats import DamagedFileError, FormatError, Recording, SpectralFunction, Values
from api.formats.text.cells import Marks
from api.formats.text.endings import Rows
from api.formats.text.txt import Lines

_CHUNK = 1 << 20
_UNITS = {"HZ": 1.0, "KHZ": 1e3, "MHZ": 1e6, "GHZ": 1e9}
_FORMS = ("RI", "MA", "DB")
"""Real and imaginary part, magnitude and degrees, decibels and degrees."""
_PARAMETERS = ("S", "Z", "Y", "G", "H")
_HYBRID = {"H": ("VI", "IV"), "G": ("IV", "VI")}
"""What the ports of G and H respond with, and what to: v1 = h11 i1 + h12 v2, i2 = h21 i1 + h22 v2."""
_VOLT_AMPERE = {"V": "V", "I": "A"}
_KEYWORD = re.compile(r"\[(?P<name>[^\]]+)\]\s*(?P<value>.*)")


@dataclass(slots=True, kw_only=True)
class _Head:
    """What the file says before its numbers."""

    scale: float = 1e9
    parameter: str = "S"
    form: str = "MA"
    resistance: float = 50.0
    said: bool = False
    lines: int = 0
    keywords: dict[str, str] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)


def open_file(file: BinaryIO) -> Recording:
    """Return the responses between the ports of a Touchstone file.

    Raises
    ------
    FormatError
        For another file, or records of different lengths.
    """
    head, records = _read(file)
    if not records:
        raise FormatError(
            "a Touchstone file must hold frequencies with their values, got none: was the measurement exported with it?"
        )
    pairs = {len(record) // 2 for record in records}
    most = max(pairs)
    shape = head.keywords.get("matrix format", "full")
    ports = math.isqrt(most) if shape == "full" else (math.isqrt(8 * most + 1) - 1) // 2
    if len(pairs) > 1 or most != (ports**2 if shape == "full" else ports * (ports + 1) // 2):
        raise FormatError(
            f"each frequency must have a value for each pair of ports, got {' and '.join(map(str, sorted(pairs)))}: the file "
            f"is damaged, or its matrices are not {shape} (write it as full matrices)"
        )
    if head.parameter in _HYBRID and ports != 2:
        raise FormatError(f"{head.parameter} must be of 2 ports, got {ports}: write S or Z")
    numbers = np.array(records)
    values = _values(head.form, numbers[:, 1::2], numbers[:, 2::2])
    labels = head.keywords.get("mixed-mode order", "").upper().split() or [str(port + 1) for port in range(ports)]
    between = "" if all(len(label) == 1 for label in labels) else ","
    functions = []
    for (to, by), place in _order(head, ports, shape).items():
        units = _units(head.parameter, to, by)
        factor = 1.0
        if "version" not in head.keywords:
            factor = {("V", "A"): head.resistance, ("A", "V"): 1.0 / head.resistance}.get(units, 1.0)
        name = f"{head.parameter}{labels[to]}{between}{labels[by]}"
        points = labels[to], labels[by]
        functions.append(_function(name, points, units, head.scale * numbers[:, 0], factor * values[:, place]))
    reference = head.keywords.get("reference") or f"{head.resistance:g}"
    said = f"{head.parameter} of {ports} ports, {head.form}, reference {reference} ohm: response 2 over reference 1 is {head.parameter}21"
    return Recording(series=[], read=_no_channels, functions=functions, remarks=[said, *head.remarks])


def _units(parameter: str, to: int, by: int) -> tuple[str, str]:
    """Return the units of a response and of what it responds to, "" for waves."""
    if parameter == "S":
        return "", ""
    out, into = {"Z": ("VV", "II"), "Y": ("II", "VV")}.get(parameter) or _HYBRID[parameter]
    return _VOLT_AMPERE[out[min(to, 1)]], _VOLT_AMPERE[into[min(by, 1)]]


def open_frd(file: BinaryIO) -> Recording:
    """Return the response of an FRD file: frequency (Hz), magnitude (dB) and, where there is a third column, phase (deg)."""
    rows = []
    lines = Lines(_pieces(file))
    for number, line in enumerate(lines, start=1):
        plain = re.split(r"[*#!;\"]", line.strip())[0].replace(",", " ").split()
        if not plain:
            continue
        try:
            rows.append([float(cell) for cell in plain[:3]])
        except ValueError as error:
            if rows:
                raise DamagedFileError(
                    f"line {number} must be frequency, dB and degrees, got {line[:40]!r}", line=number
                ) from error
    remarks = _end(file, lines, rows)
    widths = {len(row) for row in rows}
    if len(rows) < 2 or len(widths) > 1 or widths == {1}:
        raise DamagedFileError(
            "an FRD file must hold rows of frequency (Hz), magnitude (dB) and phase (degrees), got others"
        )
    numbers = np.array(rows)
    phase = numbers[:, 2] if numbers.shape[1] > 2 else np.zeros(len(rows))
    one = _function("response over reference, frequency response", ("response", "reference"), ("", ""), numbers[:, 0],
                    _values("DB", numbers[:, 1], phase))  # fmt: skip
    said = "frequency in Hz, magnitude in dB (20 log10) and phase in degrees, as FRD files have them" + (
        "" if numbers.shape[1] > 2 else "; it has no phase: it is 0"
    )
    return Recording(series=[], read=_no_channels, functions=[one], remarks=[said, *remarks])


def _values(form: str, a: Values, b: Values) -> npt.NDArray[np.complex128]:
    if form == "RI":
        return np.asarray(a + 1j * b, dtype=np.complex128)
    size = 10.0 ** (a / 20.0) if form == "DB" else a
    return np.asarray(size * np.exp(1j * np.deg2rad(b)), dtype=np.complex128)


def _no_channels(wanted: Sequence[int]) -> Iterator[tuple[int, Values]]:
    del wanted
    return iter(())


def _function(
    name: str, points: tuple[str, str], units: tuple[str, str], frequency: Values, values: npt.NDArray[np.complex128]
) -> SpectralFunction:
    return SpectralFunction(
        name=name,
        kind="frequency response",
        response=points[0],
        reference=points[1],
        response_unit=units[0],
        reference_unit=units[1],
        count=frequency.size,
        read=lambda: (frequency, values),
    )


def _pieces(file: BinaryIO) -> Iterator[bytes]:
    file.seek(0)
    return iter(lambda: file.read(_CHUNK), b"")


def _read(file: BinaryIO) -> tuple[_Head, list[list[float]]]:
    """Return the head, and the numbers of each frequency."""
    head = _Head()
    records: list[list[float]] = []
    last = ""
    lines = Lines(_pieces(file))
    for number, line in enumerate(lines, start=1):
        plain = line.split("!", 1)[0].strip()
        keyword = _KEYWORD.fullmatch(plain)
        if keyword and keyword["name"].strip().lower() in {"end", "noise data"}:
            break
        if keyword:
            last = keyword["name"].strip().lower()
            head.keywords[last] = keyword["value"].strip().lower()
        elif "version" in head.keywords and "network data" not in head.keywords and not plain.startswith("#"):
            head.keywords[last] = f"{head.keywords[last]} {plain.lower()}".strip()
        elif plain.startswith("#"):
            _option(head, plain[1:].upper().split(), number)
            head.lines = number
        elif plain and not _taken(records, _numbers(plain, number), number):
            break
    if not head.said:
        raise FormatError(
            "a Touchstone file must have its line of options (# Hz S RI R 50) before its numbers, got none: write it there"
        )
    if (shape := head.keywords.get("matrix format", "full")) not in {"full", "lower", "upper"}:
        raise FormatError(f"[Matrix Format] must be Full, Lower or Upper, got {shape[:20]!r}: write the matrices full")
    head.remarks += _end(file, lines, records, begin=head.lines)
    return head, records


def _end(file: BinaryIO, lines: Lines, records: list[list[float]], *, begin: int = 0) -> list[str]:
    """Leave out a last record that is cut; return what is to be said of a file whose last line has no end."""
    if lines.ended or not records:
        return []
    last = Rows(last_column=0, delimiter=" ", marks=Marks()).ending(file).line
    ending = Rows(last_column=max(len(last.split()), 1) - 1, delimiter=" ", marks=Marks(), header_lines=begin).ending(
        file
    )
    if ending.state == "cut" or len(records[-1]) < len(records[0]):
        records.pop()
        return ["the file is cut off: its last frequency is left out"]
    return ["the file ends without a line end: nothing tells whether its last number is whole"]


def _taken(records: list[list[float]], cells: list[float], number: int) -> bool:
    """Append the numbers of a line to its record; False where the noise of a two-port begins, whose frequency falls."""
    if len(cells) % 2:
        if records and cells[0] <= records[-1][0]:
            return False
        records.append(cells)
    elif records:
        records[-1] += cells
    else:
        raise DamagedFileError(
            f"line {number} must begin with a frequency and have its values, got {len(cells)} numbers", line=number
        )
    return True


def _numbers(plain: str, number: int) -> list[float]:
    try:
        return [float(cell) for cell in plain.split()]
    except ValueError as error:
        raise DamagedFileError(f"line {number} must be numbers, got {plain[:40]!r}", line=number) from error


def _option(head: _Head, words: Sequence[str], line: int) -> None:
    """Take the words of the line of options, which stand in any order; a second one has no meaning."""
    left = iter(() if head.said else words)
    head.said = True
    for word in left:
        if word in _UNITS:
            head.scale = _UNITS[word]
        elif word in _FORMS:
            head.form = word
        elif word in _PARAMETERS:
            head.parameter = word
        elif word == "R":
            try:
                head.resistance = float(next(left, ""))
            except ValueError as error:
                raise DamagedFileError(f"line {line}: R must be followed by a resistance in ohm", line=line) from error
        else:
            raise DamagedFileError(
                f"line {line} must be of {', '.join(_UNITS)}, {', '.join(_PARAMETERS)}, {', '.join(_FORMS)} and R, got {word[:20]!r}",
                line=line,
            )


def _order(head: _Head, ports: int, shape: str) -> dict[tuple[int, int], int]:
    """Return the place of each (response, reference) in the record: of two ports columns come first, halves are symmetric."""
    rows = [(to, by) for to in range(ports) for by in range(ports)]
    if shape != "full":
        half = [(to, by) for to, by in rows if (by <= to if shape == "lower" else by >= to)]
        places = {pair: place for place, pair in enumerate(half)}
        return {(to, by): places.get((to, by), places.get((by, to), 0)) for to, by in rows}
    by_columns = (
        ports == 2 and head.keywords.get("two-port data order", head.keywords.get("two-port order", "21_12")) == "21_12"
    )
    return {(to, by) if not by_columns else (by, to): place for place, (to, by) in enumerate(rows)}
