"""Frequency response functions from one sine after the other, each fitted by least squares where it is steady.

    x(t) ≈ x0 + Re(X e^{jωt}),  y(t) ≈ y0 + Re(Y e^{jωt}),   in up to 20 parts of whole periods;  H = Y/X

References
----------
IEEE Std 1057-2017, section 4.6 (fit of a sine of known frequency: three parameters).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from engine.exact.frequency.fourier import Complex, Real
from engine.model.errors import SpectrumError
from engine.recordings.spectra.frf import Doubt, Frf, check_pair
from engine.recordings.spectra.periodic import Repeated, repeated

_MOST_PARTS = 20
_STEADY = 0.999  # probability of a step that does not drift
_DRIFT = 0.001  # of H: less does not matter
_TURN = 0.05  # rad within a step: the sine has another frequency than was said


@dataclass(frozen=True, slots=True, kw_only=True)
class SineStep:
    """One sine of a stepped run: ``frequency`` in rad/s, ``start`` and ``end`` in s from the first sample."""

    frequency: float
    start: float
    end: float


def stepped_sine_frf(x: Real, y: Real, rate: float, steps: Sequence[SineStep], *, settle: float = 0.0) -> Frf:
    """Return the response function at the frequency of each step, in order of frequency.

    Parameters
    ----------
    x, y : ndarray, shape (samples,)
        Input and response.
    rate : float
        Samples per second.
    steps : sequence of SineStep
    settle : float
        s at the beginning of each step that are left out.

    Raises
    ------
    SpectrumError
        If a step lies outside of the recording, holds no period, or its frequency is not below half the rate.
    """
    check_pair(x, y)
    if not steps:
        raise SpectrumError("steps must be at least one, got none", at=("steps",))
    if settle < 0:
        raise SpectrumError(f"settle must be >= 0 s, got {settle:g}", at=("settle",))
    doubts: list[Doubt] = []
    found: list[tuple[float, complex, float, int]] = []
    for number, step in enumerate(steps):
        try:
            first, stop = _span(step, x.size, rate, settle)
        except SpectrumError as error_here:
            raise error_here.within("steps", number) from error_here
        left, right, spacing = _parts(x[first:stop], y[first:stop], step.frequency / rate)
        result = repeated(left, right, level=_STEADY)
        error = np.nan if result.error is None else float(result.error[0])
        found.append((step.frequency, complex(result.value[0]), error, len(left)))
        doubts += _doubts(step, left[:, 0], spacing / rate, result)
    found.sort()
    frequency, value, errors, parts = (np.array(column) for column in zip(*found, strict=True))
    known = not np.isnan(errors).any()
    fewest = int(parts.min())
    return Frf(
        frequency=frequency,
        value=value,
        magnitude_error=errors if known else None,
        phase_error=errors if known else None,
        freedom=2.0 * (fewest - 1),
        averages=fewest,
        effective_averages=float(fewest),
        doubts=tuple(doubts),
    )


def _span(step: SineStep, samples: int, rate: float, settle: float) -> tuple[int, int]:
    """Return the samples first <= i < stop of a step that are used."""
    if not 0 < step.frequency < np.pi * rate:
        msg = f"frequency must be > 0 and < {np.pi * rate:g} rad/s (half the sample rate), got {step.frequency:g}"
        raise SpectrumError(msg, at=("frequency",))
    length = samples / rate
    if not (0 <= step.start < step.end <= length * (1 + 1e-9) and step.start + settle < step.end):
        msg = (
            f"a step must begin, settle and end within the recording of {length:g} s, "
            f"got {step.start:g} to {step.end:g} s with {settle:g} s to settle"
        )
        raise SpectrumError(msg)
    first, stop = round((step.start + settle) * rate), min(round(step.end * rate), samples)
    period = 2 * np.pi / step.frequency
    if stop - first < max(period * rate * (1 - 1e-6), 4):
        msg = f"a step must hold a period of {period:g} s and 4 samples after settling, got {(stop - first) / rate:g} s"
        raise SpectrumError(msg)
    return first, stop


def _parts(x: Real, y: Real, turn: float) -> tuple[Complex, Complex, float]:
    """Return the lines of the parts of a step, shapes (parts, 1), and the distance of parts in samples.

    ``turn`` is the angle of the sine from one sample to the next, rad.
    """
    period = 2 * np.pi / turn
    periods = int(x.size / period + 1e-6)
    # a part holds whole periods, and enough samples for its three unknowns
    count = max(1, min(periods, _MOST_PARTS, x.size // 4))
    width = periods // count * period
    lines = []
    for k in range(count):
        begin = round(k * width)
        span = np.arange(begin, min(begin + max(round(width), 4), x.size))
        basis = np.stack([np.cos(turn * span), np.sin(turn * span), np.ones(span.size)], axis=1)
        c, s, _ = np.linalg.lstsq(basis, np.stack([x[span], y[span]], axis=1), rcond=None)[0]
        lines.append(c - 1j * s)
    both = np.array(lines)
    return both[:, :1], both[:, 1:], width


def _doubts(step: SineStep, left: Complex, spacing: float, result: Repeated) -> list[Doubt]:
    hertz = step.frequency / (2 * np.pi)
    if len(left) > 1:
        turn = float(np.angle((left[1:] * left[:-1].conj()).sum()))
        if abs(turn) * (len(left) - 1) > _TURN:
            detail = (
                f"the input of the step at {hertz:.4g} Hz has {hertz + turn / spacing / (2 * np.pi):.4g} Hz: "
                "state the frequency that was driven (a card may change the sample rate)"
            )
            return [Doubt(kind="frequency", detail=detail, frequency=step.frequency)]
    if result.drift is not None and result.drifts[0] and result.drift[0] > _DRIFT:
        detail = (
            f"the response of the step at {hertz:.4g} Hz changes by {float(result.drift[0]):.1%} within the step: it had not settled; "
            "leave more out by `settle`"
        )
        return [Doubt(kind="not_settled", detail=detail, frequency=step.frequency)]
    return []
