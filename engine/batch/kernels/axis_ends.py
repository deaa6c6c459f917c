"""The ends of the axis of frequency: whether a curve has come to what it does beyond them, and whether something rises there unseen."""

from __future__ import annotations

from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.compiled import compiled
from engine.batch.kernels.polishing import ALL
from engine.batch.kernels.spectrum_program import (
    BANDWIDTH,
    COMPLEMENTARY,
    DELAY,
    PEAK,
    PHASE,
    SENSITIVITY,
    SpectrumProgram,
)
from engine.batch.kernels.vector import load2, magnitude, select, spread

Real = npt.NDArray[np.float64]

Doubts: TypeAlias = tuple[Any, Any, Any, Any, Any, Any]
"""What is doubtful: all, phase, gain, peaks of loops, bandwidth, peaks of paths."""
_AHEAD: Final = 2.5
"""A peak is hidden at an end of the axis if it lies at less than a little more than the first frequency, by the parabola."""
_SLIGHT: Final = 1e-9
_STEEPEST: Final = 6
"""Curves rise and fall with the sixth power of frequency at most; what is steeper is left to the exact path."""
_NOTHING: Final = 1e-12
"""What has fallen so far below 1 (a loop) or the tallest (a path), by its square, decides nothing beyond."""
_ASKEW: Final = 0.3
"""What leads to an end of the axis has come to one of the axes of the plane up to this."""
_ON_THE_WAY: Final = 0.1
"""By so much the power may differ from a whole number: what lies beyond is at least four times as far away."""


@compiled
def doubt_ends(
    program: SpectrumProgram, wants: int, last: int, c: int, store_re: Real, store_im: Real, tallest: Any, doubts: Doubts
) -> Doubts:  # fmt: skip
    """Doubt what may lie beyond the ends of the axis, or between an end and the sample beside it."""
    doubt, phase_doubt, gain_doubt, peak_doubt, level_doubt, high_doubt = doubts
    for end, beside, next_, third in ((0, 1, 2, 3), (last, last - 1, last - 2, last - 3)):
        ratio = program.frequencies[next_] / program.frequencies[beside]
        ratio = ratio * ratio if end == 0 else 1.0 / (ratio * ratio)
        distance = program.frequencies[end] / program.frequencies[beside]
        distance = distance * distance if end == 0 else 1.0 / (distance * distance)
        near = _squared(store_re, store_im, c, beside, 2)
        x, y = load2(store_re, c, end), load2(store_im, c, end)
        arrived = _arrived(x, y, near, _squared(store_re, store_im, c, next_, 2), ratio, distance)
        if end > 0:
            arrived = arrived | (near <= _NOTHING * (tallest if wants & (BANDWIDTH | PEAK) else spread(1.0)))
        doubt = select(arrived, doubt, ALL)
        for p in range(3):
            if not wants & (SENSITIVITY << p if p < 2 else PEAK | PHASE | DELAY):
                continue
            rest, near = _squared(store_re, store_im, c, end, p), _squared(store_re, store_im, c, beside, p)
            beyond = _squared(store_re, store_im, c, next_, p), _squared(store_re, store_im, c, third, p)
            excess = _excess(rest, near, beyond, ratio)
            if p < 2:
                peak_doubt = select(excess > 0.0, float(SENSITIVITY + COMPLEMENTARY), peak_doubt)
            else:
                high_doubt = select(excess > 0.0, float(PEAK), high_doubt)
                passes = (rest < 1.0) & (rest * (1.0 + 2.0 * excess) > 1.0)
                phase_doubt = select(passes & (excess > 0.0), float(PHASE + DELAY), phase_doubt)
    return doubt, phase_doubt, gain_doubt, peak_doubt, level_doubt, high_doubt


@compiled
def _squared(store_re: Real, store_im: Real, c: int, k: int, p: int) -> Any:
    """Return |1/(1 + L)|², |L/(1 + L)|² or |T|² at one frequency."""
    x, y = load2(store_re, c, k), load2(store_im, c, k)
    square, distance = x * x + y * y, (1.0 + x) * (1.0 + x) + y * y
    if p == 2:
        return square
    return (square if p == 1 else spread(1.0)) / distance


@compiled
def _arrived(x: Any, y: Any, near: Any, next_: Any, ratio: float, distance: float) -> Any:
    """Whether the samples beside an end of the axis follow the power of frequency that leads to x + jy at the end.

    A square w^n, w = ω² (at the other end 1/ω²), grows by ratio^n from the sample beside the end to the next, and by
    distance^n to the end, where the curve is real if n is even and imaginary if it is odd. One that does not has poles or
    zeros between them.
    """
    rest, steepness = x * x + y * y, (next_ - near) / (next_ + near)
    found = rest < 0.0
    to_next, to_end = ratio ** float(-_STEEPEST), distance ** float(-_STEEPEST)
    for power in range(-_STEEPEST, _STEEPEST + 1):
        matches = magnitude(steepness - (to_next - 1.0) / (to_next + 1.0)) < _ON_THE_WAY * (ratio - 1.0) / (ratio + 1.0)
        across, along = (x, y) if power & 1 else (y, x)
        straight = magnitude(across) < _ASKEW * magnitude(along)
        found = found | (matches & straight & (rest > 0.8 * to_end * near) & (rest < 1.25 * to_end * near))
        to_next, to_end = to_next * ratio, to_end * distance
    return found


@compiled
def _excess(rest: Any, near: Any, beyond: tuple[Any, Any], ratio: float) -> Any:
    """Return by which part a curve may rise above an end of the axis before the first sample beside it; 0 where it does not.

    With w = ω² in units of the sample's (at the other end 1/ω²) the square is rest (1 + a w + b w² + c w³), through the
    samples at 1, ratio and ratio². Without c a peak far before the first of them, where a is small beside b, would be lost.
    """
    first, second = near / rest - 1.0, (beyond[0] / rest - 1.0) / ratio
    third = (beyond[1] / rest - 1.0) / (ratio * ratio)
    near_slope, far_slope = (second - first) / (ratio - 1.0), (third - second) / (ratio * (ratio - 1.0))
    c = (far_slope - near_slope) / (ratio * ratio - 1.0)
    b = near_slope - c * (1.0 + ratio)
    a = first - b - c
    return select((a > 0.0) & (b < 0.0) & (a < -_AHEAD * b), a * a / (-4.0 * b), 0.0) - _SLIGHT
