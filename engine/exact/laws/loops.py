"""In which order the outputs of nonlinear laws are known, and algebraic loops through them, solved by Newton's method with exact slopes.

v = g(e_0 + D33 v):   (1 - ∂g/∂e D33) Δv = g(e_0 + D33 v) - v

It begins at 0. Where that leads nowhere it begins again at what the laws make of their outputs, put in several times over, which goes
to a solution where the loop's gain is small; a step that leads further away is halved then.

The order is that of single outputs: the velocity of a cylinder follows no force at once, its acceleration does, so that friction makes no
loop with it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import matrix_balance

from engine.elements._nonlinear import slopes
from engine.model.errors import IllPosedError, UnresolvedError
from engine.model.strongly_connected_components import circles

if TYPE_CHECKING:
    from engine.exact.laws.laws import Law
    from engine.exact.laws.system import Instants, NonlinearSystem

Array = npt.NDArray[Any]
Real = npt.NDArray[np.float64]

_ITERATIONS = 40
_SUBSTITUTIONS = 20
_FAR = 1e-6
"""Of the outputs: nearer to a solution every step is taken as it is."""
_SINGULAR = 1e-12
_ROUNDING = 1e-14


@dataclass(frozen=True, kw_only=True)
class Group:
    """Output channels that are computed together: some of one law, or those on a loop through several ``laws``."""

    channels: tuple[int, ...]
    laws: tuple[int, ...]
    looped: bool


def groups(laws: Sequence[Law], link: npt.NDArray[np.bool_]) -> list[Group]:
    """Return all output channels in an order in which what they follow is known.

    Parameters
    ----------
    laws : sequence of Law
    link : ndarray, shape (inputs, outputs)
        Which outputs of laws enter which inputs at once.
    """
    owner = [number for number, law in enumerate(laws) for _ in range(law.outputs.start, law.outputs.stop)]
    needs: list[set[int]] = []
    for law in laws:
        follows = law.element.feed_through(law.real)
        needs.extend(set(np.flatnonzero(link[law.inputs][row].any(axis=0)).tolist()) for row in follows)
    waiting = [set(circle) for circle in circles([sorted(own) for own in needs])]
    looped = [circle for circle in waiting if len(circle) > 1 or circle & needs[min(circle)]]
    on_loops = set().union(*looped)
    found: list[Group] = []
    known: set[int] = set()
    while len(known) < len(owner):
        ready = [c for c in range(len(owner)) if c not in known | on_loops and needs[c] <= known]
        if ready:  # those of one law at once
            channels = [c for c in ready if owner[c] == owner[ready[0]]]
        else:
            circle = next(c for c in looped if not c & known and set().union(*(needs[k] for k in c)) <= known | c)
            channels = sorted(circle)
        members = tuple(dict.fromkeys(owner[c] for c in channels))
        found.append(Group(channels=tuple(channels), laws=members, looped=not ready))
        known.update(channels)
    return found


def closed(order: Sequence[Group], gain: Real, right: Real) -> Real:
    """Return (1 - gain)⁻¹ right, arrays (..., outputs, ·), by substitution in the order of the outputs; only loops are solved.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a loop has no solution.
    """
    found = np.array(np.broadcast_to(right, (*gain.shape[:-2], *right.shape[-2:])))
    for group in order:
        own = list(group.channels)
        rows = gain[..., own, :]
        if not group.looped:
            found[..., own, :] += rows @ found
            continue
        others = rows.copy()
        others[..., own] = 0.0
        scale = _scale(rows[..., own])
        matrix = np.eye(len(own)) - rows[..., own] * (scale / scale[:, None])
        inside = found[..., own, :] + others @ found
        found[..., own, :] = np.linalg.solve(matrix, inside / scale[:, None]) * scale[:, None]
    return found


def _scale(gain: Real) -> Real:
    """Return a unit for each channel of a loop in which gains (..., k, k) of mixed units are as alike as can be."""
    size = np.abs(gain).reshape(-1, *gain.shape[-2:]).max(axis=0)
    if not np.isfinite(size).all():
        raise np.linalg.LinAlgError("the gain of a loop is not finite")
    with np.errstate(invalid="ignore"):  # of permutations that are not asked for
        return np.asarray(np.diag(matrix_balance(size, permute=False)[1]))


def solve_loop(
    system: NonlinearSystem, group: Group, at: Instants, base: Array, v: Array, *, skip: frozenset[int]
) -> None:
    """Write the outputs of one loop into ``v``.

    Parameters
    ----------
    system : NonlinearSystem
    group : Group
        The outputs on the loop, and their laws.
    at : Instants
    base : ndarray, shape (lanes, N, channels)
        The laws' inputs without what the laws' outputs add to them.
    v : ndarray, shape (lanes, N, channels)
        The laws' outputs; what comes before the loop is known.
    skip : frozenset of int
        Outputs that are held.

    Raises
    ------
    IllPosedError
        If the loop gain is 1 somewhere.
    UnresolvedError
        If no solution is found.
    """
    outputs = [k for k in group.channels if k not in skip]

    def put_in() -> Array:
        """Write what the laws make of the outputs in their place; return these."""
        before = v.copy()
        for i in group.laws:
            system.apply(i, at, base, v, wanted=outputs, given=before)
        return before

    begun = v[..., outputs].copy()
    try:
        _newton((system, group, outputs), at, base, v, put_in, cautious=False)
    except (IllPosedError, UnresolvedError) as error:
        v[..., outputs] = begun
        for _ in range(_SUBSTITUTIONS):
            put_in()
        if not np.isfinite(v[..., outputs]).all():
            raise
        try:
            _newton((system, group, outputs), at, base, v, put_in, cautious=True)
        except (IllPosedError, UnresolvedError):
            raise error from None


def _newton(
    loop: tuple[NonlinearSystem, Group, list[int]], at: Instants, base: Array, v: Array, put_in: Callable[[], Array], *, cautious: bool
) -> None:  # fmt: skip
    """Write the solution that Newton's method finds from ``v``."""
    system, group, outputs = loop
    laws = [system.laws[i] for i in group.laws]
    link = system.value.matrices["d33"][0]
    real = at.real
    settled, size = 0, np.zeros(len(outputs))
    last: _Step | None = None
    for _ in range((1 + cautious) * _ITERATIONS):
        before = put_in()
        excess = v[..., outputs] - before[..., outputs]
        settled = settled + 1 if np.all(np.abs(excess.real) <= _ROUNDING * size) else 0
        if settled == 2 or (settled and not np.iscomplexobj(v)):
            return
        if last is not None and (worse := last.leads_away(excess)).any():
            v[..., outputs] = np.where(worse[:, None], last.halved(worse), before[..., outputs])
            continue
        e = base[:1].real + before[:1].real @ link.T[None]
        gain = np.zeros((e.shape[1], v.shape[-1], e.shape[-1]))
        for i, law in zip(group.laws, laws, strict=True):
            moment = system.moment(law, real.t, real.x, e)
            gain[:, law.outputs, law.inputs] = slopes(law.element, moment, at.modes[i], law.real).gz
        # what an output is rounded by: by itself, and by what its inputs are made of
        terms = np.abs(base[:1].real) + np.abs(before[:1].real) @ np.abs(link).T[None]
        entering = (np.abs(gain[:, outputs]) @ terms[0][..., None])[..., 0]
        size = np.maximum(entering, np.abs(before[0][..., outputs].real)).max(axis=0, initial=0.0)
        joined = (gain @ link)[:, outputs][:, :, outputs]
        if not np.isfinite(joined).all():
            raise UnresolvedError(f"{_names(laws)}: the slopes on their algebraic loop must be finite", at=laws[0].at)
        scale = _scale(joined)
        matrix = np.eye(len(outputs)) - joined * (scale / scale[:, None])
        spread = np.linalg.svd(matrix, compute_uv=False)
        if np.any(spread[:, -1] <= _SINGULAR * np.maximum(1.0, spread[:, 0])):
            raise _ill_posed(system, group)
        step = np.linalg.solve(matrix[None], excess[..., None] / scale[:, None]) * scale[:, None]
        if cautious:
            near = _FAR * float((size / scale).max())
            last = _Step(before[..., outputs], step[..., 0], excess, unit=scale, near=near)
        v[..., outputs] = before[..., outputs] + step[..., 0]
    msg = f"the algebraic loop through {_names(laws)} must have a solution that can be found; put a lag or a delay into it"
    raise UnresolvedError(msg, at=laws[0].at)


class _Step:
    """A step from where outputs (lanes, N, k) were, ``excess`` being how far they were from a solution, in units (k,)."""

    def __init__(self, begun: Array, step: Array, excess: Array, *, unit: Real, near: float) -> None:
        self._begun, self._step, self._unit, self._near = begun, step, unit, near
        self._away = self._distance(excess)
        self._share = np.ones(len(self._away))

    def _distance(self, excess: Array) -> Real:
        return np.asarray(np.linalg.norm(excess[0].real / self._unit, axis=-1))

    def leads_away(self, excess: Array) -> npt.NDArray[np.bool_]:
        """Return at which instants, (N,), the step has led further away; what is no number is so, too."""
        return ~(self._distance(excess) <= np.maximum(self._away, self._near))

    def halved(self, where: npt.NDArray[np.bool_]) -> Array:
        """Return the outputs with half the step at some instants."""
        self._share[where] /= 2
        return np.asarray(self._begun + self._share[:, None] * self._step)


def _names(laws: Sequence[Law]) -> str:
    return ", ".join(law.label for law in laws)


def _ill_posed(system: NonlinearSystem, group: Group) -> IllPosedError:
    ports = system.ports(group.channels)
    return IllPosedError(
        f"the algebraic loop {' -> '.join((*ports, ports[0]))} must have a loop gain other than 1 to have a solution; "
        "change a gain on it, or put a lag or a delay into it",
        at=system.laws[group.laws[0]].at,
        ports=ports,
    )
