"""An electric prismatic servo drive, open loop: recorded force -> position, with friction that really stops.

The recording ("EMPS", Janot, Gautier, Brunot 2019) has no explicit licence for its data and is not part of the project:
SERVOTUNE_RECORDINGS names the folder that holds it. Published parameters: M 95.1089 kg, F_v 203.5034, F_c 20.3935,
offset -3.1648, whose open-loop simulation was computed to reach FIT 91.85; with friction that differs between the
directions 96.84, computed before this code existed.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat
from scipy.signal import butter, decimate, filtfilt

from engine.diagram import compile_system
from engine.nonlinear.integrate import Integration
from engine.signals import make
from engine.verdicts import Verdict
from tests.unit.engine.diagrams import block, document

RATE = 1000.0


@cache
def recording() -> tuple[np.ndarray, np.ndarray]:
    """Return force in N and position in m."""
    folder = os.environ.get("SERVOTUNE_RECORDINGS", "")
    path = Path(folder, "emps", "DATA_EMPS.mat")
    if not folder or not path.exists():
        pytest.skip(f"SERVOTUNE_RECORDINGS must name the folder with emps/DATA_EMPS.mat, got '{folder}'")
    data = loadmat(path)
    return data["gtau"].item() * data["vir"].ravel(), data["qm"].ravel()


def fit(mass: float, offset: float, **friction: float) -> float:
    force, position = recording()
    made = compile_system(
        document(
            {"u": block("input"), "n": block("sum", signs="+-"), "v": block("integrator", gain=1 / mass),
             "x": block("integrator", initial=float(position[0])), "f": block("friction", **friction)},
            ["u -> n.in1", "f -> n.in2", "n -> v", "v -> x", "v -> f"],
            {"x": "x"},
        )
    )  # fmt: skip
    t = np.arange(len(force)) / RATE
    command = make("sampled", {"time": t.tolist(), "values": (force - offset).tolist()})
    found = Integration(made.laws(), {"u": command}, tolerance=1e-8).advance(float(t[-1]))
    assert found.verdict is Verdict.OK
    simulated = found.output(0).sample(t)
    return 100 * (1 - np.linalg.norm(simulated - position) / np.linalg.norm(position - position.mean()))


def test_symmetric_friction():
    assert fit(95.1089, -3.1648, coulomb=20.3935, viscous=203.5034) == pytest.approx(91.85, abs=0.3)


def test_friction_of_its_own_in_each_direction():
    """Least squares on the filtered recording: 4th-order Butterworth at 100 Hz, central differences, decimated by 10."""
    force, position = recording()
    smooth = filtfilt(*butter(4, 100 / (RATE / 2)), position)
    velocity, acceleration = np.zeros((2, len(position)))
    velocity[1:-1] = (smooth[2:] - smooth[:-2]) * RATE / 2
    acceleration[1:-1] = (velocity[2:] - velocity[:-2]) * RATE / 2
    up, down = (velocity > 0).astype(float), (velocity < 0).astype(float)
    columns = [acceleration, velocity * up, velocity * down, up, down]
    rows = np.stack([decimate(c, 10, n=8, ftype="iir")[49:] for c in columns], axis=1)
    mass, viscous, viscous_negative, coulomb, coulomb_negative = np.linalg.lstsq(
        rows, decimate(force, 10, n=8, ftype="iir")[49:], rcond=None
    )[0]
    reached = fit(
        mass, 0.0, coulomb=coulomb, viscous=viscous, coulomb_negative=-coulomb_negative,
        viscous_negative=viscous_negative,
    )  # fmt: skip
    assert reached >= 96.84 - 0.3
