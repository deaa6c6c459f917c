"""The body of an optimisation: what may be chosen, what is wanted, and what one choice must serve."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from api.schemas.methods import MethodDocument
from api.schemas.queue import QueueDocument
from api.schemas.signals import Inputs
from api.schemas.systems import BlockDocument, ConnectionDocument, Parameters, SystemRef
from api.schemas.values import (
    AutoOrQuantity,
    Band,
    Document,
    Name,
    OfPaths,
    OfResponses,
    OpenAt,
    Overrides,
    Path,
    Port,
    Quantity,
)
from optimizers.solving.solve import MOST_SAMPLES

Point = Annotated[list[Quantity], Field(min_length=2, max_length=2)]
Points = Annotated[
    list[Point],
    Field(
        min_length=2,
        max_length=10_000,
        description="[[t, y], ...] over time, straight between the points, the same instant twice a jump; "
        "[[ω, magnitude], ...] over frequency, straight on logarithmic axes",
    ),
]


class RationalDocument(Document):
    """The magnitude of a rational function over frequency, highest power of s first."""

    numerator: list[float] = Field(min_length=1, max_length=100)
    denominator: list[float] = Field(min_length=1, max_length=100)


def _points_or_rational(value: Any) -> str:
    return "points" if isinstance(value, list) else "rational"


Bound = Annotated[
    Annotated[Points, Tag("points")] | Annotated[RationalDocument, Tag("rational")], Discriminator(_points_or_rational)
]


class BoundsDocument(Document):
    """What a whole curve is held against: an envelope over time, or bounds on a gain over frequency."""

    upper: Bound | None = None
    lower: Bound | None = None
    scale: Quantity | None = Field(
        default=None, description="unit of an envelope's excess; by default the largest magnitude of its points"
    )


class VariableDocument(Document):
    """A parameter that may be chosen; bounds, scale and start default to those of the parameter itself."""

    parameter: Path
    lower: Quantity | None = None
    upper: Quantity | None = None
    scale: Literal["linear", "log"] | None = None
    start: Quantity | None = None
    choices: list[Quantity] | None = Field(
        default=None, min_length=2, max_length=10_000, description="the only values allowed, those of a catalogue say"
    )
    integer: bool = Field(default=False, description="whole numbers between the bounds only")
    expression: str | None = Field(
        default=None,
        pattern="^=",
        max_length=1000,
        description="not free, but tied to other variables and parameters: `=kp/20`",
    )


class ExperimentDocument(Document):
    """Commands under which time metrics are taken."""

    name: str = Field(min_length=1, max_length=100)
    input: Inputs
    duration: AutoOrQuantity = "auto"


class GoalDocument(OfResponses, OfPaths):
    """A metric as objective (`sense`), as constraint (`lower`, `upper` or `target`), or as both.

    On the scale of all goals, `score`, a constraint is met at 1. A goal that names no experiment, input or output takes
    the only one there is.
    """

    metric: str
    experiment: str | None = None
    output: Port | None = None
    source: Port | None = Field(default=None, alias="from")
    target: Port | None = Field(default=None, alias="to")
    open_at: OpenAt | None = None
    band: Band | None = Field(default=None, description="for `band_energy`")
    bounds: BoundsDocument | None = Field(
        default=None,
        description="for `envelope` and the metrics named `..._bound`; met at 1, which is their default upper",
    )
    reference: Points | None = Field(default=None, description="for `tracking_error`: the curve to follow")
    sense: Literal["minimize", "maximize"] | None = None
    lower: Quantity | None = None
    upper: Quantity | None = None
    aim: Quantity | None = Field(default=None, alias="target", description="value to be hit, within `tolerance`")
    tolerance: Quantity | None = Field(default=None, description="1 % of `target` by default")
    hard: bool = Field(
        default=True, description="false: the bounds are approached, beside an objective weighted with `weight`"
    )
    weight: float = 1.0
    accept: Literal["ok", "not_settled"] = Field(
        default="not_settled",
        description="not_settled takes also what a given duration says of a nonlinear output that has not settled within it",
    )


class ScenarioDocument(Document):
    """A set of parameter values with a name."""

    name: str = Field(min_length=1, max_length=100)
    parameters: Overrides


def _named_or_plain(value: Any) -> str:
    named = isinstance(value, ScenarioDocument) or (isinstance(value, dict) and set(value) == {"name", "parameters"})
    return "named" if named else "plain"


Scenario = Annotated[
    Annotated[ScenarioDocument, Tag("named")] | Annotated[Overrides, Tag("plain")], Discriminator(_named_or_plain)
]


class UncertainDocument(Document):
    """A parameter that may lie anywhere in a range; the variables must serve the worst of it."""

    parameter: Path
    lower: Quantity
    upper: Quantity
    scale: Literal["linear", "log"] | None = None


class AddedParts(Document):
    """What an alternative has besides; what is there already under the same name is replaced."""

    parameters: Parameters = Field(default_factory=dict)
    blocks: dict[Name, BlockDocument] = Field(default_factory=dict)
    connections: list[ConnectionDocument] = Field(default_factory=list)
    outputs: dict[Name, Path] = Field(default_factory=dict)


class RemovedParts(Document):
    """What an alternative does without; with a block go all its connections."""

    blocks: list[Name] = Field(default_factory=list)
    connections: list[ConnectionDocument] = Field(default_factory=list)


class AlternativeDocument(Document):
    """A structure to be compared: a system of its own, or the request's with parts added and removed (with neither: itself)."""

    name: str = Field(min_length=1, max_length=100)
    system: SystemRef | None = None
    add: AddedParts | None = None
    remove: RemovedParts | None = None
    variables: list[VariableDocument] | None = Field(
        default=None, min_length=1, max_length=100, description="those of the request by default"
    )


class OptimizationRequest(Document):
    """Variables, experiments, goals, the scenarios and ranges that one choice must serve, and the method."""

    system: SystemRef
    variables: list[VariableDocument] = Field(min_length=1, max_length=100)
    experiments: list[ExperimentDocument] = Field(default_factory=list, max_length=100)
    goals: list[GoalDocument] = Field(
        min_length=1, max_length=100, description="without any `sense`: a point that serves all of them, with most room"
    )
    scenarios: list[Scenario] = Field(
        default=[{}],
        min_length=1,
        max_length=100,
        description="parameter sets that the same variables must serve: plain, or with a `name`",
    )
    across_scenarios: Literal["worst", "mean"] = Field(
        default="worst", description="which objective counts; constraints hold in every scenario"
    )
    uncertain: list[UncertainDocument] = Field(default_factory=list, max_length=20)
    yield_samples: int = Field(
        default=0,
        ge=0,
        le=MOST_SAMPLES,
        description="draws of the uncertain parameters, for the share that meets the goals",
    )
    cross_check: list[str] = Field(
        default_factory=list, max_length=5, description="methods that solve it, too, to show how far apart they end"
    )
    alternatives: list[AlternativeDocument] | None = Field(
        default=None,
        min_length=2,
        max_length=50,
        description="structures to be compared; the best one's result is returned",
    )
    # made by a function, because generators of clients do not know a default that is an object
    method: MethodDocument = Field(default_factory=lambda: {"kind": "auto"}, validate_default=True)
    queue: QueueDocument | None = None
