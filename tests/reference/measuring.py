"""Short ways to ask the engine, and one way to compare."""

from __future__ import annotations

from typing import Any

import pytest

from engine.analysis.study import MetricRequest, frequency_response, measure, simulate
from engine.diagram.diagram import Diagram
from engine.model.verdicts import Verdict
from engine.signals import make

TIME_METRICS = (
    "rise_time",
    "settling_time",
    "response_time",
    "overshoot",
    "undershoot",
    "peak",
    "peak_time",
    "steady_state_error",
)


def step(amplitude: float = 1.0) -> Any:
    return make("step", {"amplitude": amplitude})


def time_metrics(diagram: Diagram, port: str, output: str, metrics: tuple[str, ...], **options: Any) -> dict[str, Any]:
    """Metrics of the unit step response: name -> Measured."""
    done = simulate(diagram, signals={port: step()}, outputs=[output], metrics=list(metrics), **options)
    return dict(done.metrics[output])


def loop_metrics(diagram: Diagram, open_at: str = "error") -> Any:
    """The study of the loop cut at ``open_at``: metrics and all margins."""
    return frequency_response(diagram, open_at=open_at)


def elasticities(diagram: Diagram, request: MetricRequest, parameters: tuple[str, ...]) -> tuple[float, list[float]]:
    """Value and d ln value / d ln p from the engine's exact gradient."""
    ((measured, gradient),) = measure(diagram, [request], gradient=list(parameters))
    assert measured.verdict is Verdict.OK, measured
    assert gradient is not None
    at = [diagram.parameters[name].value for name in parameters]
    return measured.value, [float(g) * p / measured.value for g, p in zip(gradient.values, at, strict=True)]


def expect(measured: Any, value: Any, *, relative: float = 1e-9, absolute: float = 1e-12) -> None:
    """Assert that a metric is there and right; ``absolute`` serves where the exact value is 0."""
    assert measured.verdict is Verdict.OK, measured
    assert measured.value == pytest.approx(float(value), rel=relative, abs=absolute)
