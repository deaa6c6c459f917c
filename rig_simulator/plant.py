"""What stands on the rig: a system document, driven by the samples of its outputs.

x_{k+1} = e^{Ah} x_k + B0 u_k + B1 u_{k+1}   (u linear between samples: a module with an interpolation filter)

A linear document without delays is followed step by step, for ever. One with delays or nonlinear laws is computed by the
engine when a run starts; its drive must then be known from beginning to end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm

from engine.diagram.diagram import Diagram
from engine.exact.nonlinear.recorded import simulate_recorded
from engine.exact.time.sampled import simulate_sampled
from engine.model.linear_system import LinearSystem

Samples = npt.NDArray[np.float64]
Drive = Callable[[int, int], Samples]
"""(first sample, count) -> values of the plant's inputs, shape (inputs, count)."""

MOST_AT_ONCE = 5_000_000
"""Samples of a run that is computed as a whole."""


class PlantError(ValueError):
    """The document cannot be followed in the way that was asked for."""


class Run(Protocol):
    """A plant in motion: its outputs, sample after sample."""

    def advance(self, count: int) -> Samples:
        """Return the next samples, shape (outputs, count)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plant:
    """A system document on the rig."""

    diagram: Diagram

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs, in the order of a drive."""
        return tuple(self.diagram.inputs)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return tuple(self.diagram.outputs)

    def start(self, rate: float, drive: Drive, *, samples: int | None) -> Run:
        """Set the plant in motion from rest.

        Parameters
        ----------
        rate : float
            Samples per second.
        drive : callable
        samples : int, optional
            Length of a finite run.

        Raises
        ------
        PlantError
            For a run without an end, or too long a one, of a document with delays or nonlinear laws.
        """
        if not self.diagram.nonlinear:
            system = self.diagram.realize()
            if not system.delays.size:
                return _Stepwise(system, rate, drive)
        if samples is None or samples > MOST_AT_ONCE:
            raise PlantError(
                f"a run of a document with delays or nonlinear laws must be finite and at most {MOST_AT_ONCE} samples"
            )
        return _Whole(self.diagram, rate, drive(0, samples))


class _Stepwise:
    """A linear plant, one sample after the other."""

    def __init__(self, system: LinearSystem, rate: float, drive: Drive) -> None:
        n, m = system.states, len(system.inputs)
        block = np.zeros((n + 2 * m, n + 2 * m))
        block[:n, :n] = system.a / rate
        block[:n, n : n + m] = system.b1 / rate
        block[n : n + m, n + m :] = np.eye(m)
        forward = expm(block)
        self._a = forward[:n, :n]
        self._late = forward[:n, n + m :]
        self._early = forward[:n, n : n + m] - self._late
        self._c, self._d = system.c1, system.d11
        self._x = np.array(system.x0, dtype=np.float64)
        self._before: Samples | None = None
        self._drive = drive
        self._done = 0

    def advance(self, count: int) -> Samples:
        """Return the next samples."""
        u = self._drive(self._done, count)
        states = np.empty((self._x.size, count))
        if count:
            before = u[:, :1] if self._before is None else self._before
            pushed = self._early @ np.hstack([before, u[:, :-1]]) + self._late @ u
            if self._before is None:  # the first sample is where the plant stands
                pushed[:, 0] = 0.0
            a, x = self._a, self._x
            moving = bool(np.any(x)) or bool(np.any(pushed))
            first = self._before is None
            for k in range(count if moving else 0):
                x = x if first and k == 0 else a @ x + pushed[:, k]
                states[:, k] = x
            if not moving:
                states[:] = 0.0
            self._x, self._before = x, u[:, -1:].copy()
            self._done += count
        return np.asarray(self._c @ states + self._d @ u)


class _Whole:
    """A run that was computed when it started."""

    def __init__(self, diagram: Diagram, rate: float, inputs: Samples) -> None:
        if diagram.nonlinear:
            self._values, _ = simulate_recorded(diagram.laws(), inputs, 1.0 / rate)
        else:
            self._values = simulate_sampled(diagram.realize(), inputs, 1.0 / rate)
        self._done = 0

    def advance(self, count: int) -> Samples:
        """Return the next samples."""
        found = self._values[:, self._done : self._done + count]
        self._done += count
        return found
