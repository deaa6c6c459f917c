"""HDF5, and MATLAB files of version 7.3, which are HDF5: every array of numbers is a channel, or a row of them.

Units and sample rates are taken from the attributes that programs use for them. Only what lies in the file itself is
read: links to other files and arrays kept outside are refused.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from api.formats import (
    MOST_RATIO,
    NUMBERS,
    ONE_COMPLEX,
    SAMPLES,
    FormatError,
    Recording,
    bounded,
    by_channel,
    text_reason,
)
from api.formats.arrays import Part, frequency_unit, line_counts, parts_of, series_of, started, stated_rate
from api.formats.exactness import Reading, Rounded

_LARGEST_CHUNK, _LARGEST_DENSE = 256 << 20, 32 << 20
"""Bytes of a chunk, which is unpacked as a whole: of any, and of one that is packed as densely as no measurement is."""
_MOST_ARRAYS = 100_000
_LONGEST_TEXT = 200
_UNIT = ("unit", "units", "Unit", "Units", "unit_string", "y_unit")
_STEP = ("dt", "delta_t", "sample_time", "wf_increment", "increment", "TimeStep")
_RATE = ("sample_rate", "fs", "Fs", "sampling_rate", "SampleRate", "samplerate")
_COMPLEX = {("real", "imag"), ("r", "i"), ("re", "im")}
_CLASSES = {
    "char": "a text",
    "cell": "a cell array, a channel must be an array of numbers: save its cells as arrays of their own (cell2mat)",
    "function_handle": "a function, a channel must be an array of numbers: save its values",
}


def open_file(file: BinaryIO) -> Recording:
    """Return the vectors and matrices of numbers of an HDF5 file.

    Raises
    ------
    FormatError
        For another or a damaged file.
    """
    import h5py  # noqa: PLC0415 - loads a library that most processes never need

    source = h5py.File(file, "r")
    matlab = any("MATLAB_class" in item.attrs for item in source.values() if hasattr(item, "attrs"))
    arrays: list[Any] = []
    names: list[str] = []
    refused: dict[str, str] = {}
    texts: dict[str, str] = {}

    def visit(path: str, item: Any) -> None:
        if len(arrays) + len(refused) > _MOST_ARRAYS:
            raise FormatError(
                f"an HDF5 file must have at most {_MOST_ARRAYS} arrays, got more: save fewer of them into one file"
            )
        name = path.replace("/", ".") if matlab else path
        if path.startswith(("#refs#", "#subsystem#")):
            return
        if not isinstance(item, h5py.Dataset):
            if "MATLAB_object_decode" in item.attrs:
                refused[name] = _class_reason(item)
            return
        reason = _reason(item)
        if reason:
            refused[name] = reason
            texts[name] = _short_text(item)
        else:
            arrays.append(item)
            names.append(name)

    try:
        source.visititems(visit)
        found = _recording(arrays, names, refused, texts, dict(source.attrs), matlab=matlab)
    except BaseException:
        source.close()
        raise
    return replace(found, close=source.close)


def _recording(
    arrays: list[Any],
    names: list[str],
    refused: dict[str, str],
    texts: Mapping[str, str],
    attributes: Mapping[str, Any],
    *,
    matlab: bool,
) -> Recording:
    parts: list[Part] = []
    scalars: dict[str, float] = {}
    rounded = Rounded()
    # MATLAB's columns are the rows of HDF5
    shapes = [array.shape[::-1] if matlab else array.shape for array in arrays]
    lines = line_counts(zip(names, shapes, strict=True))
    for i, (array, name, shape) in enumerate(zip(arrays, names, shapes, strict=True)):
        if all(n == 1 for n in shape):
            if _is_complex(array):
                refused[name] = ONE_COMPLEX
            else:
                scalars[name] = float(Reading(rounded).floats(name, np.asarray(array[()]).reshape(-1))[0])
            continue
        bounded(f"the values of {name}", math.prod(shape))
        more, reason = parts_of(name, shape, array=i, is_complex=_is_complex(array), lines=lines)
        parts += more
        if reason:
            refused[name] = reason
    rates = [_rate(array.attrs) for array in arrays]
    units = [
        _text(array.attrs, _UNIT) or frequency_unit(name, names, texts)
        for array, name in zip(arrays, names, strict=True)
    ]
    start = started(_text(attributes, ("start_time",)), _first(attributes))
    series = [
        replace(one, sample_rate=rates[part.array], start_time=start)
        for one, part in zip(series_of(parts, units), parts, strict=True)
    ]

    def part(channel: int, start: int, stop: int) -> npt.NDArray[Any]:
        one = parts[channel]
        array = arrays[one.array]
        place = [slice(start, stop) if axis == one.along else i for axis, i in enumerate(one.place)]
        values = np.asarray(array[tuple(reversed(place) if matlab else place)])
        return _component(values, imaginary=one.imaginary)

    rate = _rate(attributes)
    remarks: list[str] = []
    if rate is None:
        rate, remarks = stated_rate(scalars)
    return Recording(
        series=series,
        read=by_channel(series, part, rounded),
        rounded=rounded,
        refused=refused,
        scalars=scalars,
        layout={"sample_rate": rate} if rate else {},
        remarks=remarks,
    )


def _first(attributes: Mapping[str, Any]) -> float:
    """Return the instant of the first sample, s, which an export of a stretch has beside the start of the whole recording."""
    first = attributes.get("t0")
    return float(first) if isinstance(first, float) and math.isfinite(first) else 0.0


def _short_text(item: Any) -> str:
    """Return a text that may be a unit: letters of MATLAB are numbers; "" for anything else."""
    if item.shape is not None and 0 < math.prod(item.shape) <= _LONGEST_TEXT and not item.external:
        if item.dtype == np.uint16:
            return np.asarray(item[()]).reshape(-1).astype("<u2").tobytes().decode("utf-16-le", errors="replace")
        if item.dtype.kind in "SO" and item.shape == ():
            value = item[()]
            return value.decode("utf-8", errors="replace") if isinstance(value, bytes) else str(value)
    return ""


def _is_complex(item: Any) -> bool:
    """Whether each number has two parts: as numpy and h5py have them, or as MATLAB has."""
    return item.dtype.kind == "c" or item.dtype.names in _COMPLEX


def _component(values: npt.NDArray[Any], *, imaginary: bool) -> npt.NDArray[Any]:
    if values.dtype.kind == "c":
        return np.asarray(values.imag if imaginary else values.real)
    return values if values.dtype.names is None else np.asarray(values[values.dtype.names[1 if imaginary else 0]])


def _reason(item: Any) -> str:
    """Return why an array cannot be a channel, "" when it can."""
    class_ = _text(item.attrs, ("MATLAB_class",))
    if "MATLAB_object_decode" in item.attrs:
        return _class_reason(item)
    if class_ in _CLASSES:
        return text_reason(_short_text(item)) if class_ == "char" else f"it is {_CLASSES[class_]}"
    if "MATLAB_empty" in item.attrs or item.shape is None or 0 in item.shape:
        return f"it is empty (of shape {item.shape}), {SAMPLES}: leave it out, or save what was recorded"
    if item.dtype.kind not in "iufb" and not _is_complex(item):
        return f"its values are no plain numbers ({item.dtype}), {NUMBERS}: save them as integers or doubles"
    return _storage_reason(item)


def _storage_reason(item: Any) -> str:
    count = math.prod(item.shape)
    if item.external or item.is_virtual:
        return "its values lie in other files: copy them into this one (h5repack)"
    stored = item.id.get_storage_size()
    if item.chunks:
        chunk = math.prod(item.chunks) * item.dtype.itemsize
        if chunk > min(_LARGEST_CHUNK, max(_LARGEST_DENSE, MOST_RATIO * stored)):
            return f"its chunks of {chunk} bytes are larger than {_LARGEST_CHUNK >> 20} MiB, or packed too densely ({stored} bytes are stored): write smaller ones (h5repack -l CHUNK=...)"
    elif stored < count * item.dtype.itemsize:
        return (
            f"it claims {count} values and has {stored} bytes of them: it is damaged or was not closed, write it anew"
        )
    return ""


def _class_reason(item: Any) -> str:
    return f"it is an object of the MATLAB class {_text(item.attrs, ('MATLAB_class',))!r}: save what is in it as plain arrays"


def _text(attributes: Mapping[str, Any], names: tuple[str, ...]) -> str:
    for name in names:
        value = attributes.get(name)
        if isinstance(value, bytes):
            return value.decode("utf-8", errors="replace")[:64]
        if isinstance(value, str):
            return value[:64]
    return ""


def _rate(attributes: Mapping[str, Any]) -> float | None:
    for names, step in ((_RATE, False), (_STEP, True)):
        for name in names:
            value = attributes.get(name)
            if value is not None and np.ndim(value) == 0 and np.issubdtype(np.asarray(value).dtype, np.number):
                number = float(value)
                if math.isfinite(number) and number > 0.0:
                    return 1.0 / number if step else number
    return None
