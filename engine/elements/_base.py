"""What every element is: ports, declared parameters, and a realisation that is analytic in the values.

x' = A x + B u,   y = C x + D u + D12 w,   z = D21 u,   w_i(t) = z_i(t - delay_i)
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final

import numpy as np
import numpy.typing as npt

from engine.model.errors import DiagramError
from engine.model.parameters import Param, Scalar
from engine.model.traced import Op, Traced

Array = npt.NDArray[Any]
Values = Mapping[str, Any]
"""Name -> float, complex or batch (B,), a nested list of those, text, or None where an optional parameter is absent."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ports:
    """Names of the inputs and outputs; a unit is None where it follows from what is connected.

    ``loads`` are the inputs at which nothing but a load acts on a drive; ``input_units`` is empty where none is known.
    """

    inputs: tuple[str, ...] = ("in",)
    outputs: tuple[str, ...] = ("out",)
    output_units: tuple[str | None, ...] = (None,)
    loads: tuple[str, ...] = ()
    input_units: tuple[str | None, ...] = ()


def _no_delays() -> Array:
    return np.zeros(0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reading:
    """The outputs of a block by the rates of its states: y = c x + d u + k x'.

    The same as y = (c + k A) x + (d + k B) u, without what cancels there: a fast filter's state nearly is its input, and an
    acceleration is a small rest of large forces. ``k`` has the shape of ``c``.
    """

    c: Array
    d: Array
    k: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Realization:
    """The state space of one block (n states, m delay channels), each array with a leading batch axis or without.

    Shapes: ``a`` (n, n), ``b`` (n, inputs), ``c`` (outputs, n), ``d`` (outputs, inputs), ``delays`` (m,),
    ``d12`` (outputs, m), ``d21`` (m, inputs); ``initial`` (n,), None for rest. ``reading`` (of a block without delays) says
    how rates make the outputs.
    """

    a: Array
    b: Array
    c: Array
    d: Array
    delays: Array = field(default_factory=_no_delays)
    d12: Array | None = None
    d21: Array | None = None
    initial: Array | None = None
    reading: Reading | None = None

    @classmethod
    def static(cls, d: Array) -> Realization:
        """Return y = D u."""
        outputs, inputs = d.shape[-2:]
        return cls(a=np.zeros((0, 0)), b=np.zeros((0, inputs)), c=np.zeros((outputs, 0)), d=d)


class Element(ABC):
    """One kind of block. An element is never instantiated: its values come from the document at every call.

    `realize` is analytic: a value may be complex (an infinitesimal in its imaginary part) or an array (B,) of either,
    and every coefficient follows; decisions look at real parts only. ``example`` is a minimal working set of values.
    """

    kind: ClassVar[str]
    title: ClassVar[str]
    equation: ClassVar[str]
    source: ClassVar[str]
    parameters: ClassVar[tuple[Param, ...]] = ()
    example: ClassVar[Mapping[str, Any]] = {}

    @classmethod  # noqa: B027 - most elements have nothing to check
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Raise DiagramError where values that are right one by one do not go together; ``at`` is the parameter.

        ``given`` are the names that the document itself gives; numbers in ``values`` may still be unknown (NaN).
        """

    @classmethod
    def law(cls, given: frozenset[str]) -> type[Element]:
        """Return the element that a block is for which these parameters are given."""
        return cls

    @classmethod
    def assumed(cls, given: frozenset[str]) -> Mapping[str, str]:
        """Return parameter -> what the user is told where a default that matters is taken."""
        return {}

    @classmethod
    @abstractmethod
    def ports(cls, values: Values) -> Ports:
        """Return the ports, which follow from texts, list lengths and which optional values are present."""

    @classmethod
    @abstractmethod
    def realize(cls, values: Values) -> Realization:
        """Return the state space at ``values`` (SI)."""


def by_rates(c: Array, d: Array, rates: Mapping[int, Sequence[Scalar]]) -> Reading:
    """Return the reading whose outputs ``rates`` are these shares of the states' rates alone; the others are those of C and D."""
    c, d = c.copy(), d.copy()
    rows: list[Sequence[Scalar]] = [[0.0] * c.shape[-1] for _ in range(c.shape[-2])]
    for output, shares in rates.items():
        c[..., output, :], d[..., output, :] = 0.0, 0.0
        rows[output] = shares
    return Reading(c=c, d=d, k=matrix(rows))


_FLOATS: Final = frozenset({float, int})


def matrix(rows: Sequence[Sequence[Scalar]], *, columns: int = 0) -> Array:
    """Return an array (..., rows, columns) whose entries are numbers or batches (B,); ``columns`` serves an empty one."""
    shape = (len(rows), len(rows[0]) if rows else columns)
    entries: list[Any] = [entry for row in rows for entry in row]
    if _FLOATS.issuperset(map(type, entries)):
        return np.array(entries, dtype=float).reshape(shape)
    if any(isinstance(entry, Traced) for entry in entries):
        return np.array(entries, dtype=object).reshape(shape)
    batches = [entry.shape for entry in entries if isinstance(entry, np.ndarray)]
    if not batches:
        kind = complex if any(isinstance(entry, complex) for entry in entries) else float
        return np.array(entries, dtype=kind).reshape(shape)
    result = np.empty((*np.broadcast_shapes(*batches), *shape), dtype=np.result_type(float, *entries))
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            result[..., i, j] = entry
    return result


def absent(value: Scalar) -> bool:
    """Whether ``value`` is exactly 0 (in the whole batch) and carries no infinitesimal, so that its state can go."""
    if isinstance(value, Traced):
        return False  # a value that is going to vary
    return not np.any(value) if isinstance(value, np.ndarray) else value == 0


def vanishing(value: Scalar) -> Scalar:
    """Return 1 for the members of a batch that have no use for a state, as ``value`` is exactly 0 there, else 0.

    A batch has one structure: where a single member needs no state, its state is made to decay unseen. Where all real
    parts are 0, the state is there for an infinitesimal, and all members keep it as it is.
    """
    if isinstance(value, Traced):
        return value.apply(Op.IS_ZERO)
    if isinstance(value, np.ndarray) and np.any(value.real):
        return np.where(value == 0, 1.0, 0.0)
    return 0.0


def plain_zero(value: Scalar) -> Scalar:
    """Return ``value`` without its infinitesimal where it is 0: of a lag, say, at which a state appears out of nothing.

    The response has no derivative there, so there is none to carry.
    """
    if isinstance(value, Traced):
        return value
    if isinstance(value, np.ndarray):
        return np.where(value.real == 0, 0.0, value)
    return value if value.real else 0.0


def exclusive(given: frozenset[str], first: str, second: str) -> None:
    """Raise DiagramError where both of two alternative parameters are given."""
    if first in given and second in given:
        raise DiagramError(f"{second} must be absent where {first} is given, got both", at=(second,))
