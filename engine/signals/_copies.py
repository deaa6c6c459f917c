"""A command made of delayed, weighted copies of another one: its convolution with impulses.

u(t) = Σ_i amplitudes[i] c(t - times[i])
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from engine.model.errors import SignalError
from engine.model.linear_system import Array
from engine.signals._base import FloatArray, Signal

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
        if self.command.impulse():
            raise SignalError("command must not be an impulse, which comes at time 0 only", at=("command",))
        if self.count > MOST_COPIES:
            msg = f"command must be copied at most {MOST_COPIES} times over all levels, got {self.count}"
            raise SignalError(msg, at=("command",))

    @property
    def count(self) -> int:
        """Number of copies of the innermost command."""
        inner = getattr(self.command, "copies", None)
        return len(self.times) * (inner.count if isinstance(inner, Copies) else 1)

    @cached_property
    def _instants(self) -> Array:
        """The instants at which each copy breaks, shape (copies, breaks); those that rounding sets apart are made one."""
        instants = np.add.outer(self.times, np.array(self.command.breakpoints()))
        order = np.argsort(np.real(instants), axis=None, kind="stable")
        found = instants.ravel()[order]
        for k in range(1, len(found)):
            if np.real(found[k] - found[k - 1]) <= _SAME * np.real(found[k]):
                found[k] = found[k - 1]
        merged = np.empty_like(found)
        merged[order] = found
        return np.asarray(merged.reshape(instants.shape))

    def value(self, t: Array) -> Array:
        """Return u at the instants ``t`` (s), of the same shape."""
        breaks = np.real(np.array(self.command.breakpoints()))
        now = np.real(t)
        total = 0.0 * t
        for time, amplitude, instants in zip(self.times, self.amplitudes, np.real(self._instants), strict=True):
            local = t - time
            inside = np.real(local)
            if np.any(np.abs(inside[..., None] - breaks) <= 4 * _SAME * np.abs(now)[..., None]):
                # rounding must not move an instant to the other side of a jump of the command
                for instant, edge in zip(instants, breaks, strict=True):
                    before = np.nextafter(edge, -np.inf)
                    inside = np.where(now >= instant, np.maximum(inside, edge), np.minimum(inside, before))
                local = inside + 1j * np.imag(local) if np.iscomplexobj(local) else inside
            total = total + np.where(inside >= 0, amplitude * self.command.value(local), 0.0)
        return np.asarray(total)

    def breakpoints(self) -> tuple[float, ...]:
        """Return the instants at which a copy or one of its derivatives jumps, coinciding ones once."""
        instants = self._instants.ravel()
        _, first = np.unique(np.real(instants), return_index=True)
        found: tuple[float, ...] = tuple(instants[first].tolist())
        return found

    def breaks(self, horizon: float) -> tuple[float, ...]:
        """Return those instants up to ``horizon`` (s), of a command that repeats in all its periods."""
        if self.command.breaks(horizon) == self.command.breakpoints():
            return self.breakpoints()
        found = {time + t for time in self.times.tolist() for t in self.command.breaks(horizon)}
        return tuple(sorted(found, key=np.real))

    def end(self) -> float | None:
        """Return when the last copy has ended, None if the command does not end."""
        last = self.command.end()
        shift: float = self.times[-1].item()
        return None if last is None else shift + last


@dataclass(frozen=True, slots=True, kw_only=True)
class Copied(Signal):
    """A command made of copies of ``command`` whose amplitudes have the sum 1."""

    command: Signal
    copies: Copies = field(repr=False, compare=False)

    def value(self, t: FloatArray) -> FloatArray:
        """Return u(t)."""
        return self.copies.value(t)

    def breakpoints(self) -> tuple[float, ...]:
        """Return those of the command, once for each copy."""
        return self.copies.breakpoints()

    def breaks(self, horizon: float) -> tuple[float, ...]:
        """Return those of the command, once for each copy."""
        return self.copies.breaks(horizon)

    def final(self) -> float | None:
        """Return where the command settles."""
        return self.command.final()

    def end(self) -> float | None:
        """Return the end of the last copy."""
        return self.copies.end()

    def degree(self) -> int | None:
        """Return the degree of the command."""
        return self.command.degree()

    def repeats_after(self) -> float | None:
        """Return the period of the command."""
        return self.command.repeats_after()
