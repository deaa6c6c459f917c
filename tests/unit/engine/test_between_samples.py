"""Inputs that are held, linear or band-limited between their samples, beside scipy's discretisations and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import cont2discrete, dlsim

from engine.exact.time.at_samples import moments
from engine.exact.time.sampled import Drive, simulate_sampled
from engine.exact.time.trajectory import respond
from engine.model.between_samples import BetweenSamples, polynomials
from engine.model.linear_system import LaneSystem, LinearSystem
from engine.model.tangent import INFINITESIMAL
from engine.signals import make

H = 0.01
HOLD, LINEAR, BAND_LIMITED = BetweenSamples.HOLD, BetweenSamples.LINEAR, BetweenSamples.BAND_LIMITED
U = np.random.default_rng(1).normal(size=(1, 400))
MATRICES = (
    np.array([[-3.0, 20.0, 0.0], [-20.0, -3.0, 5.0], [0.0, 0.0, -40.0]]),
    np.array([[0.3], [-1.0], [2.0]]),
    np.array([[1.0, -0.4, 0.6]]),
    np.array([[0.7]]),
)


def delayed(k: complex, tau: complex, *, direct: float = 0.0, rate: float = 7.0) -> LinearSystem:
    """y = k (a lag of u(t - tau)) + direct u(t - tau)."""
    kind = np.result_type(k, tau, float)
    one = np.ones((1, 1), kind)
    return LinearSystem(
        a=-rate * one, b1=0 * one, b2=rate * one, c1=k * one, c2=0 * one, d11=0 * one, d12=direct * one, d21=one,
        d22=0 * one, delays=np.array([tau], kind), x0=np.zeros(1, kind), inputs=("u",), outputs=("y",),
    )  # fmt: skip


def held(k: float, tau: float, u: np.ndarray, *, parts: int, direct: float = 0.0, rate: float = 7.0) -> np.ndarray:
    """The same by scipy on a grid on which the delay is a whole number, begun at rest under the first value."""
    late = round(tau / H * parts)
    assert late == pytest.approx(tau / H * parts, abs=1e-9)
    fine = np.concatenate([np.full(late, u[0]), np.repeat(u, parts)])[: u.size * parts]
    system = cont2discrete((np.array([[-rate]]), np.array([[rate]]), np.array([[k]]), np.array([[direct]])), H / parts)
    _, y, _ = dlsim(system, fine, x0=[u[0]])
    return y[::parts, 0]


def test_a_held_input_is_answered_as_by_the_exact_discretisation() -> None:
    start = U[0, 0] * np.linalg.solve(-MATRICES[0], MATRICES[1])[:, 0]
    _, expected, _ = dlsim(cont2discrete(MATRICES, H), U[0], x0=start)
    found = simulate_sampled(LinearSystem.delay_free(*MATRICES), U, H, between=HOLD)[0]
    assert found == pytest.approx(expected[:, 0], rel=1e-12, abs=1e-12)


def test_a_held_input_of_an_integrating_path() -> None:
    matrices = (np.array([[0.0, 1.0], [0.0, -5.0]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]]), np.zeros((1, 1)))
    _, expected, _ = dlsim(cont2discrete(matrices, H), U[0])
    found = simulate_sampled(LinearSystem.delay_free(*matrices), U, H, between=HOLD)[0]
    assert found == pytest.approx(expected[:, 0], rel=1e-12, abs=1e-13)


@pytest.mark.parametrize("delay", [0.037, 0.3, 1.0, 13.7])
def test_a_held_input_through_delays_of_parts_of_a_sample(delay: float) -> None:
    tau = delay * H
    found = simulate_sampled(delayed(2.0, tau), U, H, between=HOLD)[0]
    assert found == pytest.approx(held(2.0, tau, U[0], parts=1000 if delay == 0.037 else 10), rel=1e-11, abs=1e-11)


@pytest.mark.parametrize("delay", [0, 1, 3, 29])
def test_what_feeds_through_shows_the_new_value_at_the_instant_of_a_jump(delay: int) -> None:
    # also where rounding sets the delay beside the sample: 0.29 is not 29 times 0.01
    found = simulate_sampled(delayed(2.0, delay / 100, direct=3.0), U, H, between=HOLD)[0]
    # a delay of 0 is one that is moved back, to 1e-8
    assert found == pytest.approx(held(2.0, delay * H, U[0], parts=1, direct=3.0), abs=1e-7 if delay == 0 else 1e-11)


@pytest.mark.parametrize("way", [HOLD, BAND_LIMITED])
def test_slopes_are_exact(way: BetweenSamples) -> None:
    at = np.array([2.0, 0.0137])
    lanes = [delayed(*(at + 1j * INFINITESIMAL * unit)) for unit in np.eye(2)]
    _, slopes = Drive(U, H, between=[way]).respond(LaneSystem.of(lanes))
    for slope, unit, step in zip(slopes, np.eye(2), (1e-3, 1e-6), strict=True):
        up, down = (simulate_sampled(delayed(*(at + s * step * unit)), U, H, between=way)[0] for s in (1, -1))
        assert slope[0] == pytest.approx((up - down) / (2 * step), rel=1e-5, abs=1e-4)


# 0.3 s are 100 samples: pieces of the curve end at samples, and move with the delay
@pytest.mark.parametrize(("h", "count"), [(0.003, 1000), (0.3, 10), (3e-5, 100_000)])
@pytest.mark.parametrize("rows", [1, 5])
def test_means_of_a_response_between_samples_are_exact_however_late_and_fine(h: float, count: int, rows: int) -> None:
    k, tau, rate = 2.0, 0.3, 7.0
    lanes = LaneSystem.of([delayed(k, tau + 1j * INFINITESIMAL, direct=0.5)])
    found = moments(respond(lanes, [make("step", {})], h * count).output(0), h, count, rows)[0]
    behind = round(tau / h) + 1
    left = np.exp(-rate * (h * np.arange(behind + 1, count + 1) - tau))
    for i in range(rows):
        of_growth = quad(lambda phi, i=i: phi**i * np.exp(rate * h * phi), 0, 1, epsabs=0, epsrel=2e-14)[0]
        np.testing.assert_allclose(
            found[i, behind:].real, (k + 0.5) / (i + 1) - k * of_growth * left, rtol=0, atol=1e-12
        )
        np.testing.assert_allclose(
            found[i, behind:].imag / INFINITESIMAL, -k * rate * of_growth * left, rtol=0, atol=1e-10
        )
        assert not found[i, : behind - 2].any()


@pytest.mark.parametrize(("system", "static"), [
    (LinearSystem.delay_free(*MATRICES), lambda s: (
        MATRICES[2] @ np.linalg.solve(s * np.eye(3) - MATRICES[0], MATRICES[1]) + MATRICES[3])[0, 0]),
    (delayed(2.0, 0.0237, direct=0.5), lambda s: (2.0 * 7.0 / (s + 7.0) + 0.5) * np.exp(-0.0237 * s)),
])  # fmt: skip
def test_a_band_limited_input_is_answered_as_the_sines_that_it_is_made_of(system, static) -> None:
    # up to a fifth of the sample rate; linear interpolation keeps only 0.875 of the fastest
    t = H * np.arange(1500)
    u, y = np.zeros_like(t), np.zeros_like(t)
    for hertz, phase in ((0.7, 0.3), (5.0, 1.0), (13.0, 2.0), (20.0, 4.0)):
        turn = np.exp(1j * (2 * np.pi * hertz * t + phase))
        u, y = u + turn.imag, y + (static(2j * np.pi * hertz) * turn).imag
    inside = slice(600, -30)  # behind what a start from rest leaves, before the end of the spline
    errors = {
        way: np.abs(simulate_sampled(system, u[None], H, between=way)[0] - y)[inside].max() for way in BetweenSamples
    }
    assert errors[BAND_LIMITED] < 3e-4
    assert errors[LINEAR] > 20 * errors[BAND_LIMITED]


def test_a_spline_takes_every_polynomial_of_its_degree_as_it_is() -> None:
    # the response of a lag to t^5, by its recursion; delays apart and together
    t = H * np.arange(200)
    u = (t / t[-1]) ** 5
    for system, at in ((delayed(1.0, 0.0), t), (delayed(1.0, 0.0237), np.maximum(t - 0.0237, 0.0))):
        tau, expected, derivative = 1 / 7.0, np.zeros_like(t), 1.0
        for i in range(6):  # Σ (-tau)^i u^(i), less what decays of its value at 0
            expected += (-tau) ** i * derivative * (at / t[-1]) ** (5 - i) / t[-1] ** i
            derivative *= 5 - i
        expected -= (-tau) ** 5 * 120 / t[-1] ** 5 * np.exp(-at / tau)
        found = simulate_sampled(system, u[None], H, between=BAND_LIMITED)[0]
        assert found == pytest.approx(expected, abs=2e-9)


@pytest.mark.parametrize("samples", [1, 2, 3, 4, 5, 7])
def test_polynomials_go_through_the_samples_however_few(samples: int) -> None:
    u = U[0, :samples]
    time = np.cumsum(np.linspace(0.5, 1.5, samples))
    for way in BetweenSamples:
        found = polynomials(u, way, time)
        assert found.shape[1] == samples - 1
        assert found[0] == pytest.approx(u[:-1])
        if way is not HOLD:
            assert found.sum(axis=0) == pytest.approx(u[1:])
    assert simulate_sampled(delayed(1.0, 0.005), u[None], H, between=BAND_LIMITED).shape == (1, samples)


def test_each_input_has_its_own_way() -> None:
    two = LinearSystem.delay_free(
        np.diag([-2.0, -30.0]), np.eye(2), np.ones((1, 2)), np.zeros((1, 2)), inputs=("u", "v")
    )
    u = np.concatenate([U, U[:, ::-1]])
    found = simulate_sampled(two, u, H, between={"u": HOLD})[0]
    alone = [
        simulate_sampled(LinearSystem.delay_free(np.array([[-a]]), *np.ones((2, 1, 1)), np.zeros((1, 1))), v[None], H, between=way)
        for a, v, way in ((2.0, u[0], HOLD), (30.0, u[1], LINEAR))
    ]  # fmt: skip
    assert found == pytest.approx((alone[0] + alone[1])[0], rel=1e-11, abs=1e-12)


def test_as_many_ways_as_inputs() -> None:
    with pytest.raises(ValueError, match="2 rows"):
        Drive(U, H, between=[HOLD, HOLD])
