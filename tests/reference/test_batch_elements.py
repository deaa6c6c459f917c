"""Every linear element before a lag, in compiled batches: all its numbers vary, every metric is that of the exact path."""

from __future__ import annotations

import numpy as np
import pytest

import engine.elements
from engine.analysis.study import MetricRequest
from engine.batch.screening import Screening
from engine.elements._nonlinear import NonlinearElement
from engine.model.metric_options import Options
from engine.signals import make
from tests.reference.batch_agreement import compare
from tests.reference.systems import block, system

TIME = ("rise_time", "settling_time", "overshoot", "peak", "max_velocity", "steady_state_error")
ELEMENTS = [
    kind for kind, e in engine.elements.catalogue().items() if not issubclass(e, NonlinearElement) and kind != "input"
]
CANDIDATES = 3


@pytest.mark.parametrize("kind", ELEMENTS)
def test_an_element_before_a_lag(kind: str) -> None:
    element = engine.elements.catalogue()[kind]
    values = {param.name: param.default for param in element.parameters} | dict(element.example)
    varied = {name: value for name, value in values.items() if isinstance(value, float) and value}
    ports = element.ports(values)
    used = block(kind, **{**element.example, **{name: f"=the_{name}" for name in varied}})
    inputs = {f"u{k}": block("input") for k in range(len(ports.inputs))}
    wires = [f"u{k} -> e.{port}" for k, port in enumerate(ports.inputs)]
    rng = np.random.default_rng(3)
    candidates = {f"the_{name}": v * np.exp(rng.uniform(-0.5, 0.5, CANDIDATES)) for name, v in varied.items()}
    if not candidates:
        candidates = {"spare": np.ones(CANDIDATES)}
    lag = block("transfer_function", numerator=[1.0], denominator=[0.01, 1.0])
    for port in ports.outputs:
        diagram = system(
            {**inputs, "e": used, "lag": lag},
            [*wires, f"e.{port} -> lag"],
            {"y": "lag"},
            {f"the_{name}": value for name, value in varied.items()} | {"spare": 1.0},
        )
        requests = [
            MetricRequest(metric=m, signals={"u0": make("step", {})}, output="y", options=Options(derivative=0))
            for m in TIME
        ]
        requests += [MetricRequest(metric="compliance_peak", source="u0", target="y")]
        if kind != "ac_servo_axis":
            # Its acceleration has no static gain, and its slow mode lies so far below the current loop that the curve
            # is not followed to where that shows.
            requests += [MetricRequest(metric="bandwidth", source="u0", target="y")]
        found = compare(diagram, requests, candidates, Screening(diagram, requests)(candidates))
        assert not found.wrong, "\n".join(found.wrong)
