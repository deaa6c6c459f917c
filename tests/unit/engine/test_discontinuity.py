"""A metric that is read at a level jumps where a turning point just touches it, one of the highest peak where two are as high.

Its elasticity is then one-sided, and said to be.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

from engine.analysis.influence import influence
from engine.analysis.study import MetricRequest, measure
from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.metrics._loop import rivals
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.reference.systems import unity_loop


def second_order(damping: float) -> Diagram:
    blocks = {
        "u": Block(kind="input", values={}),
        "lag": Block(kind="transfer_function", values={"numerator": [1.0], "denominator": [1.0, "=2*zeta", 1.0]}),
    }
    return compile_system(
        System(
            name="second order",
            parameters={"zeta": Parameter(value=damping)},
            blocks=blocks,
            connections=(Connection(source="u", target="lag"),),
            outputs={"y": "lag"},
        )
    )


REQUEST = {"settling_time": MetricRequest(metric="settling_time", signals={"u": make("step", {})}, output="y")}
TOUCHING = brentq(lambda z: np.exp(-np.pi * z / np.sqrt(1 - z * z)) - 0.02, 0.7, 0.85, xtol=1e-15)
"""Damping at which the overshoot is exactly 2 %: 0.7797."""


def test_settling_time_jumps_at_the_damping_whose_overshoot_is_the_band() -> None:
    # simulation literature: ω t_s = 5.09 at ζ = 0.7795, 3.60 at ζ = 0.7800
    values = [measure(second_order(z), [REQUEST["settling_time"]])[0][0].value for z in (0.7795, 0.7800)]
    assert values == pytest.approx([5.09, 3.60], abs=0.01)


@pytest.mark.parametrize(("damping", "one_sided"), [(TOUCHING, True), (0.7, False), (0.9, False)])
def test_only_at_the_jump_the_elasticity_is_one_sided(damping: float, one_sided: bool) -> None:
    cell = influence(second_order(damping), REQUEST, ["zeta"]).elasticities["settling_time"]["zeta"]
    assert cell.one_sided is one_sided
    assert cell.verdict is (Verdict.DISCONTINUOUS if one_sided else Verdict.OK)
    assert cell.value is not None


def rational(numerator: list[float], denominator: list[float]) -> Diagram:
    blocks = {
        "u": Block(kind="input", values={}),
        "g": Block(
            kind="transfer_function",
            values={"numerator": [f"=k*{c!r}" for c in numerator], "denominator": [*map(float, denominator)]},
        ),
    }
    return compile_system(
        System(
            name="rational",
            parameters={"k": Parameter(value=1.0)},
            blocks=blocks,
            connections=(Connection(source="u", target="g"),),
            outputs={"y": "g"},
        )
    )


def stepped(metric: str) -> MetricRequest:
    return MetricRequest(metric=metric, signals={"u": make("step", {})}, output="y")


def one_sided(diagram: Diagram, request: MetricRequest) -> bool:
    cell = influence(diagram, {"metric": request}, ["k"]).elasticities["metric"]["k"]
    assert (cell.verdict is Verdict.DISCONTINUOUS) is cell.one_sided
    return cell.one_sided


def test_peak_time_jumps_where_two_peaks_are_as_high() -> None:
    # 1 and 3 rad/s: the second hump overtakes the first as the middle coefficient passes this value
    denominator = np.polymul([1.0, 0.15, 1.0], [1.0, 0.3, 9.0]).tolist()
    times = [
        measure(rational([1.0, c, 9.0], denominator), [stepped("peak_time")])[0][0].value for c in (-4.4645, -4.4644)
    ]
    assert times == pytest.approx([3.964, 3.346], abs=2e-3)
    tie = brentq(lambda c: first_peaks(c, denominator), -4.4645, -4.4644, xtol=1e-15)
    assert one_sided(rational([1.0, tie, 9.0], denominator), stepped("peak_time"))
    assert not one_sided(rational([1.0, -4.4645, 9.0], denominator), stepped("peak_time"))


def first_peaks(c: float, denominator: list[float]) -> float:
    """Return by how much the hump at 3.3 s exceeds that at 4.0 s, by partial fractions."""
    poles = np.roots(denominator)
    residues = np.polyval([1.0, c, 9.0], poles) / (np.polyval(np.polyder(denominator), poles) * poles)

    def low(t: float) -> float:
        return -abs(float((9.0 / denominator[-1] + residues @ np.exp(poles * t)).real))

    def summit(a: float, b: float) -> float:
        return float(minimize_scalar(low, bounds=(a, b), method="bounded", options={"xatol": 1e-10}).fun)

    return summit(3.8, 4.1) - summit(3.2, 3.5)


def test_rise_time_jumps_where_the_first_swing_just_reaches_ninety_percent() -> None:
    def mixture(share: float) -> tuple[list[float], list[float]]:
        swing, creep = ([share], [1.0, 0.4, 1.0]), ([1 - share], [20.0, 1.0])
        numerator = np.polyadd(np.polymul(swing[0], creep[1]), np.polymul(creep[0], swing[1]))
        return numerator.tolist(), np.polymul(swing[1], creep[1]).tolist()

    def summit(share: float) -> float:
        turn = np.sqrt(1 - 0.2**2)

        def low(t: float) -> float:
            swing = 1 - np.exp(-0.2 * t) * (np.cos(turn * t) + 0.2 / turn * np.sin(turn * t))
            return -float(share * swing + (1 - share) * (1 - np.exp(-t / 20)))

        return -float(minimize_scalar(low, bounds=(2.5, 4.0), method="bounded", options={"xatol": 1e-10}).fun)

    share = brentq(lambda c: summit(c) - 0.9, 0.3, 0.8, xtol=1e-15)
    assert one_sided(rational(*mixture(share)), stepped("rise_time"))
    assert not one_sided(rational(*mixture(share + 1e-3)), stepped("rise_time"))
    assert not one_sided(rational(*mixture(share - 1e-3)), stepped("rise_time"))


def test_bandwidth_jumps_where_a_notch_just_reaches_its_level() -> None:
    def notched(damping: float) -> tuple[list[float], list[float]]:
        return [1.0, 2 * damping, 1.0], np.polymul([1.0, 2.0, 1.0], [0.01, 0.2, 1.0]).tolist()

    def depth(damping: float) -> float:
        numerator, denominator = notched(damping)

        def size(w: float) -> float:
            return float(abs(np.polyval(numerator, 1j * w) / np.polyval(denominator, 1j * w)))

        return float(minimize_scalar(size, bounds=(0.5, 2.0), method="bounded", options={"xatol": 1e-10}).fun)

    damping = brentq(lambda d: depth(d) - 10**-0.15, 0.1, 1.0, xtol=1e-15)
    path = MetricRequest(metric="bandwidth", source="u", target="y")
    assert one_sided(rational(*notched(damping)), path)
    assert not one_sided(rational(*notched(damping - 1e-3)), path)
    assert not one_sided(rational(*notched(damping + 1e-3)), path)


@pytest.mark.parametrize(("above", "jumps"), [(1e-8, True), (1e-3, False)])
@pytest.mark.parametrize("metric", ["phase_margin", "delay_margin"])
def test_margins_jump_where_the_gain_just_reaches_one(metric: str, above: float, jumps: bool) -> None:
    loop = unity_loop(["=k"], [1.0, 0.2, 1.0], k=0.2 * np.sqrt(1 - 0.1**2) * (1 + above))
    assert one_sided(loop, MetricRequest(metric=metric, open_at="error")) is jumps


def test_a_pole_on_the_axis_is_no_touch() -> None:
    loop = unity_loop(["=k", "=k"], [1.0, 0.1, 1.0, 0.1], k=0.05)  # poles at ±j
    for metric in ("phase_margin", "delay_margin"):
        assert not one_sided(loop, MetricRequest(metric=metric, open_at="error"))


def test_two_margins_are_rivals_on_either_side_only() -> None:
    assert rivals([0.5, -0.5, 2.0])
    assert not rivals([0.5, 0.5, 2.0])
    assert not rivals([0.5, -0.6])
