"""Frequency responses from samples to samples beside scipy's discretisations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, tf2ss

from engine.between_samples import BetweenSamples
from engine.errors import UnresolvedError
from engine.linear.sampled_frequency import sampled_frequency_response
from engine.linear.system import LaneSystem, LinearSystem

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
@pytest.mark.parametrize("plant", ["lag", "resonance", "with feed-through", "integrator", "two integrators"])
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
    assert found == pytest.approx(np.array(expected), rel=2e-7, abs=1e-9)


def test_a_delay_of_zero_is_none() -> None:
    assert sampled_frequency_response(system("lag", 0.0), (0, 0), W, sample_time=H, way=HOLD) == pytest.approx(
        sampled_frequency_response(system("lag", None), (0, 0), W, sample_time=H, way=HOLD), rel=1e-6
    )


def test_what_grows_without_bound_is_refused_in_words() -> None:
    with pytest.raises(UnresolvedError, match="must settle"):
        sampled_frequency_response(system("unstable", 2.4), (0, 0), W, sample_time=H, way=HOLD)
