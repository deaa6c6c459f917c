"""Echoes through delays and direct gains: where they die out, by Σ|g| = 1, and how soon what cannot be followed is refused."""

from __future__ import annotations

import numpy as np
import pytest

from engine.analysis.evaluation import Evaluation
from engine.analysis.study import simulate
from engine.diagram.diagram import Diagram, compile_system
from engine.exact.frequency.neutral import neutral
from engine.model.errors import UnresolvedError
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document


def echoes(*loops: tuple[float, float]) -> Diagram:
    """Return e = r + Σ gain e(t - delay), y = e/(s + 1)."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+" * (len(loops) + 1)),
        "lag": block("transfer_function", numerator=[1.0], denominator=[1.0, 1.0]),
    }  # fmt: skip
    wires = ["r -> e.in1", "e -> lag"]
    for k, (gain, delay) in enumerate(loops):
        blocks |= {f"d{k}": block("delay", time=delay), f"g{k}": block("gain", gain=gain)}
        wires += [f"e -> d{k}", f"d{k} -> g{k}", f"g{k} -> e.in{k + 2}"]
    return compile_system(document(blocks, wires, {"y": "lag"}))


def test_equal_delays_that_cancel_leave_no_echo() -> None:
    for second in (0.3, 0.1 + 0.2):
        poles = Evaluation(echoes((1.5, 0.3), (-1.5, second))).poles
        assert poles.verdict is Verdict.OK
        assert poles.values[0] == pytest.approx(-1.0, rel=1e-12)
    assert Evaluation(echoes((1.5, 0.3), (-1.5, 0.31))).poles.verdict is Verdict.UNSTABLE


def test_equal_delays_count_by_their_sum() -> None:
    assert Evaluation(echoes((1.5, 0.3), (-0.6, 0.3))).poles.verdict is Verdict.OK
    assert Evaluation(echoes((1.5, 0.3), (-0.4, 0.3))).poles.verdict is Verdict.UNSTABLE


@pytest.mark.parametrize("loops", range(2, 7))
def test_delays_of_different_length_count_by_the_sum_of_their_sizes(loops: int) -> None:
    rng = np.random.default_rng(loops)
    gains = rng.normal(size=loops)
    gains /= np.abs(gains).sum()
    delays = rng.uniform(0.1, 1.0, loops)
    assert neutral((1 + 1e-9) * np.tile(gains, (loops, 1)), delays)
    assert not neutral((1 - 1e-9) * np.tile(gains, (loops, 1)), delays)


def test_what_has_died_within_a_delay_is_no_pole() -> None:
    # two echoes of one signal: D22 has rank 1, and far to the left only rounding is left of e^{s τ} beside it
    poles = Evaluation(echoes((0.25, 0.1), (0.25, 0.151))).poles
    assert poles.verdict is Verdict.OK
    for s in poles.values[:8]:
        left = (s + 1) * (1 - 0.25 * np.exp(-s * 0.1) - 0.25 * np.exp(-s * 0.151))
        assert abs(left) < 1e-9


def test_echoes_too_many_to_follow_are_refused_before_they_are_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    followed = []
    monkeypatch.setattr("engine.exact.time.run.Run.step", lambda *_: followed.append(1))
    with pytest.raises(UnresolvedError, match="the echoes of its delays"):
        simulate(echoes((0.45, 0.1), (0.45, 0.1414)), signals={"r": make("step", {})}, outputs=["y"])
    assert not followed
