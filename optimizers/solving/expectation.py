"""What share of a population meets the goals: uncertain parameters are drawn, evenly over their ranges on their scales.

    share ± : Wilson's interval of k successes in n draws at 95 %

References
----------
E. B. Wilson, "Probable inference, the law of succession, and statistical inference", J. Am. Stat. Assoc. 22 (1927) 209-212.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from engine.model.interruption import interruptible
from optimizers.evaluation.certificate import TOLERANCE
from optimizers.evaluation.evaluate import UNSTABLE, Evaluator, Matrix
from optimizers.evaluation.spreading import fitting
from optimizers.problem import Problem
from optimizers.problem.turned import turned
from optimizers.search.result import Monitor, Yield

_NORMAL = 1.959963984540054
"""97.5 % quantile of the normal distribution."""
_BLOCK, _FEW = 256, 4
"""Draws of a block; few where each is a simulation."""


class _Enough(Exception):  # noqa: N818 - nothing is wrong, somebody wants no more of it
    """The monitor says that it is enough."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Draws:
    """What became of some draws: how many there were, were good, had no stable system; failures of each hard goal."""

    done: int
    good: int
    unstable: int
    failures: Mapping[int, int]


def expected(
    problem: Problem, best: Mapping[str, float], *, samples: int, rng: np.random.Generator, monitor: Monitor
) -> Yield:
    """Return the yield at given variables: every hard goal must be met in every scenario.

    Parameters
    ----------
    problem : Problem
        With uncertain parameters.
    best : mapping of str to float
        The variables, SI.
    samples : int
    rng : numpy.random.Generator
    monitor : Monitor
        Asked between blocks whether to stop; the yield is then that of the samples so far.
    """
    return together([drawn(problem, best, draws_of(problem, samples=samples, rng=rng), monitor=monitor)])


def draws_of(problem: Problem, *, samples: int, rng: np.random.Generator) -> Matrix:
    """Return the draws (samples, R) in the unit cube of the uncertain parameters."""
    return rng.random((samples, len(problem.ranges)))


def drawn(problem: Problem, best: Mapping[str, float], points: Matrix, *, monitor: Monitor) -> Draws:
    """Return what becomes of some draws (n, R)."""
    evaluator = Evaluator(turned(problem, best))
    block = max(_FEW, evaluator.together) if problem.diagram.nonlinear else _BLOCK
    good = done = unstable = 0
    failures = dict.fromkeys((g for g, goal in enumerate(problem.goals) if goal.hard), 0)

    def go_on() -> None:
        if done and monitor.cancelled():
            raise _Enough

    while done < len(points):
        try:
            with interruptible(go_on):
                go_on()
                size = fitting(evaluator, len(points) - done) or block
                found = evaluator.assess(points[done : done + size])
        except _Enough:
            break
        broken = evaluator.violations(found.values) > TOLERANCE
        good += int((found.violation <= TOLERANCE).sum())
        unstable += int((found.violation >= UNSTABLE).sum())
        for g in failures:
            failures[g] += int(broken[:, :, g].any(axis=1).sum())
        done += len(found.violation)
        monitor.progress(done / len(points), f"{done} of {len(points)} draws")
    return Draws(done=done, good=good, unstable=unstable, failures=failures)


def together(parts: Sequence[Draws]) -> Yield:
    """Return the yield of draws that were counted apart."""
    done, good = sum(part.done for part in parts), sum(part.good for part in parts)
    low, high = wilson(good, done)
    return Yield(
        share=good / done, lower95=low, upper95=high, samples=done, unstable=sum(part.unstable for part in parts),
        failures={goal: sum(part.failures[goal] for part in parts) for goal in parts[0].failures},
    )  # fmt: skip


def wilson(successes: int, draws: int) -> tuple[float, float]:
    """Return Wilson's 95 % interval of a share.

    >>> [round(end, 4) for end in wilson(8, 10)]
    [0.4902, 0.9433]
    """
    share, z2 = successes / draws, _NORMAL**2
    middle = (share + z2 / (2 * draws)) / (1 + z2 / draws)
    half = _NORMAL / (1 + z2 / draws) * math.sqrt(share * (1 - share) / draws + z2 / (4 * draws**2))
    return max(middle - half, 0.0), min(middle + half, 1.0)
