"""What every command signal is: a function of time that knows where it breaks and where it ends."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from engine.model.errors import SignalError
from engine.model.parameters import Param

FloatArray = npt.NDArray[np.float64]

START = Param(name="start", symbol="t₀", unit="s", default=0.0, lower=0.0, doc="time at which the command begins")


class Signal(ABC):
    """A command u(t), t >= 0, right-continuous. Signals are frozen dataclasses made by `make`.

    What a command computes is analytic in its numbers and in t, decisions look at real parts: so that an infinitesimal in
    one of them comes out as the derivative.
    """

    kind: ClassVar[str]
    title: ClassVar[str]
    equation: ClassVar[str]
    source: ClassVar[str]
    parameters: ClassVar[tuple[Param, ...]]
    example: ClassVar[Mapping[str, Any]] = {}

    @classmethod
    @abstractmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the signal with these values, each already within its own bounds; raise SignalError where they clash."""

    @abstractmethod
    def value(self, t: FloatArray) -> FloatArray:
        """Return u at the times ``t`` (s), of the same shape; right-continuous where it jumps."""

    @abstractmethod
    def breakpoints(self) -> tuple[float, ...]:
        """Return the times (s, >= 0, increasing) where u or one of its derivatives jumps, its start included.

        Of a command that repeats for ever those of its first period; :meth:`breaks` has the others.
        """

    @abstractmethod
    def final(self) -> float | None:
        """Return the constant at which u settles, None if it does not."""

    @abstractmethod
    def end(self) -> float | None:
        """Return the time (s) from which u is constant, None if there is none."""

    @abstractmethod
    def degree(self) -> int | None:
        """Return the polynomial degree of u between breakpoints, None where it is smooth but no polynomial."""

    def repeats_after(self) -> float | None:
        """Return the period (s) of a command that repeats for ever, None for all others."""
        return None

    def impulse(self) -> float:
        """Return the integral of an impulse at time 0, 0 for all other commands; ``value`` has nothing of it."""
        return 0.0

    def sines(self) -> FloatArray | None:
        """Return amplitude, angular frequency (rad/s) and phase (rad) of the sines that it is the sum of, (sines, 3); None for others."""
        return None

    def breaks(self, horizon: float) -> tuple[float, ...]:  # noqa: ARG002 - only what repeats needs it
        """Return the breakpoints up to ``horizon`` (s) at least; of a command that repeats, those of every period."""
        return self.breakpoints()


def checked(params: tuple[Param, ...], kind: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return every parameter's value: numbers as float, lists as read-only arrays.

    Raises
    ------
    SignalError
        If a value is missing, unknown, no number or outside its bounds; ``at`` counts from the signal.
    """
    declared = {param.name: param for param in params}
    for name in given:
        if name not in declared:
            raise SignalError(f"parameter of {kind} must be one of {', '.join(declared)}, got '{name}'", at=(name,))
    values: dict[str, Any] = {}
    for name, param in declared.items():
        value = given.get(name)
        value = param.default if value is None else value
        if value is None:
            raise SignalError(f"{name} must be given: {param.doc}", at=(name,))
        values[name] = _CHECKS[param.shape](param, value)
    return values


def _signal(param: Param, value: Any) -> Signal:
    if not isinstance(value, Signal):
        msg = f"{param.name} must be a signal, such as {{'kind': 'step'}}, got {str(value)[:80]!r}"
        raise SignalError(msg, at=(param.name,))
    return value


def _text(param: Param, value: Any) -> str:
    if value not in param.choices:
        msg = f"{param.name} must be one of {', '.join(param.choices)}, got {str(value)[:80]!r}"
        raise SignalError(msg, at=(param.name,))
    return str(value)


def _number(param: Param, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.floating | np.integer):
        raise SignalError(f"{param.name} must be a number, got {str(value)[:80]!r}", at=(param.name,))
    try:
        number = float(value)
    except OverflowError:
        number = np.inf
    if not param.admits(np.float64(number)):
        raise SignalError(f"{param.name} must be {param.rule(number)}, got {number:g}", at=(param.name,))
    return number


def _list(param: Param, value: Any) -> FloatArray:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise SignalError(
            f"{param.name} must be a list of numbers, got {str(value)[:80]!r}", at=(param.name,)
        ) from None
    if array.ndim != 1:
        raise SignalError(f"{param.name} must be a list of numbers, got {array.ndim} dimensions", at=(param.name,))
    wrong = np.flatnonzero(~param.admits(array))
    if wrong.size:
        index = int(wrong[0])
        raise SignalError(
            f"{param.name}[{index}] must be {param.rule(float(array[index]))}, got {array[index]:g}",
            at=(param.name, index),
        )
    array.setflags(write=False)
    return array


_CHECKS: Mapping[str, Callable[[Param, Any], Any]] = {
    "scalar": _number,
    "list": _list,
    "text": _text,
    "signal": _signal,
}
