"""What an identification will take, before it begins: from its counts, by what each kind of model was measured to take.

    seconds = evaluations · Σ_e samples · (1 + coordinates) · τ,   bytes = 8 · largest samples · outputs · (1 + coordinates) · arrays

Rough by a factor of three: of one core of a machine of 2024, without stiffness and events in number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from engine.batch.nonlinear.equations import Equations
from engine.model.between_samples import BetweenSamples
from engine.model.between_samples import tried as every_way
from engine.model.traced import UnsuitableError
from optimizers.problem import ProblemError
from optimizers.recorded.recording import Identification
from optimizers.search.limits import MOST_BYTES

_LINEAR: Final = 2.2e-7
"""Seconds for each sample and neighbour of a model in straight formulas,"""
_MARCHED: Final = 2.2e-6
"""of one that is marched,"""
_EVENTS: Final = 9e-5
"""and of one that goes from event to event."""
_LINE: Final = 5e-6
"""Seconds for each line of a response and neighbour."""
_LATE: Final = 0.02
"""Seconds for an evaluation with delays, beside its samples,"""
_AT_ONCE: Final = 0.003
"""and without."""
_SEARCHED: Final = 8
"""Evaluations that a start usually takes,"""
_BESIDE: Final = 3
"""and that another way between the samples takes from where the first came to rest."""
_ARRAYS: Final = 16
"""As long as the recording that are in memory at once, for each output and neighbour,"""
_ARRAYS_OF_SPLINES: Final = 36
"""and where an input may be a spline between its samples."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Expected:
    """How many evaluations (simulations of everything with its slopes), how long (s, on one core), how much memory (bytes)."""

    evaluations: int
    seconds: float
    bytes: float


def expected(problem: Identification, *, most_bytes: float = MOST_BYTES) -> Expected:
    """Return what an identification will take.

    Raises
    ------
    ProblemError
        For more memory than ``most_bytes``.
    """
    diagram, experiments = problem.diagram, problem.experiments
    states = diagram.laws().states if problem.initial_states and diagram.nonlinear else 0
    lanes = 1 + len(problem.parameters) + states
    ways = len(every_way(problem.undecided)) if problem.undecided else 1
    evaluations = problem.starts * min(problem.max_evaluations, _SEARCHED) + (ways - 1) * _BESIDE
    samples = sum(e.recording.samples * len(e.recording.outputs) for e in experiments)
    lines = sum(f.lines for f in problem.frequency)
    late = not diagram.nonlinear and bool(diagram.realize().delays.size)
    each = _LATE if late else _AT_ONCE
    seconds = evaluations * (each + lanes * (samples * _for_a_sample(problem) + lines * _LINE))
    splines = ways > 1 or any(
        BetweenSamples.BAND_LIMITED in e.recording.between_samples.values() for e in experiments
    )  # fmt: skip
    arrays = _ARRAYS_OF_SPLINES if splines else _ARRAYS
    longest = max((e.recording.samples * len(e.recording.outputs) for e in experiments), default=0)
    room = 8.0 * lanes * (longest * arrays + 3 * samples)
    if room > most_bytes:
        raise ProblemError(
            f"samples x parameters must fit into {most_bytes / 1e9:.3g} GB, {samples:,} samples with {lanes - 1} parameters and "
            f"initial states need about {room / 1e9:.2g} GB: estimate fewer at once, from a shorter recording, or from one that is "
            "decimated",
            at=("parameters",),
        )
    return Expected(evaluations=evaluations, seconds=seconds, bytes=room)


def _for_a_sample(problem: Identification) -> float:
    if not problem.diagram.nonlinear:
        return _LINEAR
    try:
        Equations.of(problem.diagram, tuple(unknown.parameter for unknown in problem.unknowns))
    except UnsuitableError:
        return _EVENTS
    return _MARCHED
