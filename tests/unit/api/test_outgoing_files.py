"""Files on their way out: also one that is complete before it is sent gives the thread back in between."""

from __future__ import annotations

import io

import h5py
import numpy as np

from api.formats import Values
from api.formats.writing import PIECE, Column, Outgoing, hdf5

SAMPLES = np.sin(np.arange(3 * PIECE + 5.0))


def test_hdf5_holds_its_thread_for_a_piece_at_a_time() -> None:
    """It held it until all was written: some forty exports kept everybody waiting, and went on without whoever asked."""
    reads = []

    def read(channel: int, start: int, stop: int) -> Values:
        reads.append((channel, start))
        return np.asarray((channel + 1) * SAMPLES[start:stop])

    outgoing = Outgoing(
        name="x", columns=[Column(name="a"), Column(name="b")], sample_rate=10.0,
        instants=lambda start, stop: np.arange(start, stop) / 10.0, start_time="", count=SAMPLES.size, read=read,
    )  # fmt: skip
    pieces = hdf5.write(outgoing)
    first = next(pieces)
    assert (first, reads) == (b"", [(0, 0)])
    content = first + b"".join(pieces)
    assert len(reads) == 8
    with h5py.File(io.BytesIO(content)) as file:
        np.testing.assert_array_equal(file["a"][:], SAMPLES)
        np.testing.assert_array_equal(file["b"][:], 2 * SAMPLES)
