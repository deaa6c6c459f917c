"""Formats told from first bytes and names: the writers' own files, and what is none of them."""

from __future__ import annotations

import doctest
import io
import struct
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
from nptdms import ChannelObject, TdmsWriter

import api.formats.recognise
from api.formats import FormatError
from api.formats.catalogue import open_file
from api.formats.recognise import HEAD, recognised
from api.formats.text.tables import TableOptions

DATA = Path(__file__).parents[3] / "examples" / "data"


def made(format_):
    target = io.BytesIO()
    if format_ == "hdf5":
        with h5py.File(target, "w") as file:
            file["x"] = np.arange(9.0)
    elif format_ == "hdf5 behind a user block":
        with h5py.File(target, "w", userblock_size=512) as file:
            file["x"] = np.arange(9.0)
    elif format_ == "mat":
        scipy.io.savemat(target, {"x": np.arange(9.0)})
    elif format_ == "mat 4":
        scipy.io.savemat(target, {"x": np.arange(9.0)}, format="4")
    elif format_ == "tdms":
        with TdmsWriter(target) as writer:
            writer.write_segment([ChannelObject("g", "x", np.arange(9.0))])
    elif format_ == "parquet":
        pq.write_table(pa.table({"x": np.arange(9.0)}), target)
    return target.getvalue()


@pytest.mark.parametrize("name", ["", "run 7", "run.dat", "wrong.csv"])
@pytest.mark.parametrize("format_", ["hdf5", "hdf5 behind a user block", "mat", "mat 4", "tdms", "parquet"])
def test_the_first_bytes_tell_whatever_the_name(format_, name):
    assert recognised(made(format_)[:HEAD], name) == (format_.partition(" ")[0], "its first bytes")


def test_matlab_4_is_refused_as_what_it_is_with_what_to_do(tmp_path):
    little = made("mat 4")
    kind, *numbers = struct.unpack("<5i", little[:20])
    big = struct.pack(">5i", 1000 + kind, *numbers) + little[20:]
    for content in (little, big):
        (tmp_path / "old.mat").write_bytes(content)
        with (
            (tmp_path / "old.mat").open("rb") as file,
            pytest.raises(FormatError, match=r"of version 4: .* save it with -v7"),
        ):
            open_file("mat", file, TableOptions())


def test_where_both_tell_or_the_name_alone():
    assert recognised(made("hdf5"), "v.mat") == ("mat", "its first bytes and its name")
    assert recognised(b"\0" * 200, "V.MAT") == ("mat", "its name")
    assert recognised(b"t;x\n0;1\n", "a.tsv") == ("csv", "its first bytes, which are text, and its name")
    assert recognised("t;Länge\n0;1\n".encode("utf-16"), "") == ("csv", "its first bytes, which are text")
    assert recognised(b"-1\n58\n-1\n", "") == ("csv", "its first bytes, which are text")


@pytest.mark.parametrize(
    "path", sorted(path for path in DATA.rglob("*") if path.suffix in {".lvm", ".uff", ".csv", ".txt"})
)
def test_the_recordings_among_the_examples(path):
    with path.open("rb") as file:
        assert recognised(file.read(HEAD), path.name)[0] == path.suffix[1:]


@pytest.mark.parametrize(
    ("head", "said"),
    [
        (b"PK\x03\x04....", "csv, frd, .* it is an archive or a spreadsheet: send what is in it, saved as CSV"),
        (b"\x1f\x8b....", "compressed by gzip"),
        (b"TDSh....", "the index of a TDMS file"),
        (
            b"\x89PNG\r\n\x1a\n\x00",
            "format must be given: .* say one of: csv, frd, hdf5, lvm, mat, mcap, mdf, parquet, tdms, touchstone, txt, uff, wav",
        ),
        (b"", "format must be given"),
        (b"\x00" * 64, "format must be given"),
    ],
)
def test_what_cannot_be_told_is_refused_with_the_formats(head, said):
    with pytest.raises(FormatError, match=said):
        recognised(head, "x.csv")


def test_the_examples_in_the_documentation_run():
    assert doctest.testmod(api.formats.recognise).failed == 0
