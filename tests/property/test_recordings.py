"""What no processing step and no frequency response function may depend on: units, superposition, the order of channels."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.model.errors import ProcessingError
from engine.recordings.processing.cut import Cut
from engine.recordings.processing.decimate import Decimate
from engine.recordings.processing.detrend import Detrend
from engine.recordings.processing.differentiate import Differentiate
from engine.recordings.processing.integrate import Integrate
from engine.recordings.processing.record import Record, Step, process
from engine.recordings.processing.resample import Resample
from engine.recordings.processing.zero_phase import ZeroPhaseFilter
from engine.recordings.spectra.averaged import averaged_frf
from engine.recordings.spectra.frf import confidence

RATE = 200.0

numbers = st.floats(-1e3, 1e3).filter(lambda value: abs(value) > 1e-3)
seeds = st.integers(0, 10_000)
bands = st.sampled_from(["low_pass", "high_pass"])
steps: st.SearchStrategy[Step] = st.one_of(
    st.builds(Cut, start=st.floats(0, 1), end=st.floats(1.5, 10)),
    st.builds(Detrend, trend=st.sampled_from(["mean", "linear"])),
    st.builds(Decimate, factor=st.integers(2, 7), keep=st.sampled_from(["first", "last"])),
    st.builds(ZeroPhaseFilter, band=bands, frequency=st.floats(20, 500), order=st.integers(1, 6)),
    st.builds(ZeroPhaseFilter, band=bands, frequency=st.floats(20, 500), family=st.just("chebyshev1")),
    st.builds(Resample, rate=st.sampled_from([50.0, 150.0, 320.0])),
    st.builds(Differentiate, channel=st.just("x")),
    st.builds(Integrate, channel=st.just("x")),
)


def noise(seed: int, samples: int = 600) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(samples)


def applied(x: np.ndarray, chosen: list[Step]) -> np.ndarray:
    return process(Record(rate=RATE, channels={"x": x}), chosen).channels["x"]


@given(seed=seeds, a=numbers, b=numbers, chosen=st.lists(steps, min_size=1, max_size=3))
def test_steps_are_linear(seed: int, a: float, b: float, chosen: list[Step]) -> None:
    try:
        one, other = applied(noise(seed), chosen), applied(noise(seed + 1), chosen)
    except ProcessingError:
        # several decimations can leave too little for the next filter; what is refused for one is refused for all
        with pytest.raises(ProcessingError):
            applied(a * noise(seed) + b * noise(seed + 1), chosen)
        return
    both = applied(a * noise(seed) + b * noise(seed + 1), chosen)
    size = abs(a) * np.abs(one).max() + abs(b) * np.abs(other).max()
    assert both == pytest.approx(a * one + b * other, abs=1e-9 * size)


@given(seed=seeds, chosen=st.lists(steps, min_size=1, max_size=2))
def test_a_recording_is_never_changed(seed: int, chosen: list[Step]) -> None:
    x = noise(seed, 2000)
    with contextlib.suppress(ProcessingError):  # what is refused changes nothing, either
        applied(x, chosen)
    assert (x == noise(seed, 2000)).all()


@given(seed=seeds, a=numbers, b=numbers, estimator=st.sampled_from(["H1", "H2", "Hv"]))
def test_units_scale_responses_and_their_bounds(seed: int, a: float, b: float, estimator: str) -> None:
    x = noise(seed)
    y = np.convolve(x, [0.5, 0.3, -0.2])[: x.size] + 0.3 * noise(seed + 1)
    before = averaged_frf([(x, y)], RATE, segment=64, estimator=estimator)
    after = averaged_frf([(a * x, b * y)], RATE, segment=64, estimator=estimator)
    assert after.value == pytest.approx(before.value * b / a, rel=1e-9)
    assert after.coherence == pytest.approx(before.coherence, abs=1e-9)
    old, new = confidence(before), confidence(after)
    assert old is not None
    assert new is not None
    assert new.magnitude_upper == pytest.approx(old.magnitude_upper * abs(b / a), rel=1e-6)


@given(seed=seeds)
def test_the_way_back_has_the_inverse_response(seed: int) -> None:
    x = noise(seed)
    y = np.convolve(x, [0.5, 0.3, -0.2])[: x.size] + 0.3 * noise(seed + 1)
    there = averaged_frf([(x, y)], RATE, segment=64, estimator="H1")
    back = averaged_frf([(y, x)], RATE, segment=64, estimator="H2")
    assert there.value * back.value == pytest.approx(np.ones(there.value.size), rel=1e-9)
    total = averaged_frf([(x, y)], RATE, segment=64, estimator="Hv")
    assert total.value * averaged_frf([(y, x)], RATE, segment=64, estimator="Hv").value == pytest.approx(
        np.ones(there.value.size), rel=1e-9
    )
