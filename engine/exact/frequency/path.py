"""The part of a system that lies between some inputs and some outputs: what the other states do is not seen there.

Structure first (a state that no command reaches, or that no output sees, is left out exactly); then, only when modes
that do not decay remain, the numerically hidden ones (an uncancelled s/s) by the controllability and observability
staircase. Stability is judged on this part: a position may integrate while its velocity settles.

References
----------
P. Van Dooren, "The generalized eigenstructure problem in linear system theory", IEEE TAC 26 (1981) 111-129 (staircase).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from engine.exact.frequency.poles import Poles, poles
from engine.model.linear_system import ARRAYS, Array, LaneSystem, balancing
from engine.model.tangent import slopes
from engine.model.verdicts import Verdict

_HIDDEN = 1e-10
"""A direction is hidden that is weaker than this part of the terms it is the sum of: they cancel."""
_ROUNDING = 1e-14
"""And one that is weaker than this part of the strongest: it is what rounding leaves in the coefficients."""
_ALIKE = 1e-4
"""Relative difference of a response without its hidden directions: what rounding may make of it, and a lost one never does."""
_REST = np.geomspace(1e-8, 1e-2, 4)
"""Parts of the slowest rate at which an integral beside it is looked for: it may act far below every pole."""


def path(
    system: LaneSystem, inputs: Sequence[int], outputs: Sequence[int], poles_of: Callable[[LaneSystem], Poles] = poles
) -> LaneSystem:
    """Return the system from ``inputs`` to ``outputs`` without the states and delays that play no part between them.

    ``poles_of`` may remember the poles of parts met before.
    """
    part = connected(system, inputs, outputs)
    if part.n and poles_of(part.value).verdict is not Verdict.OK:
        part = minimal(part, poles_of)
    return part


def connected(system: LaneSystem, inputs: Sequence[int], outputs: Sequence[int]) -> LaneSystem:
    """Return the system from ``inputs`` to ``outputs`` without what structure alone keeps from playing a part."""
    return _prune(_select(system, inputs, outputs))


def merged(system: LaneSystem) -> LaneSystem:
    """Return the system with delays in a row read as one: w_i(t) = g w_k(t - τ_i) = g z_k(t - τ_i - τ_k).

    A response marches from echo to echo of every delay; of fifty in a row, only their sum is heard.
    """
    c2, d21, d22, delays = (getattr(system, name).copy() for name in ("c2", "d21", "d22", "delays"))
    for i in range(system.m):
        for _ in range(system.m):
            sources = np.flatnonzero((d22[:, i] != 0).any(axis=0))
            if len(sources) != 1 or sources[0] == i or c2[:, i].any() or d21[:, i].any():
                break
            k = sources[0]
            gain = d22[:, i, k, None]
            c2[:, i], d21[:, i], d22[:, i] = gain * c2[:, k], gain * d21[:, k], gain * d22[:, k]
            delays[:, i] += delays[:, k]
    return replace(system, c2=c2, d21=d21, d22=d22, delays=delays)


def _select(system: LaneSystem, inputs: Sequence[int], outputs: Sequence[int]) -> LaneSystem:
    i, o = list(inputs), list(outputs)
    return replace(
        system,
        b1=system.b1[:, :, i], d21=system.d21[:, :, i], c1=system.c1[:, o], d12=system.d12[:, o], d11=system.d11[:, o][:, :, i],
        inputs=tuple(system.inputs[k] for k in i), outputs=tuple(system.outputs[k] for k in o),
    )  # fmt: skip


def _prune(system: LaneSystem) -> LaneSystem:
    """Leave out states and delays that cannot be reached from the inputs or cannot reach the outputs."""
    n, m = system.n, system.m
    pattern = {name: np.any(getattr(system, name) != 0, axis=0) for name in ARRAYS}
    inner = np.block([[pattern["a"], pattern["b2"]], [pattern["c2"], pattern["d22"]]])  # inner[i, j]: j acts on i
    reached = np.concatenate([pattern["b1"].any(axis=1) | pattern["x0"], pattern["d21"].any(axis=1)])
    seen = np.concatenate([pattern["c1"].any(axis=0), pattern["d12"].any(axis=0)])
    reached, seen = _closure(inner, reached), _closure(inner.T, seen)
    keep = reached & seen
    if keep.all():
        return system
    return system.part(keep[:n], keep[n : n + m])


def _closure(edges: npt.NDArray[np.bool_], marked: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    while True:
        grown = marked | (edges @ marked)
        if np.array_equal(grown, marked):
            return marked
        marked = grown


def minimal(system: LaneSystem, poles_of: Callable[[LaneSystem], Poles] = poles) -> LaneSystem:
    """Leave out the numerically uncontrollable and unobservable directions, where nothing else goes with them.

    What a parameter is about to bring in is hidden only as long as the parameter is just what it is: it stays, for
    derivatives' sake. Where it never comes to rest, only if it is the parameter's own, as the integral of a gain of 0 is;
    a pole and a zero that happen to coincide cancel, however they may move.
    """
    balanced = evenly_scaled(system)
    found = _without_hidden(balanced)
    if found.n < balanced.n and system.dtype is np.complex128:
        moving = _without_hidden(balanced, now_only=False)
        own = _prune(system.value).n < system.n
        if own or _lasting(poles_of(moving.value)) == _lasting(poles_of(found.value)):
            found = moving
    # between rates that lie too far apart the staircase loses directions that are driven and seen
    return found if found.n == balanced.n or _respond_alike(balanced, found) else system


def _without_hidden(system: LaneSystem, *, now_only: bool = True) -> LaneSystem:
    """Leave out the directions that are not driven or not seen: with the parameters as they are now, or near it as well."""
    driven = np.concatenate([system.b1, system.b2, system.x0[:, :, None]], axis=2)
    found = _project(system, _span(system.a, driven, now_only=now_only))
    watched = np.concatenate([found.c1, found.c2], axis=1)
    return _project(found, _span(found.a.swapaxes(1, 2), watched.swapaxes(1, 2), now_only=now_only))


def _span(a: Array, b: Array, *, now_only: bool) -> npt.NDArray[np.float64]:
    """Return an orthonormal basis of what b drives through a, with its first change x' = A x' + A' x + B' u unless now only."""
    basis = _reachable(a[0].real, b[0].real)
    if now_only:
        return basis
    changes = np.concatenate([*slopes(b), *(slopes(a) @ basis)], axis=1)
    return _reachable(a[0].real, np.concatenate([b[0].real, changes], axis=1))


def _lasting(found: Poles) -> int:
    """Return how many poles do not decay."""
    return int(((found.values.real >= 0) | found.on_axis | found.at_zero).sum())


def _respond_alike(whole: LaneSystem, part: LaneSystem) -> bool:
    """Return whether the transfer from all that drives to all that watches is the same, as far as rounding lets it be told."""
    own = poles(whole.value.part(np.arange(whole.n), np.arange(0)))
    rates = np.abs(own.values[~own.at_zero]) if not own.at_zero.all() else np.ones(1)
    places = np.concatenate([rates.min() * _REST, np.geomspace(0.1 * rates.min(), 10 * rates.max(), 9)])
    for s in places * np.exp(0.7j):  # no pole lies just there
        try:
            (expected, terms), (got, _) = _transfer(whole, s), _transfer(part, s)
        except np.linalg.LinAlgError:  # rates so far apart that s is rounding beside one of them, or drowns another
            return False
        if np.any(np.abs(got - expected) > _ALIKE * np.abs(expected) + _HIDDEN * terms):
            return False
    return True


def _transfer(system: LaneSystem, s: complex) -> tuple[npt.NDArray[np.complex128], npt.NDArray[np.float64]]:
    """Return C (s - A)⁻¹ B, and the size of the terms that each of its entries is the sum of."""
    driven = np.concatenate([system.b1[0].real, system.b2[0].real, system.x0[0].real[:, None]], axis=1)
    watched = np.concatenate([system.c1[0].real, system.c2[0].real])
    states = np.linalg.solve(s * np.eye(system.n) - system.a[0].real, driven)
    return watched @ states, np.abs(watched) @ np.abs(states)


def evenly_scaled(system: LaneSystem) -> LaneSystem:
    """Return the system with states scaled so that each is driven as strongly as it drives others.

    Balancing A alone leaves a state without a scale that only listens, as the position of an opened loop does. Inputs
    and outputs close the circle: every state lies between them.
    """
    parts = {name: np.abs(getattr(system, name)[0].real) for name in ("a", "b1", "b2", "c1", "c2", "x0")}
    driven = np.concatenate([parts["b1"], parts["b2"], parts["x0"][:, None]], axis=1).max(axis=1)
    watched = np.concatenate([parts["c1"], parts["c2"]]).max(axis=0)
    circle = np.block([[parts["a"], driven[:, None]], [watched, np.zeros(1)]])
    return system.scaled(balancing(circle)[:-1])


def _reachable(a: npt.NDArray[np.float64], b: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return an orthonormal basis of the span of b, a b, a² b, ...; directions below the tolerance do not count."""
    n = len(a)
    basis = np.zeros((n, 0))
    size = max(float(np.linalg.norm(a)), 1e-300)
    norms = np.linalg.norm(b, axis=0)
    front = b[:, norms > 0] / norms[norms > 0]
    terms = np.abs(front)
    while front.shape[1] and basis.shape[1] < n:
        for _ in range(2):
            known = basis.T @ front
            terms = terms + np.abs(basis) @ np.abs(known)
            front = front - basis @ known
        u, s, _ = np.linalg.svd(front, full_matrices=False)
        # a slow state beside a fast one is driven weakly, but by terms that are as weak
        new = u[:, s > np.maximum(_HIDDEN * (np.abs(u).T @ terms.max(axis=1)), _ROUNDING)]
        if not new.shape[1]:
            break
        basis = np.concatenate([basis, new], axis=1)
        front, terms = a @ new / size, np.abs(a) @ np.abs(new) / size
    return basis


def _project(system: LaneSystem, basis: npt.NDArray[np.float64]) -> LaneSystem:
    if basis.shape[1] == system.n:
        return system
    v = basis
    return replace(
        system,
        a=v.T @ system.a @ v, b1=v.T @ system.b1, b2=v.T @ system.b2, c1=system.c1 @ v, c2=system.c2 @ v, x0=system.x0 @ v,
    )  # fmt: skip
