"""What linear laws of a digital controller share: states and outputs from sample to sample, held in between.

x_{k+1} = A x_k + B u_k,   y_k = C x_k + D u_k,   y(t) = y_k for k T + delay <= t < (k + 1) T + delay
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np

from engine.elements._base import Array, Realization, Values
from engine.elements._nonlinear import Mode, Moment, Pattern, Signals
from engine.elements._sampler import Sampler

_APART = 1e-6
"""A pole at z = -1 has no continuous counterpart: it is taken so far beside it."""


class Discrete(Sampler):
    """States: the outputs, what they become after the delay, and those of the law."""

    note = "as a continuous block (exports, describing functions) it is Tustin's approximation, without its delays"

    @classmethod
    @abstractmethod
    def discrete(cls, values: Values) -> Realization:
        """Return A, B, C and D of the law in z."""

    @classmethod
    def initial(cls, values: Values) -> Signals:
        """Return rest."""
        return [0.0] * (2 * len(cls.ports(values).outputs) + cls.discrete(values).a.shape[-1])

    @classmethod
    def feed_through(cls, values: Values) -> Pattern:
        """Return none: between samples no output follows an input."""
        ports = cls.ports(values)
        return np.zeros((len(ports.outputs), len(ports.inputs)), dtype=bool)

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return what is held."""
        return m.x[: len(cls.ports(values).outputs)]

    @classmethod
    def update(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the outputs at what the last sample has made of them."""
        count = len(cls.ports(values).outputs)
        return [*m.x[count : 2 * count], *m.x[count:]]

    @classmethod
    def sample(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the states after a sample."""
        held, computed, moved = cls._step(m, values)
        return [*(held if np.any(values["delay"]) else computed), *computed, *moved]

    @classmethod
    def unrest(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far the states are from those of ever the same input."""
        held, computed, moved = cls._step(m, values)
        count = len(computed)
        return [
            *(new - old for new, old in zip(computed, held, strict=True)),
            *(new - old for new, old in zip([*computed, *moved], m.x[count:], strict=True)),
        ]

    @classmethod
    def _step(cls, m: Moment, values: Values) -> tuple[list[Any], list[Any], list[Any]]:
        """Return the outputs that are held, those of this sample, and the next states of the law."""
        law = cls.discrete(values)
        count = len(cls.ports(values).outputs)
        x = m.x[2 * count :]
        return list(m.x[:count]), _sums(law.c, x, law.d, m.z), _sums(law.a, x, law.b, m.z)

    @classmethod
    def small_signal(cls, m: Moment, mode: Mode, values: Values) -> Realization | None:
        """Return Tustin's approximation, z = (1 + s T/2)/(1 - s T/2)."""
        law = cls.discrete(values)
        if not law.a.shape[-1]:
            return Realization.static(law.d)
        n, half = law.a.shape[-1], 0.5 * np.asarray(values["sample_time"])[..., None, None]
        near = np.eye(n) + law.a
        if np.linalg.matrix_rank(near.reshape(-1, n, n)[0].real) < n:
            near = near + _APART * np.eye(n)
        inverse = np.linalg.inv(near)
        return Realization(
            a=(law.a - np.eye(n)) @ inverse / half, b=2 * inverse @ law.b / half, c=law.c @ inverse,
            d=law.d - law.c @ inverse @ law.b,
        )  # fmt: skip


def _sums(left: Array, x: Signals, right: Array, u: Signals) -> list[Any]:
    """Return left x + right u, row by row; entries of the matrices may be lanes."""
    rows = []
    for i in range(right.shape[-2]):
        terms = [left[..., i, j] * x[j] for j in range(left.shape[-1])]
        terms += [right[..., i, j] * u[j] for j in range(right.shape[-1])]
        rows.append(sum(terms[1:], terms[0]))
    return rows
