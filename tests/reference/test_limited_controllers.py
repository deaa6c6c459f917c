"""Controllers with limits and anti-windup beside an integration of their own, mode by mode, with scipy's events.

Plant 1/(s² + 1.2 s + 0.3), PID with a filtered derivative; the reference jumps to 3, climbs to 4 and later falls to 1, so that
both limits are reached. At a limit v is beyond it, or, with clamping, kept on it where integrating drives it out and not
integrating brings it back: then I' = -(v' without I').
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from engine.analysis.influence import influence
from engine.analysis.measuring import MetricRequest
from engine.analysis.study import simulate
from engine.diagram.diagram import Diagram, compile_system
from engine.signals import make
from tests.unit.engine.diagrams import block, document

KP, KI, KD, W = 2.0, 3.0, 0.4, 50.0
LOWER, UPPER, T_T = -1.0, 1.5, 0.4
TIME, HEIGHT = [0.0, 1.0, 6.0, 7.0], [3.0, 4.0, 4.0, 1.0]
END = 14.0
SIGNAL = make("piecewise_linear", {"time": TIME, "values": HEIGHT})


GAINS = {"p": {"kp": KP}, "i": {"ki": KI}, "d": {"kd": KD, "filter_frequency": W}}
WIRES = ["r -> error.in1", "plant -> error.in2", "law -> plant"]


def blocks(kind: str = "pid", **law: Any) -> dict[str, Any]:
    gains = {name: value for part in kind for name, value in GAINS[part].items()}
    return {
        "r": block("input"),
        "error": block("sum", signs="+-"),
        "law": block(kind, **gains, **law),
        "plant": block("transfer_function", numerator=[1.0], denominator=[1.0, 1.2, 0.3]),
    }


def loop(kind: str = "pid", **law: Any) -> Diagram:
    return compile_system(document(blocks(kind, **law), [*WIRES, "error -> law"], {"y": "plant", "u": "law"}))


@dataclass
class ByHand:
    """The loop with states (y, y', I, x_d), mode by mode: 0 free, ±1 beyond a limit, ±2 there and stopped, ±3 on the limit."""

    anti_windup: str
    tracking_time: float = T_T

    def reference(self, t: float) -> tuple[float, float]:
        k = min(int(np.searchsorted(TIME, t, side="right")) - 1, len(TIME) - 2)
        if t >= TIME[-1]:
            return HEIGHT[-1], 0.0
        slope = (HEIGHT[k + 1] - HEIGHT[k]) / (TIME[k + 1] - TIME[k])
        return HEIGHT[k] + slope * (t - TIME[k]), slope

    def wanted(self, t: float, s: np.ndarray) -> tuple[float, float, float]:
        """Return v, v' without the integral part, and ki e."""
        r, slope = self.reference(t)
        e, moved = r - s[0], slope - s[1]
        filtered = W * (e - s[3])
        return KP * e + s[2] + KD * filtered, KP * moved + KD * W * (moved - filtered), KI * e

    def rates(self, mode: int) -> Callable[[float, np.ndarray], list[float]]:
        def f(t: float, s: np.ndarray) -> list[float]:
            v, drift, driven = self.wanted(t, s)
            u = v if mode == 0 else UPPER if mode > 0 else LOWER
            integral = {2: 0.0, 3: -drift}.get(abs(mode), driven)
            if self.anti_windup == "back_calculation":
                integral += (u - v) / self.tracking_time
            return [s[1], u - 1.2 * s[1] - 0.3 * s[0], integral, W * (self.reference(t)[0] - s[0] - s[3])]

        return f

    def ends(self, mode: int) -> list[Callable[[float, np.ndarray], float]]:
        """Return what ends a mode as it rises through 0."""
        side = 1 if mode > 0 else -1
        limit = UPPER if mode > 0 else LOWER

        def back(t: float, s: np.ndarray) -> float:
            return -side * (self.wanted(t, s)[0] - limit)

        def turned(t: float, s: np.ndarray) -> float:
            return side * self.wanted(t, s)[2] * (1 if abs(mode) == 1 else -1)

        def in_again(t: float, s: np.ndarray) -> float:
            _, drift, driven = self.wanted(t, s)
            return -side * (drift + driven)

        def out_again(t: float, s: np.ndarray) -> float:
            return side * self.wanted(t, s)[1]

        if mode == 0:
            return [lambda t, s: self.wanted(t, s)[0] - UPPER, lambda t, s: LOWER - self.wanted(t, s)[0]]
        if abs(mode) == 3:
            return [in_again, out_again]
        return [back, turned] if self.anti_windup == "clamping" else [back]

    def follows(self, mode: int, t: float, s: np.ndarray) -> int:
        """Return the mode at an instant at which one has ended, or the reference has jumped."""
        v, drift, driven = self.wanted(t, s)
        for side, limit in ((1, UPPER), (-1, LOWER)):
            away = side * (v - limit)
            if away > 1e-9 or (
                away > -1e-9
                and side * (drift + (0 if self.anti_windup == "clamping" and side * driven > 0 else driven)) > 0
            ):
                return side * (2 if self.anti_windup == "clamping" and side * driven > 0 else 1)
            if self.anti_windup == "clamping" and away > -1e-9 and side * driven > 0 and side * (drift + driven) > 0:
                return side * 3
        return 0

    def pieces(self) -> Iterator[tuple[int, Any]]:
        s = np.zeros(4)
        s[3] = 0.0
        for begin, end in zip(TIME, [*TIME[1:], END], strict=True):
            t = begin
            mode = self.follows(0, t, s)
            while t < end - 1e-12:
                events = self.ends(mode)
                for event in events:
                    event.terminal, event.direction = True, 1.0  # type: ignore[attr-defined]
                found = solve_ivp(
                    self.rates(mode),
                    (t, end - 1e-13),
                    s,
                    "DOP853",
                    dense_output=True,
                    events=events,
                    rtol=1e-12,
                    atol=1e-13,
                    max_step=0.02,
                )
                yield mode, found
                t, s = float(found.t[-1]), found.y[:, -1]
                if found.status == 1:
                    mode = self.follows(mode, t, s)

    def outputs(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, set[int]]:
        y, u, modes = np.zeros_like(times), np.zeros_like(times), set()
        for mode, piece in self.pieces():
            modes.add(mode)
            inside = (times >= piece.t[0]) & (times <= piece.t[-1] + 1e-12)
            if inside.any():
                states = piece.sol(times[inside])
                y[inside] = states[0]
                v = [self.wanted(t, s)[0] for t, s in zip(times[inside], states.T, strict=True)]
                u[inside] = v if mode == 0 else UPPER if mode > 0 else LOWER
        return y, u, modes


@pytest.mark.parametrize("anti_windup", ["none", "clamping", "back_calculation"])
def test_a_loop_with_limits_is_that_of_its_modes(anti_windup):
    law = {"lower": LOWER, "upper": UPPER, "anti_windup": anti_windup}
    if anti_windup == "back_calculation":
        law["tracking_time"] = T_T
    found = simulate(loop(**law), signals={"r": SIGNAL}, duration=END, samples=701)
    y, u, modes = ByHand(anti_windup).outputs(found.time)
    np.testing.assert_allclose(found.curves["y"], y, rtol=0, atol=2e-8)
    np.testing.assert_allclose(found.curves["u"], u, rtol=0, atol=2e-7)
    assert {1, 0, -1}.issubset(np.sign(list(modes)))
    if anti_windup == "clamping":
        assert any(abs(mode) == 3 for mode in modes)


@pytest.mark.parametrize("kind", ["p", "pd", "pi", "pid"])
def test_limits_alone_are_a_saturation_behind_the_law(kind):
    limited = simulate(loop(kind, lower=LOWER, upper=UPPER), signals={"r": SIGNAL}, duration=END, samples=301)
    behind = compile_system(
        document(
            {**blocks(kind), "limit": block("saturation", lower=LOWER, upper=UPPER)},
            [*WIRES[:2], "error -> law", "law -> limit", "limit -> plant"],
            {"y": "plant", "u": "limit"},
        )
    )
    expected = simulate(behind, signals={"r": SIGNAL}, duration=END, samples=301)
    for name in ("y", "u"):
        np.testing.assert_allclose(limited.curves[name], expected.curves[name], rtol=0, atol=1e-9)


def test_tracking_an_actuator_is_back_calculation_outside_the_law():
    found = compile_system(
        document(
            {
                **blocks(anti_windup="tracking", tracking_time=T_T),
                "actuator": block("saturation", lower=LOWER, upper=UPPER),
            },
            [*WIRES[:2], "error -> law.in", "law -> actuator", "actuator -> plant", "actuator -> law.tracking"],
            {"y": "plant"},
        )
    )
    y, _, _ = ByHand("back_calculation").outputs(np.linspace(0.0, END, 301))
    measured = simulate(found, signals={"r": SIGNAL}, duration=END, samples=301)
    np.testing.assert_allclose(measured.curves["y"], y, rtol=0, atol=2e-8)


def test_within_its_limits_a_law_is_the_linear_one():
    wide = simulate(loop(lower=-1e3, upper=1e3, anti_windup="clamping"), signals={"r": SIGNAL}, duration=END)
    plain = simulate(loop(), signals={"r": SIGNAL}, duration=END)
    np.testing.assert_allclose(wide.curves["y"], plain.curves["y"], rtol=0, atol=1e-9)
    assert loop(upper=1.0).nonlinear
    assert not loop().nonlinear


@pytest.mark.parametrize(
    ("anti_windup", "parameters"),
    [
        ("none", ["law.kp", "law.upper"]),
        ("clamping", ["law.kp", "law.ki", "law.upper"]),
        ("back_calculation", ["law.ki", "law.tracking_time", "law.lower"]),
    ],
)
def test_elasticities_are_those_of_differences(anti_windup, parameters):
    law = {"lower": LOWER, "upper": UPPER, "anti_windup": anti_windup}
    if anti_windup == "back_calculation":
        law["tracking_time"] = T_T
    diagram = loop(**law)
    request = MetricRequest(metric="iae", signals={"r": SIGNAL}, output="y", duration=END)
    found = influence(diagram, {"iae": request}, parameters)

    def area(path: str, value: float) -> float:
        made = simulate(
            diagram, signals={"r": SIGNAL}, duration=END, metrics=["iae"], outputs=["y"], overrides={path: value}
        )
        area = made.metrics["y"]["iae"].value
        assert area is not None
        return area

    for path in parameters:
        base = diagram.parameters[path].value

        def slope(step: float, path: str = path, base: float = base) -> float:
            return (area(path, base + step) - area(path, base - step)) / (2 * step)

        step = 1e-4 * abs(base)  # in a wider one an episode at the upper limit comes or goes
        expected = (4 * slope(step / 2) - slope(step)) / 3 * base / area(path, base)
        assert found.elasticities["iae"][path].value == pytest.approx(expected, rel=1e-8), path
