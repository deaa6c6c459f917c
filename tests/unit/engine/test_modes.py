"""Modes of frequency response functions whose modes are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from engine.model.errors import SpectrumError
from engine.recordings.modal.modes import modes_of
from engine.recordings.spectra.averaged import averaged_frf
from engine.recordings.spectra.frf import Frf

HZ = 2 * np.pi
TRUE = ((40.0, 0.02), (95.0, 0.01), (210.0, 0.015))
SHAPES = {"tip": (1.0, 0.6, 0.8), "middle": (0.7, -0.42, 0.4), "base": (-0.4, 0.18, 0.72)}


def frf(shape: tuple[float, ...], w: np.ndarray, *, noise: float, seed: int, modes=TRUE) -> Frf:
    """Return Σ φ/(ω0² - ω² + 2jζω0ω), every line with a relative circular error."""
    s = 1j * w
    value = sum(
        phi / ((HZ * f) ** 2 + s**2 + 2 * zeta * HZ * f * s) for phi, (f, zeta) in zip(shape, modes, strict=True)
    )
    error = np.full(w.size, noise) if noise else None
    if noise:
        rng = np.random.default_rng(seed)
        value = value * (1 + noise * (rng.standard_normal(w.size) + 1j * rng.standard_normal(w.size)))
    return Frf(frequency=w, value=value, magnitude_error=error, phase_error=error)


def structure(*, noise: float = 0.0, seed: int = 0) -> dict[str, Frf]:
    w = HZ * np.arange(10, 400, 1.25)
    return {name: frf(shape, w, noise=noise, seed=10 * seed + i) for i, (name, shape) in enumerate(SHAPES.items())}


def test_three_modes_are_found_exactly_without_noise() -> None:
    found = modes_of(structure())
    assert [mode.frequency / HZ for mode in found.modes] == pytest.approx([f for f, _ in TRUE], rel=1e-9)
    assert [mode.damping for mode in found.modes] == pytest.approx([zeta for _, zeta in TRUE], rel=1e-7)
    # φ/((jω - λ)(jω - λ*)): A = φ/(λ - λ*) = φ/(2jω_d)
    first, (f, zeta) = found.modes[0], TRUE[0]
    assert first.residues["base"] == pytest.approx(-0.4 / (2j * HZ * f * np.sqrt(1 - zeta**2)), rel=1e-6)
    assert found.relative_error_percent < 1e-6


def test_the_stated_errors_hold_the_truth() -> None:
    hits = []
    for seed in range(25):
        found = modes_of(structure(noise=0.05, seed=seed))
        assert len(found.modes) == 3
        for mode, (f, zeta) in zip(found.modes, TRUE, strict=True):
            hits.append(abs(mode.frequency - HZ * f) < 1.96 * mode.frequency_error)
            hits.append(abs(mode.damping - zeta) < 1.96 * mode.damping_error)
    assert 0.9 < np.mean(hits) < 0.99  # 150 statements at 95 %


def test_close_modes_are_told_apart() -> None:
    modes = ((50.0, 0.01), (51.5, 0.01))
    w = HZ * np.arange(30, 80, 0.1)
    found = modes_of({"x": frf((1.0, 0.7), w, noise=0.01, seed=4, modes=modes)})
    assert [mode.frequency / HZ for mode in found.modes] == pytest.approx([50, 51.5], abs=0.05)
    assert [mode.damping for mode in found.modes] == pytest.approx([0.01, 0.01], rel=0.1)


def test_a_heavily_damped_mode_is_found() -> None:
    w = HZ * np.arange(0.5, 40, 0.1)
    found = modes_of({"x": frf((1.0,), w, noise=0.02, seed=5, modes=((8.0, 0.6),))})
    (mode,) = found.modes
    assert mode.frequency == pytest.approx(HZ * 8, rel=0.02)
    assert mode.damping == pytest.approx(0.6, rel=0.03)


def test_the_most_needed_modes_are_kept_when_fewer_are_asked_for() -> None:
    found = modes_of(structure(), count=2)
    assert [round(mode.frequency / HZ) for mode in found.modes] == [40, 95]


def test_noise_has_no_modes_to_speak_of() -> None:
    rng = np.random.default_rng(6)
    w = HZ * np.arange(10, 100, 0.5)
    value = 1 + 0.05 * (rng.standard_normal(w.size) + 1j * rng.standard_normal(w.size))
    error = np.full(w.size, 0.05)
    found = modes_of({"x": Frf(frequency=w, value=value, magnitude_error=error, phase_error=error)})
    assert len(found.modes) <= 1  # a gain alone: at most one that the doubt marks
    assert all(mode.doubt or mode.damping_error > 0.1 * mode.damping for mode in found.modes)


def test_a_measured_resonance_is_found_with_its_error() -> None:
    rate, f, zeta = 1024.0, 40.0, 0.03
    w0 = HZ * f
    b, a, _ = signal.cont2discrete(([1.0], [1.0, 2 * zeta * w0, w0**2]), 1 / rate, method="bilinear")
    rng = np.random.default_rng(7)
    x = rng.standard_normal(int(rate) * 120)
    y = signal.lfilter(b.ravel(), a, x)
    y += 0.1 * y.std() * rng.standard_normal(y.size)
    measured = averaged_frf([(x, y)], rate, segment=8192).within(HZ * 20, HZ * 80)
    (mode,) = modes_of({"y": measured}).modes
    # the poles of the bilinear transform: w = 2 rate tan(Ω/2)
    root = np.roots(a)[0]
    pole = np.log(root) * rate
    assert abs(mode.frequency - abs(pole)) < 3 * mode.frequency_error
    assert abs(mode.damping + pole.real / abs(pole)) < 3 * mode.damping_error + 0.01 * zeta  # 20 lines in its width
    assert mode.damping_error < 0.02 * zeta
    assert mode.doubt == ""
    coarse = averaged_frf([(x, y)], rate, segment=512).within(HZ * 4, HZ * 300)
    (doubtful,) = modes_of({"y": coarse}).modes
    assert "too far apart" in doubtful.doubt


def test_what_has_no_modes_is_refused() -> None:
    with pytest.raises(SpectrumError, match="band must hold at least 12 lines to find modes, got 5"):
        modes_of({"x": Frf(frequency=np.arange(1.0, 6), value=np.ones(5, dtype=complex))})
    with pytest.raises(SpectrumError, match="count must be <= "):
        modes_of(structure(), count=15)
    with pytest.raises(SpectrumError, match="count must be 1 to 20, got 0"):
        modes_of(structure(), count=0)


def limited(modes: tuple[tuple[float, float], ...], *, seed: int) -> Frf:
    """Return a response measured with random force from 2 to 200 Hz of 512 and 3 % noise."""
    rate, rng = 1024.0, np.random.default_rng(seed)
    white = rng.standard_normal(60 * 1024)
    force = signal.sosfilt(signal.butter(8, (2, 200), "bandpass", fs=rate, output="sos"), white)
    moved = np.zeros(force.size)
    for f, zeta in modes:
        held = signal.cont2discrete(([(HZ * f) ** 2], [1.0, 2 * zeta * HZ * f, (HZ * f) ** 2]), 1 / rate)
        moved += signal.lfilter(held[0].ravel(), held[1], force)
    moved += 0.03 * moved.std() * rng.standard_normal(force.size)
    return averaged_frf([(force, moved)], rate, segment=4096)


@pytest.mark.parametrize(
    "modes",
    [
        ((40.0, 0.02), (95.0, 0.02), (150.0, 0.015)),
        ((25.0, 0.025), (40.0, 0.02), (60.0, 0.022), (86.0, 0.03), (108.0, 0.024), (123.5, 0.018)),
    ],
    ids=["three", "six"],
)
def test_lines_without_excitation_are_left_out(modes: tuple[tuple[float, float], ...]) -> None:
    """What lies beyond the band of the force is noise over nothing, and no mode."""
    found = modes_of({"tip": limited(modes, seed=0)})
    assert [mode.frequency / HZ for mode in found.modes] == pytest.approx([f for f, _ in modes], rel=5e-3)
    assert [mode.damping for mode in found.modes] == pytest.approx([zeta for _, zeta in modes], rel=0.1)
    assert found.relative_error_percent < 5
    assert found.left_out > 1000  # of 2049
    assert found.frequency[-1] < HZ * 300
