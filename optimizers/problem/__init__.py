"""What is to be optimised: variables, experiments, goals, and what one choice of the variables must serve."""

from __future__ import annotations

from optimizers.problem.axes import Axis, Variable, Vector
from optimizers.problem.errors import ProblemError
from optimizers.problem.experiments import Experiment
from optimizers.problem.goals import Goal, Sense
from optimizers.problem.problem import Problem
from optimizers.problem.scenarios import Across, Scenario, Uncertain
from optimizers.problem.ties import Tie

__all__ = [
    "Across",
    "Axis",
    "Experiment",
    "Goal",
    "Problem",
    "ProblemError",
    "Scenario",
    "Sense",
    "Tie",
    "Uncertain",
    "Variable",
    "Vector",
]
