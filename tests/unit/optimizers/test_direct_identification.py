"""Models without a diagram: discrete and continuous, drives, static curves, noise; against independent formulas and scipy."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from engine.diagram.diagram import Block, Connection, System, compile_system
from engine.exact.time.sampled import simulate_sampled
from engine.model.between_samples import BetweenSamples
from optimizers.black_box import black_box
from optimizers.black_box.choice import _begun
from optimizers.black_box.continuous import Discrete, continuous
from optimizers.black_box.output_error import OutputError
from optimizers.estimation.inverse_dynamics import DriveRecording, Treatment, drive_parameters
from optimizers.estimation.noise import fitted
from optimizers.estimation.static_curve import static_curve
from optimizers.problem import ProblemError
from optimizers.recorded.recording import RecordedExperiment, Recording

H = 0.02
RNG = np.random.default_rng(11)
COMMAND = np.repeat(RNG.choice([-1.0, 1.0], size=100), 10)

A = np.array([[-1.0, 5.0, 0.0], [-5.0, -1.0, 1.0], [0.0, 0.0, -8.0]])
B, C, D = np.array([[1.0], [0.5], [2.0]]), np.array([[1.0, 0.0, 0.3]]), np.array([[0.2]])


def sampled(a=A, b=B, c=C, d=D, *, method="foh") -> Discrete:
    """Return the discretisation of scipy, by a triangle hold or another one."""
    phi, gamma, rows, direct, _ = cont2discrete((a, b, c, d), H, method=method)
    return Discrete(a=phi, b=gamma, c=rows, d=direct, x0=np.zeros(len(a)))


def recording(y: np.ndarray, u: np.ndarray = COMMAND) -> Recording:
    return Recording(inputs={"u": u}, outputs={"y": y}, sample_time=H)


def test_the_continuous_system_is_the_one_that_was_sampled():
    found = continuous(sampled(), H)
    assert found is not None
    for ours, theirs in ((found.a, A), (found.b, B), (found.c, C), (found.d, D)):
        np.testing.assert_allclose(ours, theirs, atol=1e-10)
    np.testing.assert_allclose(np.sort_complex(found.poles), np.sort_complex(np.linalg.eigvals(A)))


def test_each_input_is_held_or_linear():
    two_b, two_d = np.hstack([B, -B[::-1]]), np.array([[0.2, 0.5]])
    lines, steps = (sampled(b=two_b, d=two_d, method=method) for method in ("foh", "zoh"))
    b, d = (np.hstack([one[:, :1], other[:, 1:]]) for one, other in ((lines.b, steps.b), (lines.d, steps.d)))
    found = continuous(Discrete(a=lines.a, b=b, c=lines.c, d=d, x0=lines.x0), H, held=[False, True])
    for ours, theirs in ((found.a, A), (found.b, two_b), (found.c, C), (found.d, two_d)):
        np.testing.assert_allclose(ours, theirs, atol=1e-10)


@pytest.mark.parametrize("way", [BetweenSamples.HOLD, BetweenSamples.LINEAR])
def test_a_model_of_a_held_command_answers_to_a_held_command(way):
    y = sampled(d=0 * D, method="zoh").simulate(COMMAND[None] - COMMAND[0])[0]
    recorded = Recording(inputs={"u": COMMAND}, outputs={"y": y}, sample_time=H, between_samples={"u": way})
    found = black_box(RecordedExperiment(recording=recorded), method="subspace", orders=(3,))
    assert found.validation["y"].fit_percent == pytest.approx(100, abs=0.01)
    model = found.system
    gain = (model.c @ np.linalg.solve(40j * np.eye(3) - model.a, model.b) + model.d)[0, 0]
    truth = (C @ np.linalg.solve(40j * np.eye(3) - A, B))[0, 0]
    right = abs(gain / truth - 1) < 1e-3
    assert bool(right) == (way is BetweenSamples.HOLD)


def test_a_pole_at_half_the_sample_rate_has_no_continuous_counterpart():
    one = np.ones((1, 1))
    assert continuous(Discrete(a=-0.5 * one, b=one, c=one, d=one, x0=np.zeros(1)), H) is None


@pytest.mark.parametrize("method", ["subspace", "transfer_function"])
def test_a_system_comes_back_from_its_recording_and_simulates_alike_in_the_engine(method):
    y = sampled().simulate(COMMAND[None] - COMMAND[0])[0] + 0.7
    found = black_box(RecordedExperiment(recording=recording(y)), method=method, orders=(1, 2, 3, 4))
    assert found.order == 3
    np.testing.assert_allclose(np.sort_complex(found.system.poles), np.sort_complex(np.linalg.eigvals(A)), rtol=1e-4)
    assert found.validation["y"].fit_percent == pytest.approx(100, abs=0.01)
    model = dict(found.document["blocks"]["model"])
    made = compile_system(
        System(
            name="made", parameters={}, blocks={"u": Block(kind="input"), "model": Block(kind=model.pop("kind"), values=model)},
            connections=(Connection(source="u", target="model"),), outputs={"y": "model"},
        )
    )  # fmt: skip
    simulated = simulate_sampled(made.realize(), COMMAND[None], H)[0]
    # the recording began at 0 under a command of COMMAND[0]: only the constants differ
    difference = simulated - y
    np.testing.assert_allclose(difference, difference.mean(), atol=1e-3)


def test_a_delay_of_whole_samples_is_found_and_noise_does_not_raise_the_order():
    p = np.exp(-H / 0.1)
    u = np.concatenate([np.full(7, COMMAND[0]), COMMAND[:-7]])
    y = lfilter([0.0, 1 - p], [1.0, -p], u) + 0.05 * RNG.normal(size=u.size)
    found = black_box(
        RecordedExperiment(recording=recording(y)), method="transfer_function", orders=(1, 2, 3), largest_delay=0.3
    )
    # this lag holds its input between samples: as seen by straight lines it is half a sample later
    assert found.delay == pytest.approx(7 * H, abs=1.01 * H)
    assert found.order == 1
    assert found.document["blocks"]["transport"] == {"kind": "delay", "time": found.delay}


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"orders": ()}, "orders must be 1 to 20"),
        ({"orders": (30,)}, "orders must be 1 to 20"),
        ({"orders": (60,), "method": "subspace"}, "orders must be 1 to 20"),
        ({"largest_delay": 1.0, "method": "subspace"}, "0 for a subspace model"),
        ({"largest_delay": -1.0}, "largest_delay must be 0 to"),
    ],
)
def test_what_no_model_can_be_made_of_is_refused(settings, message):
    with pytest.raises(ProblemError, match=message):
        black_box(RecordedExperiment(recording=recording(COMMAND)), **{"method": "transfer_function", **settings})


def test_short_and_constant_recordings_are_refused():
    with pytest.raises(ProblemError, match="at least 140 samples for order 6, got 25"):
        black_box(
            RecordedExperiment(recording=recording(RNG.normal(size=50), COMMAND[:50])), method="transfer_function"
        )
    with pytest.raises(ProblemError, match="y must vary"):
        black_box(RecordedExperiment(recording=recording(np.ones(1000))), method="subspace")


T = 0.001 * np.arange(8000)
VELOCITY = np.sin(4 * T) + 0.6 * np.sin(13 * T + 1)
ACCELERATION = 4 * np.cos(4 * T) + 7.8 * np.cos(13 * T + 1)
POSITION = -np.cos(4 * T) / 4 - 0.6 * np.cos(13 * T + 1) / 13


def test_a_drive_with_friction_of_its_own_in_each_direction_and_a_pressure():
    pressure = 1e5 * (3 + np.sin(1.7 * T))
    friction = np.where(VELOCITY > 0, 3.0 + 5 * VELOCITY, -4.0 + 6 * VELOCITY)
    force = 2 * ACCELERATION + friction + 5e-4 * pressure
    noisy = force + 0.5 * RNG.normal(size=T.size)
    found = drive_parameters(
        DriveRecording(force=noisy, position=POSITION, further={"area": pressure}, sample_time=1e-3),
        Treatment(low_pass=400.0, decimation=4, dropped=50),
        asymmetric=True,
    )
    truth = {
        "mass": 2.0, "viscous": 5.0, "viscous_negative": 6.0, "coulomb": 3.0, "coulomb_negative": 4.0, "area": 5e-4
    }  # fmt: skip
    assert {name: term.value for name, term in found.terms.items()} == pytest.approx(truth, rel=0.03)
    assert all(term.lower95 < term.value < term.upper95 for term in found.terms.values())


def test_a_dry_friction_that_turns_smoothly_is_found_by_one_that_does():
    force = 2 * ACCELERATION + 5 * VELOCITY + 3 * np.tanh(VELOCITY / 0.3) - 0.5
    recording = DriveRecording(force=force, velocity=VELOCITY, sample_time=1e-3)
    truth = {"mass": 2.0, "viscous": 5.0, "coulomb": 3.0, "offset": -0.5}
    smooth = drive_parameters(recording, Treatment(transition_velocity=0.3))
    assert {name: term.value for name, term in smooth.terms.items()} == pytest.approx(truth, rel=1e-3)
    hard = drive_parameters(recording)
    assert hard.equation_error.fit_percent < 97
    assert smooth.equation_error.fit_percent > 99.9
    with pytest.raises(ProblemError, match="transition_velocity must be >= 0, got -1"):
        Treatment(transition_velocity=-1.0)


def test_terms_that_a_motion_does_not_tell_apart_are_named():
    creep = 0.01 + 1e-4 * np.sin(3 * T)  # never turns: dry friction and offset are the same
    found = drive_parameters(
        DriveRecording(force=5 * creep + 1 + 0.01 * RNG.normal(size=T.size), velocity=creep, sample_time=1e-3)
    )
    assert any("coulomb and offset" in sentence for sentence in found.indistinguishable)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"position": None}, "one of position and velocity"),
        ({"velocity": VELOCITY}, "one of position and velocity"),
        ({"position": POSITION[:-1]}, "must have 8000 samples"),
        ({"position": np.ones(8000)}, "position must vary"),
        ({"position": POSITION * np.nan}, "finite"),
        ({"sample_time": 0.0}, "> 0 s"),
    ],
)
def test_recordings_that_say_nothing_of_a_drive_are_refused(change, message):
    with pytest.raises(ProblemError, match=message):
        DriveRecording(**{"force": VELOCITY, "position": POSITION, "sample_time": 1e-3, **change})


def test_what_is_left_of_a_recording_must_be_enough():
    short = DriveRecording(force=VELOCITY[:50], position=POSITION[:50], sample_time=1e-3)
    with pytest.raises(ProblemError, match="at least 40 samples for 4 terms, got 20"):
        drive_parameters(short, Treatment(dropped=30))
    with pytest.raises(ProblemError, match="rad/s"):
        drive_parameters(short, Treatment(low_pass=1e5))


def test_the_degree_of_a_static_curve_is_that_of_the_law():
    u = np.sin(np.arange(2000) / 7.0)
    y = 2 - u + 3 * u**3 + 0.05 * RNG.normal(size=u.size)
    found = static_curve(u, y)
    assert found.degree == 3
    assert found.at(np.array([0.5]))[0] == pytest.approx(2 - 0.5 + 3 * 0.125, abs=0.02)
    assert np.interp(0.5, found.points, found.values) == pytest.approx(1.875, abs=0.02)
    with pytest.raises(ProblemError, match="input must vary"):
        static_curve(np.ones(500), y[:500])
    with pytest.raises(ProblemError, match="equally many"):
        static_curve(u, y[:-1])


def test_the_colour_of_noise_is_the_filter_that_made_it():
    noise = lfilter([1.0], [1.0, -1.5, 0.9], np.random.default_rng(0).normal(size=5000))
    found = fitted(noise)
    assert found.order == 2
    assert found.coefficients == pytest.approx([1.0, -1.5, 0.9], abs=0.02)
    assert found.variance == pytest.approx(1.0, rel=0.05)
    # of an AR(2): c_0 = σ² (1 + a_2) / ((1 - a_2) ((1 + a_2)² - a_1²))
    assert found.autocovariance(1)[0] == pytest.approx(1.9 / (0.1 * (1.9**2 - 1.5**2)), rel=0.1)
    assert found.innovations(noise).std() == pytest.approx(1.0, rel=0.05)
    assert fitted(np.random.default_rng(1).normal(size=5000)).order == 0


@pytest.mark.parametrize("delay", [0, 9, 77, 150])
def test_the_search_for_a_delay_looks_at_few_and_finds_what_all_of_them_would(delay):
    """A first order behind ``delay`` samples, 150 at most, driven by steps: the best of all 151 starts, from a third of them."""
    rng = np.random.default_rng(delay)
    u = np.repeat(rng.normal(size=40), 50)
    late = np.concatenate([np.zeros(delay), u[: u.size - delay]])
    y = lfilter([0.0, 0.02], [1.0, -0.98], late) + 0.001 * rng.normal(size=u.size)

    plain = OutputError(u, y, offset=True)
    with patch.object(plain, "started", wraps=plain.started) as looked:
        (_, best), *_ = _begun(plain, 1, 150)
    assert looked.call_count <= 50
    least = min(plain.started(1, d)[1] for d in range(151))
    assert plain.started(1, best)[1] <= least * (1 + 1e-6)
    assert abs(best - delay) <= 2
