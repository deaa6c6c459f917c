"""Backlash: the output stands still while the input crosses the play, and follows at one of its flanks.

y' = u'  where |u - y| = width/2 and the input pushes on,   y' = 0 else
"""

from __future__ import annotations

import numpy as np

from engine.elements._base import Array, Ports, Realization, Values, matrix
from engine.elements._fundamental import limited
from engine.elements._nonlinear import Change, Mode, Moment, NonlinearElement, Signals
from engine.model.parameters import Param


class Backlash(NonlinearElement):
    """Play of gears and joints, friction-driven: the output rests where it is left."""

    kind = "backlash"
    title = "Backlash"
    equation = "y' = u' where |u - y| = width/2 and the input pushes on, y' = 0 else"
    source = "J.-J. E. Slotine, W. Li, Applied Nonlinear Control, Prentice Hall 1991, section 5.2."
    note = "backlash is linearised as a gain of 1"
    states = ("output",)
    modes = (-1, 0, 1)
    parameters = (
        Param(name="width", symbol="w", lower=0.0, doc="whole play, in units of the input"),
        Param(name="initial", symbol="y_0", default=0.0, doc="output at the beginning"),
    )
    example = {"width": 0.02}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def initial(cls, values: Values) -> Signals:
        """Return the output at the beginning."""
        return [values["initial"]]

    @classmethod
    def rates(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return 0: the state is where the output was left."""
        return [0.0 * m.z[0]]

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the state inside the play (mode 0), else the flank that pushes up (1) or down (-1)."""
        return [0.0 * m.z[0] + m.x[0] if mode == 0 else m.z[0] - mode * 0.5 * values["width"]]

    @classmethod
    def affine(cls, mode: Mode, values: Values) -> bool:
        """Return that the output stays, or follows the flank."""
        return True

    @classmethod
    def describing_function(cls, amplitude: Array, values: Values) -> Array | None:
        """Return (1 + f(r))/2 - j (1 - r²)/π with r = 1 - w/A, the fundamental of a flattened and late sine."""
        r = np.clip(1.0 - values["width"] / amplitude, -1.0, 1.0)
        return np.asarray(0.5 * (1.0 + limited(r)) - 1j * (1.0 - r * r) / np.pi)

    @classmethod
    def guards(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far the input is beyond a flank, or how fast it leaves it."""
        if mode == 0:
            half = 0.5 * values["width"]
            return [m.z[0] - half - m.x[0], m.x[0] - half - m.z[0]]
        return [-mode * m.slope[0]] if m.slope else []

    @classmethod
    def switch(cls, guard: int, m: Moment, mode: Mode, values: Values) -> Change:
        """Return to a flank, or from it into the play, where the output stays."""
        if mode == 0:
            return Change(mode=(1, -1)[guard])
        return Change(mode=0, x=[m.z[0] - mode * 0.5 * values["width"]])

    @classmethod
    def release(cls, m: Moment, mode: Mode, values: Values) -> Change:
        """Return into the play, the output staying where it was."""
        return Change(mode=0, x=[m.x[0] if mode == 0 else m.z[0] - mode * 0.5 * values["width"]])

    @classmethod
    def small_signal(cls, m: Moment, mode: Mode, values: Values) -> Realization | None:
        """Return a gain of 1."""
        return Realization.static(matrix([[1.0]]))
