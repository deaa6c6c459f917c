"""The numbers of a candidate are its own, to the bit, alone and among any others: followed, marched, scanned."""

from __future__ import annotations

import numpy as np
import pytest

from bench import coverage, coverage_laws
from engine import signals
from engine.analysis.measuring import MetricRequest
from engine.batch.screening import Screening
from engine.diagram.diagram import Block, Connection, Diagram, System, compile_system

COUNT = 20
STEP = {"reference": signals.make("step", {})}


def candidates(count: int = COUNT) -> dict[str, np.ndarray]:
    """Return gains over decades: their loops have their corners, and so their frequencies, far from one another."""
    rng = np.random.default_rng(5)
    spread = {"pid.kp": (8.0, 1.6), "pid.ki": (2.0, 2.0), "pid.kd": (0.4, 1.5)}
    return {name: middle * 10 ** rng.uniform(-1.0, width - 1.0, count) for name, (middle, width) in spread.items()}


def asked(diagram: Diagram, duration: float | None) -> list[MetricRequest]:
    timed = [
        MetricRequest(metric=name, signals=STEP, output="position", duration=duration)
        for name in ("overshoot", "itae", "settling_time")
    ]
    if diagram.sampled:
        return timed
    loop = [
        MetricRequest(metric=name, open_at="error")
        for name in ("phase_margin", "gain_margin", "delay_margin", "sensitivity_peak")
    ]
    path = [
        MetricRequest(metric=name, source="reference", target="position") for name in ("bandwidth", "resonance_peak")
    ]
    return [*timed, *loop, *path]


def elastic() -> Diagram:
    """Return a position loop over a motor that swings lightly on a spring, so that responses ripple."""
    wires = [("reference", "error.in1"), ("motor", "error.in2"), ("error", "pid"), ("pid", "motor"), ("motor", "arm")]
    motor = {"numerator": [4.0], "denominator": [0.1, 1.0, 0.0]}
    return compile_system(
        System(
            name="axis",
            parameters={},
            blocks={
                "reference": Block(kind="input", values={}),
                "error": Block(kind="sum", values={"signs": "+-"}),
                "pid": Block(kind="pid", values={"kp": 8.0, "ki": 2.0, "kd": 0.4, "filter_frequency": 1e3}),
                "motor": Block(kind="transfer_function", values=motor),
                "arm": Block(kind="transfer_function", values={"numerator": [3600.0], "denominator": [1.0, 0.48, 3600.0]}),
            },
            connections=tuple(Connection(source=source, target=target) for source, target in wires),
            outputs={"position": "motor", "tip": "arm"},
        )
    )  # fmt: skip


def same(diagram: Diagram, requests: list[MetricRequest], points: dict[str, np.ndarray]) -> np.ndarray:
    """Ask for candidates together, in another order, in part and one by one; return which numbers are vouched for."""
    screening = Screening(diagram, requests)
    whole = screening(points)
    count = len(whole.valid)
    order = np.random.default_rng(1).permutation(count)
    for pick in (order, order[:9], *(np.array([k]) for k in order[:20]), np.array([count - 1, 3, 3, 17])):
        part = screening({name: column[pick] for name, column in points.items()})
        np.testing.assert_array_equal(part.doubtful, whole.doubtful[pick])
        known = ~part.doubtful
        np.testing.assert_array_equal(part.values[known], whole.values[pick][known])
        np.testing.assert_array_equal(part.growth >= 0, whole.growth[pick] >= 0)
    return ~whole.doubtful


LAWS = [
    (kind, delay) for kind in ("saturation", "backlash", "friction", "rate_limiter", "relay") for delay in (0.0, 1e-3)
]


@pytest.mark.parametrize(
    ("diagram", "duration"),
    [
        pytest.param(coverage.diagram(1e-3), None, id="delay"),
        pytest.param(coverage_laws.loop("zero_order_hold", 1e-3), 1.0, id="zero_order_hold"),
        *(pytest.param(coverage_laws.loop(kind, delay), 1.0, id=f"{kind}-{delay}") for kind, delay in LAWS),
    ],
)
def test_a_number_is_the_same_to_the_bit_whoever_is_beside(diagram, duration) -> None:
    known = same(diagram, asked(diagram, duration), candidates())
    assert known.any() or diagram.nonlinear


def test_whatever_is_asked_of_a_linear_loop() -> None:
    requests = [request for _, request in coverage.requests()]
    assert same(coverage.diagram(), requests, candidates(60)).mean() > 0.8


@pytest.mark.parametrize("output", ["position", "tip"])
def test_responses_that_ripple(output) -> None:
    """Some are looked at many times as closely as others, who keep what they have."""
    requests = [
        MetricRequest(metric=name, signals=STEP, output=output)
        for name in ("overshoot", "settling_time", "rise_time", "peak_time", "undershoot")
    ]
    assert same(elastic(), requests, candidates(200)).mean() > 0.5


def test_gains_of_exactly_zero_beside_others() -> None:
    """Without its integrator a loop has a state less: it is another system, whoever has one."""
    points = candidates(40)
    points["pid.ki"][::3], points["pid.kd"][::5] = 0.0, 0.0
    requests = asked(coverage.diagram(), None)
    assert same(coverage.diagram(1e-3), requests, points).any()
    poles = [MetricRequest(metric=name) for name in ("spectral_abscissa", "damping_ratio", "critical_frequency")]
    known = same(coverage.diagram(), [*requests, *poles], points)
    assert known.mean() > 0.5
    without = (points["pid.ki"] == 0) | (points["pid.kd"] == 0)
    assert known[without, -3:].mean() > 0.5
    assert known[~without, -3:].mean() > 0.5
