"""The batch job of the benchmark: a position loop with an inner velocity loop, 5 parameters, 10 results of each candidate.

PD2 controller with filter, second-order valve, integrating plant of third order, sensor lag: 8 states, two loops. The tenth
result is stability, which a screening says of every candidate.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import numpy.typing as npt

from api.convert.systems import diagram_from_wire
from api.schemas.systems import SystemDocument
from engine.analysis.study import MetricRequest
from engine.diagram.diagram import Diagram
from engine.model.metric_options import Options
from engine.signals import make

Real = npt.NDArray[np.float64]

DOCUMENT = Path(__file__).parent / "systems" / "inner_velocity_loop.json"
PARAMETERS = ("kp", "td1", "td2", "tf", "kv")
EIGHT = (*PARAMETERS, "valve_frequency", "valve_damping", "sensor_lag")
DURATION = 1.0
SAMPLES = 1000
FREQUENCIES = np.logspace(-1, 4, 200)
CUT = "sensor"
_PIECE = 65_536
EXACT = {
    "rise_time": 0.13307075530735678635,
    "settling_time": 0.27478663695953765281,
    "overshoot": 0.0047012940462144259809,
    "max_acceleration": 1529.1234919548290839,
    "steady_state_error": 0.0,
    "gain_margin": 8.0172894389445014449,
    "phase_margin": 1.4590455425279290479,
    "sensitivity_peak": 1.2754447367274674465,
    "bandwidth": 16.730277816895946714,
    "stable": 1.0,
}
"""At the document's values, computed with mpmath at 50 digits: partial fractions of the closed loop, and the loop itself."""


def diagram() -> Diagram:
    """Return the loop, read from its document."""
    return diagram_from_wire(SystemDocument.model_validate_json(DOCUMENT.read_text()))


def with_eight_parameters() -> Diagram:
    """Return the same loop, its valve and its sensor with parameters as well: :data:`EIGHT`."""
    document = json.loads(DOCUMENT.read_text())
    document["parameters"] |= {
        "valve_frequency": {"value": 300.0, "unit": "rad/s"},
        "valve_damping": {"value": 0.7},
        "sensor_lag": {"value": 0.002, "unit": "s"},
    }
    squared = "=valve_frequency**2"
    denominator = [1.0, "=2*valve_damping*valve_frequency", squared]
    document["blocks"]["valve"] |= {"numerator": [squared], "denominator": denominator}
    document["blocks"]["sensor"] |= {"denominator": ["=sensor_lag", 1.0]}
    return diagram_from_wire(SystemDocument.model_validate(document))


def requests() -> list[MetricRequest]:
    """Return the nine metrics: of a unit step, of the loop cut at the sensor, and of the closed path."""
    step = {"reference": make("step", {})}
    timed = [("rise_time", "position"), ("settling_time", "position"), ("overshoot", "position")]
    timed += [("max_acceleration", "acceleration"), ("steady_state_error", "position")]
    return [
        *(
            MetricRequest(metric=metric, signals=step, output=output, options=Options(derivative=0))
            for metric, output in timed
        ),
        *(MetricRequest(metric=metric, open_at=CUT) for metric in ("gain_margin", "phase_margin", "sensitivity_peak")),
        MetricRequest(metric="bandwidth", source="reference", target="position"),
    ]


def sample(count: int, seed: int) -> dict[str, Real]:
    """Return candidates near the document's values, each parameter times exp(-0.4) to exp(0.4): almost all are stable."""
    return _around(0.4, count, seed)


def wide(count: int, seed: int) -> dict[str, Real]:
    """Return candidates far around the document's values, each parameter times exp(-1.5) to exp(1.5): 21 % are unstable."""
    return _around(1.5, count, seed)


def _around(spread: float, count: int, seed: int) -> dict[str, Real]:
    declared = diagram().parameters
    nominal = np.array([declared[name].value for name in PARAMETERS])
    random = np.random.default_rng(seed)
    candidates = np.empty((len(PARAMETERS), count))
    # piece by piece: a million candidates are not to stand in memory several times
    for first in range(0, count, _PIECE):
        piece = candidates[:, first : first + _PIECE]
        np.exp(random.uniform(-spread, spread, piece.shape[::-1]).T, out=piece)
        piece *= nominal[:, None]
    return dict(zip(PARAMETERS, candidates, strict=True))
