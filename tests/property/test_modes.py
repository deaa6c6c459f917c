"""Modes of 100 measured frequency responses of 1 to 6 modes, full and limited bands, 3 % noise, without options."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import settings
from scipy import signal

from engine.recordings.modal.modes import modes_of
from engine.recordings.spectra.averaged import averaged_frf

HZ = 2 * np.pi
RATE, SECONDS = 1024.0, 120
CASES = 100 if settings().max_examples > 1000 else 24
"""All at proof size; a share that has every number of modes, in both bands, twice."""


def structure(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return natural frequencies (Hz), damping ratios and static compliances of modes that can be told apart.

    They lie at least 20 % and four half-power widths apart, and their peaks are of one order of size.
    """
    rng = np.random.default_rng([100, seed])
    count = 1 + seed % 6
    while True:
        hz = np.sort(np.exp(rng.uniform(np.log(20), np.log(170), size=count)))
        zeta = rng.uniform(0.01, 0.03, size=count)
        wide = 2 * zeta * hz
        if (hz[1:] > 1.2 * hz[:-1]).all() and (np.diff(hz) > 2 * (wide[1:] + wide[:-1])).all():
            compliance = rng.uniform(0.5, 1.0, size=count) * rng.choice([-1, 1], size=count) * zeta / zeta.mean()
            return hz, zeta, compliance


def recorded(seed: int, hz: np.ndarray, zeta: np.ndarray, compliance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return force and motion: random force, the exact response to it, and noise of 3 % of the motion.

    Every other band ends at 200 of 512 Hz; the response is that of a periodic signal, line by line, so that nothing of how
    it is computed is in the result.
    """
    rng = np.random.default_rng([101, seed])
    force = rng.standard_normal(int(SECONDS * RATE))
    if (seed // 6) % 2:
        force = signal.sosfilt(signal.butter(8, (2, 200), "bandpass", fs=RATE, output="sos"), force)
    s = 2j * np.pi * np.fft.rfftfreq(force.size, 1 / RATE)
    response = sum(
        a * (HZ * f) ** 2 / (s**2 + 2 * z * HZ * f * s + (HZ * f) ** 2)
        for f, z, a in zip(hz, zeta, compliance, strict=True)
    )
    motion = np.fft.irfft(response * np.fft.rfft(force), force.size)
    return force, motion + 0.03 * motion.std() * rng.standard_normal(motion.size)


@pytest.mark.parametrize("seed", range(CASES))
def test_modes_are_found_without_options(seed: int) -> None:
    hz, zeta, compliance = structure(seed)
    force, motion = recorded(seed, hz, zeta, compliance)
    found = modes_of({"tip": averaged_frf([(force, motion)], RATE, segment=force.size // 8)}).modes
    assert [mode.frequency / HZ for mode in found] == pytest.approx(hz.tolist(), rel=5e-3)
    assert [mode.damping for mode in found] == pytest.approx(zeta.tolist(), rel=0.1)
