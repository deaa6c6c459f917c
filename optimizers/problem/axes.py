"""Variables, and the coordinates of the search that they become.

continuous:  p = lower + x (upper - lower),   on a logarithmic scale  p = lower (upper / lower)^x,   0 ≤ x ≤ 1
discrete:    p = levels[round(x (n - 1))]
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.model.errors import Path
from optimizers.problem.commands import PREFIX
from optimizers.problem.errors import ProblemError, amount

if TYPE_CHECKING:
    from engine.model.parameters import ParameterInfo

Vector = npt.NDArray[np.float64]

_END = 1e-12
_MOST_LEVELS = 10_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable:
    """A parameter that may be chosen; what is None is taken from the parameter itself (start: its present value).

    A parameter is one of the system's, or a number of a command: ``signals.<experiment>.<port>.<parameter>``.
    ``choices`` are the only values allowed (those of a catalogue), ``integer`` allows whole numbers between the bounds.
    With an ``expression`` over other variables and parameters it is not free, but tied to them.
    """

    parameter: str
    lower: float | None = None
    upper: float | None = None
    scale: str | None = None
    start: float | None = None
    choices: tuple[float, ...] | None = None
    integer: bool = False
    expression: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """A variable with every default filled in: one coordinate of the search, scaled to 0…1.

    ``levels`` are the only values of a discrete one, rising; its slope is 0, because it has none.
    """

    parameter: str
    lower: float
    upper: float
    start: float
    log: bool
    unit: str = ""
    levels: tuple[float, ...] = ()

    @property
    def discrete(self) -> bool:
        """Whether only ``levels`` are allowed."""
        return bool(self.levels)

    def value(self, position: Vector | float) -> Vector:
        """Return parameter values (SI) at positions in 0…1; the ends give the bounds themselves."""
        x = np.clip(np.asarray(position, dtype=np.float64), 0.0, 1.0)
        if self.levels:
            return np.asarray(np.take(self.levels, np.rint(x * (len(self.levels) - 1)).astype(int)))
        if self.log:
            values = self.lower * np.exp(x * math.log(self.upper / self.lower))
        else:
            values = self.lower + x * (self.upper - self.lower)
        # The ends are exact, though a descent reaches them only to rounding.
        return np.where(x <= _END, self.lower, np.where(x >= 1 - _END, self.upper, values))

    def position(self, value: float) -> float:
        """Return the position in 0…1 of a parameter value, clipped to the bounds, of the nearest level if discrete."""
        if self.levels:
            return float(np.abs(np.asarray(self.levels) - value).argmin()) / (len(self.levels) - 1)
        inside = min(max(value, self.lower), self.upper)
        if self.log:
            return math.log(inside / self.lower) / math.log(self.upper / self.lower)
        return (inside - self.lower) / (self.upper - self.lower)

    def slope(self, value: float) -> float:
        """Return d(value)/d(position), 0 for a discrete one."""
        if self.levels:
            return 0.0
        return value * math.log(self.upper / self.lower) if self.log else self.upper - self.lower


def axis_of(variable: Variable, info: ParameterInfo, at: Path) -> Axis:
    """Return a variable with every default filled in.

    Raises
    ------
    ProblemError
        Bounds that are missing, contradict each other or those of the parameter, a start outside them, a wrong scale.
    """
    name = variable.parameter
    if info.bound:
        raise ProblemError(
            f"{name} must be a number to be varied, got an expression (vary the parameters it is made of)",
            at=(*at, "parameter"),
        )
    levels = _levels(variable, info, at)
    if levels:
        start = info.value if variable.start is None else variable.start
        if variable.start is not None and start not in levels:
            raise ProblemError(
                f"start must be one of the values allowed, got {amount(start, info.unit)}", at=(*at, "start")
            )
        return Axis(
            parameter=name, lower=levels[0], upper=levels[-1], start=min(levels, key=lambda level: abs(level - start)),
            log=False, unit=info.unit, levels=levels,
        )  # fmt: skip
    lower, upper = range_of(info, variable.lower, variable.upper, at)
    start = info.value if variable.start is None else variable.start
    if variable.start is not None and not lower <= start <= upper:
        raise ProblemError(
            f"start must be within {lower:g} … {amount(upper, info.unit)}, got {start:g}", at=(*at, "start")
        )
    return Axis(
        parameter=name, lower=lower, upper=upper, start=min(max(start, lower), upper),
        log=logarithmic(variable.scale, info, lower, at), unit=info.unit,
    )  # fmt: skip


def range_of(info: ParameterInfo, lower: float | None, upper: float | None, at: Path) -> tuple[float, float]:
    """Return the bounds given, or those of the parameter; both finite, apart, and within those of the parameter."""
    low = info.lower if lower is None else lower
    high = info.upper if upper is None else upper
    for key, bound in (("lower", low), ("upper", high)):
        if bound is None or not math.isfinite(bound):
            raise ProblemError(
                f"{key} must be given for {info.path} (a finite number), the parameter itself has none", at=(*at, key)
            )
    if low >= high:
        got = "a range of zero width" if low == high else f"{high:g}"
        raise ProblemError(f"upper must be > lower {amount(low, info.unit)}, got {got}", at=(*at, "upper"))
    _check_within(info, {"lower": low, "upper": high}, at)
    return low, high


def logarithmic(scale: str | None, info: ParameterInfo, lower: float, at: Path) -> bool:
    """Return whether a range is scaled by factors: as asked for, or as the parameter prefers."""
    if scale not in {None, "linear", "log"}:
        raise ProblemError(f"scale must be linear or log, got {scale!r}", at=(*at, "scale"))
    if scale == "log" and lower <= 0:
        raise ProblemError(
            f"lower must be > {amount(0.0, info.unit)} on a logarithmic scale, got {lower:g}", at=(*at, "lower")
        )
    # A parameter's own log scale is a preference: bounds that include 0 or negative values override it.
    return (scale or info.scale) == "log" and lower > 0


def _levels(variable: Variable, info: ParameterInfo, at: Path) -> tuple[float, ...]:
    """Return the only values allowed, rising; none for a continuous variable."""
    if variable.choices is not None:
        for key in ("lower", "upper", "scale"):
            if getattr(variable, key) is not None:
                raise ProblemError(f"{key} must be left out beside choices: they are the only values", at=(*at, key))
        if variable.integer:
            raise ProblemError("integer must be left out beside choices: they are the only values", at=(*at, "integer"))
        levels = tuple(sorted(set(variable.choices)))
        if len(levels) < 2 or len(levels) > _MOST_LEVELS:
            raise ProblemError(
                f"choices must be 2 … {_MOST_LEVELS} different values, got {len(levels)}", at=(*at, "choices")
            )
        for index, choice in enumerate(variable.choices):
            if not math.isfinite(choice):
                raise ProblemError(f"choices must be finite numbers, got {choice}", at=(*at, "choices", index))
            _check_within(info, {"choices": choice}, (*at, "choices", index), place=False)
        return levels
    if not variable.integer:
        return ()
    lower, upper = range_of(info, variable.lower, variable.upper, at)
    first, last = math.ceil(lower), math.floor(upper)
    if not 2 <= last - first + 1 <= _MOST_LEVELS:
        raise ProblemError(
            f"integer {info.path} must have 2 … {_MOST_LEVELS} whole numbers between its bounds, "
            f"got {max(last - first + 1, 0)} in {lower:g} … {upper:g}",
            at=(*at, "integer"),
        )
    return tuple(float(level) for level in range(first, last + 1))


def _check_within(info: ParameterInfo, bounds: dict[str, float], at: Path, *, place: bool = True) -> None:
    """Refuse values outside the bounds of the parameter itself."""
    for key, bound in bounds.items():
        where = (*at, key) if place else at
        excluded = info.lower_open and info.path.startswith(PREFIX) and bound == info.lower
        if info.lower is not None and (bound < info.lower or excluded):
            sign = ">" if excluded else ">="
            raise ProblemError(
                f"{key} of {info.path} must be {sign} {amount(info.lower, info.unit)}, got {bound:g}", at=where
            )
        if info.upper is not None and bound > info.upper:
            raise ProblemError(
                f"{key} of {info.path} must be <= {amount(info.upper, info.unit)}, got {bound:g}", at=where
            )
