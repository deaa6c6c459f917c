"""Whether a reader says that it takes all that a file has: what it passes over keeps the file."""

from __future__ import annotations

import io
from datetime import UTC, datetime, timedelta

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from asammdf import MDF, Signal

from api.formats.catalogue import open_file
from api.formats.text.tables import TableOptions
from tests.unit.api.test_rounded_values import mcap


def parquet(stamped):
    content = io.BytesIO()
    begin = datetime(2026, 1, 1, tzinfo=UTC)
    instants = [begin + timedelta(seconds=i) if stamped else float(i) for i in range(9)]
    pq.write_table(pa.table({"t": instants, "x": np.arange(9.0)}), content)
    return content.getvalue()


def labview(start):
    head = "LabVIEW Measurement\nSeparator\tTab\nDecimal_Separator\t.\nX_Columns\tNo\n***End_of_Header***\n"
    own = f"Channels\t1\nSamples\t9\nX0\t{start}\nDelta_X\t0.1\n***End_of_Header***\nX_Value\tx\tComment\n"
    return (head + own + "".join(f"\t{i}.5\n" for i in range(9))).encode()


def mdf(tmp_path, words):
    states = {"val_0": 0, "text_0": b"off", "val_1": 1, "text_1": b"on", "default": b""} if words else None
    with MDF(version="4.10") as file:
        instants = np.arange(9) / 10
        file.append([Signal(np.arange(9, dtype=np.uint8) % 2, instants, name="x", conversion=states)])
        return file.save(tmp_path / "bench.mf4").read_bytes()


CASES = {
    "stamps of Parquet": ("parquet", lambda _: parquet(stamped=True), False),
    "numbers of Parquet": ("parquet", lambda _: parquet(stamped=False), True),
    "LabVIEW from 0": ("lvm", lambda _: labview("0.0"), True),
    "LabVIEW from 5 s": ("lvm", lambda _: labview("5.0"), False),
    "states of MDF": ("mdf", lambda tmp_path: mdf(tmp_path, words=True), False),
    "numbers of MDF": ("mdf", lambda tmp_path: mdf(tmp_path, words=False), True),
    "messages": ("mcap", lambda _: mcap(), False),
    "a table": ("csv", lambda _: b"t,x\n" + b"".join(b"%d,%d.5\n" % (i, i) for i in range(9)), True),
}


@pytest.mark.parametrize("case", CASES)
def test_a_reader_says_whether_it_takes_everything(tmp_path, case):
    format_, make, complete = CASES[case]
    (tmp_path / "content").write_bytes(make(tmp_path))
    with (tmp_path / "content").open("rb") as file:
        found = open_file(format_, file, TableOptions())
        assert found.complete == complete
        found.close()


def test_a_row_that_was_left_out_is_not_everything(tmp_path):
    (tmp_path / "cut.csv").write_bytes(b"t,x\n" + b"".join(b"%d,%d.25\n" % (i, i) for i in range(20)) + b"20,2")
    with (tmp_path / "cut.csv").open("rb") as file:
        assert not open_file("csv", file, TableOptions(allow_truncated=True)).complete
