"""A system with nonlinear laws: linear blocks joined to one fractional form, the laws being channels of it, as delays are.

    x' = A x + B1 u + B2 w + B3 v,   y = C1 x + D11 u + D12 w + D13 v,   z = C2 x + D21 u + D22 w + D23 v,
    e = C3 x + D31 u + D32 w + D33 v,   w_i(t) = z_i(t - delay_i),
    ξ' = f(t, ξ, e; mode),   v = g(t, ξ, e; mode)

In a mode that holds an input (a mass that sticks), the law's output is not given but found: it is what keeps that input
from moving, ė_j = 0, an equation of index one after one differentiation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from engine.elements._nonlinear import Mode, Moment, Signals, slopes, stacked, surface_slopes
from engine.exact.laws.laws import Law, Rows
from engine.exact.laws.loops import closed, groups, solve_loop
from engine.exact.laws.straight import Map, Maps, Straight, keep
from engine.exact.laws.tangent import Tangent
from engine.model.errors import UnresolvedError

Array = npt.NDArray[Any]
Real = npt.NDArray[np.float64]
Modes = Sequence[Mode]

MATRICES = (
    "a", "b1", "b2", "b3", "c1", "c2", "c3", "d11", "d12", "d13", "d21", "d22", "d23", "d31", "d32", "d33", "delays", "x0",
)  # fmt: skip
_WEAK = 1e-10
"""An output that moves the rate of an input by less than this part of what it could does not hold it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Instants:
    """N instants at which a system is evaluated, all in the same modes.

    Shapes: ``t`` (lanes, N), s; states ``x``, inputs ``u`` with their slopes ``du`` in time, delayed signals ``w``, each
    (lanes, N, ·).
    """

    t: Array
    x: Array
    u: Array
    du: Array
    w: Array
    modes: Modes

    @property
    def real(self) -> Instants:
        """The common real part alone, as one lane."""
        if self.t.shape[0] == 1 and not any(np.iscomplexobj(a) for a in (self.t, self.x, self.u, self.w)):
            return self
        return Instants(
            t=self.t[:1].real, x=self.x[:1].real, u=self.u[:1].real, du=self.du[:1].real, w=self.w[:1].real,
            modes=self.modes,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Flow:
    """Rates ``f`` (lanes, N, states) and the laws' inputs ``e`` and outputs ``v`` (lanes, N, channels)."""

    f: Array
    e: Array
    v: Array


class NonlinearSystem:
    """Matrices with a lane axis in front, and the laws; immutable.

    Parameters
    ----------
    matrices : mapping
        Arrays of the fractional form (:data:`MATRICES`), each (lanes, ...); all lanes share the real part.
    laws : sequence of Law
    inputs, outputs : tuple of str
    """

    def __init__(
        self, matrices: dict[str, Array], laws: Sequence[Law], inputs: tuple[str, ...], outputs: tuple[str, ...]
    ) -> None:
        self.matrices = matrices
        self.laws = tuple(laws)
        self.inputs, self.outputs = inputs, outputs
        self.linear_states = matrices["a"].shape[-1]
        self.states = self.linear_states + sum(law.states.stop - law.states.start for law in laws)
        self.lanes = matrices["a"].shape[0]
        self.delays = matrices["delays"]
        self._rows = {name: np.ascontiguousarray(matrices[name].swapaxes(-1, -2)) for name in MATRICES[:-2]}
        self.complex = any(law.complex for law in laws) or any(np.iscomplexobj(m) for m in matrices.values())
        """Whether a value carries an infinitesimal."""
        self._linked = bool(np.any(matrices["d33"]))
        self.order = groups(self.laws, np.any(matrices["d33"] != 0, axis=0))
        self._plain = self.lanes == 1 and not self.complex
        self._holds: dict[tuple[Mode, ...], list[tuple[int, int]]] = {}
        self._maps = Maps(self)

    @cached_property
    def value(self) -> NonlinearSystem:
        """The common real part alone, as one lane."""
        if self.lanes == 1 and not self.complex:
            return self
        real = {name: np.ascontiguousarray(m[:1].real) for name, m in self.matrices.items()}
        return NonlinearSystem(real, [replace(law, values=law.real) for law in self.laws], self.inputs, self.outputs)

    @cached_property
    def limits(self) -> tuple[Real, Real]:
        """Least and greatest values (outputs,) of those outputs that are outputs of a law with limits; infinite else."""
        count = len(self.outputs)
        low, high = np.full(count, -np.inf), np.full(count, np.inf)
        others = [self.matrices[name][0].real for name in ("c1", "d11", "d12")]
        for law in self.laws:
            for k, (least, greatest) in enumerate(law.element.limits(law.real)):
                unit = np.eye(self.matrices["d13"].shape[-1])[law.outputs.start + k]
                for row in np.flatnonzero((self.matrices["d13"][0].real == unit).all(axis=1)):
                    if not any(np.any(m[row]) for m in others):
                        low[row], high[row] = least, greatest
        return low, high

    @cached_property
    def resting(self) -> NonlinearSystem:
        """The same with rates that are 0 at rest and only there: states that follow in jumps (samples) included."""
        laws = [replace(law, resting=True) for law in self.laws]
        return NonlinearSystem(self.matrices, laws, self.inputs, self.outputs)

    def member(self, index: int) -> NonlinearSystem:
        """Return one lane (one member of a batch) as a system of its own."""
        return self.members(slice(index, index + 1))

    def members(self, rows: Rows) -> NonlinearSystem:
        """Return some members of a batch as a system of their own."""
        matrices = {name: m[rows] if len(m) > 1 else m for name, m in self.matrices.items()}
        laws = [law.members(rows) for law in self.laws]
        return NonlinearSystem(matrices, laws, self.inputs, self.outputs)

    @property
    def start(self) -> Array:
        """Initial states, (lanes, n)."""
        parts = [self.matrices["x0"]]
        for law in self.laws:
            initial = law.element.initial(law.values)
            parts.append(stacked(initial, (self.lanes, 1))[:, 0])
        kind = complex if any(np.iscomplexobj(part) for part in parts) else float
        return np.concatenate([np.broadcast_to(p, (self.lanes, p.shape[-1])) for p in parts], axis=-1).astype(kind)

    def holds(self, modes: Modes) -> list[tuple[int, int]]:
        """Return (output channel, law) of every law that holds something."""
        key = tuple(modes)
        found = self._holds.get(key)
        if found is None:
            held = [law.element.held(mode) for law, mode in zip(self.laws, modes, strict=True)]
            found = [(self.laws[k].outputs.start + output, k) for k, output in enumerate(held) if output is not None]
            keep(self._holds, key, found)
        return found

    def straight(self, modes: Modes) -> Straight | None:
        """Return the system as linear maps where all its laws are lines in these modes, else None.

        Only of a system without infinitesimals, of one lane.
        """
        return self._maps.straight(modes) if self._plain else None

    def joined(self, modes: Modes) -> Map | None:
        """Return the linear map alone, without its constants."""
        return self._maps.map(modes) if self._plain else None

    def moment(self, law: Law, t: Array, x: Array, e: Array) -> Moment:
        """Return what ``law`` sees, arrays (lanes, N)."""
        return Moment(
            t=t,
            x=[x[..., k] for k in range(law.states.start, law.states.stop)],
            z=[e[..., k] for k in range(law.inputs.start, law.inputs.stop)],
        )

    def channels(self, at: Instants, held: Array | None = None) -> tuple[Array, Array]:
        """Return the laws' inputs and outputs (lanes, N, channels); ``held`` (lanes, N, held) are the held outputs.

        Raises
        ------
        IllPosedError, UnresolvedError
            If an algebraic loop through the laws has no solution, or none is found.
        """
        straight = self.straight(at.modes) if self._plain and held is None and not np.iscomplexobj(at.x) else None
        if straight is not None and not (straight.map.solved and self.holds(at.modes)):
            return straight.flow(at.x, at.u, at.du, at.w)[1:]
        rows = self._rows
        base = at.x[..., : self.linear_states] @ rows["c3"] + at.u @ rows["d31"]
        if at.w.shape[-1]:
            base = base + at.w @ rows["d32"]
        kind = complex if self.complex or any(np.iscomplexobj(p) for p in (base, at.x, at.t)) else float
        v = np.zeros((*base.shape[:-1], rows["b3"].shape[-2]), dtype=kind)
        pairs = self.holds(at.modes)
        for k, (output, _) in enumerate(pairs):
            v[..., output] = 0.0 if held is None else held[..., k]
        skip = frozenset(output for output, _ in pairs)
        for group in self.order:
            if group.looped:
                solve_loop(self, group, at, base, v, skip=skip)
            else:
                self.apply(group.laws[0], at, base, v, wanted=[k for k in group.channels if k not in skip])
        return (base + v @ rows["d33"] if self._linked else base), v

    def apply(
        self, number: int, at: Instants, base: Array, v: Array, *, wanted: Sequence[int], given: Array | None = None
    ) -> None:
        """Write those outputs of law ``number`` that are ``wanted`` into ``v``; its inputs follow from ``given`` outputs (default: ``v``)."""
        law = self.laws[number]
        if not wanted:
            return
        e = base
        if self._linked:
            e = np.empty((*base.shape[:-1], base.shape[-1]), dtype=v.dtype)
            link = self._rows["d33"][..., law.inputs]
            e[..., law.inputs] = base[..., law.inputs] + (v if given is None else given) @ link
        found = law.element.outputs(self.moment(law, at.t, at.x, e), at.modes[number], law.values)
        for k, output in enumerate(range(law.outputs.start, law.outputs.stop)):
            if output in wanted:
                v[..., output] = found[k]

    def flow(self, at: Instants) -> Flow:
        """Return rates and channels at N instants; held outputs are what keeps their inputs from moving."""
        straight = self.straight(at.modes) if self._plain and not np.iscomplexobj(at.x) else None
        if straight is not None and straight.map.solved:
            f, e, v = straight.flow(at.x, at.u, at.du, at.w)
            return Flow(f=f, e=e, v=v)
        pairs = self.holds(at.modes)
        if not pairs:
            return self._rates(at, None)
        tangent = self.tangent(at.real)
        try:
            inverse = np.linalg.inv(tangent.gain)[None]
        except np.linalg.LinAlgError:
            inverse = np.full(tangent.gain.shape, np.nan)
        if not np.isfinite(inverse).all():
            names = ", ".join(
                law.label for law, mode in zip(self.laws, at.modes, strict=True) if law.element.held(mode) is not None
            )
            msg = f"what {names} hold must be moved by their outputs, but it is not"
            raise UnresolvedError(msg) from None
        # how fast the commands themselves move what is held
        drift = (at.du[..., None, :] @ (tangent.surface @ self.value.matrices["d31"][0]).swapaxes(-1, -2)[None])[
            ..., 0, :
        ]
        held = np.zeros((*at.x.shape[:-1], len(pairs)), dtype=at.x.dtype)
        for _ in range(3 if np.iscomplexobj(at.x) else 2):
            flow = self._rates(at, held)
            rate = (tangent.hold[None] @ flow.f[..., None])[..., 0] + drift
            held = held - (inverse @ rate[..., None])[..., 0]
        flow = self._rates(at, held)
        flow.f[..., _pinned(tangent, drift)] = 0.0
        return flow

    def _rates(self, at: Instants, held: Array | None) -> Flow:
        e, v = self.channels(at, held)
        rows = self._rows
        linear = at.x[..., : self.linear_states] @ rows["a"] + at.u @ rows["b1"] + v @ rows["b3"]
        if at.w.shape[-1]:
            linear = linear + at.w @ rows["b2"]
        f = np.empty((*linear.shape[:-1], self.states), dtype=np.result_type(linear, v))
        f[..., : self.linear_states] = linear
        for law, mode in zip(self.laws, at.modes, strict=True):
            if law.states.stop > law.states.start:
                own = law.rates(self.moment(law, at.t, at.x, e), mode)
                for k, state in enumerate(range(law.states.start, law.states.stop)):
                    f[..., state] = own[k]
        return Flow(f=f, e=e, v=v)

    def tangent(self, at: Instants) -> Tangent:
        """Return the exact slopes at N real instants."""
        real = self.value
        joined = real.joined(at.modes)
        if joined is not None:
            return joined.tangent.at(at.x.shape[1])
        pairs = self.holds(at.modes)
        m = {name: real.matrices[name][0] for name in MATRICES[:-2]}
        e, _ = real.channels(at)
        count, n, nl = at.x.shape[1], self.states, self.linear_states
        nv, ne = m["b3"].shape[1], m["c3"].shape[0]
        fx, fe = np.zeros((count, n, n)), np.zeros((count, n, ne))
        gx, ge = np.zeros((count, nv, n)), np.zeros((count, nv, ne))
        for law, mode in zip(real.laws, at.modes, strict=True):
            part = slopes(law.element, real.moment(law, at.t, at.x, e), mode, law.values, resting=law.resting)
            fx[:, law.states, law.states] = part.fx
            fe[:, law.states, law.inputs] = part.fz
            gx[:, law.outputs, law.states] = part.gx
            ge[:, law.outputs, law.inputs] = part.gz
        unit = np.zeros((nv, len(pairs)))
        for k, (output, _) in enumerate(pairs):
            gx[:, output] = 0.0
            ge[:, output] = 0.0
            unit[output, k] = 1.0
        gx[:, :, :nl] += ge @ m["c3"]
        # columns: states, delayed signals, what is held
        columns = np.cumsum([n, m["d32"].shape[1]])
        v = np.concatenate([gx, ge @ m["d32"], np.broadcast_to(unit, (count, *unit.shape))], axis=2)
        if self._linked:
            v = closed(real.order, ge @ m["d33"], v)
        inputs = m["d33"] @ v
        inputs[:, :, :nl] += m["c3"]
        inputs[:, :, columns[0] : columns[1]] += m["d32"]
        f = np.concatenate([fe @ inputs, m["d23"] @ v], axis=1)
        f[:, :n, :n] += fx
        f[:, :nl] += m["b3"] @ v
        for rows, states, delayed in ((slice(nl), "a", "b2"), (slice(n, None), "c2", "d22")):
            f[:, rows, :nl] += m[states]
            f[:, rows, columns[0] : columns[1]] += m[delayed]
        ex, _, em = np.split(inputs, columns, axis=2)
        by_x, by_w, by_held = np.split(f, columns, axis=2)
        surface = np.zeros((count, len(pairs), ne))
        for k, (_, number) in enumerate(pairs):
            law = real.laws[number]
            seen = real.moment(law, at.t, at.x, e)
            surface[:, k, law.inputs] = surface_slopes(law.element, seen, at.modes[number], law.values)
        hold = surface @ ex
        return Tangent(
            by_x=by_x, by_w=by_w, by_held=by_held, em=surface @ em, surface=surface, hold=hold, gain=hold @ by_held[:, :n],
        )  # fmt: skip

    def holdable(self, number: int, at: Instants) -> bool:
        """Return whether the held output of law ``number`` can keep what it holds where it is, at one real instant."""
        joined = self.joined(at.modes)
        if joined is None:
            return self._holdable(number, at.modes, self.tangent(at))
        if number not in joined.holdable:
            joined.holdable[number] = self._holdable(number, at.modes, joined.tangent)
        return joined.holdable[number]

    def _holdable(self, number: int, modes: Modes, tangent: Tangent) -> bool:
        place = [held for _, held in self.holds(modes)].index(number)
        reach = float(np.abs(tangent.hold[0, place]) @ np.abs(tangent.fm[0, :, place]))
        direct = bool(np.any(tangent.em[0, place]))
        # an output that grows with what is held must drive it back: otherwise it is left, not held
        if direct or float(tangent.gain[0, place, place]) >= -_WEAK * reach:
            return False
        spread = np.linalg.svd(tangent.gain[0] / np.abs(np.diag(tangent.gain[0]))[:, None], compute_uv=False)
        return bool(spread[-1] > _WEAK * spread[0])

    def read(self, at: Instants, v: Array) -> tuple[Array, Array]:
        """Return outputs y and the signals z that enter the delays."""
        rows, states = self._rows, at.x[..., : self.linear_states]
        y = states @ rows["c1"] + at.u @ rows["d11"] + v @ rows["d13"]
        z = states @ rows["c2"] + at.u @ rows["d21"] + v @ rows["d23"]
        if at.w.shape[-1]:
            y, z = y + at.w @ rows["d12"], z + at.w @ rows["d22"]
        return y, z

    def seen(self, number: int, at: Instants, e: Array, v: Array, slope: Array | None = None) -> Moment:
        """Return all that law ``number`` sees, its outputs and the slopes of its inputs included."""
        law = self.laws[number]
        inputs, outputs = range(law.inputs.start, law.inputs.stop), range(law.outputs.start, law.outputs.stop)
        rates: Signals = [] if slope is None else [slope[..., k] for k in inputs]
        return Moment(
            t=at.t,
            x=[at.x[..., k] for k in range(law.states.start, law.states.stop)],
            z=[e[..., k] for k in inputs],
            slope=rates,
            y=[v[..., k] for k in outputs],
        )

    def ports(self, channels: Sequence[int]) -> tuple[str, ...]:
        """Return the names of some outputs of laws."""
        names = [f"{law.label}.{port}" for law in self.laws for port in law.element.ports(law.real).outputs]
        return tuple(names[channel] for channel in channels)


def _pinned(tangent: Tangent, drift: Array) -> list[int]:
    found = []
    for row in np.flatnonzero(~np.any(drift.real, axis=(0, 1))):
        places = np.flatnonzero(np.any(tangent.hold[:, row] != 0, axis=0))
        if len(places) == 1:
            found.append(int(places[0]))
    return found
