"""Which format a file has, told by its first bytes and, where they do not tell, by the ending of its name."""

from __future__ import annotations

import codecs
import re
from collections.abc import Callable, Mapping
from pathlib import PurePath
from types import MappingProxyType
from typing import Final

from api.formats import FormatError
from api.formats.mat4 import is_version_4

HEAD = 1 << 16
"""First bytes that are looked at."""

_HDF5 = b"\x89HDF\r\n\x1a\n"
_BLOCKS_OF_HDF5 = (0, 512, 1024, 2048)
_CONTROLS = frozenset(range(32)) - frozenset(b"\t\n\r\f\x1a")
"""Bytes that no text has; a table that DOS ended has 0x1a."""

_ENDINGS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "csv": "csv", "tsv": "csv", "asc": "csv", "dat": "csv", "txt": "txt", "lvm": "lvm", "tdms": "tdms", "mat": "mat",
        "h5": "hdf5", "hdf5": "hdf5", "hdf": "hdf5", "parquet": "parquet", "uff": "uff", "unv": "uff", "mdf": "mdf",
        "mf4": "mdf", "wav": "wav", "wave": "wav", "rf64": "wav", "mcap": "mcap", "frd": "frd",
        "ts": "touchstone",
    }
)  # fmt: skip


_PORTS: Final = re.compile(r"s\d+p")
_TEXTS: Final = frozenset({"csv", "txt", "touchstone", "frd"})
"""Formats that only the name tells from other text."""


def _is_hdf5(head: bytes) -> bool:
    return any(head[at : at + len(_HDF5)] == _HDF5 for at in _BLOCKS_OF_HDF5)


_TELLING: Final[tuple[tuple[str, Callable[[bytes], bool]], ...]] = (
    ("mat", lambda head: head.startswith((b"MATLAB 5.0", b"MATLAB 7.3"))),
    ("hdf5", _is_hdf5),
    ("tdms", lambda head: head.startswith(b"TDSm")),
    ("mdf", lambda head: head.startswith((b"MDF  ", b"UnFinMF"))),
    ("wav", lambda head: head[:4] in {b"RIFF", b"RF64"} and head[8:12] == b"WAVE"),
    ("mcap", lambda head: head.startswith(b"\x89MCAP")),
    ("parquet", lambda head: head.startswith(b"PAR1")),
    ("lvm", lambda head: head.removeprefix(codecs.BOM_UTF8).startswith(b"LabVIEW Measurement")),
    ("mat", is_version_4),  # which its reader refuses, with what to do
    ("uff", lambda head: re.match(rb"    -1[ \t]*\r?\n\s*\d{1,5}b?\b", head) is not None),
)
"""First the more special: a MATLAB 7.3 file is an HDF5 file."""

_OTHERS: Final[tuple[tuple[bytes, str], ...]] = (
    (
        b"PK\x03\x04",
        "an archive or a spreadsheet: send what is in it, saved as CSV (TIA exports a measurement, .ttrecx, as CSV, too)",
    ),
    (b"\xd0\xcf\x11\xe0", "a document of an office program: save its table as CSV"),
    (b"\x1f\x8b", "compressed by gzip: send what is in it"),
    (b"%PDF", "a PDF document: send the file that it was printed from"),
    (b"TDSh", "the index of a TDMS file: send the file beside it"),
)


def recognised(head: bytes, name: str = "") -> tuple[str, str]:
    r"""Return the format of a file, and what tells it.

    Parameters
    ----------
    head : bytes
        Its beginning, at least 4 kB where it has so many.
    name : str
        Its name, or "".

    Raises
    ------
    FormatError
        When nothing tells it, with the formats to choose from.

    Examples
    --------
    >>> recognised(b"TDSm....", "run 7")
    ('tdms', 'its first bytes')
    >>> recognised(b"t;x\n0;1,5\n", "run 7.txt")
    ('txt', 'its first bytes, which are text, and its name')
    """
    suffix = PurePath(name).suffix.lower().removeprefix(".")
    ending = "touchstone" if _PORTS.fullmatch(suffix) else _ENDINGS.get(suffix)
    for format_, tells in _TELLING:
        if tells(head):
            if format_ == "hdf5" and ending == "mat":
                return "mat", "its first bytes and its name"
            return format_, "its first bytes"
    known = ", ".join(sorted({*_ENDINGS.values(), "touchstone"}))
    for magic, what in _OTHERS:
        if head.startswith(magic):
            raise FormatError(f"file must be of one of the formats {known}, it is {what}")
    if _is_text(head):
        text = ending if ending in _TEXTS else "csv"
        return text, f"its first bytes, which are text{', and its name' if text == ending else ''}"
    if ending == "mat":
        return "mat", "its name"
    raise FormatError(f"format must be given: neither the first bytes nor the name tell it; say one of: {known}")


def _is_text(head: bytes) -> bool:
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return True
    return bool(head.strip()) and not any(byte in _CONTROLS for byte in head)
