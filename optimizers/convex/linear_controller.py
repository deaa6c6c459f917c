"""The loop of a controller that is linear in its parameters, found in a diagram by how the exact response depends on them.

    D(jω) = 1 + L(jω) = D_0 + Σ_k x_k D_k,   N(jω) = N_0 + Σ_k x_k N_k,   response = N/D

No kind of block is asked for: a PID, a PD₂, gains in parallel or any subsystem will do, if D and every N are linear.
The coefficients are differences of exact responses over the whole range of a parameter, which is exact for what is linear.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.analysis.evaluation import Evaluation
from engine.model.errors import EngineError
from optimizers.convex.ranges import overrides, ranges_of
from optimizers.convex.transfer import Transfer
from optimizers.problem import ProblemError

if TYPE_CHECKING:
    from optimizers.convex.ratios import Ratio
    from optimizers.problem import Problem, Scenario, Vector

Real = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

_LINEAR = 1e-6
"""Relative deviation from a straight line up to which a response is linear in a parameter."""

_LOOKS = 24
_MOST_PARAMETERS = 40


@dataclass(frozen=True, kw_only=True, eq=False)
class Coefficients:
    """D, and N and M of every ratio N/M, at some frequencies: constant parts at ``base`` (V,) and slopes.

    Shapes: ``d`` (1 + V, k), ``n`` and ``m`` (1 + V, R, k); the constant part comes first.
    """

    base: Vector
    d: Complex
    n: Complex
    m: Complex

    def at(self, chosen: npt.NDArray[np.bool_]) -> Coefficients:
        """Return the coefficients at some of the frequencies."""
        return Coefficients(base=self.base, d=self.d[..., chosen], n=self.n[..., chosen], m=self.m[..., chosen])

    def valued(self, coefficients: Complex, x: Vector) -> Complex:
        """Return D, N or M at parameter values."""
        return np.asarray(coefficients[0] + np.tensordot(x - self.base, coefficients[1:], axes=1))


class LinearLoop:
    """One scenario of a problem whose responses are ratios linear in the variables.

    Parameters
    ----------
    problem : Problem
    scenario : mapping
    ratios : sequence of Ratio
    open_at : str
        Where the loop is cut.

    Attributes
    ----------
    slowest, fastest : float
        Corner frequencies of the open loop, rad/s.
    """

    def __init__(self, problem: Problem, scenario: Scenario, ratios: Sequence[Ratio], open_at: str) -> None:
        self.problem = problem
        self.scenario = scenario
        self.ratios = tuple(ratios)
        self.open_at = open_at
        ranges = ranges_of(problem, scenario)
        self.base, self.inner, self._reach = ranges.base, ranges.inner, ranges.reach
        points = [self.base, *(self.base + np.diag(self._reach))]
        self._members = [self._member(point) for point in points]
        self.slowest, self.fastest = self._members[0][open_at].corners

    def coefficients(self, frequencies: Real) -> Coefficients:
        """Return D and every ratio at ``frequencies`` (k,), rad/s."""
        found = [self._values(member, frequencies) for member in self._members]
        d, n, m = (np.array([one[part] for one in found]) for part in range(3))
        for values in (d, n, m):
            values[1:] -= values[0]
            values[1:] /= self._reach.reshape(-1, *([1] * (values.ndim - 1)))
        return Coefficients(base=self.base, d=d, n=n, m=m)

    def exact(self, x: Vector, frequencies: Real) -> tuple[Complex, Complex, Complex]:
        """Return D (k,), N and M (R, k) computed at parameter values, without supposing that they are linear."""
        return self._values(self._member(x), frequencies)

    def evaluation(self, x: Vector) -> Evaluation:
        """Return the closed diagram at parameter values, on the exact path."""
        return Evaluation(self.problem.diagram, overrides(self.problem, self.scenario, x))

    def cut(self, x: Vector, open_at: str) -> Transfer:
        """Return the responses at parameter values with the loop cut at a place."""
        return Transfer(self.problem.diagram, overrides(self.problem, self.scenario, x), open_at)

    def _member(self, x: Vector) -> Mapping[str, Transfer]:
        """Return the diagram at parameter values, cut at every place that a goal or the loop names."""
        places = {self.open_at, *(ratio.open_at for ratio in self.ratios if ratio.open_at is not None)}
        return {place: self.cut(x, place) for place in places}

    def _values(self, member: Mapping[str, Transfer], frequencies: Real) -> tuple[Complex, Complex, Complex]:
        system = member[self.open_at]
        response = system(frequencies)
        d = 1 - response[:, -1, -1]
        n = np.empty((len(self.ratios), len(frequencies)), dtype=complex)
        m = np.empty_like(n)
        for row, ratio in enumerate(self.ratios):
            if ratio.open_at is not None:
                # 1 + L of a loop cut elsewhere, with which S is own/D
                cut_here = ratio.open_at == self.open_at
                own = np.ones_like(d) if cut_here else d / (1 - member[ratio.open_at](frequencies)[:, -1, -1])
                n[row] = own if ratio.response == "sensitivity" else d - own
                m[row] = own if ratio.response == "loop" else d
            elif ratio.at_rest:
                n[row], m[row] = _error(ratio, system, response, d) / (1j * frequencies), d
            else:
                assert ratio.source is not None
                closed = _closed(system, response, d, ratio.source, ratio.target)
                n[row], m[row] = closed if ratio.response == "path" else d - closed, d
            if ratio.mask is not None:
                low, high = ratio.band
                with np.errstate(divide="ignore", over="ignore"):
                    mask = ratio.mask(np.clip(frequencies, low, high))
                    n[row] /= mask
                if ratio.inverted:
                    n[row], m[row] = m[row].copy(), n[row].copy()
        return d, n, m


def _error(ratio: Ratio, system: Transfer, response: Complex, d: Complex) -> Complex:
    """Return the numerator of the error r - y under steps, with r = 0 where no reference is commanded."""
    total = np.zeros_like(d)
    for port, amplitude in ratio.commands:
        total -= amplitude * _closed(system, response, d, port, ratio.target)
        if port == ratio.reference:
            total += amplitude * d
    return total


def _closed(system: Transfer, response: Complex, d: Complex, source: str, target: str | None) -> Complex:
    """Return the numerator of a closed-loop response: y/u = G_yu + G_yl G_lu / D."""
    assert target is not None
    y, u = system.outputs.index(target), system.inputs.index(source)
    return np.asarray(response[:, y, u] * d + response[:, y, -1] * response[:, -1, u])


def linear_loops(problem: Problem, ratios: Sequence[Ratio]) -> tuple[LinearLoop, ...]:
    """Return the loop of each scenario, cut where all responses are linear in the variables.

    Raises
    ------
    ProblemError
        If there is no such place, naming the variables that stand in the way; if the system is nonlinear, a variable is a
        number of a command, or there are too many.
    """
    _refuse(problem)
    reasons: list[tuple[int, ProblemError]] = []
    for place in _places(problem):
        try:
            loops = tuple(LinearLoop(problem, scenario, ratios, place) for scenario in problem.scenarios)
        except EngineError:  # a port that is none, or a cut that leaves no system
            continue
        reason = next((r for r in map(_curvature, loops) if r is not None), None)
        if reason is None:
            return loops
        reasons.append(reason)
    if not reasons:
        raise ProblemError("goals must belong to a diagram with a loop that can be cut, got none", at=("goals",))
    raise min(reasons, key=lambda reason: reason[0])[1]  # the place where least stands in the way


def _refuse(problem: Problem) -> None:
    if problem.diagram.nonlinear:
        raise ProblemError(
            "the system must be linear for the method convex, got nonlinear blocks", at=("method", "kind")
        )
    for index, axis in enumerate(problem.axes):
        if axis.parameter in problem.commands:
            raise ProblemError(
                f"{axis.parameter} must be a parameter of the system for the method convex, got a number of a command",
                at=("variables", index, "parameter"),
            )
        if axis.discrete:
            raise ProblemError(
                f"{axis.parameter} must be continuous for the method convex, got {len(axis.levels)} values alone: use the "
                f"method grid", at=("variables", index),
            )  # fmt: skip
    if len(problem.axes) > _MOST_PARAMETERS:
        raise ProblemError(
            f"variables must be <= {_MOST_PARAMETERS} for the method convex, got {len(problem.axes)}", at=("variables",)
        )


def _places(problem: Problem) -> list[str]:
    """Return where the loop may be cut: first where the goals do, then at every connection."""
    named = [goal.open_at for goal in problem.goals if isinstance(goal.open_at, str)]
    sources = [c.source for c in problem.diagram.system.connections]
    return list(dict.fromkeys([*named, *(source for source in sources if source not in problem.diagram.inputs)]))


def _curvature(loop: LinearLoop) -> tuple[int, ProblemError] | None:
    """Return what is against linear responses (how many variables, and the words for it), or None when nothing is."""
    axes, base = loop.problem.axes, loop.base
    frequencies = np.geomspace(0.1 * loop.slowest, 10 * loop.fastest, _LOOKS)
    known = loop.coefficients(frequencies)

    def bent(x: Vector) -> bool:
        steps = np.append(1.0, np.abs(x - base))
        return any(
            bool((np.abs(true - known.valued(line, x)) > _LINEAR * np.tensordot(steps, np.abs(line), axes=1)).any())
            for true, line in zip(loop.exact(x, frequencies), (known.d, known.n, known.m), strict=True)
        )

    if not bent(loop.inner):
        return None
    alone = [k for k, x in enumerate(loop.inner) if bent(np.where(np.arange(len(axes)) == k, x, base))]
    names = ", ".join(axes[k].parameter for k in alone or range(len(axes)))
    what = (
        f"in each variable for the method convex, got another dependence on {names}: hold it at a value"
        if alone
        else f"in all variables together for the method convex, got products of {names} (controllers in series or in "
        f"different loops): hold some at a value"
    )
    return len(alone) or len(axes), ProblemError(
        f"the response of the loop opened at {loop.open_at} must be linear {what}, or use the method gradient",
        at=("variables", alone[0], "parameter") if alone else ("variables",),
    )
