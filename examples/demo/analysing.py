"""Steps d, e: the dynamic behaviour in numbers, in every scenario, and which parameter moves which number how much."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import servotune
from examples.demo.findings import Behaviour, Estimate
from examples.demo.systems import CONSTRUCTIVE, STEP, position_loop
from servotune.replies import Influence

STEP_METRICS = {
    "position": ("rise_time", "response_time", "settling_time", "overshoot"),
    "velocity": ("max_velocity",),
    "acceleration": ("max_acceleration",),
    "control": ("control_effort",),
}
LOOP_METRICS = ("bandwidth", "sensitivity_peak", "gain_margin", "phase_margin", "delay_margin")
INFLUENCED = {
    "position": (
        "response_time",
        "overshoot",
        "bandwidth",
        "critical_frequency",
        "sensitivity_peak",
        "gain_margin",
        "phase_margin",
        "delay_margin",
    ),
    "velocity": ("max_velocity",),
    "acceleration": ("max_acceleration",),
}
"""Which metrics are asked of which output; the metrics of the loop belong to none and come with the first."""
CHANGE = 0.1
"""The finite relative change of eq. (4)."""


def behaviour(
    client: servotune.Client, law: str, values: Mapping[str, float], scenarios: Sequence[Estimate]
) -> Behaviour:
    """Step d: simulate the step and compute the frequency responses of a law in every scenario."""
    document = position_loop(law)
    variants = [scenario.scenario | dict(values) for scenario in scenarios]
    metrics = sorted({metric for names in STEP_METRICS.values() for metric in names})
    steps = client.simulate(
        document,
        input={"port": "reference", "signal": STEP},
        outputs=list(STEP_METRICS),
        duration=0.2,
        samples=1001,
        metrics=metrics,
        variants=variants,
    )
    loops = client.frequency_response(
        document,
        from_="reference",
        to="position",
        open_at="controller",
        metrics=LOOP_METRICS,
        variants=variants,
    )
    return Behaviour(law=law, values=values, steps=steps, loops=loops)


def metric(of: Behaviour, name: str, scenario: int) -> dict[str, Any]:
    """Return a metric as the service measured it in a scenario."""
    if name in LOOP_METRICS:
        return dict(of.loops["variants"][scenario]["metrics"][name])
    output = next(output for output, names in STEP_METRICS.items() if name in names)
    return dict(of.steps["variants"][scenario]["metrics"][output][name])


def influence(client: servotune.Client, law: str, base: Estimate) -> Influence:
    """Step e: elasticities and influence coefficients of the metrics in every parameter of machine and control law."""
    document = position_loop(law)
    for path, value in base.scenario.items():
        block, _, name = path.partition(".")
        document["blocks"][block][name] = value
    asked: dict[str, Any] = {
        "input": "reference",
        "parameters": [*CONSTRUCTIVE, "controller.kp"],
        "change": CHANGE,
        "signal": STEP,
    }
    return _joined(
        [
            client.influence(document, output=output, metrics=metrics, open_at="controller", **asked)
            for output, metrics in INFLUENCED.items()
        ]
    )


def parameters(study: Influence) -> list[str]:
    """Return the parameters of a study: its rows."""
    return list(next(iter(study["elasticities"].values())))


def existing(study: Influence) -> list[str]:
    """Return the metrics that have an elasticity at all: one that is 0 has no relative change."""
    return [name for name, row in study["elasticities"].items() if any(e["value"] is not None for e in row.values())]


def _joined(parts: Sequence[Influence]) -> Influence:
    """Join studies of the same parameters on several outputs, and find the strongest of each row and column again."""
    elasticities = {name: row for part in parts for name, row in part["elasticities"].items()}
    strongest: dict[str, tuple[float, str]] = {}
    for name, row in elasticities.items():
        for parameter, entry in row.items():
            size = abs(entry["value"] or 0.0)
            if size > strongest.get(parameter, (0.0, ""))[0]:
                strongest[parameter] = (size, name)
    return {
        "base": {metric: entry for part in parts for metric, entry in part["base"].items()},
        "elasticities": elasticities,
        "coefficients": {metric: row for part in parts for metric, row in part["coefficients"].items()},
        "strongest": {
            "by_parameter": {parameter: name for parameter, (_, name) in strongest.items()},
            "by_metric": {name: lever for part in parts for name, lever in part["strongest"]["by_metric"].items()},
        },
    }
