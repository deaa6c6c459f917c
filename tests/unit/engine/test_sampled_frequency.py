"""Frequency responses from samples to samples beside scipy's discretisations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import cont2discrete, tf2ss

from engine.exact.frequency.sampled_frequency import sampled_frequency_response
from engine.model.between_samples import BetweenSamples
from engine.model.errors import UnresolvedError
from engine.model.linear_system import LaneSystem, LinearSystem

H = 0.01
W = np.geomspace(0.5, np.pi / H, 40)
HOLD, LINEAR = BetweenSamples.HOLD, BetweenSamples.LINEAR

PLANTS = {
    "lag": ([3.0], [0.02, 1.0]),
    "resonance": ([400.0], [1.0, 2.0, 400.0]),
    "with feed-through": ([1.0, 3.0], [1.0, 30.0]),
    "integrator": ([5.0], [1.0, 8.0, 0.0]),
    "two integrators": ([5.0, 20.0], [1.0, 0.0, 0.0]),
    "unstable": ([1.0], [1.0, -2.0]),
}


def system(plant: str, delay: float | None) -> LaneSystem:
    a, b, c, d = tf2ss(*PLANTS[plant])
    if delay is None:
        return LaneSystem.of([LinearSystem.delay_free(a, b, c, d)])
    n, one = len(a), np.ones((1, 1))
    late = LinearSystem(
        a=a, b1=0 * b, b2=b, c1=c, c2=np.zeros((1, n)), d11=0 * d, d12=d, d21=one, d22=0 * one,
        delays=np.array([delay * H]), x0=np.zeros(n), inputs=("u",), outputs=("y",),
    )  # fmt: skip
    return LaneSystem.of([late])


@pytest.mark.parametrize("way", [HOLD, LINEAR])
@pytest.mark.parametrize("plant", PLANTS)
def test_without_delays(plant: str, way: BetweenSamples) -> None:
    method = "zoh" if way is HOLD else "foh"
    a, b, c, d, _ = cont2discrete(tf2ss(*PLANTS[plant]), H, method)
    expected = [(c @ np.linalg.solve(np.exp(1j * w * H) * np.eye(len(a)) - a, b) + d)[0, 0] for w in W]
    found = sampled_frequency_response(system(plant, None), (0, 0), W, sample_time=H, way=way)
    assert found == pytest.approx(np.array(expected), rel=1e-9)


@pytest.mark.parametrize("delay", [3, 2.4])
@pytest.mark.parametrize("plant", PLANTS)
def test_with_delays(plant: str, delay: float) -> None:
    # of parts of a sample: the delayed held input is one that is held on a grid five times as fine
    parts, (a, b, c, d) = 5, tf2ss(*PLANTS[plant])
    fine_a, fine_b, *_ = cont2discrete((a, b, c, d), H / parts)
    late = round(delay * parts)
    whole, rest = divmod(late, parts)
    z = np.exp(1j * W * H)
    # x_{k+1} = F x_k + (F_late u_{k-whole-1} + F_early u_{k-whole})
    power = [np.linalg.matrix_power(fine_a, i) for i in range(parts + 1)]
    early = sum((power[i] @ fine_b for i in range(parts - rest)), np.zeros_like(b))
    old = sum((power[i] @ fine_b for i in range(parts - rest, parts)), np.zeros_like(b))
    through = d * z ** -(whole + (rest > 0))
    expected = [
        (c @ np.linalg.solve(t * np.eye(len(a)) - power[parts], early * t**-whole + old * t ** -(whole + 1)))[0, 0] + f
        for t, f in zip(z, through.ravel(), strict=True)
    ]
    found = sampled_frequency_response(system(plant, delay), (0, 0), W, sample_time=H, way=HOLD)
    assert found == pytest.approx(np.array(expected), rel=1e-9)


def test_a_delay_of_zero_is_none() -> None:
    assert sampled_frequency_response(system("lag", 0.0), (0, 0), W, sample_time=H, way=HOLD) == pytest.approx(
        sampled_frequency_response(system("lag", None), (0, 0), W, sample_time=H, way=HOLD), rel=1e-6
    )


def test_what_grows_without_bound_is_refused_in_words() -> None:
    with pytest.raises(UnresolvedError, match="must settle"):
        sampled_frequency_response(looped("unstable", 2.4, gain=0.5), (0, 0), W, sample_time=H, way=HOLD)


@pytest.mark.parametrize("delay", [0.0, 0.6, 2.4])
@pytest.mark.parametrize("plant", PLANTS)
def test_linear_inputs_with_delays(plant: str, delay: float) -> None:
    # a straight line between two samples is one on a grid five times as fine, too
    parts, (a, b, c, d) = 5, tf2ss(*PLANTS[plant])
    n = len(a)
    joint = np.zeros((n + 2, n + 2))
    joint[:n, :n], joint[:n, n : n + 1], joint[n, n + 1] = a * H / parts, b * H / parts, 1.0
    grown = expm(joint)
    step, level, slope = grown[:n, :n], grown[:n, n], grown[:n, n + 1]
    late = round(delay * parts)
    expected = []
    for w in W:
        z = np.exp(1j * w * H)

        def u(j: int, z: complex = z) -> complex:
            whole, rest = divmod(j, parts)
            return complex(z**whole * (1 + (z - 1) * rest / parts))

        forced = np.zeros(n, dtype=complex)
        for j in range(-late, parts - late):
            forced = step @ forced + level * u(j) + slope * (u(j + 1) - u(j))
        state = np.linalg.solve(z * np.eye(n) - np.linalg.matrix_power(step, parts), forced)
        expected.append((c @ state)[0] + d[0, 0] * u(-late))
    found = sampled_frequency_response(system(plant, delay), (0, 0), W, sample_time=H, way=LINEAR)
    assert found == pytest.approx(np.array(expected), rel=1e-9)


def looped(plant: str, delay: float, *, gain: float) -> LaneSystem:
    """Return a plant with a late feedback: x' = A x + B (u - gain y(t - τ))."""
    a, b, c, d = tf2ss(*PLANTS[plant])
    n, one = len(a), np.ones((1, 1))
    return LaneSystem.of([LinearSystem(
        a=a, b1=b, b2=-gain * b, c1=c, c2=c, d11=d, d12=0 * d, d21=0 * one, d22=0 * one,
        delays=np.array([delay * H]), x0=np.zeros(n), inputs=("u",), outputs=("y",),
    )])  # fmt: skip


def test_a_delay_in_a_loop() -> None:
    # 3 / (0.02 s + 1), held, with a feedback two samples late
    late = 0.2
    found = sampled_frequency_response(looped("lag", 2.0, gain=late), (0, 0), W, sample_time=1e-2, way=HOLD)
    fine, z = 200, np.exp(1j * W * H)
    # the feedback is no held signal: on a grid 200 times as fine it nearly is one
    p, q = np.exp(-H / fine / 0.02), 3 * (1 - np.exp(-H / fine / 0.02))
    y = np.zeros(fine * 400)
    for k in range(1, y.size):
        back = 0.5 * (y[k - 1 - 2 * fine] + y[k - 2 * fine]) if k > 2 * fine else 0.0
        y[k] = p * y[k - 1] + q * (1.0 - late * back)
    steps = np.diff(y[::fine], prepend=0.0)
    expected = np.array([np.sum(steps * one ** -np.arange(steps.size)) for one in z])
    assert found == pytest.approx(expected, rel=1e-4)


def test_delays_in_a_row_and_beside_each_other() -> None:
    # (e^(-0.6 h s) + 2) G e^(-1.8 h s), each piece as above; the same by superposition of single delays
    a, b, c, d = tf2ss(*PLANTS["lag"])
    n = len(a)
    both = LinearSystem(
        a=a, b1=0 * b, b2=np.concatenate([0 * b, b], axis=1), c1=c, c2=np.zeros((2, n)), d11=d, d12=np.zeros((1, 2)),
        d21=np.array([[1.0], [2.0]]), d22=np.array([[0.0, 0.0], [1.0, 0.0]]), delays=H * np.array([0.6, 1.8]),
        x0=np.zeros(n), inputs=("u",), outputs=("y",),
    )  # fmt: skip
    for way in (HOLD, LINEAR):
        alone = [sampled_frequency_response(system("lag", t), (0, 0), W, sample_time=H, way=way) for t in (2.4, 1.8)]
        found = sampled_frequency_response(LaneSystem.of([both]), (0, 0), W, sample_time=H, way=way)
        assert found == pytest.approx(alone[0] + 2 * alone[1], rel=1e-10)
