"""Lookup table: straight lines between given points.

y = y_k + (y_{k+1} - y_k) (u - u_k) / (u_{k+1} - u_k)   for u_k <= u < u_{k+1}
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import Any

import numpy as np

from engine.elements._base import Array, Ports, Values
from engine.elements._fundamental import limited
from engine.elements._nonlinear import Change, Mode, Moment, NonlinearElement, Signals, first
from engine.model.errors import DiagramError
from engine.model.parameters import Param


class LookupTable(NonlinearElement):
    """A measured characteristic. The mode is the interval that the input lies in, so that every line is exact."""

    kind = "lookup_table"
    title = "Lookup table"
    equation = "y = linear interpolation of (points, values) at u"
    source = "Definition."
    note = "the slope of the table at its operating point counts"
    continuous = True
    parameters = (
        Param(name="points", symbol="u_k", shape="list", doc="inputs, increasing, two at least"),
        Param(name="values", symbol="y_k", shape="list", doc="outputs at these inputs"),
        Param(
            name="extrapolation", symbol="y_∞", shape="text", choices=("hold", "linear"), default="hold",
            doc="beyond the ends: hold the last value, or go on straight",
        ),
    )  # fmt: skip
    example = {"points": [-1.0, 0.0, 2.0], "values": [-0.5, 0.0, 3.0]}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse lists of different length, or fewer than two points."""
        count = len(values["points"])
        if count < 2:
            raise DiagramError(f"points must be at least 2, got {count}", at=("points",))
        if len(values["values"]) != count:
            raise DiagramError(
                f"values must be as many as points ({count}), got {len(values['values'])}", at=("values",)
            )
        for k in range(1, count):
            if values["points"][k].real <= values["points"][k - 1].real:
                raise DiagramError(
                    f"points[{k}] must be > {values['points'][k - 1].real:g} (the one before), "
                    f"got {values['points'][k].real:g}",
                    at=("points", k),
                )

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def _interval(cls, m: Moment, values: Values) -> Mode:
        return bisect_right([first(p) for p in values["points"]], first(m.z[0])) - 1

    @classmethod
    def start(cls, m: Moment, values: Values) -> Mode:
        """Return the number of the interval that the input lies in, -1 before the first."""
        return cls._interval(m, values)

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the line of the interval, or what lies beyond the ends."""
        points, heights = values["points"], values["values"]
        last = len(points) - 1
        if values["extrapolation"] == "hold" and not 0 <= mode < last:
            return [0.0 * m.z[0] + heights[0 if mode < 0 else -1]]
        k = min(max(mode, 0), last - 1)
        rise = (heights[k + 1] - heights[k]) / (points[k + 1] - points[k])
        return [heights[k] + rise * (m.z[0] - points[k])]

    @classmethod
    def affine(cls, mode: Mode, values: Values) -> bool:
        """Return that every interval is a straight line."""
        return True

    @classmethod
    def limits(cls, values: Values) -> Sequence[tuple[Any, Any]]:
        """Return the least and the greatest value where the table holds its ends."""
        if values["extrapolation"] != "hold":
            return ()
        return [(min(values["values"], key=first), max(values["values"], key=first))]

    @classmethod
    def describing_function(cls, amplitude: Array, values: Values) -> Array | None:
        """Return Σ slope_k (f(u_k+1/A) - f(u_k/A))/2 over the intervals, f being that of a limiter."""
        points, heights = np.array(values["points"], dtype=float), np.array(values["values"], dtype=float)
        rises = np.diff(heights) / np.diff(points)
        if values["extrapolation"] == "linear":
            points[[0, -1]] = -np.inf, np.inf
        shares = limited(points / np.asarray(amplitude)[..., None])
        return 0.5 * np.diff(shares, axis=-1) @ rises + 0j

    @classmethod
    def guards(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far the input is beyond the ends of the interval."""
        points = values["points"]
        below = points[mode] - m.z[0] if mode >= 0 else -1.0
        above = m.z[0] - points[mode + 1] if mode + 1 < len(points) else -1.0
        return [below, above]

    @classmethod
    def switch(cls, guard: int, m: Moment, mode: Mode, values: Values) -> Change:
        """Return the next interval, or that of an input which has jumped further."""
        there = cls._interval(m, values)
        return Change(mode=min(there, mode - 1) if guard == 0 else max(there, mode + 1))
