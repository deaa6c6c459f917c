"""Which reader opens a file of which format."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import BinaryIO

from api.formats import Recording, hdf5, lvm, mat, mdf, parquet, tables, tdms, uff
from api.formats.tables import TableOptions

_MATLAB_7_3 = b"MATLAB 7.3"
_HDF5 = b"\x89HDF\r\n\x1a\n"

TABLES = ("csv", "txt")
"""Formats whose layout may have to be said."""


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
        "uff": uff.open_file,
        "mdf": mdf.open_file,
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
        When it is no such file, or a damaged one.
    """
    file.seek(0)
    if format_ == "lvm":
        return lvm.open_file(file, allow_truncated=options.allow_truncated)
    return tables.open_file(file, options) if format_ in TABLES else _READERS[format_](file)
