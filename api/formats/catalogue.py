"""Which reader opens a file of which format."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from types import MappingProxyType
from typing import Any, BinaryIO

from api.formats import (
    FormatError,
    Recording,
    SpectralFunction,
    Values,
    hdf5,
    mat,
    mcap,
    mdf,
    parquet,
    proportionate,
    tdms,
    touchstone,
    uff,
    wav,
)
from api.formats.spectral.columns import spectral
from api.formats.text import lvm, scope, tables
from api.formats.text.tables import TableOptions

_MATLAB_7_3 = b"MATLAB 7.3"
_HDF5 = b"\x89HDF\r\n\x1a\n"

_HEAD = 4096

TABLES = ("csv", "txt")
"""Formats whose layout may have to be said."""

_TITLES: Mapping[str, str] = MappingProxyType(
    {
        "tdms": "a TDMS", "mat": "a MATLAB", "hdf5": "an HDF5", "parquet": "a Parquet", "uff": "a universal", "mdf": "an MDF",
        "lvm": "a LabVIEW", "wav": "a WAV", "mcap": "an MCAP",
        "touchstone": "a Touchstone", "frd": "an FRD",
    }
)  # fmt: skip


def _matlab(file: BinaryIO) -> Recording:
    head = file.read(1024)
    file.seek(0)
    return (
        hdf5.open_file(file) if head.startswith((_MATLAB_7_3, _HDF5)) or head[512:520] == _HDF5 else mat.open_file(file)
    )


_READERS: Mapping[str, Callable[[BinaryIO], Recording]] = MappingProxyType(
    {
        "tdms": tdms.open_file,
        "mat": _matlab,
        "hdf5": hdf5.open_file,
        "parquet": parquet.open_file,
        "mdf": mdf.open_file,
        "wav": wav.open_file,
        "mcap": mcap.open_file,
        "touchstone": touchstone.open_file,
        "frd": touchstone.open_frd,
    }
)


def open_file(format_: str, file: BinaryIO, options: TableOptions) -> Recording:
    """Return what a file holds.

    Parameters
    ----------
    format_ : str
        ``csv``, ``txt`` or one of the containers.
    file : binary file
        Of the operating system: it is mapped or handed to libraries. It must stay open while the recording is read.
    options : TableOptions
        What is known of a text.

    Raises
    ------
    FormatError
        When it is no such file, or a damaged one; also while it is read.
    """
    size = file.seek(0, 2)
    with _understood(format_):
        found = _opened(format_, file, options)

    def read(wanted: Sequence[int]) -> Iterator[tuple[int, Values]]:
        with _understood(format_):
            claimed = sum(found.series[place].count or 0 for place in wanted)
            proportionate("the samples", 8 * claimed, size=size)
            yield from found.read(wanted)

    return replace(found, read=read, functions=[_guarded(format_, one) for one in found.functions])


def _opened(format_: str, file: BinaryIO, options: TableOptions) -> Recording:
    file.seek(0)
    if format_ == "lvm":
        return lvm.open_file(file, allow_truncated=options.allow_truncated)
    if format_ in TABLES:
        start = file.read(_HEAD).decode("utf-8", errors="replace")
        file.seek(0)
        if options.known.header_lines is None and scope.is_scope(start):
            return scope.open_file(file)
        return tables.open_file(file, options)
    found = (
        uff.open_file(file, allow_truncated=options.allow_truncated) if format_ == "uff" else _READERS[format_](file)
    )
    return found if options.over_time else spectral(found)


def _guarded(format_: str, function: SpectralFunction) -> SpectralFunction:
    def read() -> tuple[Any, Any]:
        with _understood(format_):
            return function.read()

    return replace(function, read=read)


@contextmanager
def _understood(format_: str) -> Iterator[None]:
    """Turn whatever a reader or its library throws at a damaged file into words; no list of exceptions is ever whole."""
    try:
        yield
    except (FormatError, MemoryError):
        raise
    except Exception as error:
        said = " ".join(str(error).split())[:200]
        raise FormatError(
            f"{_TITLES.get(format_, 'a text')} file must be complete and sound, got one that its reader does not understand "
            f"({type(error).__name__}{said and f': {said}'}): write it anew with what made it, or export it as text"
        ) from error
