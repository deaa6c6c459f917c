"""What the exact path says of the goals of a problem: a point is measured once, whoever asks."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

from engine.model.verdicts import Measured
from optimizers.evaluation.certificate import Certificate, certify
from optimizers.evaluation.compared import Exact
from optimizers.evaluation.measuring import measured
from optimizers.problem import Problem


class ExactValues:
    """Goals of a problem in all scenarios, by the exact path."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._measured: dict[tuple[float, ...], list[list[Exact]]] = {}
        self._certificates: dict[tuple[float, ...], Certificate] = {}

    @cached_property
    def before(self) -> list[list[Measured]]:
        """Every goal in every scenario at the present parameter values: [scenario][goal]."""
        return [
            [one for one, _ in measured(self._problem, self._problem.before, scenario, tied=False)]
            for scenario in self._problem.scenarios
        ]

    def at(self, point: Mapping[str, float]) -> list[list[Exact]]:
        """Return every goal with its derivatives by the variables: [scenario][goal]."""
        key = self._key(point)
        if key not in self._measured:
            self._measured[key] = [
                measured(self._problem, point, scenario, gradient=True) for scenario in self._problem.scenarios
            ]
        return self._measured[key]

    def certificate(self, point: Mapping[str, float]) -> Certificate:
        """Return the proof of a point."""
        key = self._key(point)
        if key not in self._certificates:
            rows = [[one for one, _ in row] for row in self.at(point)]
            self._certificates[key] = certify(self._problem, point, rows)
        return self._certificates[key]

    def _key(self, point: Mapping[str, float]) -> tuple[float, ...]:
        return tuple(point[axis.parameter] for axis in self._problem.axes)
