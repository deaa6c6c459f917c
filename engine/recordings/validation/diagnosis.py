"""What to try when a model fails: every suspicion asked, the most helpful first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from engine.recordings.validation.comparison import Comparison
from engine.recordings.validation.delay import delay
from engine.recordings.validation.direction import direction
from engine.recordings.validation.friction import friction
from engine.recordings.validation.gain import gain
from engine.recordings.validation.offset import offset
from engine.recordings.validation.remedy import Remedy
from engine.recordings.validation.saturation import saturation
from engine.recordings.validation.steps import Movable, Steps, steps

_SUSPICIONS = (offset, gain, delay, saturation, friction)


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnosis:
    """What would make the error smaller.

    Attributes
    ----------
    remedies : mapping of output to tuple of Remedy
        The one that leaves the smallest error first. Each is predicted alone; causes that look alike (a lag, a delay, a
        gain) appear side by side, because a recording may not tell them apart.
    steps : Steps or None
        Which parameter would have to move, all outputs together.
    """

    remedies: Mapping[str, tuple[Remedy, ...]]
    steps: Steps | None


def diagnose(comparisons: Sequence[Comparison], movable: Sequence[Movable] = ()) -> Diagnosis:
    """Return what would make the error of a model smaller.

    Parameters
    ----------
    comparisons : sequence of Comparison
        One for each output, with the derivatives of every parameter in ``movable``.
    movable : sequence of Movable, optional
    """
    remedies = {}
    for comparison in comparisons:
        found = [suspicion(comparison) for suspicion in _SUSPICIONS]
        found.append(direction(comparison, movable))
        remedies[comparison.name] = tuple(
            sorted((r for r in found if r is not None), key=lambda remedy: remedy.relative_error_percent)
        )
    return Diagnosis(remedies=remedies, steps=steps(comparisons, movable))
