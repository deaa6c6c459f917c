"""Quantizer: the nearest multiple of a step.

y = step · round(u / step)
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from engine.elements._base import Array, Ports, Realization, Values, matrix
from engine.elements._limiting import Limiting, Shape
from engine.elements._nonlinear import Change, Mode, Moment, NonlinearElement, Pattern, Signals, first
from engine.model.parameters import Param

_AT_EDGE = 1e-9
_MOST_EDGES = 1000


class Quantizer(NonlinearElement):
    """Resolution of a converter or an encoder.

    An even mode 2 k is the level k; an odd one, 2 k + 1, slides along the edge above it, where the output drives the input
    back from either side and takes the mean value that keeps it there.
    """

    kind = "quantizer"
    title = "Quantizer"
    equation = "y = step · round(u/step)"
    source = "G. F. Franklin, J. D. Powell, M. Workman, Digital Control of Dynamic Systems, 3rd ed., chapter 10."
    note = "a quantizer is linearised as a gain of 1"
    modes = (0, 1, 2)
    parameters = (
        Param(
            name="step", symbol="q", lower=0.0, lower_open=True, scale="log",
            doc="distance of the levels, in units of the input",
        ),
    )  # fmt: skip
    example = {"step": 0.01}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def feed_through(cls, values: Values) -> Pattern:
        """Return none: on a level the output does not follow the input."""
        return np.zeros((1, 1), dtype=bool)

    @classmethod
    def start(cls, m: Moment, values: Values) -> Mode:
        """Return the level of the input."""
        return 2 * _level(m, values)

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the level; what is held on an edge."""
        return [values["step"] * (mode // 2)]

    @classmethod
    def limiting(cls, values: Values) -> Limiting:
        """Return the nearest level."""
        return Limiting(values["step"], values["step"], shape=Shape.LEVELS)

    @classmethod
    def across(cls, guard: int, mode: Mode, values: Values) -> Mode | None:
        """Return the next level, unless the input is held on an edge."""
        return None if mode % 2 else mode + (2, -2)[guard]

    @classmethod
    def held(cls, mode: Mode) -> int | None:
        """Return that an edge holds the input."""
        return 0 if mode % 2 else None

    @classmethod
    def surface(cls, m: Moment, mode: Mode, values: Values) -> Any:
        """Return how far the input is from the edge."""
        return m.z[0] - values["step"] * (0.5 * mode)

    @classmethod
    def unheld(cls, m: Moment, mode: Mode, values: Values, *, before: Mode) -> Change:
        """Return the level on the other side: the input passes the edge; the one below where it had been held."""
        return Change(mode=mode - 1 if before > mode or before == mode else mode + 1)

    @classmethod
    def release(cls, m: Moment, mode: Mode, values: Values) -> Change:
        """Return the level below an edge: nothing holds the input there while it jumps."""
        return Change(mode=mode - mode % 2)

    @classmethod
    def affine(cls, mode: Mode, values: Values) -> bool:
        """Return that the output is constant, or held."""
        return True

    @classmethod
    def alike(cls, mode: Mode) -> Mode:
        """Return one level for all levels, one edge for all edges."""
        return mode % 2

    @classmethod
    def describing_function(cls, amplitude: Array, values: Values) -> Array | None:
        """Return 4 q/(π A) Σ sqrt(1 - ((2 k - 1) q/(2 A))²): a pair of rectangles for each edge passed."""
        step = float(values["step"])
        ratio = np.asarray(amplitude, dtype=float) / step
        # of many edges nothing is left but the gain of 1: the sum differs from it by less than 1e-4
        count = int(min(np.max(ratio, initial=0.0) + 0.5, _MOST_EDGES))
        edges = np.arange(1, count + 1) - 0.5
        depth = np.clip(1 - (edges / ratio[..., None]) ** 2, 0.0, None)
        gain = 4 / (np.pi * ratio) * np.sqrt(depth).sum(axis=-1)
        return np.where(ratio > _MOST_EDGES, 1.0, gain) + 0j

    @classmethod
    def guards(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far the input is beyond the edges of the level, or the mean value beyond the two levels."""
        step = values["step"]
        if mode % 2:
            return [m.y[0] - step * (mode // 2 + 1), step * (mode // 2) - m.y[0]]
        return [m.z[0] - step * (mode // 2 + 0.5), step * (mode // 2 - 0.5) - m.z[0]]

    @classmethod
    def switch(cls, guard: int, m: Moment, mode: Mode, values: Values) -> Change:
        """Return the edge between, or the level of an input which has jumped."""
        if mode % 2:
            return Change(mode=mode + (1, -1)[guard])
        edge = first(values["step"]) * (mode // 2 + (0.5, -0.5)[guard])
        if abs(first(m.z[0]) - edge) > _AT_EDGE * first(values["step"]):
            return Change(mode=2 * _level(m, values))
        return Change(mode=mode + (1, -1)[guard])

    @classmethod
    def small_signal(cls, m: Moment, mode: Mode, values: Values) -> Realization | None:
        """Return a gain of 1."""
        return Realization.static(matrix([[1.0]]))


def _level(m: Moment, values: Values) -> int:
    return math.floor(first(m.z[0]) / first(values["step"]) + 0.5)
