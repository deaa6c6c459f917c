"""Instants at which a derivative jumps, because a jump of the command has come around through delays (breaking points)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from engine.batch.linear.channel_maps import SMOOTH
from engine.batch.linear.channels import SAME, Channels, first_at, piece_at
from engine.batch.linear.compiled import compiled
from engine.batch.linear.series import SIZE, value_at

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]
Series = npt.NDArray[Any]


@compiled
def announce(channels: Channels, instant: Any, round_: Whole, inflow: int, order: int) -> bool:
    """Enter an instant at which derivatives of what goes into channels jump, ``round_`` (m,); False where there is no place left.

    ``inflow`` is the channel that brings it and ``order`` the derivative of what arrives that jumps.
    """
    own, count = channels.delays.shape[0], channels.waiting[0]
    near = SAME * abs(instant.real)
    place = count
    while place > 0 and channels.kinks[place - 1].real > instant.real - near:
        place -= 1
    if place < count and abs(channels.kinks[place].real - instant.real) <= near:
        rough = order <= 1
        for k in range(own):
            rough = rough or channels.jumps[place, 1, k] <= 1
        if rough and channels.kinks[place].imag != instant.imag:
            return False  # two jumps at one instant that move apart
        for k in range(own):
            channels.jumps[place, 0, k] = min(channels.jumps[place, 0, k], round_[k])
        channels.jumps[place, 1, inflow] = min(channels.jumps[place, 1, inflow], order)
        return True
    if count == channels.kinks.shape[0]:
        return False
    for i in range(count, place, -1):
        channels.kinks[i] = channels.kinks[i - 1]
        for k in range(own):
            channels.jumps[i, 0, k] = channels.jumps[i - 1, 0, k]
            channels.jumps[i, 1, k] = channels.jumps[i - 1, 1, k]
    channels.kinks[place] = instant
    for k in range(own):
        channels.jumps[place, 0, k], channels.jumps[place, 1, k] = round_[k], SMOOTH
    channels.jumps[place, 1, inflow] = order
    channels.waiting[0] = count + 1
    return True


@compiled
def go_on(channels: Channels, instant: Any, went_in: Whole, round_: Whole) -> bool:
    """Announce where jumps of derivatives ``went_in`` (m,) of what goes into channels at an instant come out."""
    own = channels.delays.shape[0]
    for j in range(own):
        if went_in[j] >= SMOOTH:
            continue
        for k in range(own):
            round_[k] = min(SMOOTH, went_in[j] + channels.order[k, j])
        if not announce(channels, instant + channels.delays[j], round_, j, went_in[j]):
            return False
    return True


@compiled
def _went_in(times: Real, series: Series, base: Series, count: int, instant: float, near: float, right: bool) -> float:
    """Return what went into a channel at an instant; ``right``: behind it where it jumps."""
    piece = piece_at(times, count, first_at(times, count, instant - near), instant, near, right)
    u = 2.0 * (instant - times[piece]) / (times[piece + 1] - times[piece]) - 1.0
    return (value_at(series[piece], SIZE, u) + base[piece]).real  # type: ignore[no-any-return]


@compiled
def bends(channels: Channels) -> bool:
    """Whether a slope of what is watched may jump at the earliest instant."""
    found = False
    for k in range(channels.delays.shape[0]):
        found = found or channels.jumps[0, 1, k] <= 1
    return found


@compiled
def forget(channels: Channels) -> None:
    """Drop the earliest instant."""
    own, count = channels.delays.shape[0], channels.waiting[0] - 1
    for i in range(count):
        channels.kinks[i] = channels.kinks[i + 1]
        for k in range(own):
            channels.jumps[i, 0, k] = channels.jumps[i + 1, 0, k]
            channels.jumps[i, 1, k] = channels.jumps[i + 1, 1, k]
    channels.waiting[0] = count


@compiled
def strike(channels: Channels, times: Real, series: Series, base: Series, count: int, z: Series, scale: Real) -> bool:
    """Take the earliest instant: what arrives there jumps, and if the instant moves with a parameter the states move by -B₂ jump dt.

    Its rounds are announced. False where what is watched jumps as well, so that no derivative exists, or where there are too many.
    """
    own = channels.delays.shape[0]
    first, instant = series.shape[0] - own, channels.kinks[0]
    near = SAME * instant.real
    for k in range(own):
        channels.steps[0, k] = channels.jumps[0, 0, k]
    shift = instant - instant.real
    for j in range(own):
        if instant.imag == 0.0 or channels.jumps[0, 1, j] != 0:
            continue
        row = first + j
        source = instant.real - channels.delays[j]
        behind = _went_in(times, series[row], base[row], count, source.real, near, True)
        ahead = 0.0 * behind
        if source.real > times[0] + near:
            ahead = _went_in(times, series[row], base[row], count, source.real, near, False)
        jump = behind - ahead
        for r in range(series.shape[0]):
            if abs(channels.through[r, j].real * jump) > SAME * scale[r]:
                return False
        for i in range(channels.drive.shape[0]):
            z[i] = z[i] - channels.drive[i, j] * (jump * shift)
    forget(channels)
    return go_on(channels, instant, channels.steps[0], channels.steps[1])
