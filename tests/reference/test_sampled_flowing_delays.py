"""Loops of samplers with pure delays through which a signal flows on, against boundary value problems of the test's own.

A delay of n parts, of which the sample time has q: over each part the states of all q parts flow at once, x_i' = A x_i + B u
- g B C x_(i-n), where what lies k sample times back is z^-k of the same. So the loop has a pole at z where a matrix of finite size
that depends on z is singular: nothing is discretised.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from engine.analysis.evaluation import Evaluation
from engine.analysis.measuring import MetricRequest, measure
from engine.analysis.study import frequency_response, simulate
from engine.diagram.diagram import Diagram, compile_system
from engine.model.errors import UnresolvedError
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document

KP, KI, T = 0.15, 0.02, 0.05
A, B, C = np.array([[0.0, 1.0], [-1.0, -1.2]]), np.array([0.0, 1.0]), np.array([2.0, 0.0])
PARTS = [(5, 2), (1, 1), (10, 7), (3, 5), (10, 23)]
"""q and n."""


def looped(delay: float, gain: float = 0.3, kp: float = KP, ki: float = KI) -> Diagram:
    """Return a plant with its own delayed feedback, which no sampler reads, under a sampled controller."""
    blocks = {
        "r": block("input"), "d": block("input"), "e": block("sum", signs="+-"),
        "c": block("sampled_pid", kp=kp, ki=ki, sample_time=T), "late": block("delay", time=delay), "g": block("gain", gain=gain),
        "p": block("transfer_function", numerator=[2.0], denominator=[1.0, 1.2, 1.0]), "s": block("sum", signs="+-+"),
    }  # fmt: skip
    wires = [
        "r -> e.in1",
        "p -> e.in2",
        "e -> c",
        "c -> s.in1",
        "g -> s.in2",
        "d -> s.in3",
        "late -> g",
        "s -> p",
        "p -> late",
    ]
    return compile_system(document(blocks, wires, {"y": "p", "v": "late"}))


def flows(z: complex, q: int, n: int, gain: float) -> np.ndarray:
    """How the states of all q parts and a constant input flow."""
    found = np.zeros((2 * q + 1, 2 * q + 1), complex)
    for i in range(q):
        turns, j = divmod(i - n, q)
        found[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = A
        found[2 * i : 2 * i + 2, 2 * j : 2 * j + 2] += -gain * np.outer(B, C) * z**turns
        found[2 * i : 2 * i + 2, 2 * q] = B
    return found


def closed(z: complex, q: int, n: int, *, k: complex = 1.0, gain: complex = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """The equations of a mode in the states at the begin of each part, u and the integral; and what r = z^k adds."""
    over = expm(flows(z, q, n, gain) * (T / q))
    size = 2 * q + 2
    found = np.zeros((size, size), complex)
    for i in range(q):
        rows = slice(2 * i, 2 * i + 2)
        found[rows, : 2 * q + 1] = over[rows]
        j = (i + 1) % q
        found[rows, 2 * j : 2 * j + 2] -= (z if j == 0 else 1) * np.eye(2)
    found[2 * q, 2 * q + 1], found[2 * q, :2] = 1 - 1 / z, KI * T * k * C
    found[2 * q + 1, 2 * q : 2 * q + 2], found[2 * q + 1, :2] = (-1, 1), -KP * k * C
    right = np.zeros(size, complex)
    right[2 * q], right[2 * q + 1] = KI * T, -KP
    return found, right


def singular(z: complex, q: int, n: int, **factors: complex) -> complex:
    return complex(np.linalg.det(closed(z, q, n, **factors)[0]))


def newton(start: np.ndarray, value) -> np.ndarray:
    """Solve value(x) = 0 for two real numbers by Newton's method with differences."""
    x = np.array(start)
    for _ in range(40):
        step = 1e-6 * np.abs(x)
        columns = [(value(x + h) - value(x - h)) / (2 * h.sum()) for h in np.diag(step)]
        now = value(x)
        x = x - np.linalg.solve([[c.real for c in columns], [c.imag for c in columns]], [now.real, now.imag])
    return x


@pytest.mark.parametrize(("q", "n"), PARTS)
def test_margins_are_where_the_loop_has_a_mode_on_the_unit_circle(q, n):
    made = looped(n * T / q)
    factors = {"c": ("k",), "e": ("k",), "g": ("gain",), "late": ("gain",), "s": ("k", "gain"), "p": ("k", "gain")}
    for place, moved in factors.items() if n == 2 else [("s", factors["s"])]:
        (up, _), (phase, _) = measure(
            made, [MetricRequest(metric=m, open_at=place) for m in ("gain_margin_up", "phase_margin")]
        )

        def mode(x, moved=moved, turn=False):
            own = np.exp(-1j * x[1]) if turn else x[1]
            return singular(
                np.exp(1j * x[0] * T), q, n, **{name: own * (0.3 if name == "gain" else 1) for name in moved}
            )

        assert up.value == pytest.approx(newton([up.at, up.value], mode)[1], rel=1e-9)
        if phase.value is not None:
            exact = newton([phase.at, phase.value], lambda x, mode=mode: mode(x, turn=True))
            assert phase.value == pytest.approx(exact[1], rel=1e-9)


@pytest.mark.parametrize(("q", "n"), PARTS)
def test_poles_are_the_modes_and_verdicts_follow_the_margin(q, n):
    made = looped(n * T / q)
    z = np.exp(Evaluation(made).poles.values * T)
    for value in z[z.imag >= 0]:
        exact = value
        for _ in range(20):
            step = 1e-7 * abs(exact)
            slope = (singular(exact + step, q, n) - singular(exact - step, q, n)) / (2 * step)
            exact -= singular(exact, q, n) / slope
        assert value == pytest.approx(exact, rel=1e-9)
    up = measure(made, [MetricRequest(metric="gain_margin_up", open_at="c")])[0][0].value
    for part, verdict in ((0.99, Verdict.OK), (1.01, Verdict.UNSTABLE)):
        moved = {"c.kp": part * up * KP, "c.ki": part * up * KI}
        assert Evaluation(made, moved).poles.verdict is verdict


@pytest.mark.parametrize(("q", "n"), [(5, 2), (10, 7), (3, 5)])
def test_a_response_is_the_mean_over_the_mode_that_is_forced(q, n):
    made, omega = looped(n * T / q), np.array([0.3, 1.1, 4.0, 17.0, 50.0])
    found = frequency_response(made, source="r", target="y", frequencies=omega, metrics=()).response
    late = frequency_response(made, source="r", target="v", frequencies=omega, metrics=()).response
    opened = frequency_response(made, open_at="c", frequencies=omega, metrics=()).response
    for w, value, behind, cut in zip(omega, found, late, opened, strict=True):
        z = np.exp(1j * w * T)
        equations, right = closed(z, q, n)
        forced = np.linalg.solve(equations, right)
        # ∫ e^{-jω(ih + s)} x_i(s) ds, an integral beside the states
        size = 2 * q + 1
        joint = np.zeros((2 * size, 2 * size), complex)
        joint[:size, :size] = flows(z, q, n, 0.3)
        joint[size:, :size], joint[size:, size:] = np.eye(size), 1j * w * np.eye(size)
        passed = expm(joint * (T / q)) @ np.append(forced[:size], np.zeros(size))
        means = passed[size:] * np.exp(-1j * w * T / q)  # the integral has turned with the frame
        exact = sum(np.exp(-1j * w * i * T / q) * means[2 * i] * 2 for i in range(q)) / T
        assert value == pytest.approx(exact, rel=1e-8)
        assert behind == pytest.approx(exact * np.exp(-1j * w * n * T / q), rel=1e-8)
        # the determinant is linear in the gain: 1 + k L = 0
        none, one = singular(z, q, n, k=0.0), singular(z, q, n, k=1.0)
        assert cut == pytest.approx((one - none) / none, rel=1e-8)


@pytest.mark.parametrize("place", ["s"])
def test_a_delay_margin_is_the_delay_that_makes_a_pole_reach_the_circle(place):
    """The delay stands as a block of its own at the place, in parts of the sample time that come near the margin."""
    made = looped(0.02, kp=6.0, ki=0.5)
    margin = measure(made, [MetricRequest(metric="delay_margin", open_at=place)])[0][0].value
    for part, verdict in ((0.99, Verdict.OK), (1.01, Verdict.UNSTABLE)):
        blocks, wires = dict(made.system.blocks), [f"{c.source} -> {c.target}" for c in made.system.connections]
        blocks["way"] = block("delay", time=part * margin)
        wires = [wire.replace(f"{place} ->", "way ->") for wire in wires] + [f"{place} -> way"]
        later = compile_system(document(blocks, wires, {"y": "p"}))
        assert Evaluation(later).poles.verdict is verdict
        assert abs(Evaluation(later).poles.values.real).min() < 0.05


def test_a_simulation_diverges_beyond_a_margin_and_decays_below_it():
    made = looped(0.0371)
    up = measure(made, [MetricRequest(metric="gain_margin_up", open_at="c")])[0][0]
    for part in (0.9, 1.1):
        moved = {"c.kp": part * up.value * KP, "c.ki": part * up.value * KI}
        run = simulate(
            made, signals={"d": make("pulse", {"width": 0.1})}, duration=12.0, samples=1200, metrics=(), overrides=moved
        )  # fmt: skip
        y = np.abs(run.curves["y"])
        rate = Evaluation(made, moved).poles.values.real.max()
        assert np.log(y[950:].max() / y[450:700].max()) / 5.0 == pytest.approx(rate, abs=0.004)
        assert bool(rate > 0) is (part > 1)


@pytest.mark.parametrize("delay", [0.0371, 0.011])
def test_slopes_are_exact(delay):
    names = ["late.time", "c.kp", "c.sample_time", "g.gain", "c.delay"]
    asked = [
        MetricRequest(metric=m, open_at="c")
        for m in ("gain_margin_up", "phase_margin", "delay_margin", "sensitivity_peak")
    ]
    asked.append(MetricRequest(metric="spectral_abscissa"))
    made = looped(delay, kp=6.0, ki=0.5)
    start = {"c.delay": 0.0113}
    found = measure(made, asked, gradient=names, overrides=start)
    for k, name in enumerate(names):
        value, h = start.get(name, made.parameters[name].value), 1e-5
        sides = [measure(made, asked, overrides=start | {name: value * (1 + s * h)}) for s in (1, -1)]
        for row, (_, slopes) in enumerate(found):
            difference = (sides[0][row][0].value - sides[1][row][0].value) / (2 * h * value)
            assert slopes.values[k] == pytest.approx(difference, rel=2e-6, abs=1e-6 * abs(found[row][0].value / value))


def test_jumps_that_go_round_without_end_are_refused():
    """w = v late, v = u - w / 2 at once: nothing smooths the jumps, whose images are dense where the ratio is irrational."""
    made = compile_system(
        document(
            {
                "r": block("input"), "c": block("zero_order_hold", sample_time=T), "s": block("sum", signs="+-"),
                "late": block("delay", time=0.01 * np.pi), "g": block("gain", gain=0.5),
                "p": block("transfer_function", numerator=[2.0], denominator=[1.0, 1.0]), "e": block("sum", signs="+-"),
                "x": block("sum", signs="++"), "q": block("transfer_function", numerator=[1.0], denominator=[1.0, 3.0]),
            },
            ["r -> e.in1", "p -> e.in2", "e -> c", "c -> x.in1", "q -> x.in2", "p -> q", "x -> s.in1", "late -> g", "g -> s.in2",
             "s -> late", "late -> p"],
            {"y": "p"},
        )
    )  # fmt: skip
    with pytest.raises(UnresolvedError, match="put a lag into the loop of the delay"):
        Evaluation(made).poles  # noqa: B018
