"""Our engine at the pneumatic loop: the exact path, its elasticities, and the screening of many sets."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from bench.pneumatic_loop import EXACT, GAINS, PER_SI, Gains, Sets, diagram
from engine.analysis.measuring import MetricRequest, measure
from engine.analysis.study import frequency_response, simulate
from engine.batch.screening import Screening
from engine.signals import make

TIMED = ("rise_time", "settling_time", "overshoot", "peak_time")


class Ours:
    """The exact path of this engine: what every number that a user is shown comes from."""

    name = "this engine"
    remark = "curve, 7 metrics, all margins"
    derivation = "of all 7 metrics, exact"

    def __init__(self) -> None:
        self._diagram = diagram()
        self._step = {"reference": make("step", {})}
        self._screening = Screening(self._diagram, [self._request(name) for name in EXACT])

    def metrics(self, gains: Gains) -> dict[str, float]:
        """Simulate, measure and take the margins of one set of gains."""
        overrides = {name: value * PER_SI for name, value in gains.items()}
        step = simulate(
            self._diagram, signals=self._step, overrides=overrides, duration=15.0, samples=1000, metrics=TIMED
        )
        study = frequency_response(
            self._diagram,
            overrides=overrides,
            open_at="error",
            source="reference",
            target="position",
            metrics=["gain_margin", "phase_margin", "bandwidth"],
        )
        found = {**step.metrics["position"], **study.metrics}
        return {name: _number(found[name].value) for name in EXACT}

    def elasticities(self) -> dict[str, list[float]]:
        """Return d ln metric/d ln gain of every metric, exactly."""
        out = {}
        requests = [self._request(name) for name in EXACT]
        for name, (measured, gradient) in zip(
            EXACT, measure(self._diagram, requests, gradient=list(GAINS)), strict=True
        ):
            assert gradient is not None
            at = [self._diagram.parameters[gain].value for gain in GAINS]
            out[name] = [float(g) * p / _number(measured.value) for g, p in zip(gradient.values, at, strict=True)]
        return out

    def rise_elasticities(self) -> list[float]:
        """Return the elasticities of the rise time; those of the other six metrics come with them."""
        return self.elasticities()["rise_time"]

    def many(self, sets: Sets) -> dict[str, npt.NDArray[np.float64]]:
        """Screen many sets of gains, as an optimiser does: metric -> (sets,)."""
        found = self._screening({name: column * PER_SI for name, column in sets.items()})
        return dict(zip(EXACT, found.values.T, strict=True))

    def _request(self, metric: str) -> MetricRequest:
        if metric.endswith("margin"):
            return MetricRequest(metric=metric, open_at="error")
        if metric == "bandwidth":
            return MetricRequest(metric=metric, source="reference", target="position")
        return MetricRequest(metric=metric, signals=self._step, output="position")


def _number(value: float | None) -> float:
    assert value is not None  # the loop is stable, every metric exists
    return value
