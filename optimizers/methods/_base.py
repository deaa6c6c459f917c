"""What every method of optimisation has in common: options described as Params, and one entry point."""

from __future__ import annotations

import abc
import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from engine.model.parameters import Param
from optimizers.problem import Problem, ProblemError
from optimizers.search.result import Monitor, Result

MAX_SECONDS = Param(
    name="max_seconds", symbol="", unit="s", doc="how long it may take, the proof included; 0 is no limit", default=0,
    lower=0, upper=1e8,
)  # fmt: skip
"""An option of every method: its best point until then is the result."""


class Method(abc.ABC):
    """A way to choose the variables. One subclass in one file; the catalogue finds it there.

    Methods are deterministic under a seed, keep to the bounds, report their progress and stop within a second of being
    cancelled.
    """

    kind: ClassVar[str]
    title: ClassVar[str]
    doc: ClassVar[str]
    source: ClassVar[str]
    options: ClassVar[tuple[Param, ...]] = ()

    @abc.abstractmethod
    def minimize(
        self, problem: Problem, options: Mapping[str, Any], *, rng: np.random.Generator, monitor: Monitor
    ) -> Result:
        """Return the best point found.

        Parameters
        ----------
        problem : Problem
        options : mapping
            Complete and checked, as :meth:`resolve` returns them.
        rng : numpy.random.Generator
            The only source of randomness.
        monitor : Monitor
        """

    @classmethod
    def check(cls, problem: Problem, options: Mapping[str, Any]) -> None:  # noqa: ARG003 - most take any problem
        """Refuse a problem that these options, complete and checked, cannot be used with; before anything is evaluated.

        Raises
        ------
        ProblemError
        """
        return

    @classmethod
    def resolve(cls, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return the options with defaults filled in.

        Raises
        ------
        ProblemError
            An unknown option, or a value outside its bounds; ``at`` is ("method", name).
        """
        known = {param.name: param for param in cls.options}
        for name in given:
            if name not in known:
                raise ProblemError(
                    f"{name} must be an option of {cls.kind} ({', '.join(known) or 'it has none'})", at=("method", name)
                )
        resolved: dict[str, Any] = {}
        for name, param in known.items():
            value = given.get(name)
            resolved[name] = param.default if value is None else _checked(param, value)
        return resolved


def _checked(param: Param, value: Any) -> Any:
    at = ("method", param.name)
    if param.choices:
        if value not in param.choices:
            raise ProblemError(f"{param.name} must be one of {', '.join(param.choices)}, got {value!r}", at=at)
        return value
    if isinstance(value, Mapping):
        # A number for each variable; the method checks the names against its problem.
        return {name: _checked(param, entry) for name, entry in value.items()}
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or value != int(value):
        raise ProblemError(f"{param.name} must be a whole number, got {value!r}", at=at)
    if not param.lower <= value <= param.upper:
        raise ProblemError(f"{param.name} must be within {param.lower:g} … {param.upper:g}, got {value}", at=at)
    return int(value)
