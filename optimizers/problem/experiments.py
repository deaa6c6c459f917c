"""Commands under which time metrics are taken."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from optimizers.problem.errors import ProblemError, listed

if TYPE_CHECKING:
    from engine.diagram.diagram import Diagram
    from engine.model.errors import Path
    from engine.signals import Signal


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """Commands on input ports, by name; ``duration`` (s) limits only the integral metrics (None: the whole response)."""

    name: str
    signals: Mapping[str, Signal]
    duration: float | None = None


def check_experiment(diagram: Diagram, experiment: Experiment, at: Path) -> None:
    """Refuse an experiment without a command, at an unknown port, or of no duration."""
    if not experiment.signals:
        raise ProblemError(
            f"input must be at least one command for experiment {experiment.name!r}, got none", at=(*at, "input")
        )
    for port in experiment.signals:
        if port not in diagram.inputs:
            raise ProblemError(f"port must be one of {listed(diagram.inputs)}, got {port!r}", at=(*at, "input", "port"))
    if experiment.duration is not None and not (experiment.duration > 0 and math.isfinite(experiment.duration)):
        raise ProblemError(f"duration must be > 0 s, got {experiment.duration:g}", at=(*at, "duration"))
