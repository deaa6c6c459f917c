"""Systematic errors of an averaged frequency response function that its data give away.

A resonance needs at least eight lines within its half-power width B = 2 ζ ω0, or its peak is read too low; a record that is
neither periodic nor at rest at its ends needs a window; a delay τ between the channels costs the part τ/T of a segment; a sweep or
a pulse is weighed by a window at other instants than its response; periods that are not like those between them (a response that has not settled) move the mean of all.

References
----------
J. S. Bendat, A. G. Piersol, "Random Data", 4th ed., Wiley 2010, section 9.2.3 (bias by resolution and by delay).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engine.exact.frequency.fourier import Complex, Real
from engine.recordings.spectra.crossed import SHORTEST, Crossed, crossed
from engine.recordings.spectra.frf import Doubt, Frf
from engine.recordings.spectra.stretches import Samples, stretches

LINES_OF_A_RESONANCE = 8
"""Within the half-power width: a Hann window then reads the peak of one mode 0.2 dB too low, with four lines 0.7 dB."""

_PROMINENCE = 6.0  # dB, of a peak that is a resonance
_CERTAIN = 0.1  # largest standard deviation of ln|H| at a line that may be part of a peak
_REPEATS = 0.02  # relative difference of segments of a periodic input
_REST = 1e-3  # of the largest value: an end that is at rest
_LOST = 0.05  # of a segment
_MOST = 10
_DRIVEN = 1e-3  # of the largest power of the input: a line that it drives
_PARTS = 4  # of a segment, in which the input is looked for
_IN_FEW = 0.25  # of the parts: a line of noise is in half of them, that of a sweep in two or three
_OFF = 0.001  # of H, by the first and the last period: less does not matter
_OFF_PERHAPS = 0.005  # the same, where too few periods tell it from noise
_CERTAINLY = 0.999  # probability of ends that are like what is between them
_TOLD_APART = 4  # periods of which two are neither the first nor the last
_BANDS, _OF_BAND = 8, 8  # bands that are looked at by themselves, and lines that one has at least
_MEDIAN = float(np.log(2))  # of the square of a complex normal number, over its mean


def resonance_doubts(frf: Frf) -> list[Doubt]:
    """Return a doubt for each resonance that is narrower than the lines can show."""
    from scipy.signal import find_peaks  # noqa: PLC0415 - a tenth of a second

    if frf.resolution is None or frf.magnitude_error is None:
        return []  # without a random error nobody knows which peaks are noise
    telling = np.isfinite(frf.value) & (np.abs(frf.value) > 0) & (frf.magnitude_error < _CERTAIN)
    frequency, magnitude = frf.frequency[telling], np.abs(frf.value[telling])
    if magnitude.size < 3:
        return []
    peaks, _ = find_peaks(20 * np.log10(magnitude), prominence=_PROMINENCE)
    doubts = []
    for peak in peaks:
        width = _half_power_width(frequency, magnitude, int(peak))
        if width is None or width >= LINES_OF_A_RESONANCE * frf.resolution:
            continue
        lines, hertz = width / frf.resolution, frequency[peak] / (2 * np.pi)
        wanted = 2 * np.pi * LINES_OF_A_RESONANCE / width
        detail = (
            f"the resonance at {hertz:.4g} Hz is {width / (2 * np.pi):.3g} Hz wide, {lines:.2g} lines: "
            f"its peak is read too low and its damping too high; segments of {wanted:.3g} s or more would show it"
        )
        doubts.append(Doubt(kind="resonance_bias", detail=detail, frequency=float(frequency[peak])))
    return sorted(doubts, key=lambda doubt: doubt.frequency or 0.0)[:_MOST]


def _half_power_width(frequency: Real, magnitude: Real, peak: int) -> float | None:
    """Return the width of a peak at 1/√2 of its height, rad/s; None where a side does not fall that far."""
    level = magnitude[peak] / np.sqrt(2)
    below = np.flatnonzero(magnitude < level)
    left, right = below[below < peak], below[below > peak]
    if not left.size or not right.size:
        return None
    ends = []
    for outside, inside in ((left[-1], left[-1] + 1), (right[0], right[0] - 1)):
        part = (level - magnitude[outside]) / (magnitude[inside] - magnitude[outside])
        ends.append(frequency[outside] + part * (frequency[inside] - frequency[outside]))
    return float(ends[1] - ends[0])


def leakage_doubts(pairs: Sequence[tuple[Samples, Samples]], segment: int) -> list[Doubt]:
    """Return a doubt about segments without a window that are neither periods nor at rest at their ends."""
    if all(_periodic(x, segment) or (_rests(x, segment) and _rests(y, segment)) for x, y in pairs if x.size >= segment):
        return []
    detail = (
        "without a window a segment must be a whole number of periods, or begin and end at rest: these leak from line to "
        "line; take a Hann window, or the period as the segment"
    )
    return [Doubt(kind="leakage", detail=detail)]


def _periodic(x: Samples, segment: int) -> bool:
    if x.size < 2 * segment:
        return False
    first, second = x[:segment], x[segment : 2 * segment]
    return float(np.linalg.norm(second - first)) < _REPEATS * float(np.linalg.norm(first - first.mean()))


def _rests(values: Samples, segment: int) -> bool:
    """Say whether segments begin and end at one level, as a pulse with silence around it does."""
    kept, low, high = [], np.inf, -np.inf
    for start, part in stretches(values):
        place = np.arange(start, start + part.size) % segment
        kept.append(part[(place == 0) | (place == segment - 1)])
        low, high = min(low, float(part.min())), max(high, float(part.max()))
    ends = np.concatenate(kept)
    level = float(np.median(ends))
    return float(np.abs(ends - level).max()) <= _REST * max(high - level, level - low)


def delay_doubts(found: Crossed, length: float) -> list[Doubt]:
    """Return a doubt about a delay between the channels that is not short beside a segment of ``length`` s."""
    weight = np.nan_to_num(found.coherence)
    common = np.abs(found.xy)
    lines = np.where(common > 0, found.xy / np.where(common > 0, common, 1.0), 0.0) * weight
    echo = np.fft.irfft(np.concatenate([[0.0], lines, [0.0]]))
    at = int(np.argmax(np.abs(echo)))
    delay = at / echo.size * length
    if at > echo.size // 2:
        delay -= length
    # one line of many is no peak: a resonance or noise spreads over the whole segment
    peak = np.abs(echo[at]) ** 2 / float((echo**2).sum())
    if abs(delay) < _LOST * length or peak < 0.1:
        return []
    detail = (
        f"the response comes {delay:.3g} s after the input, {abs(delay) / length:.0%} of a segment, and is read too small by "
        "that part: take longer segments, or shift one channel"
    )
    return [Doubt(kind="delay", detail=detail)]


def sweep_doubts(inputs: Sequence[Samples], rate: float, segment: int) -> list[Doubt]:
    """Return a doubt about an input whose lines are each there for a short time of a windowed segment: a sweep, a pulse, a step.

    A window weighs the response, which comes later, otherwise than such an input; of noise that is the same on average.
    """
    part = max(segment // _PARTS, SHORTEST)
    found = crossed([(x, x) for x in inputs], rate, segment=part)
    driven = found.xx > _DRIVEN * found.xx.max()
    share = float(np.median(found.shares[driven]))
    if share >= _IN_FEW:
        return []
    detail = (
        f"the input has a line in some {share:.0%} of the time only, as a sweep, a pulse or a step: the window weighs it otherwise than the response, "
        "which comes later, so that resonances, their damping and bounds are wrong; take the whole of it as one segment without a window, "
        "beginning and ending at rest, or drive with noise or a multisine"
    )
    return [Doubt(kind="sweep", detail=detail)]


def fading_doubts(x: Complex, y: Complex) -> list[Doubt]:
    """Return a doubt where the first or the last of some periods moves the response function: no steady state is there.

    It is held against that of the periods between them, whose scatter tells the noise. A drive that fades in and out costs
    nothing by itself: a record that begins and ends at rest holds the whole response to the whole input.

    Parameters
    ----------
    x, y : ndarray of complex, shape (periods, lines)
        Lines of each period, of the input and of the response.
    """
    count, lines = x.shape
    if count < 2:
        return []
    told_apart = count >= _TOLD_APART
    inner = slice(1, -1 if told_apart else 2)
    left = (y - y[inner].mean(axis=0) / x[inner].mean(axis=0) * x) / np.abs(y.mean(axis=0))
    # a transient is smooth over frequency, and largest near a resonance
    bands = np.array_split(left, max(1, min(lines // _OF_BAND, _BANDS)), axis=1)
    sizes = [_moved(band, band[inner] if told_apart else None, chance=(1 - _CERTAINLY) / len(bands)) for band in bands]
    size, left = max(sizes), bands[int(np.argmax(sizes))]
    if size < (_OFF if told_apart else _OFF_PERHAPS):
        return []
    end, remedy = ("last", "the end of `part`") if _typical(left[-1]) > _typical(left[0]) else ("first", "`settle`")
    doubt = "" if told_apart else f", or it is noise, which {count} periods cannot tell"
    detail = (
        f"the {end} of {count} periods moves the response by some {size:.1%}: it had not settled, or the drive fades "
        f"there{doubt}; leave it out by {remedy}"
    )
    return [Doubt(kind="not_settled", detail=detail)]


def _moved(left: Complex, inner: Complex | None, *, chance: float) -> float:
    """Return how far the mean of all periods lies from that of the inner ones, relative; 0 where their scatter explains it."""
    off = _typical(left.mean(axis=0))
    if inner is None:
        return float(np.sqrt(off))
    from scipy.stats import f  # noqa: PLC0415 - a third of a second

    lines = left.shape[1]
    noise = float(np.median(inner.var(axis=0, ddof=1))) / _MEDIAN * (1 / len(inner) - 1 / len(left))
    return float(np.sqrt(off - noise)) if off > float(f.isf(chance, lines, lines)) * noise else 0.0


def _typical(values: Complex) -> float:
    """Return the mean square of lines, told by their median: a few weak ones say nothing of the others."""
    return float(np.median(np.abs(values) ** 2)) / _MEDIAN
