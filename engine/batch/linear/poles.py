"""Poles of many systems: what decays, for how long, and metrics of poles with their derivatives.

dλ/dp = w A_p v / (w v);   the quotient w A v / (w v) is wrong to second order in the vectors
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch import stacks

Real = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Array = npt.NDArray[Any]

_EPS: Final = float(np.finfo(float).eps)
_KNOWN: Final = 1e-11
"""A pole is known well enough whose rounding is below this part of it."""
_APART: Final = 1e-7
"""Nearer to the real axis, to 0 or to another pole that decides, relative to the pole, the exact path tells."""
_ON_AXIS: Final = 1e-12
_LEFT: Final = 36.0
_SHARES: Final = np.linspace(0.05, 0.99, 95)


def growth_of(values: Array) -> Real:
    """Return the largest real part of poles (B, n), 1/s; NaN where it cannot be told from 0."""
    rightmost = values.real.max(axis=1)
    unsure = np.abs(rightmost) <= _ON_AXIS * np.abs(values).max(axis=1)
    return np.asarray(np.where(unsure, np.nan, rightmost))


def lifetime_of(values: Array) -> Real:
    """Return how long responses last, s, of systems whose poles (B, n) all decay: Chernoff's bound on poles in a row."""
    rates = np.where(values.imag >= 0, -values.real, np.inf)
    slowest = rates.min(axis=1)
    left = np.log1p(-_SHARES[:, None] * (slowest / rates.T).T[:, None, :]).sum(axis=2)
    return np.asarray(((_LEFT - left) / _SHARES).min(axis=1) / slowest)


def poles_of(a: Array) -> tuple[Array, Array, Flags]:
    """Return poles (B, n), their first change where ``a`` (B, n, n) carries infinitesimals, and which are not known well enough."""
    # complex whether or not some pole of somebody is
    values, right = (found.astype(complex) for found in np.linalg.eig(a.real))
    with np.errstate(all="ignore"):
        left = stacks.solve(right, np.eye(a.shape[1]))
        refined = stacks.contract(left, a.real @ right)
        size = stacks.contract(np.abs(left), np.abs(a.real) @ np.abs(right))
        unsure = ~(20 * _EPS * size <= _KNOWN * np.abs(values)) | ~(np.abs(refined - values) <= 1e-9 * np.abs(values))
        motion = stacks.contract(left, a.imag @ right) if np.iscomplexobj(a) else np.zeros_like(refined)
    refined = np.where(values.imag == 0, refined.real, refined)
    return np.where(unsure, values, refined), motion, np.asarray(unsure)


def _upper(values: Array) -> Flags:
    return np.asarray(values.imag > 0)


def _ambiguous(values: Array, unsure: Flags) -> Flags:
    """Return whose poles are not known, lie near 0 or so near the axis that a pair may be two real ones."""
    sizes = np.abs(values)
    near = (values.imag != 0) & (np.abs(values.imag) <= _APART * sizes)
    zero = sizes <= _APART * sizes.max(axis=1, keepdims=True) * 1e-3
    return np.asarray((unsure | near | zero).any(axis=1))


def _tied(scores: Array, chosen: Array, scale: Array) -> Flags:
    """Return where another pole decides as well."""
    best = np.take_along_axis(scores, chosen[:, None], axis=1)
    rivals = np.abs(scores - best) <= _APART * scale[:, None]
    np.put_along_axis(rivals, chosen[:, None], values=False, axis=1)
    return np.asarray(rivals.any(axis=1))


def _damping(values: Array, motion: Array) -> tuple[Array, Flags]:
    """Return the smallest -Re p / |p|."""
    moved = values.real + 1j * motion.real
    imaginary = values.imag + 1j * motion.imag
    paired = _upper(values)
    with np.errstate(all="ignore"):
        ratios = np.where(paired, -moved / np.sqrt(moved * moved + imaginary * imaginary), -np.sign(values.real))
    scores = np.where(paired | (values.imag == 0), ratios.real, np.inf)
    chosen = scores.argmin(axis=1)
    found = np.take_along_axis(ratios, chosen[:, None], axis=1)[:, 0]
    single = np.abs(found.real) == 1.0
    return found, ~single & _tied(scores, chosen, np.ones(len(values)))


def _critical(values: Array, motion: Array) -> tuple[Array, Flags]:
    """Return the natural frequency of the complex pair with the largest real part; NaN without a pair."""
    moved = values.real + 1j * motion.real
    imaginary = values.imag + 1j * motion.imag
    paired = _upper(values)
    scores = np.where(paired, values.real, -np.inf)
    chosen = scores.argmax(axis=1)
    sizes = np.sqrt(moved * moved + imaginary * imaginary)
    found = np.take_along_axis(sizes, chosen[:, None], axis=1)[:, 0]
    with np.errstate(invalid="ignore"):
        tied = _tied(np.where(paired, scores, -1e300), chosen, np.abs(found))
    some = paired.any(axis=1)
    return np.where(some, found, np.nan), some & tied


def _abscissa(values: Array, motion: Array) -> tuple[Array, Flags]:
    """Return the largest real part."""
    chosen = values.real.argmax(axis=1)
    found = np.take_along_axis(values.real + 1j * motion.real, chosen[:, None], axis=1)[:, 0]
    lower = np.where(values.imag < 0, -np.inf, values.real)
    chosen = lower.argmax(axis=1)
    size = np.abs(np.take_along_axis(values, chosen[:, None], axis=1)[:, 0])
    return found, _tied(np.where(np.isinf(lower), -1e300, lower), chosen, size) | (np.abs(found.real) <= _APART * size)


METRICS: Mapping[str, Callable[[Array, Array], tuple[Array, Flags]]] = MappingProxyType(
    {"damping_ratio": _damping, "critical_frequency": _critical, "spectral_abscissa": _abscissa}
)


def measured(metric: str, a: Array) -> tuple[Array, Flags, Real]:
    """Return a metric of the poles of ``a`` (B, n, n) with its change as the imaginary part, which are doubtful, and the growth."""
    values, motion, unsure = poles_of(a)
    return (*read(metric, values, motion, unsure), growth_of(values))


def read(metric: str, values: Array, motion: Array, unsure: Flags) -> tuple[Array, Flags]:
    """Return a metric of poles (B, n) with its change as the imaginary part, and which are doubtful; see :func:`poles_of`."""
    found, doubt = METRICS[metric](values, motion)
    return found, doubt | _ambiguous(values, unsure)
