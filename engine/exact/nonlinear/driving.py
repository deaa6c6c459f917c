"""What drives a nonlinear system at an instant: its commands, with constants added, and its own past behind the delays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from engine.exact.nonlinear.pieces import Command, Record, command
from engine.exact.nonlinear.windows import Lines, lines

if TYPE_CHECKING:
    from engine.exact.laws.system import NonlinearSystem
    from engine.signals import Signal

Array = npt.NDArray[Any]
Real = npt.NDArray[np.float64]


_MOST_CUTS = 20
"""So often a look ahead is made shorter at most, by four each time."""


class Driving:
    """The commands of one simulation.

    Parameters
    ----------
    system : NonlinearSystem
    signals : mapping of input name to Signal
        Inputs left out are 0.
    constants : ndarray, shape (inputs,), optional
        Added to the commands.
    record : Record
        What has been simulated so far.
    """

    def __init__(
        self, system: NonlinearSystem, signals: Mapping[str, Signal], constants: Real | None, record: Record
    ) -> None:
        self._delays = system.delays
        self._signals = [signals.get(name) for name in system.inputs]
        self._constants = np.zeros(len(self._signals)) if constants is None else constants
        self._record = record
        self.straight = all(signal is None or signal.degree() in {0, 1} for signal in self._signals)
        """Whether every command consists of straight lines."""
        self._last_seen: tuple[Array, float, tuple[Array, Array, Array]] | None = None

    def breaks(self, horizon: float) -> list[float]:
        """Return 0 and the instants at which a command jumps or bends, up to ``horizon`` (s) at least, rising."""
        return sorted({0.0, *(t for s in self._signals if s is not None for t in s.breaks(horizon))})

    def command(self, now: float, width: float) -> Command:
        """Return the commands of a step of ``width`` (s) from ``now`` (s)."""
        return command(self._signals, now, width, self._constants)

    def lines(self, times: Real) -> Lines | None:
        """Return the commands between rising ``times``, None where they are not straight lines there."""
        return lines(self._signals, times, self._constants) if np.all(np.diff(times) > 0) else None

    def may_jump(self, now: float) -> bool:
        """Return whether a signal may jump at this instant; after a mere kink the laws are where they were."""
        if not self._record.u or self._delays.shape[-1]:
            return True
        last = self._record.u[-1][-1, 0].real
        at = np.array([now])
        new = [0.0 if signal is None else float(signal.value(at)[0]) for signal in self._signals]
        return bool(np.any(np.abs(np.array(new) + self._constants - last) > 1e-12 * np.abs(last)))

    def around(self, t: Array, now: float, ahead: float) -> tuple[Array, Array, Array]:
        """Return inputs, their slopes and the delayed signals just after the instant ``t`` (lanes,), looking ``ahead`` (s)."""
        if self._delays.shape[-1]:
            return self._seen(t, now, ahead)
        if self._last_seen is None or self._last_seen[0] is not t or self._last_seen[1] != ahead:
            self._last_seen = (t, ahead, self._seen(t, now, ahead))
        return self._last_seen[2]

    def _seen(self, t: Array, now: float, ahead: float) -> tuple[Array, Array, Array]:
        near = self.command(now, ahead)
        for _ in range(_MOST_CUTS):
            if self.straight or near.resolved:
                break
            # a long look ahead, as before the first step, may be several turns of a sine: its limit here is that of a shorter one
            near = self.command(now, near.width / 4)
        u, du = near.near(np.zeros(1), t[:, None])
        return u, du, self._record.delayed(t[:, None], self._delays, later=True)
