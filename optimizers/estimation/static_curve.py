"""A static curve through measured pairs: a polynomial whose degree is chosen on samples that did not take part.

    y = Σ_k c_k ((u - u_0)/s)^k

It says what a valve or a motor does once everything has settled; what it leaves is dynamics, hysteresis and noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from engine.recordings.fit import Fit, compare
from optimizers.problem import ProblemError

Samples = npt.NDArray[np.float64]

MOST_DEGREE = 9
POINTS = 33
"""Of the lookup table that stands for the curve."""
_SAMPLES_PER_TERM = 10
_PARTS = 10
_BETTER = 0.1
"""Points of FIT by which a higher degree must be better on the other samples."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StaticCurve:
    """The curve.

    Attributes
    ----------
    degree : int
    coefficients : ndarray, shape (degree + 1,)
        Of 1, x, x², ... with x = (u - center)/scale.
    fit : Fit
        Over all samples.
    validation : tuple of (degree, FIT %)
        What each degree reached on samples that did not take part, in turn.
    points, values : ndarray
        The same curve as the points and values of a lookup table.
    """

    degree: int
    center: float
    scale: float
    coefficients: Samples
    fit: Fit
    validation: tuple[tuple[int, float], ...]
    points: Samples
    values: Samples

    def at(self, inputs: Samples) -> Samples:
        """Return the curve at some inputs."""
        return np.asarray(np.polynomial.polynomial.polyval((inputs - self.center) / self.scale, self.coefficients))


def static_curve(inputs: Samples, outputs: Samples, *, degree: int | None = None) -> StaticCurve:
    """Return the polynomial through pairs of samples.

    Parameters
    ----------
    inputs, outputs : ndarray, shape (samples,)
    degree : int, optional
        Chosen by tenfold validation on stretches of the recording by default: the lowest one that none of a higher degree
        beats by more than 0.1 points of FIT.

    Raises
    ------
    ProblemError
        For signals of different length, too few samples or a constant one.
    """
    if inputs.shape != outputs.shape:
        raise ProblemError(
            f"input and output must have equally many samples, got {inputs.size} and {outputs.size}", at=("dataset",)
        )
    for name, signal in (("input", inputs), ("output", outputs)):
        if np.ptp(signal) == 0:
            raise ProblemError(f"{name} must vary, got a constant", at=(name,))
    if degree is not None and not 0 <= degree <= MOST_DEGREE:
        raise ProblemError(f"degree must be 0 to {MOST_DEGREE}, got {degree}", at=("degree",))
    highest = MOST_DEGREE if degree is None else degree
    if inputs.size < _SAMPLES_PER_TERM * (highest + 1):
        raise ProblemError(
            f"the recording must have at least {_SAMPLES_PER_TERM * (highest + 1)} samples, got {inputs.size}",
            at=("dataset",),
        )
    center, scale = float(inputs.min() + inputs.max()) / 2, float(np.ptp(inputs)) / 2
    x = (inputs - center) / scale
    tried = tuple((k, _validated(x, outputs, k)) for k in (range(1, MOST_DEGREE + 1) if degree is None else (degree,)))
    best = max(fit for _, fit in tried)
    chosen = next(k for k, fit in tried if fit >= best - _BETTER)
    coefficients = _fitted(x, outputs, chosen)
    points = np.linspace(inputs.min(), inputs.max(), POINTS)
    curve = np.asarray(np.polynomial.polynomial.polyval(x, coefficients), dtype=np.float64)
    values = np.asarray(np.polynomial.polynomial.polyval((points - center) / scale, coefficients), dtype=np.float64)
    return StaticCurve(
        degree=chosen, center=center, scale=scale, coefficients=coefficients, fit=compare(outputs, curve),
        validation=tried, points=points, values=values,
    )  # fmt: skip


def _fitted(x: Samples, y: Samples, degree: int) -> Samples:
    return np.asarray(np.polynomial.chebyshev.cheb2poly(np.polynomial.chebyshev.chebfit(x, y, degree)))


def _validated(x: Samples, y: Samples, degree: int) -> float:
    """Return the FIT (%) on stretches that did not take part, one after the other."""
    stretch = np.arange(x.size) * _PARTS // x.size
    predicted = np.empty_like(y)
    for k in range(_PARTS):
        out = stretch == k
        predicted[out] = np.polynomial.polynomial.polyval(x[out], _fitted(x[~out], y[~out], degree))
    return 100 * (1 - float(np.linalg.norm(y - predicted) / np.linalg.norm(y - y.mean())))
