"""Whether a result is plausible beside the start it was given: a sign or a unit taken wrongly, a bound, a fit that is none.

    g = <ŷ_0, y> / <ŷ_0, ŷ_0>,   c = <ŷ_0, y> / (||ŷ_0|| ||y||)     ŷ_0: the model's answer at the given start, means taken off

The least squares cannot tell them from dynamics: they end at a bound, or with parameters that no machine has.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from optimizers.identification import words
from optimizers.identification.answers import Samples
from optimizers.recorded.recording import Unknown

Signals = npt.NDArray[Any]
Pairs = Mapping[str, tuple[Signals, Signals]]
"""Measured and simulated signals by output: samples, or complex values at lines."""

_ALIKE: Final = 0.5
"""Correlation from which on two signals are the same movement, whatever its size."""
_FAR: Final = 30.0
"""Times that a start that means the same unit is seldom away."""
_NEAR: Final = 1.15
"""Times that a factor between units may be away where a start that is merely rough might be as far."""
_LITTLE: Final = 10.0
_GOOD: Final = 50.0
"""Percent of fit."""
_UNITS: Final = {
    "milli, such as mm taken for m": 1e3, "micro, such as µm taken for m": 1e6, "bar taken for Pa, or the reverse": 1e5,
    "degrees taken for rad, or the reverse": 180 / math.pi, "1/min taken for rad/s, or the reverse": 30 / math.pi,
    "Hz taken for rad/s, or the reverse": 2 * math.pi, "inches taken for mm, or the reverse": 25.4,
}  # fmt: skip


def implausible(unknowns: Sequence[Unknown], x: Samples, begun: Pairs, ended: Pairs) -> tuple[str, ...]:
    """Return a sentence on each sign and unit that may be wrong, each parameter at a bound, each output that is not explained.

    Parameters
    ----------
    unknowns : sequence of Unknown
    x : ndarray
        Coordinates of what was found.
    begun, ended : mapping of output to (ndarray, ndarray)
        Measured and simulated signals at the given start, and with what was found; empty where there is no answer.
    """
    turned = any(u.start * u.value(float(c)) < 0 for u, c in zip(unknowns, x, strict=False))
    said: list[str] = []
    for output, pair in begun.items():
        fit = _fit(*ended[output]) if output in ended else None
        said += _beside_the_start(output, *pair, settled=fit is not None and fit > _GOOD and not turned)
    said += words.at_bounds(unknowns, x)
    for output, pair in ended.items():
        fit = _fit(*pair)
        if fit is not None and fit < _LITTLE:
            said.append(
                f"the model explains little of {output} (fit {fit:.3g} %, where the mean of what was measured has 0): do not use "
                "the values before you know why"
            )
    return tuple(said)


def joined(parts: Iterable[tuple[str, Pairs]]) -> Pairs:
    """Return the pairs of several experiments, each under the output's name and the experiment's."""
    return {f"{output} in {name}" if name else output: pair for name, pairs in parts for output, pair in pairs.items()}


def _beside_the_start(output: str, measured: Signals, simulated: Signals, *, settled: bool) -> list[str]:
    y, model = _moving(measured), _moving(simulated)
    size = float(np.linalg.norm(y) * np.linalg.norm(model))
    if size == 0:
        return []
    along = float(np.vdot(model, y).real)
    if abs(along) < _ALIKE * size:
        return []
    ratio = along / float(np.linalg.norm(model)) ** 2
    said = []
    if along < 0 and not settled:
        said.append(
            f"{output} moves against the model at its start (correlation {along / size:.2f}): is the sign of an input, an output "
            "or a parameter the wrong one?"
        )
    times = max(abs(ratio), 1 / abs(ratio))
    name = min(_UNITS, key=lambda unit: abs(math.log(times / _UNITS[unit])))
    away = max(times / _UNITS[name], _UNITS[name] / times)
    if times > _FAR or away < _NEAR:
        known = f" ({name}: {_UNITS[name]:.4g})" if away < 2 else ""
        said.append(
            f"{output} moves {abs(ratio):.3g} times as much as the model at its start: is a unit the wrong one{known}?"
        )
    return said


def _moving(signal: Signals) -> Signals:
    """Return a signal without its mean; a response has none."""
    return signal if np.iscomplexobj(signal) else signal - signal.mean()


def _fit(measured: Signals, simulated: Signals) -> float | None:
    spread = float(np.linalg.norm(measured - measured.mean()))
    if spread <= 1e-14 * float(np.linalg.norm(measured)):
        return None
    return 100 * (1 - float(np.linalg.norm(measured - simulated)) / spread)
