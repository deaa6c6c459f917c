"""Margins, poles and responses of loops with samplers, against a lifted map of the test's own and python-control.

The map is written here with `scipy.linalg.expm` for every stretch between two instants of all rates, and knows nothing of the
engine: the axis' own equations, registers for the computing times, and the loop's factor where the loop is opened.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction

import control
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from engine.analysis.evaluation import Evaluation
from engine.analysis.frequency_study import FrequencyStudy
from engine.analysis.measuring import MetricRequest, measure
from engine.analysis.study import frequency_response, simulate
from engine.diagram.diagram import Diagram, compile_system
from engine.model.errors import UnresolvedError
from engine.model.verdicts import Verdict
from engine.signals import make
from optimizers.problem import Goal, Problem, Sense, Variable
from optimizers.solving.solve import solve
from tests.unit.engine.diagrams import block, document

MS = Fraction(1, 1000)


@dataclass(frozen=True)
class Axis:
    """A two-inertia axis with P position and PI speed control, times in ms as fractions."""

    slow: Fraction
    slow_delay: Fraction
    fast: Fraction
    fast_delay: Fraction
    kv: float
    kp: float
    ki: float
    motor: float = 2e-3
    load: float = 3e-3
    stiffness: float = 2000.0
    damping: float = 0.05
    slow_offset: Fraction = Fraction(0)
    fast_offset: Fraction = Fraction(0)

    @property
    def diagram(self) -> Diagram:
        slow = {
            "sample_time": float(self.slow * MS),
            "delay": float(self.slow_delay * MS),
            "offset": float(self.slow_offset * MS),
        }
        fast = {
            "sample_time": float(self.fast * MS),
            "delay": float(self.fast_delay * MS),
            "offset": float(self.fast_offset * MS),
        }
        return compile_system(
            document(
                {
                    "r": block("input"),
                    "e": block("sum", signs="+-"),
                    "position": block("sampled_pid", kp=self.kv, **slow),
                    "f": block("sum", signs="+-"),
                    "speed": block("sampled_pid", kp=self.kp, ki=self.ki, **fast),
                    "axis": block(
                        "two_inertia",
                        motor_inertia=self.motor,
                        load_inertia=self.load,
                        stiffness=self.stiffness,
                        damping=self.damping,
                    ),
                },
                [
                    "r -> e.in1",
                    "axis.load_angle -> e.in2",
                    "e -> position",
                    "position -> f.in1",
                    "axis.motor_speed -> f.in2",
                    "f -> speed",
                    "speed -> axis.motor_torque",
                ],
                {"y": "axis.load_angle"},
            )
        )

    def map(
        self,
        k_position: complex = 1.0,
        k_speed: complex = 1.0,
        later_position: Fraction = Fraction(0),
        later_speed: Fraction = Fraction(0),
    ) -> np.ndarray:
        """The map over the common period, with factors on both errors and outputs that arrive later, ms.

        States θm, ωm, θl, ωl, then torque, speed command and integral, then what is under way to the command and to the torque.
        """
        m, j, k, d = self.motor, self.load, self.stiffness, self.damping
        ways = ((self.slow, self.slow_delay + later_position), (self.fast, self.fast_delay + later_speed))
        depths = [math.ceil(delay / period) or 1 for period, delay in ways]
        chains = (range(7, 7 + depths[0]), range(7 + depths[0], 7 + sum(depths)))
        size = 7 + sum(depths)
        flow = np.zeros((size, size))
        flow[0, 1] = flow[2, 3] = 1
        flow[1, [0, 1, 2, 3, 4]] = [-k / m, -d / m, k / m, d / m, 1 / m]
        flow[3, [0, 1, 2, 3]] = [k / j, d / j, -k / j, -d / j]
        whole = Fraction(math.lcm(self.slow.numerator * self.fast.denominator, self.fast.numerator * self.slow.denominator),
                         self.slow.denominator * self.fast.denominator)  # fmt: skip
        listed = []
        for number, ((period, delay), offset) in enumerate(
            zip(ways, (self.slow_offset, self.fast_offset), strict=True)
        ):
            for turn in range(int(whole / period)):
                listed.append((offset + turn * period, 1 if number == 0 else 2, number))
                listed.append(((offset + turn * period + delay) % whole, 0 if delay else 3, 2 + number))
        t, found = Fraction(0), np.eye(size, dtype=complex)
        flows: dict[Fraction, np.ndarray] = {}

        def after(width: Fraction) -> np.ndarray:
            if width not in flows:
                flows[width] = expm(flow * float(width * MS))
            return flows[width]

        for at, _, what in sorted(listed):
            found = after(at - t) @ found
            t = at
            jump = np.eye(size, dtype=complex)
            if what > 1:  # the oldest arrives
                jump[5 if what == 2 else 4] = np.eye(size)[chains[what - 2][-1]]
            else:
                for state in chains[what][1:]:
                    jump[state] = np.eye(size)[state - 1]
                jump[chains[what][0]] = 0
            if what == 0:
                jump[chains[0][0], 2] = -self.kv * k_position
            elif what == 1:
                error = np.zeros(size, dtype=complex)
                error[5], error[1] = k_speed, -k_speed
                jump[6] += self.ki * float(self.fast * MS) * error
                jump[chains[1][0]] = self.kp * error + jump[6]
            found = jump @ found
        return after(whole - t) @ found

    def radius(self, **factors: complex | Fraction) -> float:
        return float(np.abs(np.linalg.eigvals(self.map(**factors))).max())


_ms = Fraction
AXES = [
    Axis(_ms(1), _ms(3, 10), _ms(1, 4), _ms(1, 10), kv=60.0, kp=0.6, ki=20.0),
    Axis(_ms(1), _ms(1, 2), _ms(1, 4), _ms(1, 4), kv=40.0, kp=1.0, ki=40.0, stiffness=800.0),
    Axis(_ms(2), _ms(2, 5), _ms(1, 2), _ms(1, 10), kv=25.0, kp=0.8, ki=10.0, damping=0.3),
    Axis(_ms(3), _ms(1), _ms(2), _ms(1, 2), kv=12.0, kp=0.4, ki=5.0, motor=4e-3),
    Axis(_ms(1), _ms(1, 5), _ms(1), _ms(1, 2), kv=30.0, kp=0.7, ki=15.0, load=6e-3),
    Axis(_ms(1, 2), _ms(1, 4), _ms(3, 8), _ms(1, 16), kv=50.0, kp=1.0, ki=40.0, stiffness=4000.0, damping=0.1),
    Axis(
        _ms(1), _ms(1, 5), _ms(1, 4), _ms(1, 10), kv=60.0, kp=0.6, ki=20.0, slow_offset=_ms(9, 10), fast_offset=_ms(1, 8)
    ),
]  # fmt: skip


def bounds(radius, grid):
    """Every sign change of radius - 1 on a grid, found to rounding."""
    values = [radius(x) - 1 for x in grid]
    return [
        brentq(lambda x: radius(x) - 1, a, b, xtol=1e-14, rtol=1e-14)
        for a, b, fa, fb in zip(grid, grid[1:], values, values[1:], strict=False)
        if fa * fb < 0
    ]


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize(("place", "factor"), [("e", "k_position"), ("f", "k_speed")])
def test_margins_are_where_the_lifted_map_reaches_the_unit_circle(axis, place, factor):
    made = axis.diagram
    requests = [MetricRequest(metric=m, open_at=place) for m in ("gain_margin_up", "gain_margin_down", "phase_margin")]
    (up, _), (down, _), (phase, _) = measure(made, requests)
    assert axis.radius() < 1
    edge = bounds(lambda g: axis.radius(**{factor: np.exp(g)}), np.linspace(0, np.log(500), 60))
    assert up.value == pytest.approx(np.exp(edge[0]), rel=1e-9)
    assert axis.radius(**{factor: 0.99 * up.value}) < 1 < axis.radius(**{factor: 1.01 * up.value})
    lower = bounds(lambda g: axis.radius(**{factor: np.exp(g)}), np.linspace(np.log(1e-3), 0, 60))
    if lower:
        assert down.value == pytest.approx(np.exp(lower[-1]), rel=1e-9)
        assert axis.radius(**{factor: 0.99 * down.value}) > 1 > axis.radius(**{factor: 1.01 * down.value})
    else:
        assert down.value == 0
    ahead = bounds(lambda q: axis.radius(**{factor: np.exp(-1j * q)}), np.linspace(0, np.pi, 80))
    # of a real system a phase that may be lost at ω may be gained at -ω: the map of both factors is the other's conjugate
    assert abs(phase.value) == pytest.approx(ahead[0], rel=1e-9)


@pytest.mark.parametrize("axis", [AXES[0], AXES[3]])
def test_a_simulation_diverges_and_decays_accordingly(axis):
    up = measure(axis.diagram, [MetricRequest(metric="gain_margin_up", open_at="e")])[0][0].value
    for part in (0.85, 1.15):
        run = simulate(
            axis.diagram, signals={"r": make("pulse", {"width": 0.002})}, overrides={"position.kp": part * up * axis.kv},
            duration=0.12, samples=600, metrics=(),
        )  # fmt: skip
        y = np.abs(run.curves["y"])
        assert (y[450:].max() > y[100:250].max()) == (axis.radius(k_position=part * up) > 1)


@pytest.mark.parametrize("axis", AXES[:3])
def test_poles_are_the_eigenvalues_of_the_map(axis):
    found = Evaluation(axis.diagram).poles.values
    length = float(max(axis.slow, axis.fast)) * 1e-3  # one is a multiple of the other here
    z = np.exp(found * length)
    expected = np.linalg.eigvals(axis.map())
    for value in expected[np.abs(expected) > 1e-9]:
        assert np.abs(z - value).min() < 1e-8


@dataclass(frozen=True)
class Diverging:
    """An axis whose speed gains are `factor` times as large, a fifth above the margin, and its loop cut at f."""

    factor: float
    moved: dict[str, float]
    cut: FrequencyStudy


@pytest.fixture(scope="module")
def diverging() -> Diverging:
    axis = AXES[0]
    factor = 1.2 * measure(axis.diagram, [MetricRequest(metric="gain_margin_up", open_at="f")])[0][0].value
    moved = {"speed.kp": factor * axis.kp, "speed.ki": factor * axis.ki}
    return Diverging(factor, moved, frequency_response(axis.diagram, open_at="f", overrides=moved))


def test_a_loop_that_diverges_is_called_unstable(diverging):
    axis, moved = AXES[0], diverging.moved
    assert axis.radius(k_speed=diverging.factor) > 1
    for found in (diverging.cut, frequency_response(axis.diagram, overrides=moved, source="r", target="y")):
        assert found.verdict is Verdict.UNSTABLE
    (margin, _), (damping, _) = measure(
        axis.diagram,
        [MetricRequest(metric="gain_margin", open_at="f"), MetricRequest(metric="damping_ratio")],
        overrides=moved,
    )
    assert margin.value is None
    assert margin.verdict is Verdict.UNSTABLE
    assert damping.value < 0


def test_simulation_response_and_search_all_refuse_speed_gains_that_diverge(diverging):
    axis, moved, up = AXES[0], diverging.moved, diverging.factor / 1.2
    assert replace(axis, kp=moved["speed.kp"], ki=moved["speed.ki"]).radius() > 1
    run = simulate(
        axis.diagram, signals={"r": make("pulse", {"width": 0.002})}, overrides=moved, duration=0.05, metrics=()
    )
    assert run.verdict is Verdict.UNSTABLE
    assert diverging.cut.verdict is Verdict.UNSTABLE
    problem = Problem(
        diagram=axis.diagram,
        variables=(Variable(parameter="speed.kp", lower=axis.kp, upper=2 * up * axis.kp),),
        goals=(Goal(metric="bandwidth", source="r", target="y", sense=Sense.MAXIMIZE),),
    )
    found = solve("grid", problem, {"points": 5})
    tried = np.geomspace(axis.kp, 2 * up * axis.kp, 5)
    radii = [replace(axis, kp=kp).radius() for kp in tried]
    assert min(radii) < 1 < max(radii)
    assert radii[int(np.argmin(np.abs(tried - found.best["speed.kp"])))] < 1
    assert found.certificate.valid


def single(kp: float = 4.0, ki: float = 3.0, period: float = 0.05) -> Diagram:
    return compile_system(
        document(
            {
                "r": block("input"),
                "e": block("sum", signs="+-"),
                "c": block("sampled_pid", kp=kp, ki=ki, sample_time=period),
                "p": block("transfer_function", numerator=[2.0], denominator=[1.0, 1.2, 1.0, 0.0]),
            },
            ["r -> e.in1", "p -> e.in2", "e -> c", "c -> p"],
            {"y": "p"},
        )
    )


def sampled(kp: float, ki: float, period: float) -> control.StateSpace:
    plant = control.ss(
        [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, -1.2]], [[0.0], [0.0], [1.0]], [[2.0, 0.0, 0.0]], 0
    )
    law = control.ss([[1.0]], [[ki * period]], [[1.0]], [[kp + ki * period]], period)
    return law * control.c2d(plant, period, "zoh")


def radius(loop: control.StateSpace, gain: float) -> float:
    return float(np.abs(np.linalg.eigvals(control.feedback(gain * loop, 1).A)).max())


@pytest.mark.parametrize("period", [0.01, 0.05, 0.2])
@pytest.mark.parametrize("place", ["e", "c"])
def test_at_one_rate_all_is_what_python_control_says(period, place):
    kp, ki = 0.15, 0.02
    made, loop = single(kp, ki, period), sampled(kp, ki, period)
    found = frequency_response(made, open_at=place)
    omega = np.linspace(0.05, 0.98 * np.pi / period, 25)
    asked = frequency_response(made, open_at=place, frequencies=omega, metrics=())
    exact = np.array([complex(loop(np.exp(1j * w * period))) for w in omega])
    np.testing.assert_allclose(asked.response, exact, rtol=1e-9, atol=1e-13)
    up = found.metrics["gain_margin_up"]
    edge = brentq(lambda k: radius(loop, k) - 1, 1.0, 2 * up.value, xtol=1e-14, rtol=1e-14)
    assert up.value == pytest.approx(edge, rel=1e-9)
    assert abs(complex(loop(np.exp(1j * up.at * period))).imag) < 1e-9 / edge
    phase = found.metrics["phase_margin"]
    crossing = brentq(lambda w: abs(complex(loop(np.exp(1j * w * period)))) - 1, 0.05, up.at, xtol=1e-14, rtol=1e-14)
    assert phase.at == pytest.approx(crossing, rel=1e-9)
    assert phase.value == pytest.approx(np.pi + np.angle(complex(loop(np.exp(1j * crossing * period)))), rel=1e-9)
    fine = np.geomspace(1e-3, np.pi / period, 20001)
    response = np.array([complex(loop(np.exp(1j * w * period))) for w in fine[::4]])
    peak = np.abs(1 / (1 + response)).max()
    assert found.metrics["sensitivity_peak"].value == pytest.approx(peak, rel=1e-5)
    poles = control.feedback(loop, 1).poles()
    z = np.exp(Evaluation(made).poles.values * period)
    assert all(np.abs(z - pole).min() < 1e-7 for pole in poles if abs(pole) > 1e-6)


@pytest.mark.parametrize("axis", AXES[:1])
def test_a_delay_margin_is_the_computing_time_that_may_be_added(axis):
    up = measure(axis.diagram, [MetricRequest(metric="gain_margin_up", open_at="speed")])[0][0].value
    for share in (0.7, 0.97):
        near = replace(axis, kp=share * up * axis.kp, ki=share * up * axis.ki)
        delay = measure(near.diagram, [MetricRequest(metric="delay_margin", open_at="speed")])[0][0].value
        for part, inside in ((0.99, True), (1.01, False)):
            later = replace(near, fast_delay=near.fast_delay + Fraction(part * delay * 1000))
            assert (later.radius() < 1) is inside
        exactly = replace(near, fast_delay=near.fast_delay + Fraction(delay * 1000))
        assert exactly.radius() == pytest.approx(1, abs=1e-11)


@pytest.mark.parametrize("place", ["e", "c"])
def test_a_delay_margin_of_many_samples(place):
    """x' = A x + B u(t - m T - ρ): the state, the integral and m + 1 values of u that are under way."""
    kp, ki, period = 0.15, 0.02, 0.05
    delay = measure(single(kp, ki, period), [MetricRequest(metric="delay_margin", open_at=place)])[0][0].value

    def edge(tau: float) -> float:
        m, rho = int(tau // period), tau % period
        flow = np.zeros((4, 4))
        flow[:3, :3] = [[0, 1, 0], [0, 0, 1], [0, -1, -1.2]]
        flow[2, 3] = 1
        early, late = expm(flow * rho), expm(flow * (period - rho))
        size = 4 + m + 1  # x, integral, u_k-1 ... u_k-m-1
        whole = np.zeros((size, size))
        output = np.zeros(size)
        output[0], output[3] = -2 * (kp + ki * period), 1.0  # u_k = kp e_k + I_k, I_k = I_k-1 + ki T e_k, e = -2 x_0
        under_way = np.vstack([output, np.eye(size)[4:]])  # u_k, u_k-1, ..., u_k-m-1
        x = np.eye(size)[:3]
        first = early[:3, :3] @ x + np.outer(early[:3, 3], under_way[m + 1])
        whole[:3] = late[:3, :3] @ first + np.outer(late[:3, 3], under_way[m])
        whole[3, 3], whole[3, 0] = 1.0, -2 * ki * period
        whole[4:] = under_way[:-1]
        return float(np.abs(np.linalg.eigvals(whole)).max()) - 1

    assert edge(0.99 * delay) < 0 < edge(1.01 * delay)
    assert delay == pytest.approx(brentq(edge, 0.99 * delay, 1.01 * delay, xtol=1e-13, rtol=1e-13), rel=1e-9)


def test_slopes_are_those_of_the_map():
    axis = AXES[-1]
    requests = [MetricRequest(metric=m, open_at="f") for m in ("gain_margin_up", "phase_margin")]
    names = ["speed.kp", "axis.stiffness", "speed.delay", "position.offset"]
    found = measure(axis.diagram, requests, gradient=names)
    h = 1e-6
    for k, name in enumerate(names):
        value = axis.diagram.parameters[name].value
        sides = [measure(axis.diagram, requests, overrides={name: value * (1 + sign * h)}) for sign in (1, -1)]
        for row, (_, slopes) in enumerate(found):
            difference = (sides[0][row][0].value - sides[1][row][0].value) / (2 * h * value)
            assert slopes.values[k] == pytest.approx(difference, rel=1e-4)


def test_one_of_two_rates_cannot_be_moved_alone():
    """The map of two rates has no derivative by one of them: nothing repeats any more."""
    ((value, slopes),) = measure(
        AXES[0].diagram, [MetricRequest(metric="gain_margin_up", open_at="f")], gradient=["speed.sample_time"]
    )
    assert value.value is not None
    assert np.isnan(slopes.values[0])


def test_the_slope_by_the_only_sample_time():
    h = 1e-6
    request = [MetricRequest(metric=m, open_at="e") for m in ("phase_margin", "delay_margin")]
    request.append(MetricRequest(metric="spectral_abscissa"))
    found = measure(single(0.15, 0.02), request, gradient=["c.sample_time"])
    up, down = (measure(single(0.15, 0.02, 0.05 * (1 + sign * h)), request) for sign in (1, -1))
    for (_, slopes), (above, _), (below, _) in zip(found, up, down, strict=True):
        assert slopes.values[0] == pytest.approx((above.value - below.value) / (2 * h * 0.05), rel=1e-5)


def test_rates_without_a_common_period_are_refused_by_name():
    axis = AXES[0].diagram
    with pytest.raises(UnresolvedError, match=r"0\.001 s of position and 0\.000314159265\d* s of speed"):
        frequency_response(axis, overrides={"speed.sample_time": 1e-4 * np.pi}, open_at="e")


def test_limits_are_left_out_and_that_is_said():
    made = compile_system(
        document(
            {
                "r": block("input"),
                "e": block("sum", signs="+-"),
                "c": block("sampled_pid", kp=0.15, ki=0.02, sample_time=0.05, upper=1.0),
                "p": block("transfer_function", numerator=[2.0], denominator=[1.0, 1.2, 1.0, 0.0]),
            },
            ["r -> e.in1", "p -> e.in2", "e -> c", "c -> p"],
            {"y": "p"},
        )
    )
    found = frequency_response(made, open_at="e")
    plain = frequency_response(single(0.15, 0.02), open_at="e")
    assert found.metrics["gain_margin"].value == plain.metrics["gain_margin"].value
    assert any("c: its limits are left out" in remark.detail for remark in found.warnings)
