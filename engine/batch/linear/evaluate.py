"""From the matrices of candidates to metrics of their responses to one command: balance, equations with the command, pieces, readings."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from engine.batch.linear.channels import Channels, work_space
from engine.batch.linear.compiled import allocating, compiled
from engine.batch.linear.ladder import LEVELS, Ladder, unit_of
from engine.batch.linear.march import follow
from engine.batch.linear.pieces import Pieces, Plan
from engine.batch.linear.primitives import Room
from engine.batch.linear.readings import Rest, Wanted, read
from engine.batch.linear.series import DEPTH, MOST_ROOTS, PARTS, SIZE
from engine.batch.linear.small_matrices import balance, solve

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]
Series = npt.NDArray[Any]

MOST_PIECES: Final = 6000
_CANCELLED: Final = 1e-13
_JUMPS: Final = 1e-9
_UNDECIDED: Final = 1e3


class Drive(NamedTuple):
    """The command: ``flow`` (w, w), ``drive`` (inputs, w), ``jumps`` (corners, w), largest ``sizes`` (w,), ``rate`` (rad/s).

    ``climbs`` says that it grows for ever.
    """

    flow: Real
    drive: Real
    jumps: Real
    sizes: Real
    rate: float
    climbs: int


class Delayed(NamedTuple):
    """What goes into delay channels and comes out, of each candidate.

    ``b2`` (B, n, m), ``c2`` (B, m, n), ``d12`` (B, O, m) to the outputs, ``d21`` (B, m, inputs), ``d22`` (B, m, m) and ``delays`` (B, m), s.
    """

    b2: Series
    c2: Series
    d12: Series
    d21: Series
    d22: Series
    delays: Series


class Watched(NamedTuple):
    """``outputs`` (R,): which; ``kinds`` (R,): 1 as it is, -1 reference minus output; ``orders`` (R,) derivatives; ``errors`` (R,) flags.

    ``reference`` (R, inputs) is added to those flagged.
    """

    outputs: Whole
    kinds: Real
    orders: Whole
    reference: Real
    errors: Whole


@compiled
def assemble(
    a: Series, b: Series, c: Series, d: Series, delayed: Delayed, candidate: int, drive: Drive, watched: Watched,
    channels: Channels, m: Series, rows: Series,
) -> None:  # fmt: skip
    """Write M, and the rows that are watched: of outputs, then of what goes into channels."""
    n, size, inputs = a.shape[0], m.shape[0], b.shape[1]
    for i in range(n):
        for j in range(n):
            m[i, j] = a[i, j]
        for j in range(n, size):
            total = 0.0 * a[0, 0]
            for k in range(inputs):
                total = total + b[i, k] * drive.drive[k, j - n]
            m[i, j] = total
    for i in range(n, size):
        for j in range(size):
            m[i, j] = 0.0 * a[0, 0] + (drive.flow[i - n, j - n] if j >= n else 0.0)
    own, count = channels.delays.shape[0], watched.kinds.shape[0]
    for j in range(own):
        channels.delays[j] = delayed.delays[candidate, j]
        for i in range(n):
            channels.drive[i, j] = delayed.b2[candidate, i, j]
        for r in range(count):
            channels.through[r, j] = watched.kinds[r] * delayed.d12[candidate, watched.outputs[r], j]
        for k in range(own):
            channels.through[count + k, j] = delayed.d22[candidate, k, j]
        for i in range(n):
            rows[count + j, i] = delayed.c2[candidate, j, i]
        for i in range(n, size):
            total = 0.0 * a[0, 0]
            for k in range(inputs):
                total = total + delayed.d21[candidate, j, k] * drive.drive[k, i - n]
            rows[count + j, i] = total
    for r in range(count):
        output = watched.outputs[r]
        for j in range(n):
            rows[r, j] = watched.kinds[r] * c[output, j]
        for j in range(n, size):
            total = 0.0 * a[0, 0]
            for k in range(inputs):
                share = watched.kinds[r] * d[output, k]
                if watched.errors[r]:
                    share = share + watched.reference[r, k]
                total = total + share * drive.drive[k, j - n]
            rows[r, j] = total


@compiled
def differentiate(
    m: Series, row: Series, through: Series, n: int, x0: Series, drive: Drive, channels: Channels, work: Series
) -> int:  # fmt: skip
    """Write row M over a row; 1 where what it watches jumps, -1 where that cannot be told, 0 where it does not."""
    size = row.shape[0]
    for j in range(through.shape[0]):
        if through[j] != 0.0:
            return -1
        for i in range(n):
            through[j] += row[i] * channels.drive[i, j]
    largest = 0.0
    for j in range(n, size):
        largest += abs(row[j].real) * drive.sizes[j - n]
    jump = 0.0
    for corner in range(drive.jumps.shape[0]):
        step = 0.0
        for j in range(n, size):
            step += row[j].real * drive.jumps[corner, j - n]
        jump = max(jump, abs(step))
    struck, terms = 0.0, 0.0
    for j in range(n):
        struck += row[j].real * x0[j].real
        terms += abs(row[j].real) * abs(x0[j].real)
    jump, largest = max(jump, abs(struck)), max(largest, terms)
    for j in range(size):
        total = 0.0 * row[0]
        for k in range(size):
            total = total + row[k] * m[k, j]
        work[j] = total
    for j in range(size):
        row[j] = work[j]
    if jump > _UNDECIDED * _JUMPS * largest:
        return 1
    return -1 if jump > _JUMPS * largest / _UNDECIDED else 0


@compiled
def _resting(
    plan: Plan, a: Series, m: Series, rows: Series, watched: Watched, channels: Channels, rest: Rest, rest_x: Series,
    work: Series, right: Series,
) -> bool:  # fmt: skip
    """Write where states and what is watched go under a command that settles; an error that is rounding is 0."""
    n, size, count, own = a.shape[0], m.shape[0], watched.kinds.shape[0], channels.delays.shape[0]
    whole = channels.closed
    for i in range(n):
        total = 0.0 * a[0, 0]
        for j in range(n, size):
            total = total - m[i, j] * plan.states[plan.last, j - n]
        right[i] = total
        for j in range(n):
            whole[i, j] = a[i, j]
        for j in range(own):
            whole[i, n + j] = channels.drive[i, j]
    for k in range(own):
        total = 0.0 * a[0, 0]
        for j in range(n, size):
            total = total - rows[count + k, j] * plan.states[plan.last, j - n]
        right[n + k] = total
        for j in range(n):
            whole[n + k, j] = rows[count + k, j]
        for j in range(own):
            whole[n + k, n + j] = channels.through[count + k, j] - (1.0 if j == k else 0.0)
    if not solve(whole, right[: n + own], work, rest_x):
        return False
    settle(plan, rows, watched, channels, rest, rest_x, n)
    return True


@compiled
def settle(
    plan: Plan, rows: Series, watched: Watched, channels: Channels, rest: Rest, rest_x: Series, n: int
) -> None:  # fmt: skip
    """Write where what is watched goes, of where states and delayed signals do; an error that is rounding is 0."""
    size, count, own = rows.shape[1], watched.kinds.shape[0], channels.delays.shape[0]
    for r in range(rows.shape[0]):
        total, terms = 0.0 * rest_x[0], 0.0
        for j in range(size):
            part = rows[r, j] * (rest_x[j] if j < n else plan.states[plan.last, j - n])
            total = total + part
            terms = max(terms, abs(part.real))
        for j in range(own):
            part = channels.through[r, j] * rest_x[n + j]
            total = total + part
            terms = max(terms, abs(part.real))
        if r < count and watched.orders[r] > 0:
            total = 0.0 * total
        elif r < count and watched.errors[r] and abs(total.real) <= _CANCELLED * terms:
            total = total - total.real
        rest.y[r] = total


@compiled
def _climbing(
    plan: Plan, a: Series, m: Series, rows: Series, rest: Rest, columns: Series, work: Series, right: Series
) -> None:  # fmt: skip
    """Write where errors go under a command that climbs for ever: x = P w behind its last corner, with A P = P S - B K."""
    n, size = a.shape[0], m.shape[0]
    corner = plan.times.shape[0] - 1
    for r in range(rows.shape[0]):
        rest.error[r] = 0.0 * a[0, 0]
    for j in range(n, size):
        for i in range(n):
            total = -m[i, j]
            for k in range(n, j):
                total = total + columns[k - n, i] * m[k, j]
            right[i] = total
        if not solve(a, right[:n], work, columns[j - n]):
            for r in range(rows.shape[0]):
                rest.error[r] = 0.0 * a[0, 0] + math.inf
            return
        moving = False
        for k in range(j + 1, size):
            moving = moving or (m[j, k].real != 0.0 and plan.states[corner, k - n] != 0.0)
        for r in range(rows.shape[0]):
            share, terms = rows[r, j], abs(rows[r, j].real)
            for i in range(n):
                part = rows[r, i] * columns[j - n, i]
                share = share + part
                terms = max(terms, abs(part.real))
            if not moving:
                rest.error[r] = rest.error[r] + share * plan.states[corner, j - n]
            elif abs(share.real) > _JUMPS * terms:
                rest.error[r] = rest.error[r] + math.nan
            elif abs(share.real) > _CANCELLED * terms:
                rest.error[r] = rest.error[r] + math.inf


@compiled
def _shared(unit: float, channels: Channels) -> float:
    """Return a unit, no longer, in pieces of which the shortest delay is whole: jumps come back at every one, and a wider piece holds none."""
    own = math.inf
    for j in range(channels.delays.shape[0]):
        own = min(own, channels.delays[j].real / PARTS)
    if own == math.inf or not 0.0 < unit < math.inf:
        return unit
    while own > unit:
        own *= 0.5
    return own


@compiled
def _struck(plan: Plan, b: Series, d21: Series, x0: Series) -> bool:
    """Write the states that impulses leave behind; whether none goes straight into a delay."""
    for i in range(x0.shape[0]):
        x0[i] = 0.0 * b[0, 0]
    for k in range(plan.impulses.shape[0]):
        if plan.impulses[k] != 0.0:
            for j in range(d21.shape[0]):
                if d21[j, k] != 0.0:
                    return False
            for i in range(x0.shape[0]):
                x0[i] += b[i, k] * plan.impulses[k]
    return True


@allocating
def evaluate(
    a: Series, b: Series, c: Series, d: Series, delayed: Delayed, plan: Plan, drive: Drive, watched: Watched,
    wanted: Wanted, ends: Real, values: Series, doubtful: npt.NDArray[np.bool_],
) -> None:  # fmt: skip
    """Enter the metrics of candidates.

    Parameters
    ----------
    a, b, c, d : ndarray, shapes (B, n, n), (B, n, inputs), (B, O, n), (B, O, inputs)
        Overwritten.
    ends : ndarray, shape (B,)
        Where to stop, s; infinite: at rest. NaN for what is not followed.
    values, doubtful : ndarray, shape (B, K)
        Written.
    """
    n, extra, own = a.shape[1], drive.flow.shape[0], delayed.delays.shape[1]
    seen = watched.kinds.shape[0]
    size, corners, count = n + extra, plan.times.shape[0], seen + own
    kind = a.dtype
    m, rows, x0 = np.zeros((size, size), kind), np.zeros((count, size), kind), np.zeros(n, kind)
    rest_x, work = np.zeros(n + own, kind), np.zeros((n + own, n + own + 1), kind)
    right = np.zeros(size + own + 1, kind)
    channels = work_space(own, n, count, right)
    columns = np.zeros((extra, n), kind)
    ladder = Ladder(
        np.zeros((LEVELS, size, size), kind), np.zeros((LEVELS, count, PARTS + 1, size), kind),
        np.zeros((LEVELS, count, SIZE, size), kind), np.zeros((4, size, size), kind), np.zeros((SIZE, size), kind),
    )  # fmt: skip
    pieces = Pieces(
        np.zeros(MOST_PIECES + 1), np.zeros(MOST_PIECES + 1, kind), np.zeros((count, MOST_PIECES, SIZE), kind), np.zeros((count, MOST_PIECES), kind),
        np.zeros(corners + 1, np.int64), np.zeros(count), np.zeros(count), np.zeros(n), np.zeros((count, SIZE), kind),
        np.zeros(size, kind), np.zeros(size + count + 32, kind), np.zeros((32, size), kind), np.zeros(3, np.int64),
        np.zeros(1),
    )  # fmt: skip
    room = Room(
        np.zeros((DEPTH + 4, SIZE + 2)), np.zeros(MOST_ROOTS), np.zeros(SIZE, kind), np.zeros(SIZE, kind),
        np.zeros((2, SIZE + 3), kind),
    )  # fmt: skip
    rest = Rest(np.zeros(count, kind), 1 if plan.last >= 0 else 0, np.zeros(count, kind), np.zeros(count, np.int64))
    for candidate in range(a.shape[0]):
        if math.isnan(ends[candidate]):
            continue
        for k in range(values.shape[1]):
            doubtful[candidate, k] = True
        flow = a[candidate]
        balance(flow, b[candidate], c[candidate], delayed.b2[candidate], delayed.c2[candidate])
        assemble(
            flow, b[candidate], c[candidate], d[candidate], delayed, candidate, drive, watched, channels, m, rows
        )  # fmt: skip
        unit = _shared(unit_of(flow, n, drive.rate), channels)
        if not _struck(plan, b[candidate], delayed.d21[candidate], x0) or not unit > 0.0 or unit == math.inf:
            continue
        for r in range(count):
            rest.open[r], rest.y[r], rest.error[r] = 0, 0.0 * flow[0, 0], 0.0 * flow[0, 0] + math.nan
            for k in range(plan.impulses.shape[0] if r < seen else 0):
                if plan.impulses[k] != 0.0 and d[candidate, watched.outputs[r], k] != 0.0:
                    rest.open[r] = -1
            for _ in range(watched.orders[r] if r < seen else 0):
                found = differentiate(m, rows[r], channels.through[r], n, x0, drive, channels, right)
                if rest.open[r] != 1 and found != 0:
                    rest.open[r] = found
        if plan.last >= 0 and not _resting(plan, flow, m, rows, watched, channels, rest, rest_x, work, right):
            continue
        if drive.climbs and own:  # where an error goes is left to the exact path
            for r in range(seen):
                rest.error[r] = 0.0 * flow[0, 0] + math.inf
        elif drive.climbs:
            _climbing(plan, flow, m, rows, rest, columns, work, right)
        found = follow(
            plan, ladder, pieces, channels, m, rows, x0, rest_x, rest.y, unit, n, ends[candidate], drive.jumps
        )  # fmt: skip
        if found > 0:
            read(wanted, rest, pieces, room, found, values[candidate], doubtful[candidate])
