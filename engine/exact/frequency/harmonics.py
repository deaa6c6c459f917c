"""The harmonic content of a movement: how much of it moves at each multiple (order) of one fundamental.

y(t) ≈ mean + Σ_n amplitude_n cos(n ω t + phase_n),   thd = sqrt(Σ_{n≥2} amplitude_n²) / amplitude_1

References
----------
IEEE Std 1057-2017, annex A (least-squares fit of sines of known frequency).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.exact.frequency.fourier import Complex, Real, transform
from engine.exact.time.curve import Curve
from engine.model.errors import SpectrumError

_AT_ONCE = 1 << 18
"""Numbers of the least-squares problem that are looked at together: 2 MB, whatever the length of the recording."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Harmonics:
    """Amplitudes (unit of the signal) and phases (rad, cosine at t = 0) of the orders 1, 2, ...

    ``thd`` is the total harmonic distortion, a ratio; None where nothing moves at the fundamental.
    """

    fundamental: float
    mean: float
    amplitude: Real
    phase: Real
    thd: float | None

    @classmethod
    def of(cls, fundamental: float, mean: float, lines: Complex) -> Harmonics:
        """Return the harmonics of complex amplitudes, order 1 first."""
        amplitude = np.abs(lines)
        overtones = float(np.sqrt((amplitude[1:] ** 2).sum()))
        thd = overtones / float(amplitude[0]) if amplitude[0] > 1e-12 * max(overtones, abs(mean), 1e-300) else None
        return cls(fundamental=fundamental, mean=mean, amplitude=amplitude, phase=np.angle(lines), thd=thd)


def harmonics_of_samples(values: Real, rate: float, fundamental: float, count: int) -> Harmonics:
    """Return the harmonics that fit samples best; the record need not be a whole number of periods.

    Parameters
    ----------
    values : ndarray, shape (samples,)
    rate : float
        Samples per second.
    fundamental : float
        rad/s.
    count : int
        Highest order.

    Raises
    ------
    SpectrumError
        If the record is shorter than a period, or the highest order is above half the sample rate.
    """
    length = len(values) / rate
    if fundamental * length < 2 * np.pi * (1 - 1e-9):
        msg = f"fundamental must be >= {2 * np.pi / length:g} rad/s (one period in the record), got {fundamental:g}"
        raise SpectrumError(msg, at=("fundamental",))
    if count * fundamental >= np.pi * rate:
        most = int(np.ceil(np.pi * rate / fundamental)) - 1
        raise SpectrumError(f"orders must be <= {most} (below half the sample rate), got {count}", at=("orders",))
    # Piece after piece, only the triangle of a QR decomposition is carried on: it has the same least-squares solution.
    width = 2 * count + 2
    triangle = np.empty((0, width))
    for start in range(0, len(values), max(_AT_ONCE // width, width)):
        piece = values[start : start + max(_AT_ONCE // width, width)]
        angle = np.multiply.outer(np.arange(start, start + len(piece)) / rate * fundamental, np.arange(1, count + 1))
        rows = np.concatenate([np.ones((len(piece), 1)), np.cos(angle), np.sin(angle), piece[:, np.newaxis]], axis=1)
        triangle = np.asarray(np.linalg.qr(np.concatenate([triangle, rows]), mode="r"), dtype=np.float64)
    found, *_ = np.linalg.lstsq(triangle[:, :-1], triangle[:, -1], rcond=None)
    return Harmonics.of(fundamental, float(found[0]), found[1 : count + 1] - 1j * found[count + 1 :])


def harmonics_of_curve(curve: Curve, fundamental: float, count: int) -> Harmonics:
    """Return the harmonics of the last period of an exact response: its steady state under a periodic command.

    Parameters
    ----------
    curve : Curve
        Long enough for its last period to be steady.
    fundamental : float
        rad/s.
    count : int
        Highest order.

    Raises
    ------
    SpectrumError
        If the curve is shorter than a period.
    """
    period = 2 * np.pi / fundamental
    begin = curve.end - period
    if begin < curve.times[0] - 1e-9 * period:
        length = curve.end - float(curve.times[0])
        msg = f"fundamental must be >= {2 * np.pi / length:g} rad/s (one period in the response), got {fundamental:g}"
        raise SpectrumError(msg, at=("fundamental",))
    lines = transform(curve.since(begin), fundamental * np.arange(count + 1.0)).value / period
    return Harmonics.of(fundamental, float(lines[0].real), 2 * lines[1:])
