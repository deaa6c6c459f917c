"""Intervals of the estimates, and plain sentences on what recordings cannot tell."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from optimizers.estimation.confidence import correlations
from optimizers.identification.answers import Samples
from optimizers.identification.result import Estimate
from optimizers.recorded.recording import Unknown
from optimizers.search.result import Status

NORMAL_95 = 1.959963984540054
STRONG_CORRELATION = 0.95

_NO_INFLUENCE = 1e-12
"""Part of the errors that a parameter must move when it doubles."""
_SAME = 1e-6
"""A direction of the (scaled) parameters that moves the errors less, relative to the strongest, is not seen."""
_TAKES_PART = 0.1


def estimate(unknown: Unknown, x: float, deviation: float | None) -> Estimate:
    """Return a parameter with its interval; ``deviation`` is the standard deviation of its coordinate."""
    lower: float | None = None
    upper: float | None = None
    if deviation is not None:
        low, high = _interval(unknown, x, deviation)
        lower, upper = max(low, unknown.lower), min(high, unknown.upper)
    return Estimate(value=unknown.value(x), unit=unknown.unit, lower95=lower, upper95=upper, start=unknown.start)


def silent(unknowns: Sequence[Unknown], jacobian: Samples, x: Samples) -> tuple[int, ...]:
    """Return the parameters that do not move the errors at all."""
    moved = np.linalg.norm(jacobian, axis=0)[: len(unknowns)] * np.array(
        [1.0 if u.log else max(abs(float(c)), abs(u.start), 1e-300) for u, c in zip(unknowns, x, strict=False)]
    )
    return tuple(int(i) for i in np.flatnonzero(moved <= _NO_INFLUENCE))


def sentences(unknowns: Sequence[Unknown], x: Samples, cov: Samples, jacobian: Samples) -> tuple[str, ...]:
    """Say what the recordings cannot tell."""
    without = silent(unknowns, jacobian, x)
    said = [f"{unknowns[i].parameter} has no influence on what was measured: keep it at a known value" for i in without]
    heard = [i for i in range(len(unknowns)) if i not in without]
    groups = _groups(jacobian, heard)
    for group in groups:
        names = [unknowns[i].parameter for i in group]
        said.append(
            f"{', '.join(names[:-1])} and {names[-1]} act in the same way on what was measured: "
            "only a combination of them can be identified"
        )
    said += _pairs(unknowns, x, cov, heard, groups)
    for i in heard:
        unknown = unknowns[i]
        low, high = _interval(unknown, float(x[i]), math.sqrt(cov[i, i]))
        reach = f"from {max(low, unknown.lower):.3g} to {min(high, unknown.upper):.3g} {unknown.unit}".rstrip()
        if low <= unknown.lower and high >= unknown.upper:
            said.append(f"{unknown.parameter} is not determined within its bounds: its 95 % interval reaches {reach}")
        elif not unknown.log and low <= 0 <= high:
            said.append(f"{unknown.parameter} cannot be told from 0: its 95 % interval reaches {reach}")
    return tuple(said)


def advice(status: Status, unknowns: Sequence[Unknown], x: Samples, indistinguishable: Sequence[str]) -> str:
    """Say what to do."""
    if status is Status.STALLED:
        return "The model has no bounded response at any start: choose starts (or fixed parameters) where it is stable."
    said = []
    if status is Status.CANCELLED:
        said.append("Cancelled: these are the best values met before.")
    if status is Status.BUDGET:
        said.append(
            "The search had not settled when its evaluations or its time were used up: start nearer, or narrow the bounds."
        )
    said += [f"{sentence}." for sentence in at_bounds(unknowns, x)]
    if indistinguishable:
        said.append(
            "Fix one of the parameters that are hard to tell apart, or design for every combination that the intervals allow."
        )
    return " ".join(said)


def at_bounds(unknowns: Sequence[Unknown], x: Samples) -> list[str]:
    """Return a sentence on each parameter that came to rest at a bound."""
    said = []
    for unknown, c in zip(unknowns, x, strict=False):
        value = unknown.value(float(c))
        for side, bound in (("lower", unknown.lower), ("upper", unknown.upper)):
            if value == bound == 0:
                said.append(f"{unknown.parameter} came to rest at 0: the recording shows none of it")
            elif math.isfinite(bound) and math.isclose(value, bound, rel_tol=1e-9):
                limit = f"{bound:.4g} {unknown.unit}".rstrip()
                said.append(
                    f"{unknown.parameter} came to rest at its {side} bound {limit}: the recording asks for more room"
                )
    return said


def _interval(unknown: Unknown, x: float, deviation: float) -> tuple[float, float]:
    """Return the 95 % interval of the value, not cut at the bounds."""
    reach = NORMAL_95 * deviation
    if unknown.log:
        return math.exp(max(x - reach, -700.0)), math.exp(min(x + reach, 700.0))
    return x - reach, x + reach


def _groups(jacobian: Samples, heard: Sequence[int]) -> list[tuple[int, ...]]:
    """Return the parameters that act together in each direction that is not seen."""
    if not heard:
        return []
    columns = jacobian[:, heard]
    _, strength, right = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    found = []
    for s, direction in zip(strength, right, strict=True):
        group = tuple(i for i, part in zip(heard, direction, strict=True) if abs(part) > _TAKES_PART)
        if s < _SAME * strength[0] and len(group) > 1 and group not in found:
            found.append(group)
    return found


def _pairs(
    unknowns: Sequence[Unknown], x: Samples, cov: Samples, heard: Sequence[int], groups: Sequence[tuple[int, ...]]
) -> list[str]:
    """Return a sentence for each pair that is strongly correlated, and no group by itself."""
    matrix = correlations(cov)
    values = [u.value(float(c)) for u, c in zip(unknowns, x, strict=False)]
    slope = np.array([u.slope(float(c)) for u, c in zip(unknowns, x, strict=False)])
    linear = cov[: len(slope), : len(slope)] * np.outer(slope, slope)
    said = []
    for place, i in enumerate(heard):
        for j in heard[:place]:
            first, second = unknowns[i], unknowns[j]
            if abs(matrix[i, j]) <= STRONG_CORRELATION or any({i, j} <= set(group) for group in groups):
                continue
            sentence = (
                f"{second.parameter} and {first.parameter} are hard to tell apart (correlation {matrix[i, j]:.3f})"
            )
            if matrix[i, j] < 0 and first.unit == second.unit:
                spread = NORMAL_95 * math.sqrt(max(linear[i, i] + linear[j, j] + 2 * linear[i, j], 0.0))
                sentence += f": their sum {values[i] + values[j]:.4g} {first.unit} is known to ± {spread:.2g}"
            said.append(sentence)
    return said
