"""Universal files, dataset 58, of frequency responses: as text, which every program reads, whereas binary files are read by few."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime

import numpy as np
import numpy.typing as npt

from api.formats import FormatError
from api.formats.uff import FUNCTIONS

_CODES = {"displacement": 8, "force": 13, "velocity": 11, "acceleration": 12, "pressure": 15, "": 0}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrequencyResponse:
    """A measured frequency response, for a universal file.

    Parameters
    ----------
    frequency : ndarray, shape (lines,)
        Hz, evenly spaced.
    values : ndarray of complex, shape (lines,)
        Response over reference, in ``unit``.
    name : str
        A line that says what it is.
    response, reference : str
        Names of the two channels; up to 10 characters stand in the file, the rest is cut.
    response_quantity, reference_quantity : str
        "displacement", "velocity", "acceleration", "force", "pressure" or "".
    response_unit, reference_unit : str
    coherence : ndarray, shape (lines,), optional
        Written as a function of its own behind the response.
    """

    frequency: npt.NDArray[np.float64]
    values: npt.NDArray[np.complex128]
    name: str = ""
    response: str = ""
    reference: str = ""
    response_quantity: str = ""
    reference_quantity: str = ""
    response_unit: str = ""
    reference_unit: str = ""
    coherence: npt.NDArray[np.float64] | None = None


def write(functions: Iterable[FrequencyResponse], *, recorded: datetime) -> Iterator[bytes]:
    """Yield a universal file (text, double precision) with frequency responses, piece by piece.

    Parameters
    ----------
    functions : iterable of FrequencyResponse
    recorded : datetime
        Written into each header.

    Raises
    ------
    FormatError
        For frequencies that are not evenly spaced, or a response of another length.
    """
    for function in functions:
        yield _written(function, function.values, 4, recorded)
        if function.coherence is not None:
            yield _written(function, function.coherence, 6, recorded)


def _written(
    function: FrequencyResponse,
    values: npt.NDArray[np.float64] | npt.NDArray[np.complex128],
    kind: int,
    recorded: datetime,
) -> bytes:
    frequency = np.asarray(function.frequency, dtype=np.float64)
    count = frequency.size
    if count < 2 or values.shape != frequency.shape:
        raise FormatError(
            f"a frequency response must be as long as its {count} (at least 2) frequencies, got {values.shape}: give a value for each"
        )
    step = (frequency[-1] - frequency[0]) / (count - 1)
    if not step > 0.0 or float(np.max(np.abs(frequency - frequency[0] - step * np.arange(count)))) > 1e-6 * step:
        raise FormatError(
            "the frequencies of a universal file must be evenly spaced and rising, got others: export it in another format"
        )
    complex_values = kind == 4
    ratio = (function.response_unit, function.reference_unit) if complex_values else ("NONE", "NONE")
    lines = [
        "    -1",
        "    58",
        _line(function.name or f"{function.response} / {function.reference}", 80),
        _line(f"{FUNCTIONS[kind]}", 80),
        recorded.strftime("%d-%b-%y %H:%M:%S"),
        "NONE",
        "NONE",
        f"{kind:5d}{0:10d}{0:5d}{0:10d} {_line(function.response, 10):10s}{1:10d}{0:4d} {_line(function.reference, 10):10s}{1:10d}{0:4d}",
        f"{6 if complex_values else 4:10d}{count:10d}{1:10d}{frequency[0]:13.5E}{step:13.5E}{0.0:13.5E}",
        _axis(18, "Frequency", "Hz"),
        _axis(_CODES.get(function.response_quantity, 0) if complex_values else 0, function.response, ratio[0]),
        _axis(_CODES.get(function.reference_quantity, 0) if complex_values else 0, function.reference, ratio[1]),
        _axis(0, "NONE", "NONE"),
    ]
    flat = np.ascontiguousarray(values).view(np.float64) if complex_values else np.asarray(values, dtype=np.float64)
    lines += ["".join(f"{value:20.12E}" for value in flat[i : i + 4]) for i in range(0, flat.size, 4)]
    return "\n".join([*lines, "    -1", ""]).encode("ascii", errors="replace")


def _axis(kind: int, label: str, unit: str) -> str:
    return f"{kind:10d}{0:5d}{0:5d}{0:5d} {_line(label or 'NONE', 20):20s} {_line(unit or 'NONE', 20):20s}"


def _line(text: str, width: int) -> str:
    return " ".join(text.split())[:width]
