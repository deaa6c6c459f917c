"""The search for the unknown parameters, and everything that is said about its result."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from engine.recordings.fit import Fit, baselines, compare, examine_residuals
from optimizers.estimation.confidence import correlations, covariance
from optimizers.estimation.noise import fitted
from optimizers.identification import words
from optimizers.identification.answers import Answer, Samples
from optimizers.identification.beginning import begun_moving
from optimizers.identification.comparison import Comparison, Nuisance
from optimizers.identification.doubts import as_likely, doubted_responses, doubts, undecided
from optimizers.identification.plausible import Pairs, implausible, joined
from optimizers.identification.result import BetweenTried, Estimate, Fits, Identified, Judged
from optimizers.identification.search import Search
from optimizers.identification.starts import first_start
from optimizers.identification.ways import Tried, tried_ways
from optimizers.recorded.recorded_data import doubted_data, doubted_samples
from optimizers.search.result import Monitor, Unwatched

if TYPE_CHECKING:
    from optimizers.recorded.recording import Identification, RecordedExperiment, Unknown, Window

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
    tried = tried_ways(problem, monitor or Unwatched(), rng)
    best = tried[0]
    search, found, status = best.search, best.found, best.status
    unknowns, count = problem.unknowns, len(problem.unknowns)
    start = np.pad(first_start(problem), (0, search.coordinates - count))
    x = start if found is None else found.x
    with search.workers():
        shown = [] if found is None else _shown(search, x)
        responses = () if found is None else tuple(r.judged(search.values(x)) for r in search.responses)
        doubted = () if found is None or search.stopped else implausible(
            unknowns, x, _pairs(search, _shown(search, start), start), _pairs(search, shown, x)
        )  # fmt: skip
    cov = None if found is None else covariance(*search.blocks(found))
    said = () if cov is None or found is None else words.sentences(unknowns, x, cov, found.jacobian)
    unheard = () if found is None else words.silent(unknowns, found.jacobian, x)
    judged = tuple(s.judged() for s in shown) or tuple(_unjudged(e) for e in problem.experiments)
    validating = any(c.experiment.windows[1] is not None for c in search.comparisons)
    estimates = _estimates(unknowns, x, cov, unheard)
    return Identified(
        parameters=_reaching(estimates, tried),
        correlations=np.eye(count) if cov is None else correlations(cov)[:count, :count],
        indistinguishable=said,
        estimation=_pooled((s.pairs(s.estimation) for s in shown), compare),
        validation=_pooled((s.pairs(s.validation) for s in shown), compare),
        one_step=_pooled((s.predicted(s.judging(validating=validating)) for s in shown), compare),
        baselines=_trivial(problem, validating=validating),
        experiments=judged,
        status=status,
        advice=words.advice(status, unknowns, x, said),
        evaluations=max(one.search.evaluations for one in tried),
        seconds=time.perf_counter() - began,
        between_samples=best.way,
        between_tried={one.way: _tried(one) for one in tried if one.way is not None},
        warnings=(
            *(sentence for e in problem.experiments for sentence in doubted_data(e)),
            *doubted,
            *(sentence for one in shown for sentence in one.apart()),
            *(() if found is None else begun_moving(search.problem, search.values(x))),
            *doubts(judged, [tuple(e.recording.inputs) for e in _seen(search, shown)]),
            *doubted_responses(problem.frequency, responses),
            *undecided(tried, estimates),
        ),
        responses=responses or tuple({} for _ in problem.frequency),
    )


def _estimates(
    unknowns: Sequence[Unknown], x: Samples, cov: Samples | None, unheard: Sequence[int]
) -> dict[str, Estimate]:
    """Return the parameters with their intervals."""
    return {
        u.parameter: words.estimate(u, float(x[i]), None if cov is None or i in unheard else math.sqrt(cov[i, i]))
        for i, u in enumerate(unknowns)
    }


def _reaching(estimates: Mapping[str, Estimate], tried: Sequence[Tried]) -> dict[str, Estimate]:
    """Return the estimates of the best way between the samples, their intervals over those of all ways that fit about as well."""
    found = dict(estimates)
    for one in tried[1:]:
        if one.found is None or not as_likely(tried[0], one):
            continue
        unknowns = one.search.problem.unknowns
        unheard = words.silent(unknowns, one.found.jacobian, one.found.x)
        other = _estimates(unknowns, one.found.x, covariance(*one.search.blocks(one.found)), unheard)
        found = {
            name: replace(
                own,
                lower95=_outer(min, own.lower95, other[name].lower95),
                upper95=_outer(max, own.upper95, other[name].upper95),
            )
            for name, own in found.items()
        }
    return found


def _outer(of: Callable[[float, float], float], own: float | None, other: float | None) -> float | None:
    return None if own is None or other is None else of(own, other)


def _tried(one: Tried) -> BetweenTried:
    if one.found is None:
        return BetweenTried(fit_percent=None, values=None)
    fit = 100.0 * (1.0 - math.sqrt(2.0 * one.found.cost))
    return BetweenTried(fit_percent=fit, values=one.search.values(one.found.x))


def _seen(search: Search, shown: Sequence[_Shown]) -> Sequence[RecordedExperiment]:
    return [s.experiment for s in shown] or search.problem.experiments


def _shown(search: Search, x: Samples) -> list[_Shown]:
    """Return the experiments beside the model at coordinates, those that have an answer."""
    answers = zip(search.comparisons, search.answers(x), strict=True)
    return [_Shown(comparison, *answer) for comparison, answer in answers if answer is not None]


def _pairs(search: Search, shown: Sequence[_Shown], x: Samples) -> Pairs:
    """Return measured and simulated signals of everything that estimates."""
    values = search.values(x)
    recorded = ((one.experiment.name, one.pairs(one.estimation)) for one in shown)
    return joined((*recorded, *((one.experiment.name, one.pairs(values)) for one in search.responses)))


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

    def apart(self) -> tuple[str, ...]:
        """Return a sentence on each output with outliers."""
        where = f" in {self.experiment.name}" if self.experiment.name else ""
        pairs = self.pairs(self.estimation).items()
        return tuple(said for name, pair in pairs for said in doubted_samples(*pair, f"{name}{where}"))

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
