"""Samples of recorded channels, and a pyramid of minima and maxima that makes a plot of any length cheap.

Level 0 holds the samples x[i]; level k >= 1 holds for each cell c the extremes over 16**k samples::

    low_k[c] = min x[i],  high_k[c] = max x[i],   c 16**k <= i < (c+1) 16**k

A level exists when the one below has at least 16 cells. Missing samples (NaN) are passed over.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Row, Select, delete, insert, select
from sqlalchemy.orm import Session

from storage.blobs import PLACE, Packed, encoded, packed, put_packed, without_those_kept
from storage.errors import NotFoundError
from storage.models import Blob, BlobChunk, ChannelBlock
from storage.packing import decode
from storage.postgres import in_pieces

#: Cells of one level that are joined to one cell of the next.
FACTOR = 16
#: Cells in one block, the unit of reading; as one chunk of its blob.
BLOCK = 32768
#: Blocks that are written together, each of 256 or 512 KiB before compression.
BATCH = 64
#: Blocks that are in memory at a time while a channel is read.
_AHEAD = 8

Float = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Envelope:
    """The extremes of consecutive stretches of a channel; ``index`` (n,) is the first sample of each."""

    index: NDArray[np.int64]
    minimum: Float
    maximum: Float


def write_channels(session: Session, dataset_id: str, blocks: Iterable[Float], *, channel_count: int) -> int:
    """Keep the samples of all channels, in place of any that were there, and return how many each channel has.

    Parameters
    ----------
    blocks : iterable of array (n, channel_count)
        The recording, piece after piece.

    Raises
    ------
    ValueError
        When a piece has another number of columns.
    """
    session.execute(delete(ChannelBlock).where(ChannelBlock.dataset_id == dataset_id))

    waiting: list[tuple[dict[str, Any], Packed]] = []

    def put(channel: int, level: int, number: int, cells: Float) -> None:
        place = {"dataset_id": dataset_id, "channel": channel, "level": level, "number": number}
        waiting.append((place, packed(cells.tobytes(), itemsize=8)))
        if len(waiting) >= BATCH:
            write()

    def write() -> None:
        write_blocks(session, waiting, without_those_kept(session, [content for _, content in waiting]))
        waiting.clear()

    cutters = [ChannelCutter(channel, put) for channel in range(channel_count)]
    count = 0
    for block in blocks:
        if block.ndim != 2 or block.shape[1] != channel_count:
            raise ValueError(f"a block of samples must be (n, {channel_count}), got {block.shape}")
        for cutter, column in zip(cutters, np.asarray(block, dtype=np.float64).T, strict=True):
            cutter.add(column)
        count += len(block)
    for cutter in cutters:
        cutter.close()
    write()
    return count


def write_blocks(session: Session, blocks: Sequence[tuple[dict[str, Any], Packed]], contents: Sequence[Packed]) -> None:
    """Write blocks (their places and contents) whose contents are ready to be kept."""
    put_packed(session, contents)
    rows = [{**place, "sha256": content.sha256} for place, content in blocks]
    if rows:
        session.execute(insert(ChannelBlock), rows)


Put = Callable[[int, int, int, Float], None]
"""Keeps block ``number`` of one level of one channel: cells (1, n) of samples or (2, n) of extremes."""


class ChannelCutter:
    """Cuts one channel into blocks, level by level, while it streams in."""

    def __init__(self, channel: int, put: Put) -> None:
        self.count = 0
        self._channel = channel
        self._put = put
        # of each level: the cells that do not fill a block yet, their number, and the blocks that are put
        self._blocks: list[Float] = []
        self._filled: list[int] = []
        self._numbers: list[int] = []

    def add(self, samples: Float) -> None:
        """Append samples (n,)."""
        self.count += samples.size
        self._append(0, samples[np.newaxis])

    def close(self) -> None:
        """Put the blocks that are not full."""
        level = 0
        while level < len(self._blocks):
            filled = self._filled[level]
            if filled:
                self._put_block(level, self._blocks[level][:, :filled])
            level += 1

    def _append(self, level: int, cells: Float) -> None:
        if level == len(self._blocks):
            self._blocks.append(np.empty((len(cells), BLOCK)))
            self._filled.append(0)
            self._numbers.append(0)
        block = self._blocks[level]
        start = 0
        while start < cells.shape[1]:
            filled = self._filled[level]
            taken = min(BLOCK - filled, cells.shape[1] - start)
            block[:, filled : filled + taken] = cells[:, start : start + taken]
            self._filled[level] = filled + taken
            start += taken
            if self._filled[level] == BLOCK:
                self._put_block(level, block)

    def _put_block(self, level: int, cells: Float) -> None:
        """Put a block, and hand its extremes on; a block is a whole number of the next level's cells, but for the last."""
        number = self._numbers[level]
        self._numbers[level] += 1
        self._filled[level] = 0
        self._put(self._channel, level, number, cells.copy())
        if number or cells.shape[1] >= FACTOR:
            self._append(level + 1, _coarser(cells))


def _coarser(cells: Float) -> Float:
    """Return the extremes (2, m) of each `FACTOR` cells; the last stretch may be shorter."""
    whole = cells.shape[1] // FACTOR * FACTOR
    # sample after sample of all stretches at once: three times as fast as stretch after stretch
    columns = np.ascontiguousarray(cells[:, :whole].reshape(len(cells), -1, FACTOR).transpose(0, 2, 1))
    parts = [np.stack([np.fmin.reduce(columns[0]), np.fmax.reduce(columns[-1])])] if whole else []
    if whole < cells.shape[1]:
        parts.append(_extremes(cells[:, np.newaxis, whole:]))
    return np.concatenate(parts, axis=1)


class ChannelReader:
    """Reads one channel of ``count`` samples, fetching no more blocks than it needs."""

    def __init__(self, session: Session, dataset_id: str, channel: int, *, count: int) -> None:
        self._session = session
        self._dataset_id = dataset_id
        self._channel = channel
        self._count = count

    def samples(self, start: int, stop: int) -> Float:
        """Return the samples start <= i < stop as recorded, shape (stop - start,)."""
        self._check(start, stop)
        samples: Float = self._read(0, start, stop)[0]
        return samples

    def envelope(self, start: int, stop: int, *, points: int) -> Envelope:
        """Return the extremes of at most ``points`` (>= 1) stretches that cover start <= i < stop.

        Several stretches begin at multiples of their length, so that they stay where they are while a plot is moved.
        """
        self._check(start, stop)
        if points < 1:
            raise ValueError(f"points must be >= 1, got {points}")
        if points == 1 and start < stop:
            low, high = self._extremes_of(self._level_for(stop - start), start, stop)
            return Envelope(index=np.array([start]), minimum=np.array([low]), maximum=np.array([high]))
        width = max(1, -(-(stop - start) // max(points - 1, 1)))
        level = self._level_for(width)
        cell = FACTOR**level
        width = -(-width // cell) * cell
        edges = np.arange(start // width, -(-stop // width) + 1) * width
        edges = np.clip(edges, start, stop)
        extremes = np.empty((2, len(edges) - 1))
        whole = slice(int(edges[0] % width != 0), len(edges) - 1 - int(edges[-1] % width != 0))
        if whole.start < whole.stop:
            cells = self._read(level, int(edges[whole.start]) // cell, int(edges[whole.stop]) // cell)
            extremes[:, whole] = _extremes(cells.reshape(len(cells), -1, width // cell))
        for partial in {*range(whole.start), *range(max(whole.stop, 0), len(edges) - 1)}:
            extremes[:, partial] = self._extremes_of(level, int(edges[partial]), int(edges[partial + 1]))
        return Envelope(index=edges[:-1], minimum=extremes[0], maximum=extremes[1])

    def _extremes_of(self, level: int, start: int, stop: int) -> Float:
        """Return (low, high) over start <= i < stop: whole cells of this level, and of lower ones for the ends."""
        cell = FACTOR**level
        first, last = -(-start // cell), stop // cell
        if level == 0 or first >= last:
            return self._extremes_of(level - 1, start, stop) if level else _extremes(self._read(0, start, stop))
        parts = [_extremes(self._read(level, first, last))]
        if start < first * cell:
            parts.append(self._extremes_of(level - 1, start, first * cell))
        if last * cell < stop:
            parts.append(self._extremes_of(level - 1, last * cell, stop))
        low, high = np.stack(parts, axis=1)
        return np.array([np.fmin.reduce(low), np.fmax.reduce(high)])

    def _level_for(self, width: int) -> int:
        """Return the highest level that exists and whose cells are not longer than ``width`` samples."""
        level, cells = 0, self._count
        while cells >= FACTOR and FACTOR ** (level + 1) <= width:
            level, cells = level + 1, -(-cells // FACTOR)
        return level

    def _read(self, level: int, first: int, last: int) -> Float:
        """Return the cells first <= c < last of a level, (1, n) samples or (2, n) extremes."""
        rows = 2 if level else 1
        cells = np.empty((rows, last - first))
        if first == last:
            return cells
        wanted = (
            select(ChannelBlock.number.label("block"), Blob.size, *PLACE)
            .join(Blob, Blob.sha256 == ChannelBlock.sha256)
            .join(BlobChunk, BlobChunk.sha256 == ChannelBlock.sha256)
            .where(
                ChannelBlock.dataset_id == self._dataset_id,
                ChannelBlock.channel == self._channel,
                ChannelBlock.level == level,
                ChannelBlock.number.between(first // BLOCK, (last - 1) // BLOCK),
            )
            .order_by(ChannelBlock.number)
        )
        end = first
        for row, data in self._contents(wanted):
            offset = row.block * BLOCK
            block = np.frombuffer(decode(row.encoding, data, row.size), dtype=np.float64).reshape(rows, -1)
            if not offset <= end < offset + block.shape[1]:
                continue  # one before it is missing, as is told below
            stop = min(offset + block.shape[1], last)
            cells[:, end - first : stop - first] = block[:, end - offset : stop - offset]
            end = stop
        if end < last:
            place = f"channel {self._channel}, level {level}, cell {end}"
            raise NotFoundError("block of", f"{self._dataset_id}, {place}")
        return cells

    def _contents(self, wanted: Select[*tuple[Any, ...]]) -> Iterator[tuple[Row[*tuple[Any, ...]], bytes]]:
        """Give the rows of blocks with their bytes as they are kept, some in memory at a time."""
        with closing(in_pieces(self._session, wanted, size=_AHEAD)) as found:
            while some := list(islice(found, _AHEAD)):
                yield from zip(some, encoded(self._session, some), strict=True)

    def _check(self, start: int, stop: int) -> None:
        if not 0 <= start <= stop <= self._count:
            raise ValueError(f"start and stop must be in order within 0 ... {self._count}, got {start}, {stop}")


def _extremes(cells: Float) -> Float:
    """Return the lows and highs (2, ...) over the last axis; the first axis holds values, or lows and highs."""
    return np.stack([np.fmin.reduce(cells[0], axis=-1), np.fmax.reduce(cells[-1], axis=-1)])
