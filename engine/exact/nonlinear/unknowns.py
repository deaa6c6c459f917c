"""What is solved for on one step: the states at its stages, and with them what comes out of the delays where the step is longer than one.

    x_j = x_0 + h Σ_k a_jk f(x_k, w_k),   w_j = past_j + Σ_k l_jk z(x_k, w_k)

See `engine.exact.nonlinear.collocation`; of a shorter step the delayed signals are known beforehand.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from engine.elements._nonlinear import Mode
from engine.exact.laws.system import Instants, NonlinearSystem
from engine.exact.nonlinear.collocation import Scheme, Sums
from engine.exact.nonlinear.switching import ROUNDING

if TYPE_CHECKING:
    from engine.exact.nonlinear.pieces import Command

Array = npt.NDArray[Any]
Real = npt.NDArray[np.float64]

_START = np.zeros(1)
_NONE = np.zeros((0, 0, 0))


class Unknowns:
    """The equations of one step, for one lane of real numbers or for lanes with infinitesimals.

    Parameters
    ----------
    system : NonlinearSystem
    command : Command
    modes : sequence of int
    start : ndarray, shape (lanes, n)
    begin, width : ndarray, shape (lanes,)
        When the step begins and how long it is, s.
    method : Scheme
    delayed : callable
        Times (lanes, N) of a step -> the delayed signals there, as far as they are known.

    Attributes
    ----------
    overlaps : bool
        Whether the step is longer than a delay.
    known : ndarray, shape (lanes, s, r)
        What the unknowns are made of besides sums over the step: r = n, or n + m where it overlaps.
    """

    def __init__(
        self, system: NonlinearSystem, command: Command, modes: Sequence[Mode], *, start: Array, begin: Array, width: Array,
        method: Scheme, delayed: Callable[[Array], Array],
    ) -> None:  # fmt: skip
        self._system, self._method, self._width, self._modes = system, method, width, modes
        self._n = start.shape[1]
        self._times = begin[:, None] + method.points * width[:, None]
        self._inputs = command.near(method.points, self._times)
        self.known = np.repeat(start[:, None], len(method.points), axis=1)
        grain = ROUNDING * float(
            (begin + width)[0].real
        )  # what jumps at the start, and is due at the end, is not yet seen there
        shortest = float(system.delays[0].real.min(initial=np.inf))
        self.overlaps = shortest < float(width[0].real) - grain
        self._back: Array | None = None
        if not self.overlaps:
            self._past = delayed(self._times)
            return
        past = delayed(np.concatenate([begin[:, None], self._times], axis=1))
        back = self._back = method.back(system.delays / width[:, None], grain / float(width[0].real))
        self._own = back[0].any(axis=-1).T
        self._first, self._past = past[:, :1], np.where(self._own, 0.0, past[:, 1:])
        u, du = command.near(_START, begin[:, None])
        at = Instants(t=begin[:, None], x=start[:, None], u=u, du=du, w=self._first, modes=modes)
        entering = system.read(at, system.flow(at).v)[1][:, 0]
        heard = self._past + np.einsum("lmj,lm->ljm", back[..., 0], entering)
        self.known = np.concatenate([self.known, heard], axis=2)

    @property
    def sums(self) -> Sums:
        """The sums over the step, of real numbers."""
        back = _NONE if self._back is None else self._back[0, ..., 1:].real
        return Sums(float(self._width[0].real) * self._method.a, back)

    def values(self, path: Array, heard: Array | None) -> Array:
        """Return all unknowns (lanes, s, r) of states (s, n) and delayed signals (s, m) at the stages.

        What comes from before the step has its infinitesimals.
        """
        x = np.broadcast_to(path, (len(self._times), *path.shape))
        if not self.overlaps:
            return x
        return np.concatenate([x, self._past if heard is None else np.where(self._own, heard, self._past)], axis=2)

    def heard(self, y: Array) -> Array | None:
        """Return the delayed signals at start and stages, (lanes, s + 1, m); None where the step does not overlap."""
        return np.concatenate([self._first, y[..., self._n :]], axis=1) if self.overlaps else None

    def _at(self, y: Array) -> Instants:
        u, du = self._inputs
        w = y[..., self._n :] if self.overlaps else self._past
        return Instants(t=self._times, x=y[..., : self._n], u=u, du=du, w=w, modes=self._modes)

    def g(self, y: Array) -> Array:
        """Return rates, and what goes into the delays where the step overlaps, (lanes, s, r)."""
        at = self._at(y)
        flow = self._system.flow(at)
        return np.concatenate([flow.f, self._system.read(at, flow.v)[1]], axis=2) if self.overlaps else flow.f

    def slope(self, y: Array) -> Array:
        """Return the slopes of `g` by its real arguments, (s, r, r)."""
        tangent = self._system.value.tangent(self._at(y).real)
        return tangent.joint if self.overlaps else tangent.total

    def missed(self, y: Array) -> Array:
        """Return by how much unknowns differ from what follows from them, (lanes, s, r)."""
        g = self.g(y)
        sums = self._width[:, None, None] * (self._method.a @ g[..., : self._n])
        if self._back is not None:
            sums = np.concatenate([sums, np.einsum("lmjk,lkm->ljm", self._back[..., 1:], g[..., self._n :])], axis=2)
        return np.asarray(self.known + sums - y)
