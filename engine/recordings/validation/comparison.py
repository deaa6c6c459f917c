"""One output of a model beside its measurement, over one window; the common ground of every suspicion.

relative error of a residual e:   100 ||e|| / ||y||,   e less its mean where a constant offset is estimated
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

Signal = npt.NDArray[np.float64]


_REST = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """A measured and a simulated signal, and what is known around them.

    Parameters
    ----------
    name : str
        Of the output.
    measured, simulated : ndarray, shape (samples,)
        In the same unit; the offset is added to the simulated one already.
    sample_time : float
        s.
    inputs : mapping of str to ndarray, shape (samples,)
        What drove the system.
    tangents : mapping of str to ndarray, shape (samples,)
        Derivative of the simulated signal by each parameter that may move; empty where none is known.
    constant : bool
        Whether the output has an unknown constant offset: errors then count without their mean.

    Raises
    ------
    ValueError
        For signals of different length, fewer than 2 samples, or a value that is not finite.
    """

    name: str
    measured: Signal
    simulated: Signal
    sample_time: float
    inputs: Mapping[str, Signal] = field(default_factory=dict)
    tangents: Mapping[str, Signal] = field(default_factory=dict)
    constant: bool = False

    def __post_init__(self) -> None:
        size = self.measured.size
        if size < 2:
            raise ValueError(f"{self.name} must have at least 2 samples, got {size}")
        signals = {"measured": self.measured, "simulated": self.simulated, **self.inputs, **self.tangents}
        for name, signal in signals.items():
            if signal.shape != (size,):
                raise ValueError(f"{name} must have {size} samples as {self.name} has, got shape {signal.shape}")
            if not np.isfinite(signal).all():
                raise ValueError(f"{name} must be finite at every sample, got NaN or infinity")
        if not self.sample_time > 0:
            raise ValueError(f"sample_time must be > 0 s, got {self.sample_time}")

    @cached_property
    def residual(self) -> Signal:
        """Measured less simulated, without its mean where the offset is unknown."""
        return self.free(self.measured - self.simulated)

    def free(self, signal: Signal) -> Signal:
        """Return a signal without what an unknown offset would take away."""
        return signal - signal.mean() if self.constant else signal

    def relative_error(self, residual: Signal) -> float | None:
        """Return the relative error (%) that a residual stands for, None for a measurement that is 0 throughout."""
        size = float(np.linalg.norm(self.measured))
        return 100.0 * float(np.linalg.norm(self.free(residual))) / size if size > 0.0 else None

    @cached_property
    def present_error(self) -> float | None:
        """Relative error as it is, %."""
        return self.relative_error(self.residual)

    @cached_property
    def velocity(self) -> Signal:
        """Rate of the measurement, smoothed so that noise does not decide its direction."""
        return rate(self.measured, self.sample_time)


def rate(signal: Signal, sample_time: float) -> Signal:
    """Return the rate of a noisy signal: central differences over a distance at which it really moves.

    The distance grows from 1 sample to an eighth of the signal, until a step is large beside the noise, which is judged
    from the second differences (a white noise of deviation s has second differences of mean square 6 s²).

    Parameters
    ----------
    signal : ndarray, shape (samples,)
    sample_time : float
        s.

    Returns
    -------
    ndarray, shape (samples,)
        Unit of the signal per s.
    """
    n = signal.size
    noise = float(np.sqrt(np.mean(np.diff(signal, 2) ** 2) / 6)) if n > 2 else 0.0
    reach = 1
    while reach < max(n // 16, 1):
        moved = float(np.sqrt(np.mean((signal[2 * reach :] - signal[: -2 * reach]) ** 2)))
        if moved > 10 * noise:
            break
        reach *= 2
    index = np.arange(n)
    before, after = np.maximum(index - reach, 0), np.minimum(index + reach, n - 1)
    return np.asarray((signal[after] - signal[before]) / ((after - before) * sample_time))


def held_directions(velocity: Signal) -> Signal:
    """Return +1 and -1, at rest the direction of the motion before: what dry friction and a hanging load remember.

    A turn is no rest: where a signal stands for less than a tenth of the motion before, it is 0.

    Parameters
    ----------
    velocity : ndarray, shape (samples,)
    """
    sign = directions(velocity)
    bounds = [0, *(np.flatnonzero(np.diff(sign)) + 1).tolist(), sign.size]
    before, last = 0, 0.0
    for first, stop in pairwise(bounds):
        if sign[first] != 0.0:
            before, last = stop - first, float(sign[first])
        elif stop - first >= _REST * before:
            sign[first:stop] = last
    return sign


def directions(velocity: Signal) -> Signal:
    """Return +1 and -1 where a signal clearly moves, 0 where it rests or turns.

    Parameters
    ----------
    velocity : ndarray, shape (samples,)
    """
    threshold = 0.02 * float(np.abs(velocity).max(initial=0.0))
    return np.where(np.abs(velocity) > threshold, np.sign(velocity), 0.0)
