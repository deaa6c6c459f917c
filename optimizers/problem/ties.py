"""Variables that are not free: each is an expression over free ones, parameters of the system and of scenarios.

p_tied = g(p_free, ...),   d f / d p_free = ∂f/∂p_free + ∂f/∂p_tied ∂g/∂p_free
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from engine.model.errors import EngineError, Path
from engine.model.expressions import Expression, parse
from engine.model.names import no_parameter
from optimizers.problem.errors import ProblemError

if TYPE_CHECKING:
    from engine.diagram.diagram import Diagram
    from engine.model.parameters import ParameterInfo, Scalar
    from optimizers.problem.axes import Variable


@dataclass(frozen=True, slots=True, kw_only=True)
class Tie:
    """A parameter and the expression that gives its value."""

    parameter: str
    expression: Expression

    def value(self, known: Callable[[str], Scalar]) -> Scalar:
        """Return the value, from those of the parameters it is made of.

        Raises
        ------
        ExpressionError
            If it has none.
        """
        return self.expression.evaluate([known(name) for name in self.expression.names])


def tie_of(
    variable: Variable, diagram: Diagram, info: ParameterInfo, at: Path, *, free: Collection[str], tied: Collection[str]
) -> Tie:
    """Return a tied variable.

    Raises
    ------
    ProblemError
        Bounds beside the expression, a name that is unknown or itself tied, an expression without a free variable.
    """
    for key in ("lower", "upper", "scale", "start", "choices"):
        if getattr(variable, key) is not None:
            raise ProblemError(f"{key} must be left out beside an expression: it gives the value", at=(*at, key))
    place = (*at, "expression")
    if info.bound:
        raise ProblemError(
            f"{variable.parameter} must be a number to be tied, got an expression", at=(*at, "parameter")
        )
    if not (variable.expression or "").startswith("="):
        raise ProblemError(f"expression must begin with '=', got {variable.expression!r}", at=place)
    try:
        expression = parse(variable.expression or "")
    except EngineError as error:
        raise ProblemError(error.message, at=place) from error
    for name in expression.names:
        if name in tied:
            raise ProblemError(
                f"expression must be made of free variables and parameters, got {name}, which is tied", at=place
            )
        if name not in diagram.parameters:
            raise ProblemError(
                f"expression of {variable.parameter}: {no_parameter(name, diagram.parameters)}", at=place
            )
    if not any(name in free for name in expression.names):
        raise ProblemError(
            f"expression of {variable.parameter} must name at least one variable, got {variable.expression!r}", at=place
        )
    return Tie(parameter=variable.parameter, expression=expression)


def resolved(
    ties: Mapping[str, Tie], values: Mapping[str, Any], otherwise: Callable[[str], Scalar]
) -> dict[str, Scalar]:
    """Return the values of tied parameters; what ``values`` does not hold is asked of ``otherwise``."""
    return {
        name: tie.value(lambda known: values[known] if known in values else otherwise(known))
        for name, tie in ties.items()
    }
