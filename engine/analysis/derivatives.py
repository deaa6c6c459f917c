"""Velocities, accelerations and efforts: how often the output named must be differentiated to be one.

Its unit tells: of a position (m, rad) a velocity is the first derivative, of a velocity (m/s, rad/s) it is the output itself.
Where there is no unit the request says it, as a number that is silently that of another quantity helps nobody.

    y = c x,  x' = A x + B u   =>   y' = c A x + c B u

As long as nothing goes straight from the input to the output, the equations themselves give the derivative; beyond, and of
nonlinear systems, the pieces of the curve are differentiated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from engine.metrics._base import Absent, TimeSubject
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.diagram.references import References
    from engine.model.linear_system import LaneSystem

MOST: Final = 2
"""An output is differentiated twice at most."""

_MOTIONS: Final[Mapping[str, int]] = {"m": 0, "rad": 0, "m/s": 1, "rad/s": 1, "m/s**2": 2, "rad/s**2": 2}
_CONTINUOUS: Final = 1e-9
"""Neighbouring pieces of a curve that differ by less than this part of its largest value meet."""
_NAMES: Final = ("position", "velocity", "acceleration")


def order_of(order: int, output: str, references: References, given: int | None) -> int | str:
    """Return how often an output is differentiated for a metric, or what the request must say.

    Parameters
    ----------
    order : int
        What the metric is of a position: 1 a velocity, 2 an acceleration; 0 of what a controller gives.
    output : str
    references : References
        Units of the outputs, and which of them are compared with a command.
    given : int or None
        The request's ``derivative``.
    """
    if given is not None:
        return given
    unit = references.output_units.get(output) or ""
    motion = _MOTIONS.get(unit)
    if order == 0:
        if motion is None and (unit or output not in references.measured):
            return 0
        what = f"is a {_NAMES[motion]} ({unit})" if motion is not None else "is what the loop controls"
        return f"it needs 'derivative' or the output of a controller: {output} {what}; 0 takes it as it is"
    if motion is not None and motion <= order:
        return order - motion
    what = f"has the unit {unit}" if unit else "has no unit"
    choices = ", ".join(f"{k} if it is {_an(_NAMES[order - k])}" for k in range(order + 1))
    return f"it needs 'derivative', as output {output} {what}: {choices}"


def _an(name: str) -> str:
    return f"an {name}" if name[0] in "aeiou" else f"a {name}"


def unit_of(unit: str, order: int) -> str:
    """Return the unit of a derivative.

    >>> unit_of("m", 2), unit_of("rad/s", 1), unit_of("1", 1)
    ('m/s**2', 'rad/s**2', '1/s')
    """
    if not order:
        return unit
    base, had = unit, 0
    for tail, count in (("/s**2", 2), ("/s", 1)):
        if unit.endswith(tail):
            base, had = unit.removesuffix(tail), count
            break
    power = had + order
    return f"{base}/s" if power == 1 else f"{base}/s**{power}"


def with_rate(system: LaneSystem, output: int, name: str) -> LaneSystem | None:
    """Return the system with one more output, the derivative of an output; None where an input goes straight to that."""
    c = system.c1[:, output : output + 1]
    if np.any(system.d11[:, output]) or np.any(system.d12[:, output]):
        return None
    return replace(
        system,
        c1=np.concatenate([system.c1, c @ system.a], axis=1),
        d11=np.concatenate([system.d11, c @ system.b1], axis=1),
        d12=np.concatenate([system.d12, c @ system.b2], axis=1),
        outputs=(*system.outputs, name),
    )


def differentiated(subject: TimeSubject, times: int) -> TimeSubject:
    """Return the response differentiated piece by piece; with the reason why nothing is measured where it jumps."""
    for _ in range(times):
        y = subject.y
        if y is None or subject.incomplete is not None:
            return subject
        nodes = y.values[:, :, 0].real
        before = np.concatenate([[float(subject.initial[0].real)], nodes[:-1, -1]])
        steps = np.abs(nodes[:, 0] - before)
        if steps.max() > _CONTINUOUS * np.abs(nodes).max(initial=1e-300):
            at = float(y.times[int(np.argmax(steps))])
            advice = (
                f"its derivative is infinite: the response jumps at {at:.6g} s; command a smoother motion, such as a trapezoid or "
                "an s-curve, or name a smoother output"
            )
            return replace(subject, incomplete=Absent(verdict=Verdict.DIVERGES, advice=advice))
        final = None if subject.final is None else np.zeros_like(subject.final)
        subject = replace(subject, y=y.slope, initial=np.zeros_like(subject.initial), final=final)
    return subject


__all__ = ["MOST", "differentiated", "order_of", "unit_of", "with_rate"]
