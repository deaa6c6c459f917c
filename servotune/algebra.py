"""Parts of systems as formulas: `feedback(gain("=kp") >> tf([1], [0.02, 1, 0]))` is the document of a loop."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from servotune.building import System

Connection = tuple[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """Blocks with one input and one output.

    ``a >> b`` is a followed by b, ``a + b`` and ``a - b`` stand side by side, ``-a`` is a turned round; numbers are gains.

    Parameters
    ----------
    blocks : mapping
        By name.
    connections : sequence of (str, str)
        From, to.
    entries : sequence of str
        What the input leads to.
    exit : str
        What the output is.
    """

    blocks: Mapping[str, Mapping[str, Any]]
    connections: tuple[Connection, ...]
    entries: tuple[str, ...]
    exit: str

    def __rshift__(self, other: Part | float) -> Part:
        return series(self, other)

    def __rrshift__(self, other: float) -> Part:
        return series(other, self)

    def __add__(self, other: Part | float) -> Part:
        return _summed("++", self, _part(other))

    def __radd__(self, other: float) -> Part:
        return _summed("++", _part(other), self)

    def __sub__(self, other: Part | float) -> Part:
        return _summed("+-", self, _part(other))

    def __rsub__(self, other: float) -> Part:
        return _summed("+-", _part(other), self)

    def __neg__(self) -> Part:
        return self >> -1.0

    def named(self, name: str) -> Part:
        """Return the same with another name for its only block.

        Raises
        ------
        ValueError
            It has several.
        """
        if len(self.blocks) != 1:
            raise ValueError(f"a name is given to a part with one block, this one has {', '.join(self.blocks)}")
        return self._renamed(lambda _: name)

    def system(self, name: str, /, *, input: str = "r", output: str = "y", **parameters: Any) -> System:  # noqa: A002 - what it is called
        """Return the document of it.

        Parameters
        ----------
        name : str
        input, output : str
            Names of the input and the output.
        parameters
            Named values of its expressions, as those of `System`.
        """
        made = System(name, **parameters)
        made.add("input", input)
        own = self._renamed(_free({input}, self.blocks))
        made["blocks"] |= {block: dict(values) for block, values in own.blocks.items()}
        for source, target in (*((input, entry) for entry in own.entries), *own.connections):
            made.connect(source, target)
        made.output(output, own.exit)
        return made

    def _renamed(self, new: Callable[[str], str]) -> Part:
        def moved(path: str) -> str:
            block, dot, port = path.partition(".")
            return f"{new(block)}{dot}{port}"

        return Part(
            blocks={new(name): values for name, values in self.blocks.items()},
            connections=tuple((moved(source), moved(target)) for source, target in self.connections),
            entries=tuple(map(moved, self.entries)),
            exit=moved(self.exit),
        )

    def __repr__(self) -> str:
        return f"<Part {', '.join(self.blocks)}>"


def block(kind: str, name: str | None = None, /, **values: Any) -> Part:
    """Return one block of the catalogue that has one input and one output.

    Parameters
    ----------
    kind : str
    name : str, optional
        That of its kind unless given; a number is added where it is taken.
    values
        Its parameters.
    """
    own = name or kind
    return Part(blocks={own: {"kind": kind} | values}, connections=(), entries=(own,), exit=own)


def tf(numerator: Sequence[Any], denominator: Sequence[Any], name: str | None = None) -> Part:
    """Return a transfer function, its coefficients from the highest power of s down, as in python-control and MATLAB."""
    return block("transfer_function", name, numerator=list(numerator), denominator=list(denominator))


def gain(value: float | str, name: str | None = None) -> Part:
    """Return a gain: a number, a quantity, or an expression such as "=kp"."""
    return block("gain", name, gain=value)


def series(first: Part | float, *others: Part | float) -> Part:
    """Return parts that follow each other, the signal from left to right."""
    found = _part(first)
    for other in others:
        before, behind = _apart(found, _part(other))
        found = Part(
            blocks={**before.blocks, **behind.blocks},
            connections=(*before.connections, *behind.connections, *((before.exit, entry) for entry in behind.entries)),
            entries=before.entries,
            exit=behind.exit,
        )
    return found


def parallel(first: Part | float, *others: Part | float) -> Part:
    """Return parts that have the same input, and whose outputs are added."""
    return _summed("+" * (1 + len(others)), *map(_part, (first, *others))) if others else _part(first)


def feedback(forward: Part | float, back: Part | float | None = None, sign: int = -1) -> Part:
    """Return a closed loop: the error, ``forward``, and ``back`` on the way from the output to the error, 1 unless given.

    Parameters
    ----------
    sign : int
        -1, or 1 for positive feedback.
    """
    if sign not in {-1, 1}:
        raise ValueError(f"sign must be -1 or 1, got {sign!r}")
    error, way, *home = _apart(
        block("sum", "error", signs="+-" if sign < 0 else "++"),
        _part(forward),
        *([] if back is None else [_part(back)]),
    )
    joint, ends = error.exit, (way, *home)
    returning = [(way.exit, entry) for one in home for entry in one.entries]
    return Part(
        blocks={name: values for one in (error, *ends) for name, values in one.blocks.items()},
        connections=(
            *((joint, entry) for entry in way.entries),
            *(connection for one in ends for connection in one.connections),
            *returning,
            (ends[-1].exit, f"{joint}.in2"),
        ),
        entries=(f"{joint}.in1",),
        exit=way.exit,
    )


def from_control(system: Any, name: str | None = None) -> Part:
    """Return a continuous python-control system with one input and one output, a transfer function or a state space.

    Raises
    ------
    ValueError
        It has several inputs or outputs, or is sampled.
    """
    ports = getattr(system, "ninputs", None), getattr(system, "noutputs", None)
    if ports != (1, 1):
        raise ValueError(f"system must have one input and one output, got {ports[0]} and {ports[1]}")
    if system.dt not in {0, None}:
        raise ValueError(f"system must be continuous in time, got one sampled with dt = {system.dt}")
    if hasattr(system, "num_array"):
        return tf(_numbers(system.num_array[0, 0]), _numbers(system.den_array[0, 0]), name)
    matrices = {key: [_numbers(row) for row in getattr(system, key)] for key in "ABCD"}
    found = block("state_space", name, **matrices, inputs=["u"], outputs=["y"])
    return Part(blocks=found.blocks, connections=(), entries=(f"{found.exit}.u",), exit=f"{found.exit}.y")


def _numbers(values: Iterable[Any]) -> list[float]:
    return [float(value) for value in values]


def _part(given: Part | float) -> Part:
    if isinstance(given, Part):
        return given
    if isinstance(given, bool) or not hasattr(given, "__float__"):
        raise TypeError(f"a part must be made by tf, gain, block ..., or be a number, got {type(given).__name__}")
    return gain(float(given))


def _summed(signs: str, *parts: Part) -> Part:
    """Return parts with the same input, summed with their signs."""
    total, *own = _apart(block("sum", "sum", signs=signs), *parts)
    return Part(
        blocks={name: values for one in (*own, total) for name, values in one.blocks.items()},
        connections=(
            *(connection for one in own for connection in one.connections),
            *((one.exit, f"{total.exit}.in{k}") for k, one in enumerate(own, start=1)),
        ),
        entries=tuple(entry for one in own for entry in one.entries),
        exit=total.exit,
    )


def _apart(*parts: Part) -> list[Part]:
    """Return parts with names that none of them shares."""
    taken: set[str] = set()
    found = []
    for one in parts:
        own = one._renamed(_free(taken, one.blocks))  # noqa: SLF001 - of this file
        taken |= own.blocks.keys()
        found.append(own)
    return found


def _free(taken: set[str], own: Iterable[str]) -> Callable[[str], str]:
    """Return what gives each name that is taken a number, and leaves the others."""
    names = list(own)
    new: dict[str, str] = {}
    for name in names:
        stem = name.rstrip("0123456789").rstrip("_") if name in taken else name
        candidate, number = name, 2
        while candidate in taken or candidate in new.values() or (candidate != name and candidate in names):
            candidate, number = f"{stem}_{number}", number + 1
        new[name] = candidate
    return new.__getitem__
