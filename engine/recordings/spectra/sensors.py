"""What sensors do to a frequency response function, taken back.

measured = S(jω) physical,    H = H_measured S_x / S_y
S(jω) = table(ω) · jω/(jω + ω_c) · e^{-jωτ}
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.exact.frequency.fourier import Complex, Real
from engine.model.errors import SpectrumError


@dataclass(frozen=True, kw_only=True, eq=False)
class Sensor:
    """The frequency response of a measuring channel, relative to its nominal sensitivity.

    Parameters
    ----------
    delay : float
        τ, s: of a filter or converter.
    coupling : float, optional
        ω_c, rad/s: corner of an AC or IEPE coupling.
    frequency, magnitude, phase : ndarray, shape (points,), optional
        A calibration, rad/s, ratio, rad; between its points ln(magnitude) and phase are linear over ln(frequency).
    """

    delay: float = 0.0
    coupling: float | None = None
    frequency: Real | None = None
    magnitude: Real | None = None
    phase: Real | None = None

    def __post_init__(self) -> None:
        if self.coupling is not None and not self.coupling > 0:
            raise SpectrumError(f"coupling must be > 0 rad/s, got {self.coupling:g}", at=("coupling",))
        if self.frequency is None:
            return
        if self.frequency.size < 2 or not (np.diff(self.frequency) > 0).all() or not self.frequency[0] > 0:
            raise SpectrumError("frequency must be two points or more, > 0 rad/s and increasing", at=("frequency",))
        for name, values in (("magnitude", self.magnitude), ("phase", self.phase)):
            if values is not None and values.size != self.frequency.size:
                msg = f"{name} must have as many points as frequency ({self.frequency.size}), got {values.size}"
                raise SpectrumError(msg, at=(name,))
        if self.magnitude is not None and not (self.magnitude > 0).all():
            raise SpectrumError("magnitude must be > 0 everywhere", at=("magnitude",))

    def response(self, w: Real) -> Complex:
        """Return S(jω) at angular frequencies > 0.

        Raises
        ------
        SpectrumError
            For frequencies outside of the calibration: nobody knows what the sensor does there.
        """
        found = np.exp(-1j * w * self.delay)
        if self.coupling is not None:
            found = found * 1j * w / (1j * w + self.coupling)
        if self.frequency is None:
            return np.asarray(found)
        low, high = self.frequency[0] * (1 - 1e-9), self.frequency[-1] * (1 + 1e-9)
        if w.min() < low or w.max() > high:
            msg = (
                f"the calibration must cover all lines, {w.min():g} to {w.max():g} rad/s, "
                f"got {self.frequency[0]:g} to {self.frequency[-1]:g}: limit the lines by `band`"
            )
            raise SpectrumError(msg, at=("frequency",))
        at, points = np.log(w), np.log(self.frequency)
        if self.magnitude is not None:
            found = found * np.exp(np.interp(at, points, np.log(self.magnitude)))
        if self.phase is not None:
            found = found * np.exp(1j * np.interp(at, points, self.phase))
        return np.asarray(found)


def correction(w: Real, *, input: Sensor | None, output: Sensor | None) -> Complex:  # noqa: A002 - the contract's word
    """Return the factor S_x/S_y by which a measured response function is multiplied.

    Parameters
    ----------
    w : ndarray, shape (lines,)
        rad/s, > 0.
    input, output : Sensor, optional
        None for an ideal one.
    """
    one = np.ones(w.size, dtype=np.complex128)
    above = one if input is None else input.response(w)
    return np.asarray(above / (one if output is None else output.response(w)))
