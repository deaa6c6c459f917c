"""What share of a population meets the goals: uncertain parameters are drawn, evenly over their ranges on their scales.

    share ± : Wilson's interval of k successes in n draws at 95 %

References
----------
E. B. Wilson, "Probable inference, the law of succession, and statistical inference", J. Am. Stat. Assoc. 22 (1927) 209-212.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from engine.model.interruption import interruptible
from optimizers.evaluation.certificate import TOLERANCE
from optimizers.evaluation.evaluate import UNSTABLE, Evaluator
from optimizers.evaluation.spreading import fitting
from optimizers.problem import Problem
from optimizers.problem.turned import turned
from optimizers.search.result import Keeper, Monitor, Yield, kept_by
from optimizers.search.sampling_plan import sobol_sequence

_NORMAL = 1.959963984540054
"""97.5 % quantile of the normal distribution."""
_KIND: Final = "yield"
"""Of the states that are kept."""
_BLOCK, _FEW = 256, 4
"""Draws of a block; few where each is a simulation."""


class _Enough(Exception):  # noqa: N818 - nothing is wrong, somebody wants no more of it
    """The monitor says that it is enough."""


@dataclass(slots=True, kw_only=True)
class _Draws:
    """What became of the draws until here: how many there were, were good, had no stable system; failures of each hard goal."""

    done: int = 0
    good: int = 0
    unstable: int = 0
    failures: dict[int, int]

    def document(self) -> dict[str, Any]:
        """Return it in plain numbers."""
        return {"kind": _KIND, **asdict(self), "failures": list(self.failures.items())}

    @staticmethod
    def of(document: Mapping[str, Any]) -> _Draws:
        """Return what such numbers tell."""
        done, good, unstable = (int(document[name]) for name in ("done", "good", "unstable"))
        failures = {int(goal): int(count) for goal, count in document["failures"]}
        return _Draws(done=done, good=good, unstable=unstable, failures=failures)

    def share(self) -> Yield:
        """Return the yield of these draws."""
        low, high = wilson(self.good, self.done)
        return Yield(
            share=self.good / self.done, lower95=low, upper95=high, samples=self.done, unstable=self.unstable,
            failures=self.failures,
        )  # fmt: skip


def expected(
    problem: Problem, best: Mapping[str, float], *, samples: int, rng: np.random.Generator, monitor: Monitor
) -> Yield:
    """Return the yield at given variables: every hard goal must be met in every scenario.

    Draws fill the ranges evenly, however many there are: shares come nearer to the truth than those of independent draws, whose interval
    is told.

    Parameters
    ----------
    problem : Problem
        With uncertain parameters.
    best : mapping of str to float
        The variables, SI.
    samples : int
    rng : numpy.random.Generator
    monitor : Monitor
        Asked between blocks whether to stop; the yield is then that of the samples so far. One that keeps states keeps where
        the draws are.
    """
    points = sobol_sequence(len(problem.ranges), rng).random_base2((samples - 1).bit_length())[:samples]
    evaluator = Evaluator(turned(problem, best))
    block = max(_FEW, evaluator.together) if problem.diagram.nonlinear else _BLOCK
    draws = _Draws(failures={g: 0 for g, goal in enumerate(problem.goals) if goal.hard})
    kept = kept_by(monitor, _KIND)
    if kept is not None and kept["best"] == best:
        draws = _Draws.of(kept)

    def go_on() -> None:
        if draws.done and monitor.cancelled():
            raise _Enough

    while draws.done < samples:
        try:
            with interruptible(go_on):
                go_on()
                size = fitting(evaluator, samples - draws.done) or block
                found = evaluator.assess(points[draws.done : draws.done + size])
        except _Enough:
            break
        broken = evaluator.violations(found.values) > TOLERANCE
        draws.good += int((found.violation <= TOLERANCE).sum())
        draws.unstable += int((found.violation >= UNSTABLE).sum())
        for g in draws.failures:
            draws.failures[g] += int(broken[:, :, g].any(axis=1).sum())
        draws.done += len(found.violation)
        if isinstance(monitor, Keeper):
            monitor.keep(draws.document() | {"best": dict(best)})
        monitor.progress(draws.done / samples, f"{draws.done} of {samples} draws")
    return draws.share()


def wilson(successes: int, draws: int) -> tuple[float, float]:
    """Return Wilson's 95 % interval of a share.

    >>> [round(end, 4) for end in wilson(8, 10)]
    [0.4902, 0.9433]
    """
    share, z2 = successes / draws, _NORMAL**2
    middle = (share + z2 / (2 * draws)) / (1 + z2 / draws)
    half = _NORMAL / (1 + z2 / draws) * math.sqrt(share * (1 - share) / draws + z2 / (4 * draws**2))
    return max(middle - half, 0.0), min(middle + half, 1.0)
