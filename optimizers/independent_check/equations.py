"""The equations of a system with nonlinear laws in given modes, for the second measurement.

    x' = A x + B₁ u + B₃ v,   e = C₃ x + D₃₁ u + D₃₃ v,   ξ' = f(ξ, e; mode),   v = g(ξ, e; mode)

What a law holds is kept where it is by the output that makes the rate of its surface 0, which is affine in that output. Slopes
along the motion are those of a complex step. Delays, samplers and loops without a state are left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.elements._nonlinear import Moment
from optimizers.independent_check.march import CannotFollowError

if TYPE_CHECKING:
    from engine.exact.laws.laws import Law
    from engine.exact.laws.system import NonlinearSystem

Array = npt.NDArray[Any]

_STEP: Final = 1e-40
_HOLDS: Final = -1e-12


@dataclass(frozen=True, kw_only=True, eq=False)
class Instants:
    """N instants: times (N,), s; states, commands and their slopes, (N, ·)."""

    t: Array
    x: Array
    u: Array
    du: Array

    def along(self, f: Array) -> Instants:
        """Return the same an infinitesimal later, for rates ``f``."""
        step = 1j * _STEP
        return replace(self, t=self.t + step, x=self.x + step * f, u=self.u + step * self.du)


@dataclass(frozen=True, kw_only=True, eq=False)
class Flow:
    """Rates ``f``, the laws' inputs ``e`` and outputs ``v``, and how fast the surfaces that are held move, each (N, ·)."""

    f: Array
    e: Array
    v: Array
    sliding: Array


class Equations:
    """A system whose laws have the modes ``modes``.

    Raises
    ------
    CannotFollowError
        Here and in its methods: for what is not followed here.
    """

    def __init__(self, system: NonlinearSystem) -> None:
        if system.delays.shape[-1] or any(law.element.period(law.real) is not None for law in system.laws):
            raise CannotFollowError
        self.matrices = {name: np.asarray(matrix[0].real) for name, matrix in system.matrices.items()}
        self.laws: Sequence[Law] = system.laws
        self.modes = [0] * len(self.laws)
        self._linear = system.linear_states

    def holding(self) -> list[tuple[int, int]]:
        """Return (output, law) of every law that holds something."""
        held = [law.element.held(mode) for law, mode in zip(self.laws, self.modes, strict=True)]
        return [(self.laws[k].outputs.start + output, k) for k, output in enumerate(held) if output is not None]

    def channels(self, at: Instants, held: Mapping[int, Array] | None = None) -> tuple[Array, Array]:
        """Return the laws' inputs and outputs (N, channels), where ``held`` outputs are as given, 0 by default."""
        m = self.matrices
        base = at.x[:, : self._linear] @ m["c3"].T + at.u @ m["d31"].T
        given = {output: np.zeros(len(base)) for output, _ in self.holding()} if held is None else held
        v = np.zeros((len(base), m["b3"].shape[1]), dtype=np.result_type(base, at.x, float, *given.values()))
        for output, value in given.items():
            v[:, output] = value
        e = base + v @ m["d33"].T
        again: Sequence[int] = range(len(self.laws))
        for _ in range(len(self.laws) + 2):
            if not again:
                return e, v
            for k in again:
                law, mode = self.laws[k], self.modes[k]
                found = law.element.outputs(seen(law, at, e), mode, law.real)
                for place, output in enumerate(range(law.outputs.start, law.outputs.stop)):
                    if output not in given:
                        v[:, output] = found[place]
            shown, e = e, base + v @ m["d33"].T
            moved = (e != shown).any(axis=0).tolist()
            again = [k for k, law in enumerate(self.laws) if any(moved[law.inputs])]
        raise CannotFollowError  # a loop through laws without a state

    def flow(self, at: Instants) -> Flow:
        """Return the rates with what holds, so that nothing that is held moves."""
        pairs = self.holding()
        still = self._pushed(at, {output: np.zeros(len(at.t)) for output, _ in pairs})
        if not pairs:
            return still
        try:
            needed = np.linalg.solve(self.gain(at, still), -still.sliding[..., None])[..., 0]
        except np.linalg.LinAlgError:
            raise CannotFollowError from None
        return self._pushed(at, {output: needed[:, k] for k, (output, _) in enumerate(pairs)})

    def gain(self, at: Instants, still: Flow) -> Array:
        """Return how much each held output moves the rate of each surface, (N, held, held)."""
        return np.stack([pushed.sliding - still.sliding for pushed in self._each(at)], axis=-1)

    def held_at(self, at: Instants, number: int) -> Array | None:
        """Return the states (n,) with what a law begins to hold at 0; None where its output does not drive it back there."""
        place = [law for _, law in self.holding()].index(number)
        still = self._pushed(at, {output: np.zeros(1) for output, _ in self.holding()})
        gain = self.gain(at, still)[0]
        sound = np.isfinite(gain).all() and float(np.diag(gain).max()) < _HOLDS
        if not sound or np.linalg.matrix_rank(gain) < len(gain):
            return None
        law = self.laws[number]
        away = float(np.ravel(law.element.surface(seen(law, at, still.e), self.modes[number], law.real))[0])
        push = (self._each(at)[place].f - still.f)[0]
        return np.asarray(at.x[0] - push * away / gain[place, place])

    def slopes(self, at: Instants, flow: Flow) -> Array:
        """Return how fast the laws' inputs move, (N, channels)."""
        held = {output: flow.v[:, output] for output, _ in self.holding()}
        return np.asarray(self.channels(at.along(flow.f), held)[0].imag / _STEP)

    def outputs(self, at: Instants, flow: Flow) -> Array:
        """Return the outputs of the system, (N, outputs)."""
        m = self.matrices
        return np.asarray(at.x[:, : self._linear] @ m["c1"].T + at.u @ m["d11"].T + flow.v @ m["d13"].T)

    def _each(self, at: Instants) -> list[Flow]:
        """Return the flow for each held output at 1, the others at 0."""
        outputs = [output for output, _ in self.holding()]
        return [self._pushed(at, {o: np.full(len(at.t), float(o == one)) for o in outputs}) for one in outputs]

    def _pushed(self, at: Instants, held: Mapping[int, Array]) -> Flow:
        """Return the rates for given held outputs."""
        m = self.matrices
        e, v = self.channels(at, held)
        f = np.empty(at.x.shape, dtype=v.dtype)
        f[:, : self._linear] = at.x[:, : self._linear] @ m["a"].T + at.u @ m["b1"].T + v @ m["b3"].T
        for law, mode in zip(self.laws, self.modes, strict=True):
            own = law.element.rates(seen(law, at, e), mode, law.real)
            for k, state in enumerate(range(law.states.start, law.states.stop)):
                f[:, state] = own[k]
        sliding = np.zeros((len(at.t), len(held)))
        if held:
            later = at.along(f)
            moved, _ = self.channels(later, held)
            for k, (_, number) in enumerate(self.holding()):
                law = self.laws[number]
                surface = law.element.surface(seen(law, later, moved), self.modes[number], law.real)
                sliding[:, k] = np.imag(surface) / _STEP
        return Flow(f=f, e=e, v=v, sliding=sliding)


def seen(law: Law, at: Instants, e: Array, v: Array | None = None, slope: Array | None = None) -> Moment:
    """Return what a law sees; its outputs and the slopes of its inputs where they are given."""
    rows = range(law.inputs.start, law.inputs.stop)
    return Moment(
        t=at.t,
        x=[at.x[:, k] for k in range(law.states.start, law.states.stop)],
        z=[e[:, k] for k in rows],
        slope=[] if slope is None else [slope[:, k] for k in rows],
        y=[] if v is None else [v[:, k] for k in range(law.outputs.start, law.outputs.stop)],
    )
