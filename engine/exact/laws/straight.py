"""A system all of whose laws are straight lines in their present modes: its rates and whole steps are linear maps.

    [f; z; e; v; y] = M [x; u; u'; w; o]

with states x, inputs u and their slopes u', delayed signals w, and the constants o of the laws' lines; f are the rates, z what
goes into the delays, e and v the laws' inputs and outputs. The maps depend on the slopes of the lines only: the levels of a
quantizer share them. A step of the collocation then is a linear map of its start, the inputs and o, solved once for each width
and kept.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
from scipy.linalg import lu_factor, lu_solve, matrix_balance

from engine.elements._nonlinear import Moment, slopes, surface_slopes
from engine.exact.laws.loops import closed
from engine.exact.laws.tangent import Tangent
from engine.exact.time.chebyshev import DEGREE, NODES, coefficient_matrix, differentiation_matrix, weights

if TYPE_CHECKING:
    from engine.elements._nonlinear import Mode
    from engine.exact.laws.laws import Law
    from engine.exact.laws.system import NonlinearSystem
    from engine.exact.nonlinear.collocation import Scheme

Real = npt.NDArray[np.float64]

MOST_LEAPS: Final = 64
"""So many widths are kept for one map."""

_REMEMBERED: Final = 4096


@dataclass(frozen=True, kw_only=True, eq=False)
class Line:
    """One law in one mode: its slopes, and what it holds."""

    fx: Real
    fz: Real
    gx: Real
    gz: Real
    surface: Real | None
    held: int | None

    @property
    def count(self) -> int:
        """How many constants go with it: one for each rate and output."""
        return len(self.fx) + len(self.gx)

    @classmethod
    def of(cls, law: Law, mode: Mode) -> Line | None:
        """Return the line of a law, None where it is none or not finite."""
        element, values = law.element, law.real
        if law.resting or not element.affine(mode, values):
            return None
        n, p = law.states.stop - law.states.start, law.inputs.stop - law.inputs.start
        zero = np.zeros((1, 1))
        origin = Moment(t=zero, x=[zero] * n, z=[zero] * p)
        part, held = slopes(element, origin, mode, values), element.held(mode)
        fx, fz, gx, gz = part.fx[0], part.fz[0], part.gx[0].copy(), part.gz[0].copy()
        if not all(np.isfinite(block).all() for block in (fx, fz, gx, gz, constants(law, mode))):
            return None
        if held is None:
            return cls(fx=fx, fz=fz, gx=gx, gz=gz, surface=None, held=None)
        gx[held] = gz[held] = 0.0  # whatever keeps the surface where it is
        surface = surface_slopes(element, origin, mode, values)[0]
        return cls(fx=fx, fz=fz, gx=gx, gz=gz, surface=surface, held=held)


def constants(law: Law, mode: Mode) -> Real:
    """Return the rates and outputs of a law at 0, those that are held as 0."""
    zero = np.zeros((1, 1))
    states, inputs = law.states.stop - law.states.start, law.inputs.stop - law.inputs.start
    origin = Moment(t=zero, x=[zero] * states, z=[zero] * inputs)
    found = [*law.element.rates(origin, mode, law.real), *law.element.outputs(origin, mode, law.real)]
    held = law.element.held(mode)
    if held is not None:
        found[states + held] = 0.0
    return np.array([float(np.ravel(value)[0]) for value in found])


@dataclass(frozen=True, kw_only=True, eq=False)
class Map:
    """M, by the columns of x, u, u', w and o; the first rows are the rates, then z, e, v and y; ``tangent`` of one instant.

    ``solved`` is False where what is held is not moved by what holds it: only the tangent then says anything.
    """

    x: Real
    u: Real
    du: Real
    w: Real
    o: Real
    rows: tuple[int, int, int, int, int]
    tangent: Tangent
    solved: bool
    leaps: dict[float, Leap] = field(default_factory=dict)
    holdable: dict[int, bool] = field(default_factory=dict)

    @classmethod
    def of(cls, system: NonlinearSystem, lines: Sequence[Line]) -> Map:
        """Join the laws' lines with the linear part; held outputs are what keeps their surfaces where they are.

        Raises
        ------
        numpy.linalg.LinAlgError
            If an algebraic loop has no solution.
        """
        m = {name: matrix[0] for name, matrix in system.matrices.items()}
        n, nl, ne, nv = system.states, system.linear_states, m["c3"].shape[0], m["b3"].shape[1]
        count, nu, nw = sum(line.count for line in lines), m["d31"].shape[1], m["d32"].shape[1]
        held = [
            (law.outputs.start + line.held, law, line) for law, line in _pairs(system, lines) if line.held is not None
        ]
        own, fe, ge, gx = (np.zeros(shape) for shape in ((n, n), (n, ne), (nv, ne), (nv, n)))
        rate, out = np.zeros((n, count)), np.zeros((nv, count))
        at = 0
        for law, line in _pairs(system, lines):
            own[law.states, law.states], fe[law.states, law.inputs] = line.fx, line.fz
            gx[law.outputs, law.states], ge[law.outputs, law.inputs] = line.gx, line.gz
            states, outputs = len(line.fx), len(line.gx)
            rate[law.states, at : at + states] = np.eye(states)
            out[law.outputs, at + states : at + states + outputs] = np.eye(outputs)
            at += states + outputs
        own[:nl, :nl] = m["a"]
        gx[:, :nl] += ge @ m["c3"]
        unit = np.zeros((nv, len(held)))
        surface = np.zeros((len(held), ne))
        for k, (output, law, line) in enumerate(held):
            unit[output, k] = 1.0
            surface[k, law.inputs] = line.surface
        # columns: x, u, u', w, o and what is held
        edges = np.cumsum([0, n, nu, nu, nw, count, len(held)])
        x, u, du, w, o, h = (slice(*pair) for pair in pairwise(edges))
        v, e, f, z, y = (np.zeros((rows, edges[-1])) for rows in (nv, ne, n, nw, m["d13"].shape[0]))
        v[:, x], v[:, u], v[:, w], v[:, o], v[:, h] = gx, ge @ m["d31"], ge @ m["d32"], out, unit
        if np.any(m["d33"]):
            v = closed(system.order, ge @ m["d33"], v)
        e[:, :nl], e[:, u], e[:, w] = m["c3"], m["d31"], m["d32"]
        e += m["d33"] @ v
        f[:, x], f[:, o], f[:nl, u], f[:nl, w] = own, rate, m["b1"], m["b2"]
        f += fe @ e
        f[:nl] += m["b3"] @ v
        for rows, k in ((y, 1), (z, 2)):
            rows[:, :nl], rows[:, u], rows[:, w] = m[f"c{k}"], m[f"d{k}1"], m[f"d{k}2"]
            rows[:] += m[f"d{k}3"] @ v
        hold = surface @ e[:, x]
        moved = np.concatenate([f, z])[None]
        tangent = Tangent(
            by_x=moved[:, :, x], by_w=moved[:, :, w], by_held=moved[:, :, h], em=(surface @ e[:, h])[None],
            surface=surface[None], hold=hold[None], gain=(hold @ f[:, h])[None],
        )  # fmt: skip
        whole = np.concatenate([moved[0], e, v, y])
        solved = not held or bool(np.linalg.matrix_rank(tangent.gain[0]) == len(held))
        if held and solved:
            moves = hold @ f
            moves[:, du] += surface @ m["d31"]
            kept = -np.linalg.solve(tangent.gain[0], moves[:, : h.start])
            whole[:, : h.start] += whole[:, h] @ kept
            for k in range(len(held)):
                places = np.flatnonzero(hold[k])
                if len(places) == 1:  # what is held is a state itself: it follows the command, or rests exactly
                    whole[places[0], : h.start] = 0.0
                    whole[places[0], du] = -(surface[k] @ m["d31"]) / hold[k, places[0]]
        if not np.isfinite(whole).all():
            raise np.linalg.LinAlgError
        return cls(
            x=whole[:, x], u=whole[:, u], du=whole[:, du], w=whole[:, w], o=whole[:, o], rows=(n, nw, ne, nv, len(y)),
            tangent=tangent, solved=solved,
        )  # fmt: skip

    def leap(self, width: float, method: Scheme) -> Leap:
        """Return the step of this width."""
        found = self.leaps.get(width)
        if found is None:
            if len(self.leaps) >= MOST_LEAPS:
                self.leaps.clear()
            found = self.leaps[width] = Leap.of(self, width, method)
        return found


def _pairs(system: NonlinearSystem, lines: Sequence[Line]) -> Iterator[tuple[Law, Line]]:
    return zip(system.laws, lines, strict=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Leap:
    """A step as linear maps of its start, of the inputs at its nodes (in one row) and of o.

    ``nodes`` gives [x; f; z; e; v; y] at the 17 nodes, ``path`` the start and the stages.
    """

    nodes: Real
    path: Real
    width: float

    @classmethod
    def of(cls, own: Map, width: float, method: Scheme) -> Leap:
        """Solve the collocation for unit starts, unit inputs and unit constants.

        X_j = x_0 + h Σ_k a_jk (M_x X_k + M_u u_k + M_u' u'_k + M_o o)
        """
        n, inputs, constants = own.rows[0], own.u.shape[1], own.o.shape[1]
        s, count = len(method.points), DEGREE + 1
        fx, fu, fdu, fo = (part[:n] for part in (own.x, own.u, own.du, own.o))
        at = weights(method.points)
        slope = at @ differentiation_matrix() / width
        _, transform = matrix_balance(fx, permute=False) if n else (fx, np.eye(0))
        unit = np.diag(transform)  # powers of two: states as far apart as pressures and positions
        balanced = fx * (unit[None, :] / unit[:, None])
        matrix = np.eye(s * n) - width * np.einsum("jk,ab->jakb", method.a, balanced).reshape(s * n, s * n)
        drive = np.einsum("jk,kl,ai->jali", method.a, at, fu) + np.einsum("jk,kl,ai->jali", method.a, slope, fdu)
        right = np.concatenate(
            [
                np.tile(np.eye(n), (s, 1)),
                width * drive.reshape(s * n, count * inputs),
                width * np.einsum("j,ao->jao", method.a.sum(axis=1), fo).reshape(s * n, constants),
            ],
            axis=1,
        ) / np.tile(unit, s)[:, None]  # fmt: skip
        columns = right.shape[1]
        if n:
            factors = lu_factor(matrix)
            stages = lu_solve(factors, right)
            stages += lu_solve(factors, right - matrix @ stages)
        else:
            stages = right
        start = np.zeros((n, columns))
        start[:, :n] = np.eye(n)
        path = np.concatenate([start[None], stages.reshape(s, n, columns) * unit[:, None]])
        x = np.einsum("lj,jac->lac", method.to_nodes, path)
        signals = np.einsum("ra,lac->lrc", own.x, x)
        held = n + count * inputs
        place = signals[:, :, n:held].reshape(count, len(own.x), count, inputs)
        place[np.arange(count), :, np.arange(count)] += own.u
        place += np.einsum("lm,ri->lrmi", differentiation_matrix() / width, own.du)
        signals[:, :, n:held] = place.reshape(count, len(own.x), count * inputs)
        signals[:, :, held:] += own.o
        nodes = np.concatenate([x, signals], axis=1).reshape(-1, columns)
        return cls(nodes=nodes, path=path.reshape(-1, columns), width=width)


@dataclass(frozen=True, kw_only=True, eq=False)
class Straight:
    """A system in modes that are lines: its map with the constants of these modes.

    ``constant`` is M_o o; ``still`` (n,) are the states that do not move whatever happens.
    """

    map: Map
    o: Real
    constant: Real
    still: npt.NDArray[np.intp]

    @classmethod
    def of(cls, own: Map, o: Real) -> Straight:
        """Return the map with constants."""
        n, constant = own.rows[0], own.o @ o
        moves = constant[:n] != 0
        for part in (own.x, own.u, own.du, own.w):
            moves = moves | (part[:n] != 0).any(axis=1)
        return cls(map=own, o=o, constant=constant, still=np.flatnonzero(~moves))

    def flow(self, x: Real, u: Real, du: Real, w: Real) -> tuple[Real, Real, Real]:
        """Return f, e and v at N instants, arrays (1, N, ·); held outputs are 0 where the map is not solved."""
        own = self.map
        found = x @ own.x.T + u @ own.u.T + self.constant
        if own.du.any():
            found += du @ own.du.T
        if own.w.shape[1]:
            found += w @ own.w.T
        n, z, e, v, _ = own.rows
        return found[..., :n], found[..., n + z : n + z + e], found[..., n + z + e : n + z + e + v]

    def step(self, start: Real, values: Real, width: float, method: Scheme) -> tuple[Real, Real]:
        """Return start and stages (s + 1, n) of a step, and [x; f; z; e; v; y] at its nodes (17, ·).

        ``values`` (17, inputs) are the inputs at the nodes.
        """
        leap = self.map.leap(width, method)
        given = np.concatenate([start, values.ravel(), self.o])
        nodes = (leap.nodes @ given).reshape(len(NODES), -1)
        path = (leap.path @ given).reshape(-1, len(start))
        nodes[:, self.still] = path[:, self.still] = start[self.still]
        nodes[0, : len(start)], nodes[-1, : len(start)] = start, path[-1]
        return path, nodes


class Maps:
    """The maps of one system, each made when its modes are first met."""

    def __init__(self, system: NonlinearSystem) -> None:
        self._system = system
        self._lines: dict[tuple[int, Mode], Line | None] = {}
        self._constants: dict[tuple[int, Mode], Real] = {}
        self._maps: dict[tuple[Mode, ...], Map | None] = {}
        self._straights: dict[tuple[Mode, ...], Straight | None] = {}

    def map(self, modes: Sequence[Mode]) -> Map | None:
        """Return the map of all modes with the slopes of these; None where a law is no line or a loop has no solution."""
        laws = self._system.laws
        alike = tuple(law.element.alike(mode) for law, mode in zip(laws, modes, strict=True))
        if alike not in self._maps:
            lines = [self._line(number, mode) for number, mode in enumerate(alike)]
            known = [line for line in lines if line is not None]
            found = None
            if len(known) == len(lines):
                with contextlib.suppress(np.linalg.LinAlgError):  # the general way says what is wrong
                    found = Map.of(self._system, known)
            keep(self._maps, alike, found)
        return self._maps[alike]

    def straight(self, modes: Sequence[Mode]) -> Straight | None:
        """Return the map of these modes with their constants, None where there is none."""
        key = tuple(modes)
        if key not in self._straights:
            joined = self.map(modes)
            found = None
            if joined is not None:
                parts = [self._constant(number, mode) for number, mode in enumerate(key)]
                found = Straight.of(joined, np.concatenate([np.zeros(0), *parts]))
            keep(self._straights, key, found)
        return self._straights[key]

    def _line(self, number: int, mode: Mode) -> Line | None:
        key = (number, mode)
        if key not in self._lines:
            keep(self._lines, key, Line.of(self._system.laws[number], mode))
        return self._lines[key]

    def _constant(self, number: int, mode: Mode) -> Real:
        key = (number, mode)
        if key not in self._constants:
            keep(self._constants, key, constants(self._system.laws[number], mode))
        return self._constants[key]


def keep(kept: dict[Any, Any], key: Any, found: Any) -> None:
    """Remember a few thousand; a quantizer has modes without end."""
    if len(kept) >= _REMEMBERED:
        kept.clear()
    kept[key] = found


def until(theta: float) -> Real:
    """Return the weights (17, 17) from the nodes of a step to those of its part before ``theta``."""
    angle = np.arccos(np.clip(2.0 * theta * NODES - 1.0, -1.0, 1.0))
    return np.asarray(np.cos(np.multiply.outer(angle, np.arange(DEGREE + 1))) @ coefficient_matrix())
