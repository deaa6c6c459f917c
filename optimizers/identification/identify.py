"""The search for the unknown parameters, and everything that is said about its result."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from engine.fit import Fit, baselines, compare, examine_residuals
from optimizers.confidence import correlations, covariance
from optimizers.identification import words
from optimizers.identification.answers import Answer, Samples
from optimizers.identification.comparison import Comparison, Nuisance
from optimizers.identification.result import Fits, Identified, Judged
from optimizers.identification.search import CancelledError, Search
from optimizers.limits import Limited
from optimizers.methods.least_squares import Minimum, Reached, minimize_squares
from optimizers.noise import fitted
from optimizers.result import Keeper, Monitor, Status, Unwatched, kept_by

if TYPE_CHECKING:
    from optimizers.recording import Identification, RecordedExperiment, Unknown, Window

LEAST_GAIN = 1e-7
"""A parameter that moves by its standard deviation changes the cost by 1/samples: far more than this."""
_KIND = "identification"
"""Of the states that a search keeps."""
BASELINES = ("mean", "input", "static_gain")


def identify(problem: Identification, *, rng: np.random.Generator, monitor: Monitor | None = None) -> Identified:
    """Estimate the unknown parameters.

    Parameters
    ----------
    problem : Identification
    rng : numpy.random.Generator
        Chooses the starts after the first.
    monitor : Monitor, optional

    Returns
    -------
    Identified
        Always: a search that failed says so in ``status`` and ``advice``.
    """
    began = time.perf_counter()
    search = Search(problem, monitor or Unwatched())
    with search.workers():
        found, status = _searched(search, rng)
        x = _first(search) if found is None else found.x
        answers = [None] * len(search.comparisons) if found is None else search.answers(x)
    shown = [_Shown(c, *answer) for c, answer in zip(search.comparisons, answers, strict=True) if answer is not None]
    cov = None if found is None else covariance(*search.blocks(found))
    unknowns, count = problem.unknowns, len(problem.unknowns)
    said = () if cov is None or found is None else words.sentences(unknowns, x, cov, found.jacobian)
    unheard = () if found is None else words.silent(unknowns, found.jacobian, x)
    validating = any(c.experiment.windows[1] is not None for c in search.comparisons)
    return Identified(
        parameters={
            u.parameter: words.estimate(u, float(x[i]), None if cov is None or i in unheard else math.sqrt(cov[i, i]))
            for i, u in enumerate(unknowns)
        },
        correlations=np.eye(count) if cov is None else correlations(cov)[:count, :count],
        indistinguishable=said,
        estimation=_pooled((s.pairs(s.estimation) for s in shown), compare),
        validation=_pooled((s.pairs(s.validation) for s in shown), compare),
        one_step=_pooled((s.predicted(s.judging(validating=validating)) for s in shown), compare),
        baselines=_trivial(problem, validating=validating),
        experiments=tuple(s.judged() for s in shown) or tuple(_unjudged(e) for e in problem.experiments),
        status=status,
        advice=words.advice(status, unknowns, x, said),
        evaluations=search.evaluations,
        seconds=time.perf_counter() - began,
    )


def _searched(search: Search, rng: np.random.Generator) -> tuple[Minimum | None, Status]:
    """Return the best minimum and how the search ended."""
    unknowns = search.problem.unknowns
    free = np.full(search.coordinates - search.parameters, np.inf)
    lower = np.append([u.coordinate(u.lower) for u in unknowns], -free)
    upper = np.append([u.coordinate(u.upper) for u in unknowns], free)
    further = (np.append(_elsewhere(unknowns, rng), 0 * np.isinf(free)) for _ in range(search.problem.starts - 1))
    starts = np.array([_first(search), *further])
    keeper = search.monitor if isinstance(search.monitor, Keeper) else None

    def tell(reached: Reached) -> None:
        if keeper is not None:
            keeper.keep({"kind": _KIND, "evaluations": search.evaluations, **asdict(reached)})

    kept = dict(kept_by(search.monitor, _KIND) or {})
    if kept:
        search.evaluations = int(kept.pop("evaluations"))
    try:
        found = minimize_squares(
            search.errors, starts, lower=lower, upper=upper, max_evaluations=search.problem.max_evaluations,
            least_gain=LEAST_GAIN, reached=_reached(kept), tell=tell,
        )  # fmt: skip
    except CancelledError:
        over = isinstance(search.monitor, Limited) and search.monitor.over
        return search.best, Status.BUDGET if over else Status.CANCELLED
    if found is None:
        return None, Status.STALLED
    return found, Status.CONVERGED if found.converged else Status.BUDGET


def _reached(kept: Mapping[str, Any]) -> Reached | None:
    """Return how far an earlier run of the search got, None for the first one."""
    if not kept:
        return None
    here, best = kept["here"], kept["best"]
    return Reached(
        start=int(kept["start"]),
        here=None if here is None else tuple(here),
        spent=int(kept["spent"]),
        best=None if best is None else tuple(best),
        converged=bool(kept["converged"]),
    )


def _first(search: Search) -> Samples:
    """Return the coordinates of the given start; initial states begin at rest."""
    given = [unknown.coordinate(unknown.start) for unknown in search.problem.unknowns]
    return np.append(given, np.zeros(search.coordinates - search.parameters))


def _elsewhere(unknowns: tuple[Unknown, ...], rng: np.random.Generator) -> Samples:
    """Return a random start: anywhere within finite bounds, else within a decade of the given start."""
    x = []
    for unknown in unknowns:
        if math.isfinite(unknown.lower) and math.isfinite(unknown.upper):
            low, high = unknown.coordinate(unknown.lower), unknown.coordinate(unknown.upper)
            x.append(float(rng.uniform(low, high)))
        else:
            value = (unknown.start or 1.0) * 10 ** float(rng.uniform(-1, 1))
            x.append(unknown.coordinate(min(max(value, unknown.lower), unknown.upper)))
    return np.array(x)


Pairs = Mapping[str, tuple[Samples, Samples]]
"""Measured and simulated signals by output."""


class _Shown:
    """One experiment beside the final model."""

    def __init__(self, comparison: Comparison, answer: Answer, deviation: Samples) -> None:
        self._comparison = comparison
        self.experiment = comparison.experiment
        self.estimation, self.validation = self.experiment.windows
        self._nuisance: Nuisance = comparison.nuisance(answer, deviation)
        self._simulated = comparison.simulated(answer, self._nuisance)
        self._names = tuple(self.experiment.recording.outputs)

    def judging(self, *, validating: bool) -> Window | None:
        """Return the window that judges the model: the one for validation wherever there is one at all."""
        return self.validation if validating else self.estimation

    def pairs(self, window: Window | None) -> Pairs:
        """Return measured and simulated signals in a window."""
        if window is None:
            return {}
        part = self._comparison.part(window)
        rows = zip(self._names, self._comparison.measured, self._simulated, strict=True)
        return {name: (y[part], model[part]) for name, y, model in rows}

    def predicted(self, window: Window | None) -> Pairs:
        """Return measured signals and their one-step predictions in a window."""
        found = {}
        own = self.pairs(self.estimation or window)
        for name, (measured, simulated) in self.pairs(window).items():
            noise = fitted(own[name][0] - own[name][1])
            found[name] = (measured, measured - noise.innovations(measured - simulated))
        return found

    def judged(self) -> Judged:
        """Return what is said about this experiment alone."""
        recording = self.experiment.recording
        part = self._comparison.part(self.estimation) if self.estimation is not None else slice(0, 0)
        inputs = np.array([signal[part] for signal in recording.inputs.values()]).reshape(len(recording.inputs), -1)
        return Judged(
            name=self.experiment.name,
            offsets=dict(zip(self._names, self._nuisance.offsets.tolist(), strict=False)),
            initial_state=self._nuisance.state,
            estimation=_compared(self.pairs(self.estimation)),
            validation=_compared(self.pairs(self.validation)),
            one_step=_compared(self.predicted(self.validation or self.estimation)),
            residuals={
                name: examine_residuals(measured - simulated, inputs)
                for name, (measured, simulated) in self.pairs(self.estimation).items()
            },
        )


def _unjudged(experiment: RecordedExperiment) -> Judged:
    return Judged(
        name=experiment.name, offsets={}, initial_state=np.zeros(0), estimation={}, validation={}, one_step={}, residuals={}
    )  # fmt: skip


def _compared(pairs: Pairs) -> Fits:
    return {name: compare(*pair) for name, pair in pairs.items()}


def _pooled(parts: Iterable[Pairs], of: Callable[[Samples, Samples], Fit]) -> Fits:
    """Return the fits over all experiments together, output by output."""
    joined: dict[str, list[tuple[Samples, Samples]]] = {}
    for part in parts:
        for name, pair in part.items():
            joined.setdefault(name, []).append(pair)
    return {
        name: of(*(np.concatenate(signals) for signals in zip(*pairs, strict=True))) for name, pairs in joined.items()
    }


def _trivial(problem: Identification, *, validating: bool) -> Mapping[str, Fits]:
    """Return what models without dynamics reach, output by output."""
    judged: dict[str, list[tuple[Samples, Samples]]] = {}
    recorded = dict.fromkeys(name for experiment in problem.experiments for name in experiment.recording.inputs)
    for experiment in problem.experiments:
        estimation, validation = experiment.windows
        window = validation if validating else estimation
        recording = experiment.recording
        if window is not None:
            part = recording.within(window)
            silence = np.zeros(recording.samples)
            inputs = np.array([recording.inputs.get(name, silence)[part] for name in recorded])
            for name, measured in recording.outputs.items():
                judged.setdefault(name, []).append((measured[part], inputs))
    found = {
        name: baselines(
            np.concatenate([measured for measured, _ in parts]),
            np.concatenate([inputs for _, inputs in parts], axis=1),
            constant=problem.offsets,
        )
        for name, parts in judged.items()
    }
    return {kind: {name: fits[kind] for name, fits in found.items()} for kind in BASELINES}
