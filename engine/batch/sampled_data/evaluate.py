"""From the periods of candidates to metrics of their responses to one command."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from engine.batch.linear.channels import Channels, work_space
from engine.batch.linear.evaluate import Delayed, Drive, Watched, assemble, differentiate, settle
from engine.batch.linear.ladder import Ladder
from engine.batch.linear.pieces import Pieces, Plan
from engine.batch.linear.primitives import Room, extreme
from engine.batch.linear.readings import Rest, Wanted, read
from engine.batch.linear.series import DEPTH, MOST_ROOTS, PARTS, SIZE, right_end, spread_of
from engine.batch.sampled_data.compiled import allocating, compiled
from engine.batch.sampled_data.maps import norm_of
from engine.batch.sampled_data.march import ANGLE, LEVELS, Beat, follow, prepare

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]
Series = npt.NDArray[Any]

MOST_PIECES: Final = 100_000
_NEAR: Final = 1e-3
_BETWEEN: Final = 0.1
"""A run whose last tenth stays within this part of its range of rest has settled; this much nearer or further there is no doubt."""
_GONE: Final = 5e-3
"""Of its largest distance from rest: what is left of each state in the end of a run that has settled."""


class Ends(NamedTuple):
    """What a run that ends after a time tells of each metric, (K,): ``plain`` is the row of its output as it is, watched for rest.

    ``relative`` flags those that look at where the output settles, ``refused`` those that have no value where it has not; ``last`` is when
    the commands change for the last time, s.
    """

    plain: Whole
    relative: Whole
    refused: Whole
    last: float


@compiled
def _settled(pieces: Pieces, room: Room, rest: Rest, r: int, count: int, last: float, n: int) -> int:
    """Return whether a row has settled in a run: 1, 0, or -1 where that is not clear."""
    end = pieces.times[count]
    if end <= last:
        return -1
    seen = max(last, 0.1 * last + 0.9 * end)
    high, _, one = extreme(pieces, room, r, 0, count, 1.0)
    low, _, two = extreme(pieces, room, r, 0, count, -1.0)
    size = (high + low).real
    if one == 2.0 or two == 2.0 or not size > 0.0:
        return -1
    upper, lower = 0.0, 0.0
    for p in range(count - 1, -1, -1):
        if pieces.times[p + 1] <= seen:
            break
        series = pieces.series[r, p]
        away = (pieces.base[r, p] - rest.y[r]).real
        upper = max(upper, abs(away + series[0].real) + spread_of(series))
        lower = max(lower, abs(away + right_end(series).real))
    if lower > (1.0 + _BETWEEN) * _NEAR * size:
        return 0
    gone = upper < (1.0 - _BETWEEN) * _NEAR * size
    for i in range(n):
        gone = gone and abs(pieces.state[i].real) <= _GONE * pieces.largest[i]
    return 1 if gone else -1


@compiled
def _read_of_run(
    wanted: Wanted, ends: Ends, rest: Rest, pieces: Pieces, room: Room, count: int, values: Series, doubtful: Flags,
    settled: Whole, at_rest: Series, n: int, known: bool,
) -> None:  # fmt: skip
    """Enter the metrics of a run that ends after a time: of who has not settled in it, its last value stands for where it settles."""
    for r in range(settled.shape[0]):
        settled[r], at_rest[r] = 2, rest.y[r]
    for k in range(wanted.codes.shape[0]):
        plain = ends.plain[k]
        if (ends.relative[k] or ends.refused[k]) and settled[plain] == 2:
            settled[plain] = _settled(pieces, room, rest, plain, count, ends.last, n) if known else -1
    for r in range(settled.shape[0]):
        for k in range(wanted.codes.shape[0]):
            if wanted.row[k] == r and ends.relative[k] and settled[ends.plain[k]] == 0:
                rest.y[r] = pieces.base[r, count - 1] + right_end(pieces.series[r, count - 1])
    read(wanted, rest, pieces, room, count, values, doubtful)
    for k in range(wanted.codes.shape[0]):
        if not (ends.relative[k] or ends.refused[k]):
            continue
        if settled[ends.plain[k]] == -1:
            doubtful[k] = True
        elif settled[ends.plain[k]] == 0 and ends.refused[k]:
            values[k], doubtful[k] = math.nan * values[k], False
    for r in range(settled.shape[0]):
        rest.y[r] = at_rest[r]


@compiled
def _enter(entering: Series, drive: Drive, enters: Series) -> None:
    """Write by what the command's states enter at each instant, (g, n, w), from what its inputs do, (g, n, inputs)."""
    for instant in range(enters.shape[0]):
        for i in range(enters.shape[1]):
            for j in range(enters.shape[2]):
                total = 0.0 * entering[instant, i, 0]
                for k in range(drive.drive.shape[0]):
                    total = total + entering[instant, i, k] * drive.drive[k, j]
                enters[instant, i, j] = total


@compiled
def _differentiate(
    m: Series, rows: Series, watched: Watched, channels: Channels, drive: Drive, moved: Flags, room: tuple[Series, Series], rest: Rest
) -> None:  # fmt: skip
    """Make the rows of what is watched those of its rates; what jumps has none."""
    n = moved.shape[0]
    for r in range(rows.shape[0]):
        rest.open[r], rest.y[r], rest.error[r] = 0, 0.0 * m[0, 0], math.nan + 0.0 * m[0, 0]
        for _ in range(watched.orders[r]):
            for i in range(n):
                if moved[i] and rows[r, i] != 0.0:
                    rest.open[r] = -1
            found = differentiate(m, rows[r], channels.through[r], n, room[0], drive, channels, room[1])
            if rest.open[r] != 1 and found != 0:
                rest.open[r] = found


@allocating
def evaluate(
    flow: Series, driven: Series, seen: Series, through: Series, jumps: Series, entering: Series, rests: Series,
    known: Flags, limits: Series, timing: Beat, plan: Plan, drive: Drive, watched: Watched, wanted: Wanted, ends: Ends, until: float, moved: Flags,
    values: Series, doubtful: Flags,
) -> None:  # fmt: skip
    """Enter the metrics of candidates.

    Parameters
    ----------
    flow, driven, seen, through : ndarray, shapes (B, n, n), (B, n, inputs), (B, O, n), (B, O, inputs)
    jumps, entering : ndarray, shapes (B, g, n, n), (B, g, n, inputs)
    rests : ndarray, shape (B, n)
        States at rest; NaN for what is not followed.
    known : ndarray of bool, shape (B,)
        Whether the states at rest are those to which a run goes.
    limits : ndarray, shape (B, L, 4)
    timing : Beat
        Of all; its ``jumps``, ``entering`` and ``limits`` are those of nobody.
    until : float
        Where to stop, s; infinite: at rest.
    moved : ndarray of bool, shape (n,)
        Which states jump.
    values, doubtful : ndarray, shape (B, K)
        Written.
    """
    n, extra, count, kind = flow.shape[1], drive.flow.shape[0], watched.kinds.shape[0], flow.dtype
    size, corners, widths, g = n + extra, plan.times.shape[0], timing.widths.shape[0], timing.instants.shape[0]
    m, rows = np.zeros((size, size), kind), np.zeros((count, size), kind)
    right, struck = np.zeros(size + 1, kind), np.zeros(n, kind)
    channels = work_space(0, n, count, right)
    none = Delayed(
        np.zeros((1, n, 0), kind), np.zeros((1, 0, n), kind), np.zeros((1, seen.shape[1], 0), kind),
        np.zeros((1, 0, driven.shape[2]), kind), np.zeros((1, 0, 0), kind), np.zeros((1, 0), kind),
    )  # fmt: skip
    ladders = Ladder(
        np.zeros((widths, LEVELS, size, size), kind), np.zeros((widths, LEVELS, count, PARTS + 1, size), kind),
        np.zeros((widths, LEVELS, count, SIZE, size), kind), np.zeros((1, 4, size, size), kind), np.zeros((1, SIZE, size), kind),
    )  # fmt: skip
    pieces = Pieces(
        np.empty(MOST_PIECES + 1), np.zeros(MOST_PIECES + 1, kind), np.empty((count, MOST_PIECES, SIZE), kind),
        np.empty((count, MOST_PIECES), kind), np.zeros(corners + 1, np.int64), np.zeros(count), np.zeros(count), np.zeros(n),
        np.zeros((count, SIZE), kind), np.zeros(size, kind), np.zeros(size + count + 32, kind), np.zeros((32, size), kind),
        np.zeros(3, np.int64), np.zeros(1),
    )  # fmt: skip
    room = Room(
        np.zeros((DEPTH + 4, SIZE + 2)), np.zeros(MOST_ROOTS), np.zeros(SIZE, kind), np.zeros(SIZE, kind),
        np.zeros((2, SIZE + 3), kind),
    )  # fmt: skip
    rest = Rest(np.zeros(count, kind), 1 if plan.last >= 0 else 0, np.zeros(count, kind), np.zeros(count, np.int64))
    enters, settled, at_rest = np.zeros((g, n, extra), kind), np.zeros(count, np.int64), np.zeros(count, kind)
    for candidate in range(flow.shape[0]):
        if math.isnan(rests[candidate, 0].real):
            continue
        assemble(
            flow[candidate], driven[candidate], seen[candidate], through[candidate], none, 0, drive, watched, channels, m, rows
        )  # fmt: skip
        _enter(entering[candidate], drive, enters)
        _differentiate(m, rows, watched, channels, drive, moved, (struck, right), rest)
        if plan.last >= 0:
            settle(plan, rows, watched, channels, rest, rests[candidate], n)
        beat = Beat(
            timing.instants, timing.widths, timing.kinds, timing.length, timing.flowing, jumps[candidate], enters, timing.rows,
            timing.levels, timing.counts, timing.sizes, timing.limited, timing.bounded, limits[candidate],
        )  # fmt: skip
        fastest = max(norm_of(m, timing.flowing), drive.rate)
        unit = min(ANGLE / fastest, timing.length) if fastest > 0.0 else timing.length
        if not prepare(beat, ladders, m, rows, drive.rate):
            continue
        found = follow(
            plan, beat, ladders, pieces, channels, m, rows, rests[candidate], rest.y, unit, until
        )  # fmt: skip
        if found <= 0:
            continue
        if until < math.inf:
            _read_of_run(
                wanted, ends, rest, pieces, room, found, values[candidate], doubtful[candidate], settled, at_rest, n,
                known[candidate],
            )  # fmt: skip
        else:
            read(wanted, rest, pieces, room, found, values[candidate], doubtful[candidate])
