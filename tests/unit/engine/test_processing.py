"""Processing steps against analytic results and against another writing of the same filters."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from scipy import signal

from engine.model.errors import ProcessingError
from engine.recordings.processing.calibrate import Calibrate
from engine.recordings.processing.cut import Cut
from engine.recordings.processing.decimate import Decimate, decimated
from engine.recordings.processing.detrend import Detrend
from engine.recordings.processing.differentiate import Differentiate
from engine.recordings.processing.fill import Fill
from engine.recordings.processing.integrate import Integrate
from engine.recordings.processing.merge import appended, side_by_side
from engine.recordings.processing.record import Record, process
from engine.recordings.processing.resample import Resample, resampled
from engine.recordings.processing.select import Select
from engine.recordings.processing.zero_phase import ZeroPhaseFilter

RATE = 1000.0
HZ = 2 * np.pi


def record(rate: float = RATE, unit: str = "m", **channels: np.ndarray) -> Record:
    return Record(rate=rate, channels=channels, units=dict.fromkeys(channels, unit))


def sine(frequency: float, *, samples: int = 4000, rate: float = RATE, phase: float = 0.0) -> np.ndarray:
    return np.sin(HZ * frequency * np.arange(samples) / rate + phase)


def middle(values: np.ndarray) -> np.ndarray:
    return values[len(values) // 4 : -(len(values) // 4)]


def amplitude(values: np.ndarray, frequency: float, rate: float = RATE) -> complex:
    """Return the complex amplitude of a sine in the middle of samples, by least squares."""
    angle = HZ * frequency * np.arange(values.size) / rate
    basis = np.stack([np.sin(angle), np.cos(angle), np.ones_like(angle)], axis=1)
    s, c, _ = np.linalg.lstsq(middle(basis), middle(values), rcond=None)[0]
    return complex(s, c)


def test_the_steps_of_the_published_preprocessing_of_a_drive_can_be_expressed() -> None:
    # A. Janot, M. Gautier, M. Brunot, "Data Set and Reference Models of EMPS" (2019): Butterworth forward and backward,
    # central differences twice, 49 samples off, one of ten after an order-8 Chebyshev; written here with polynomials
    # and the padding of 3 (coefficients - 1) samples, where the steps use sections.
    rng = np.random.default_rng(1)
    position = np.cumsum(rng.standard_normal(5003)) * 1e-4 + 0.1 * sine(0.7, samples=5003)
    volts = rng.standard_normal(5003)
    done = process(
        record(q=position, force=volts),
        [
            Calibrate(channel="force", scale=35.15065188, unit="N"),
            ZeroPhaseFilter(band="low_pass", frequency=100 * HZ, order=4, channels=("q",)),
            Differentiate(channel="q", name="dq"),
            Differentiate(channel="dq", name="ddq"),
            Cut(start=0.049),
            Decimate(factor=10, keep="last"),
        ],
    )
    b, a = signal.butter(4, 100 / 500)
    q = signal.filtfilt(b, a, position, padlen=12)
    dq = np.concatenate([[q[1] - q[0]], (q[2:] - q[:-2]) / 2, [q[-1] - q[-2]]]) / 1e-3
    ddq = np.concatenate([[dq[1] - dq[0]], (dq[2:] - dq[:-2]) / 2, [dq[-1] - dq[-2]]]) / 1e-3
    b, a = signal.cheby1(8, 0.05, 0.8 / 10)
    for name, wanted in {"q": q, "dq": dq, "ddq": ddq, "force": 35.15065188 * volts}.items():
        full = signal.filtfilt(b, a, wanted[49:], padlen=24)
        # polynomials of order 8 with poles near 1 keep about eight digits
        assert done.channels[name] == pytest.approx(full[(full.size - 1) % 10 :: 10], rel=1e-6, abs=1e-6 * np.ptp(full))
    assert done.rate == 100.0
    assert done.begin == pytest.approx(0.049 + 0.003)
    assert dict(done.units) == {"q": "m", "force": "N", "dq": "m/s", "ddq": "m/s**2"}


@pytest.mark.parametrize(
    ("band", "edges", "frequency"),
    [("low_pass", 50.0, 30.0), ("low_pass", 50.0, 50.0), ("high_pass", 50.0, 70.0), ("band_pass", (40.0, 60.0), 42.0)],
)
def test_a_zero_phase_butterworth_has_the_squared_magnitude_and_no_phase(
    band: str, edges: float | tuple[float, float], frequency: float
) -> None:
    cutoff = tuple(HZ * edge for edge in edges) if isinstance(edges, tuple) else HZ * edges
    step = ZeroPhaseFilter(band=band, frequency=cutoff, order=3)
    done = step.apply(record(x=sine(frequency, samples=20_000)))
    # the bilinear transform with warped edges: |F|² = 1/(1 + v^(2 order)), v the frequency variable of the band
    w = np.tan(np.pi * frequency / RATE)
    low, *high = np.tan(np.pi * np.atleast_1d(edges) / RATE)
    v = (w**2 - low * high[0]) / (w * (high[0] - low)) if high else w / low if band == "low_pass" else low / w
    found = amplitude(done.channels["x"], frequency)
    assert found.real == pytest.approx(1 / (1 + v**6), rel=1e-6)
    assert found.imag == pytest.approx(0, abs=1e-6)


def test_a_chebyshev_leaves_its_ripple_twice_at_its_edge() -> None:
    step = ZeroPhaseFilter(band="low_pass", frequency=HZ * 50, order=4, family="chebyshev1", ripple=0.5)
    found = amplitude(step.apply(record(x=sine(50))).channels["x"], 50)
    assert abs(found) == pytest.approx(10 ** (-2 * 0.5 / 20), rel=1e-6)


def test_trends_are_those_of_least_squares() -> None:
    time = np.arange(500) / RATE
    noise = np.random.default_rng(2).standard_normal(500)
    values = 3 + 20 * time + noise
    done = Detrend(trend="linear").apply(record(x=values)).channels["x"]
    assert done == pytest.approx(values - np.polyval(np.polyfit(time, values, 1), time), abs=1e-11)
    assert Detrend().apply(record(x=values)).channels["x"] == pytest.approx(values - np.mean(values), abs=1e-12)


def test_a_derivative_has_the_gain_of_central_differences_and_an_integral_that_of_the_trapezoids() -> None:
    frequency = 20.0
    derivative = Differentiate(channel="x", name="v").apply(record(x=sine(frequency)))
    assert amplitude(derivative.channels["v"], frequency).imag == pytest.approx(
        np.sin(HZ * frequency / RATE) * RATE, rel=1e-9
    )
    assert derivative.channels["x"] == pytest.approx(sine(frequency))
    integral = Integrate(channel="x", name="s").apply(record(x=sine(frequency), unit="m/s**2"))
    assert amplitude(integral.channels["s"], frequency).imag == pytest.approx(
        -1 / (2 * RATE * np.tan(HZ * frequency / RATE / 2)), rel=1e-9
    )
    assert integral.units["s"] == "m/s"


def test_an_integral_with_a_high_pass_does_not_run_away() -> None:
    biased = sine(20, samples=20_000) + 0.1
    plain = Integrate(channel="x").apply(record(x=biased)).channels["x"]
    stated = Integrate(channel="x", high_pass=HZ * 1.0).apply(record(x=biased)).channels["x"]
    assert plain[-1] == pytest.approx(0.1 * 20, rel=0.01)  # 20 s of the offset
    assert np.abs(middle(stated)).max() == pytest.approx(1 / (HZ * 20), rel=0.02)


def test_a_stated_low_pass_is_the_filter_step_before_the_difference() -> None:
    noisy = record(x=np.random.default_rng(3).standard_normal(1000))
    both = Differentiate(channel="x", low_pass=HZ * 80, order=3).apply(noisy)
    apart = process(noisy, [ZeroPhaseFilter(band="low_pass", frequency=HZ * 80, order=3), Differentiate(channel="x")])
    assert both.channels["x"] == pytest.approx(apart.channels["x"], abs=1e-12)


def test_decimation_keeps_what_the_new_rate_can_show_and_nothing_else() -> None:
    slow, fast = sine(20, samples=20_000), sine(180, samples=20_000)  # 180 Hz would be folded to 20 Hz at 100 samples/s
    kept, folded = decimated(slow, 10), decimated(fast, 10)
    assert abs(amplitude(kept, 20, 100)) == pytest.approx(1, rel=0.012)  # 0.05 dB of ripple, twice
    assert abs(amplitude(folded, 20, 100)) < 1e-6
    assert decimated(slow, 7).size == -(-20_000 // 7)
    last = Decimate(factor=7, keep="last").apply(record(x=slow))
    assert last.begin == pytest.approx((19_999 % 7) / RATE)


@pytest.mark.parametrize(("rate", "ratio"), [(400.0, Fraction(2, 5)), (1500.0, Fraction(3, 2))])
def test_resampling_is_the_same_sine_at_other_instants(rate: float, ratio: Fraction) -> None:
    done = Resample(rate=rate).apply(record(x=5 + sine(40, samples=5000)))
    assert done.rate == pytest.approx(rate)
    found = done.channels["x"]
    assert found.size == int(np.ceil(5000 * ratio))
    time = np.arange(found.size) / rate
    assert middle(found) == pytest.approx(middle(5 + np.sin(HZ * 40 * time)), abs=5e-3)


def test_resampling_down_folds_nothing_back() -> None:
    assert np.abs(middle(resampled(sine(280, samples=5000), Fraction(2, 5)))).max() < 10 ** (-50 / 20)


def test_a_cut_holds_the_samples_within_both_ends() -> None:
    done = Cut(start=0.3, end=0.7).apply(record(rate=10, x=np.arange(20.0)))
    assert done.channels["x"].tolist() == [3, 4, 5, 6, 7]
    assert done.begin == pytest.approx(0.3)


def test_short_gaps_are_filled_and_long_ones_refused() -> None:
    values = np.array([0.0, np.nan, np.nan, 3.0, 4.0])
    assert Fill(longest=0.003).apply(record(x=values)).channels["x"] == pytest.approx([0, 1, 2, 3, 4])
    with pytest.raises(ProcessingError, match=r"gaps of channel x must be <= 0\.001 s, got 0\.002"):
        Fill(longest=0.001).apply(record(x=values))


def test_experiments_are_put_after_one_another_and_channels_beside() -> None:
    one, two = record(x=np.arange(3.0), y=np.ones(3)), record(y=np.zeros(2), x=np.arange(2.0))
    merged = appended([one, two])
    assert merged.record.channels["x"].tolist() == [0, 1, 2, 0, 1]
    assert merged.experiments == (3, 2)
    beside = side_by_side([one, record(unit="N", force=np.arange(3.0))])
    assert list(beside.record.channels) == ["x", "y", "force"]
    assert beside.record.unit("force") == "N"


@pytest.mark.parametrize(
    ("records", "rule"),
    [
        ([record(x=np.ones(3)), record(x=np.ones(3), rate=500.0)], "rate must be that of the first"),
        ([record(x=np.ones(3)), record(x=np.ones(3), unit="mm")], "unit of x must be that of the first"),
        ([record(x=np.ones(3)), record(y=np.ones(3))], "channels must be those of the first"),
    ],
)
def test_different_experiments_are_not_merged(records: list[Record], rule: str) -> None:
    with pytest.raises(ProcessingError, match=rule):
        appended(records)


def test_channels_of_different_length_are_not_put_beside_one_another() -> None:
    with pytest.raises(ProcessingError, match=r"samples must be as many as those of the first \(3\), got 4"):
        side_by_side([record(x=np.ones(3)), record(y=np.ones(4))])
    with pytest.raises(ProcessingError, match="got channel x twice"):
        side_by_side([record(x=np.ones(3)), record(x=np.ones(3))])


@pytest.mark.parametrize(
    ("make", "rule"),
    [
        (lambda: ZeroPhaseFilter(band="low_pass", frequency=HZ * 500), "frequency must be < 3141.59 rad/s"),
        (lambda: ZeroPhaseFilter(band="band_pass", frequency=5.0), "frequency must be two edges"),
        (lambda: ZeroPhaseFilter(band="low_pass", frequency=-5.0), "frequency must be > 0 rad/s"),
        (lambda: ZeroPhaseFilter(band="low_pass", frequency=5.0, order=0), "order must be 1 to 20, got 0"),
        (lambda: ZeroPhaseFilter(band="low_pass", frequency=5.0, order=20), "recording must be > 60 samples"),
        (lambda: ZeroPhaseFilter(band="low_pass", frequency=5.0, channels=("y",)), "recording's \\(x\\), got 'y'"),
        (lambda: Decimate(factor=1), "factor must be 2 to 100, got 1"),
        (lambda: Resample(rate=RATE * np.pi), "rate must be a/b of the recording's 1000"),
        (lambda: Resample(rate=0.0), "rate must be > 0"),
        (lambda: Cut(start=1.0, end=0.5), "start and end must be 0 <= start < end s"),
        (lambda: Cut(start=7.0), "must hold at least one of the samples"),
        (lambda: Calibrate(channel="x", scale=0.0), "scale must be finite and not 0"),
        (lambda: Select(channels=()), "channels must be at least one"),
        (lambda: Integrate(channel="force"), "got 'force'"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_refused(make, rule: str) -> None:
    with pytest.raises(ProcessingError, match=rule):
        process(record(x=np.ones(50)), [make()])


@pytest.mark.parametrize("family", ["butterworth", "chebyshev1"])
@pytest.mark.parametrize("order", [1, 2, 4, 8, 20])
@pytest.mark.parametrize("band", ["low_pass", "high_pass", "band_pass", "band_stop"])
def test_no_edge_gives_numbers_that_rounding_has_made(band, order: int, family) -> None:
    """Of a constant a filter leaves all or nothing, whatever its edge: forward and backward, with its ripple at most."""
    constant = record(x=np.ones(500))
    rng = np.random.default_rng(3)
    noise = record(x=rng.standard_normal(2000))
    done, places = 0, set()
    for edge in [1e-300, 1e-100, 1e-20, *np.geomspace(1e-9, 3000.0, 25)]:
        for frequency in (
            [edge] if band.endswith("_pass") and not band.startswith("band") else [(edge, 1.001 * edge), (edge, 3050.0)]
        ):
            step = ZeroPhaseFilter(band=band, frequency=frequency, order=order, family=family)
            try:
                held, filtered = step.apply(constant).values("x"), step.apply(noise).values("x")
            except ProcessingError as error:
                places.add(error.at)
                continue
            done += 1
            wanted = (1.0, 10 ** (-0.1 / 20)) if band in {"low_pass", "band_stop"} else (0.0, 0.0)
            assert min(np.abs(held - value).max() for value in wanted) < 2e-3
            assert np.abs(filtered).max() < 100 * np.abs(noise.values("x")).max()
    assert done > 3
    assert places == {("frequency",)}


def test_an_edge_that_float64_does_not_resolve_is_named_with_the_least_that_it_does() -> None:
    """A pole at a distance of 0.001 rad/s over 1000 samples/s has the square 1e-12, of which rounding leaves four digits."""
    with pytest.raises(
        ProcessingError, match=r"frequency must be >= 0.00101 rad/s, .* at 1000 samples/s .*, got 6.3e-12"
    ):
        ZeroPhaseFilter(band="low_pass", frequency=6.3e-12).apply(record(x=sine(5)))
    ZeroPhaseFilter(band="low_pass", frequency=0.00101).apply(record(x=sine(5)))
    for step, name in (
        (Differentiate(channel="x", low_pass=1e-12), "low_pass"),
        (Integrate(channel="x", high_pass=1e-12), "high_pass"),
        (Integrate(channel="x", high_pass=4000.0), "high_pass"),
    ):
        with pytest.raises(ProcessingError, match=f"{name} must be") as caught:
            process(record(x=sine(5)), [step])
        assert caught.value.at == ("steps", 0, name)


def test_numbers_beyond_float64_are_refused_by_name() -> None:
    slow = record(rate=1e-3, x=sine(5))
    with pytest.raises(ProcessingError, match=r"rate must be a/b of the recording's 0.001 samples/s .*, got 1.7e\+308"):
        Resample(rate=1.7e308).apply(slow)
    with pytest.raises(
        ProcessingError, match=r"scale must leave the samples of channel x within float64, got 1.7e\+308"
    ):
        Calibrate(channel="x", scale=1.7e308).apply(record(x=3 * sine(5)))
    with pytest.raises(ProcessingError, match="ripple must be > 1e-15 dB"):
        Decimate(factor=2, ripple=1e-300).apply(slow)


def test_missing_samples_are_named_with_their_place() -> None:
    values = np.ones(100)
    values[40:43] = np.nan
    with pytest.raises(
        ProcessingError, match=r"channel x must have no missing .* got 3, the first at 0\.04 s"
    ) as caught:
        process(record(x=values), [Cut(), Detrend()])
    assert caught.value.at[:2] == ("steps", 1)
    assert process(record(x=values), [Cut(start=0.05), Detrend()]).samples == 50


def test_a_record_stays_as_it_was() -> None:
    values = sine(20, samples=400)
    given = record(x=values.copy())
    process(given, [Calibrate(channel="x", scale=2.0), Detrend(), Cut(end=0.1), Decimate(factor=2)])
    assert given.channels["x"].tolist() == values.tolist()
