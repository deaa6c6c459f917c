"""Identifications are bounded before they start: what they take is told, refused where it is too much, and further starts are counted."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.model.between_samples import BetweenSamples
from optimizers.black_box import black_box, checked
from optimizers.black_box.thinning import thinned
from optimizers.identification import expected, identify
from optimizers.problem import ProblemError, Variable
from optimizers.recorded.recorded_data import doubted_samples
from optimizers.recorded.recording import Identification, RecordedExperiment, Recording

H = 1e-4
TAU = 0.2


def late_lag() -> Diagram:
    return compile_system(
        System(
            name="lag",
            parameters={
                "k": Parameter(value=1.0, lower=0.1, upper=10.0), "T": Parameter(value=0.3, lower=1e-3, upper=10.0),
                "L": Parameter(value=0.01, lower=0.0, upper=1.0),
            },
            blocks={
                "u": Block(kind="input"),
                "plant": Block(kind="transfer_function", values={"numerator": ["=k"], "denominator": ["=T", 1.0]}),
                "late": Block(kind="delay", values={"time": "=L"}),
            },
            connections=(Connection(source="u", target="plant"), Connection(source="plant", target="late")),
            outputs={"y": "late"},
        )
    )  # fmt: skip


def stepped(samples: int, *, h: float = H, late: int = 700, noise: float = 0.02) -> Recording:
    """Return one step of a lag behind a delay, by the recursion of a held input."""
    u = np.where(np.arange(samples) >= samples // 10, 1.0, 0.0)
    pole = np.exp(-h / TAU)
    y = lfilter([0.0, 2.0 * (1 - pole)], [1.0, -pole], np.concatenate([np.zeros(late), u[: samples - late]]))
    y = y + noise * np.random.default_rng(5).normal(size=samples)
    return Recording(inputs={"u": u}, outputs={"y": y}, sample_time=h, undecided=("u",))


def asked(recording: Recording, **options: int) -> Identification:
    return Identification(
        diagram=late_lag(), experiments=(RecordedExperiment(recording=recording, split=1.0),),
        parameters=tuple(Variable(parameter=name) for name in ("k", "T", "L")), **options,
    )  # fmt: skip


def test_a_late_lag_is_found_from_one_step_of_5000_samples_whatever_its_input_does_between_them():
    found = identify(asked(stepped(5000, h=0.002, late=35)), rng=np.random.default_rng(0))
    assert found.parameters["k"].value == pytest.approx(2.0, rel=0.01)
    assert found.parameters["T"].value == pytest.approx(TAU, rel=0.02)
    assert found.parameters["L"].value == pytest.approx(0.07, abs=0.004)
    assert found.evaluations <= 40
    assert any("moves once" in sentence for sentence in found.warnings)


def test_what_it_takes_grows_with_samples_starts_and_ways():
    short, long = expected(asked(stepped(20_000))), expected(asked(stepped(200_000)))
    assert long.bytes == pytest.approx(10 * short.bytes)
    assert long.seconds > 5 * short.seconds
    assert expected(asked(stepped(20_000), starts=5)).evaluations > 3 * short.evaluations
    told = stepped(20_000).with_undecided(BetweenSamples.HOLD)
    assert expected(asked(told)).evaluations < short.evaluations
    assert expected(asked(told)).bytes < short.bytes


def test_more_memory_than_a_worker_has_is_refused_with_the_remedy():
    silent = np.zeros(9_000_000)
    silent[1] = 1.0
    recording = Recording(inputs={"u": silent}, outputs={"y": silent}, sample_time=H, undecided=("u",))
    with pytest.raises(ProblemError, match=r"must fit into 4 GB, 9,000,000 samples .* decimated"):
        expected(asked(recording))
    with pytest.raises(ProblemError, match=r"must fit into 0\.5 GB"):
        expected(asked(recording), most_bytes=5e8)
    assert expected(asked(recording), most_bytes=math.inf).bytes > 4e9


def test_further_starts_are_counted():
    """A start that cannot lead anywhere: the unit of the output is a wrong one."""
    recording = stepped(1500, h=0.004, late=20)
    wrong = Recording(
        inputs=recording.inputs, outputs={"y": -1000 * recording.outputs["y"]}, sample_time=0.004, undecided=("u",)
    )
    found = identify(asked(wrong), rng=np.random.default_rng(0))
    assert found.evaluations <= 200  # were more than 600: further starts of every way between the samples
    assert any("sign" in sentence for sentence in found.warnings)


def test_a_recording_far_finer_than_what_moves_is_fitted_by_means():
    recording = stepped(60_000).with_undecided(BetweenSamples.HOLD)
    experiment = RecordedExperiment(recording=recording, split=1.0)
    means, together = thinned(experiment)
    assert together >= 5
    for name in ("u", "y"):
        signals = recording.inputs | recording.outputs
        own = means.recording.inputs | means.recording.outputs
        assert own[name][3] == pytest.approx(signals[name][3 * together : 4 * together].mean())
    found = black_box(experiment, method="transfer_function", orders=(1, 2, 3), largest_delay=0.2)
    assert any(f"means of {together} samples" in sentence for sentence in found.warnings)
    slowest = found.system.poles[np.argmin(np.abs(found.system.poles))]
    assert -1 / slowest.real == pytest.approx(TAU, rel=0.05)
    assert found.delay == pytest.approx(0.07, abs=2 * together * H)


@pytest.mark.parametrize("denominator", [[1.0, -0.5], [1.0]])
def test_a_recording_whose_output_moves_from_sample_to_sample_stays_as_it_is(denominator):
    rng = np.random.default_rng(3)
    u = rng.normal(size=40_000)
    slow = lfilter([1e-3], [1.0, -0.999], u)  # what a flat spectrum stands above is not all that there is
    y = lfilter([0.0, 0.5], denominator, u) + 20 * slow + 0.5 * rng.normal(size=u.size)
    experiment = RecordedExperiment(recording=Recording(inputs={"u": u}, outputs={"y": y}, sample_time=H), split=1.0)
    assert thinned(experiment) == (experiment, 1)


def test_delays_up_to_a_quarter_of_the_recording_are_searched():
    experiment = RecordedExperiment(recording=stepped(4000, late=900), split=1.0)
    found = black_box(experiment, method="transfer_function", orders=(1,), largest_delay=0.1)
    assert found.delay == pytest.approx(0.09, abs=2e-3)
    for wrong in (0.11, -0.01, math.nan, math.inf):
        with pytest.raises(ProblemError, match=r"largest_delay must be 0 to 0.1 s"):
            checked(experiment, "transfer_function", (1,), wrong)


def test_regressions_that_no_memory_holds_are_refused():
    rng = np.random.default_rng(4)
    signals = rng.normal(size=(20, 40_000))
    names = [f"s{k}" for k in range(20)]
    recording = Recording(
        inputs=dict(zip(names, signals, strict=True)),
        outputs=dict(zip(names, signals[::-1], strict=True)),
        sample_time=H,
    )
    with pytest.raises(ProblemError, match="regressions fit into 4 GB"):
        checked(RecordedExperiment(recording=recording, split=1.0), "subspace", (20,), 0.0)
    with pytest.raises(ProblemError, match=r"regressions fit into 0\.01 GB"):
        checked(RecordedExperiment(recording=recording, split=1.0), "subspace", (2,), 0.0, most_bytes=1e7)


def test_an_order_is_not_judged_where_nothing_moves():
    """The step is long over where the model would be validated: every model without dynamics fits there."""
    recording = stepped(8000, h=0.002, late=0)
    found = black_box(RecordedExperiment(recording=recording, split=0.6), method="transfer_function", orders=(1, 2))
    assert any("no input moves where the model is validated" in sentence for sentence in found.warnings)
    moved = Recording(
        inputs={"u": np.tile(recording.inputs["u"], 2)},
        outputs={"y": np.tile(recording.outputs["y"], 2)},
        sample_time=0.002,
    )
    again = black_box(RecordedExperiment(recording=moved, split=0.5), method="transfer_function", orders=(1, 2))
    assert not any("no input moves" in sentence for sentence in again.warnings)


def test_a_model_that_misses_a_command_is_no_outlier():
    rng = np.random.default_rng(6)
    smooth = np.convolve(rng.normal(size=2000), np.ones(50) / 50, mode="same") * 10
    spiked = smooth.copy()
    spiked[[300, 900, 1500]] += 20.0
    noise = 0.01 * rng.normal(size=2000)
    assert doubted_samples(smooth + noise, spiked, "y") == ()  # the model jumps, and nothing that was measured
    (sentence,) = doubted_samples(spiked + noise, smooth, "y")
    assert sentence.startswith("3 samples of y")
