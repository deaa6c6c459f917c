"""A command made of delayed, weighted copies of another one: its convolution with impulses.

u(t) = Σ_i amplitudes[i] c(t - times[i])
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.errors import SignalError
from engine.linear.system import Array
from engine.signals._base import Signal

MOST_COPIES = 100
"""Copies of copies multiply, and the response costs a segment for every breaking point."""

_SAME = 4 * np.finfo(float).eps


@dataclass(frozen=True, kw_only=True, eq=False)
class Copies:
    """The copies of one command.

    Parameters
    ----------
    command : Signal
        What is copied; 0 before its time 0.
    times : ndarray, shape (copies,)
        Delays, s, >= 0, rising; entries may carry an infinitesimal, as those of ``amplitudes``.
    amplitudes : ndarray, shape (copies,)
    """

    command: Signal
    times: Array
    amplitudes: Array

    def __post_init__(self) -> None:
        if self.count > MOST_COPIES:
            msg = f"command must be copied at most {MOST_COPIES} times over all levels, got {self.count}"
            raise SignalError(msg, at=("command",))

    @property
    def count(self) -> int:
        """Number of copies of the innermost command."""
        inner = getattr(self.command, "copies", None)
        return len(self.times) * (inner.count if isinstance(inner, Copies) else 1)

    def value(self, t: Array) -> Array:
        """Return u at the instants ``t`` (s), of the same shape."""
        total = 0.0 * t
        breaks = np.array(self.command.breakpoints())
        for time, amplitude in zip(self.times, self.amplitudes, strict=True):
            local = t - time
            # rounding must not move an instant to the other side of a jump of the command
            for instant in breaks:
                near = np.abs(np.real(local - instant)) <= _SAME * np.maximum(np.abs(np.real(t)), 1e-300)
                snapped = np.real(instant) + 1j * np.imag(local) if np.iscomplexobj(local) else np.real(instant)
                local = np.where(near, snapped, local)
            copy = self.command.value(local)
            total = total + np.where(np.real(local) >= 0, amplitude * copy, 0.0)
        return np.asarray(total)

    def breakpoints(self) -> tuple[float, ...]:
        """Return the instants at which a copy or one of its derivatives jumps, coinciding ones once."""
        instants = np.add.outer(self.times, np.array(self.command.breakpoints())).ravel()
        instants = instants[np.argsort(np.real(instants), kind="stable")]
        apart = np.diff(np.real(instants), prepend=-1.0) > _SAME * np.real(instants)
        found: tuple[float, ...] = tuple(instants[apart].tolist())
        return found

    def final(self) -> float | None:
        """Return where the sum settles, None if the command does not."""
        last = self.command.final()
        whole: float = self.amplitudes.sum().item()
        return None if last is None else whole * last

    def end(self) -> float | None:
        """Return when the last copy has ended, None if the command does not end."""
        last = self.command.end()
        shift: float = self.times[-1].item()
        return None if last is None else shift + last
