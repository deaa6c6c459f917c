"""The H2 norm and the noise that a path lets through: against formulas, python-control, mpmath and a closed form with a delay."""

from __future__ import annotations

import itertools
import math

import control
import mpmath as mp
import numpy as np
import pytest

from engine.analysis.frequency_study import frequency_response
from engine.analysis.measuring import MetricRequest, measure
from engine.diagram.diagram import Diagram
from engine.exact.frequency import h2
from engine.model.metric_options import Options
from engine.model.verdicts import Verdict
from tests.reference.systems import block, system

NORM = MetricRequest(metric="h2_norm", source="r", target="y")


def noise(density: float) -> MetricRequest:
    return MetricRequest(metric="noise_rms", source="r", target="y", options=Options(noise_density=density))


def mode() -> Diagram:
    blocks = {
        "r": block("input"),
        "mode": block("transfer_function", numerator=["=g*w**2"], denominator=[1, "=2*z*w", "=w**2"]),
    }
    return system(blocks, ["r -> mode"], {"y": "mode"}, {"g": 3.0, "w": 8.0, "z": 0.2})


def chain(*poles: float) -> Diagram:
    """Π p/(s + p)."""
    lags = {f"b{k}": block("transfer_function", numerator=[p], denominator=[1, p]) for k, p in enumerate(poles)}
    names = ["r", *lags]
    wires = [f"{a} -> {b}" for a, b in itertools.pairwise(names)]
    return system({"r": block("input"), **lags}, wires, {"y": names[-1]})


def delayed_loop() -> Diagram:
    """x' = k (r - x)(t - delay)."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "k": block("gain", gain="=k"),
        "late": block("delay", time="=t"), "x": block("integrator"),
    }  # fmt: skip
    wires = ["r -> e.in1", "x -> e.in2", "e -> k", "k -> late", "late -> x"]
    return system(blocks, wires, {"y": "x", "e": "e"}, {"k": 1.2, "t": 0.7})


@pytest.mark.parametrize("by_gramians", [True, False])
def test_of_a_mode_it_is_that_of_the_textbooks(by_gramians: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    # ∫ g² dt of g w²/(s² + 2 z w s + w²) is g² w/(4 z); both ways to find it say the same, derivatives as well
    if not by_gramians:
        monkeypatch.setattr(h2, "_by_gramians", lambda _system: None)
    ((found, gradient),) = measure(mode(), [NORM], gradient=["g", "w", "z"])
    norm = 3 * math.sqrt(8 / 0.8)
    assert (found.unit, found.verdict) == ("1/s**0.5", Verdict.OK)
    assert found.value == pytest.approx(norm, rel=1e-12)
    assert gradient is not None
    assert gradient.values == pytest.approx([norm / 3, norm / 16, -norm / 0.4], rel=1e-11)


def test_noise_is_half_the_one_sided_density_times_the_energy() -> None:
    # white noise of S per Hz through a lag: the equivalent bandwidth is a/4 Hz, σ² = S a/4
    ((found, gradient),) = measure(
        system(
            {"r": block("input"), "lag": block("transfer_function", numerator=["=a"], denominator=[1, "=a"])},
            ["r -> lag"], {"y": "lag"}, {"a": 100.0},
        ),
        [noise(4e-6)], gradient=["a"],
    )  # fmt: skip
    assert found.value == pytest.approx(math.sqrt(4e-6 * 100 / 4), rel=1e-12)
    assert gradient is not None
    assert gradient.values == pytest.approx([found.value / 200], rel=1e-11)


def test_a_hundred_random_systems_are_those_of_python_control() -> None:
    random = np.random.default_rng(27)
    for _ in range(100):
        n = int(random.integers(1, 8))
        poles = -np.exp(random.uniform(-2, 4, n)) * np.exp(1j * random.uniform(-1.4, 1.4, n))
        poles = np.concatenate([poles, poles.conj()])
        denominator = np.poly(poles).real
        numerator = random.normal(size=n) * denominator[-n:]
        diagram = system(
            {"r": block("input"), "g": block("transfer_function", numerator=numerator.tolist(), denominator=denominator.tolist())},
            ["r -> g"], {"y": "g"},
        )  # fmt: skip
        ((found, _),) = measure(diagram, [NORM])
        zeros = np.roots(numerator)
        reference = control.norm(control.ss(control.zpk(zeros, poles, numerator[np.flatnonzero(numerator)[0]])), 2)
        assert found.value == pytest.approx(float(reference), rel=1e-6)


@pytest.mark.parametrize("poles", [(1e-3, 1.0, 1e5, 3e5), (1e-4, 1e4, 1e8, 1e9), tuple(1 + k / 10 for k in range(10))])
def test_rates_far_apart_and_close_together_keep_their_digits(poles: tuple[float, ...]) -> None:
    # Σ r_i r_j / (p_i + p_j) of the residues, in 60 digits
    with mp.workdps(60):
        p = [mp.mpf(repr(pole)) for pole in poles]
        r = [mp.fprod(p) / mp.fprod(b - a for b in p if b != a) for a in p]
        exact = mp.sqrt(mp.fsum(x * y / (a + b) for x, a in zip(r, p, strict=True) for y, b in zip(r, p, strict=True)))
    ((found, _),) = measure(chain(*poles), [NORM])
    assert found.value == pytest.approx(float(exact), rel=1e-12)


@pytest.mark.parametrize(("gain", "delay"), [(0.2, 1.0), (1.0, 1.0), (1.5, 1.0), (30.0, 0.01)])
def test_a_loop_with_a_delay_has_its_closed_form(gain: float, delay: float) -> None:
    # U. Küchler, B. Mensch (1992): ∫ x² of x' = -k x(t - τ), x(0) = 1, is (1 + sin kτ) / (2 k cos kτ)
    values = {"k": gain, "t": delay}
    ((found, gradient),) = measure(delayed_loop(), [NORM], overrides=values, gradient=["k", "t"])

    def norm(k: mp.mpf, t: mp.mpf) -> mp.mpf:
        return mp.sqrt(k * (1 + mp.sin(k * t)) / (2 * mp.cos(k * t)))

    assert found.value == pytest.approx(float(norm(gain, delay)), rel=1e-12)
    assert gradient is not None
    slopes = [float(mp.diff(norm, (gain, delay), order)) for order in ((1, 0), (0, 1))]
    assert gradient.values == pytest.approx(slopes, rel=1e-9)


@pytest.mark.parametrize("delay", [1e-3, 0.5, 40.0])
def test_an_echo_beside_the_signal_counts(delay: float) -> None:
    # (1 + e^(-sτ)) / (s + 1): ∫ g² = 1 + e^-τ
    blocks = {
        "r": block("input"), "late": block("delay", time=delay), "s": block("sum", signs="++"),
        "lag": block("transfer_function", numerator=[1], denominator=[1, 1]),
    }  # fmt: skip
    diagram = system(blocks, ["r -> late", "r -> s.in1", "late -> s.in2", "s -> lag"], {"y": "lag"})
    ((found, _),) = measure(diagram, [NORM])
    assert found.value == pytest.approx(math.sqrt(1 + math.exp(-delay)), rel=1e-12)


def lone(kind: str, **values: object) -> Diagram:
    return system({"r": block("input"), "g": block(kind, **values)}, ["r -> g"], {"y": "g"})


@pytest.mark.parametrize(
    ("diagram", "verdict"),
    [
        (lone("transfer_function", numerator=[1, 0], denominator=[1, 1]), Verdict.DIVERGES),
        (lone("gain", gain=2.0), Verdict.DIVERGES),
        (lone("delay", time=0.1), Verdict.DIVERGES),
        (lone("integrator"), Verdict.DIVERGES),
        (lone("transfer_function", numerator=[1], denominator=[1, 0, 4]), Verdict.DIVERGES),
        (lone("transfer_function", numerator=[1], denominator=[1, -1]), Verdict.UNSTABLE),
    ],
)
def test_where_its_power_is_infinite_it_says_so(diagram: Diagram, verdict: Verdict) -> None:
    for request in (NORM, noise(1.0)):
        ((found, _),) = measure(diagram, [request])
        assert (found.value, found.verdict) == (None, verdict)
        assert found.advice


def test_an_impulse_that_comes_back_through_a_delay_is_noticed() -> None:
    # r -> e is a direct gain; r -> y is none
    ((through, _),) = measure(delayed_loop(), [MetricRequest(metric="h2_norm", source="r", target="e")])
    assert through.verdict is Verdict.DIVERGES


def test_it_is_shown_where_it_is_asked_for() -> None:
    assert not {"h2_norm", "noise_rms"} & set(frequency_response(mode(), source="r", target="y").metrics)
    given = frequency_response(mode(), source="r", target="y", options=Options(noise_density=2.0)).metrics
    assert given["noise_rms"].value == pytest.approx(3 * math.sqrt(10), rel=1e-12)
    asked = frequency_response(mode(), source="r", target="y", metrics=["h2_norm", "noise_rms"]).metrics
    assert asked["h2_norm"].verdict is Verdict.OK
    assert asked["noise_rms"].verdict is Verdict.NOT_APPLICABLE
    assert "noise_density" in asked["noise_rms"].advice
