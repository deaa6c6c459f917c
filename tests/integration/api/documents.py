"""Documents that many tests send."""

from __future__ import annotations

import copy
import hashlib
from typing import Any

import httpx
import numpy as np

#: The pneumatic loop of the reference tests, in the units of the paper.
PNEUMATIC: dict[str, Any] = {
    "name": "LPM position loop",
    "parameters": {
        "kp": {
            "value": 100,
            "unit": "cm**2/s",
            "lower": {"value": 20, "unit": "cm**2/s"},
            "upper": {"value": 250, "unit": "cm**2/s"},
            "doc": "proportional gain",
        },
        "m": {"value": 0.3, "unit": "daN*s**2/cm"},
    },
    "blocks": {
        "reference": {"kind": "input"},
        "load": {"kind": "input", "role": "disturbance"},
        "error": {"kind": "sum", "signs": "+-"},
        "controller": {
            "kind": "pid",
            "kp": "=kp",
            "ki": {"value": 20, "unit": "cm**2/s**2"},
            "kd": {"value": 5, "unit": "cm**2"},
            "filter_frequency": 100,
        },
        "motor": {
            "kind": "linear_pneumatic_motor",
            "area": {"value": 65, "unit": "cm**2"},
            "volume": {"value": 750, "unit": "cm**3"},
            "pressure": {"value": 5, "unit": "daN/cm**2"},
            "adiabatic_index": 1.4,
            "leakage": {"value": 0.4, "unit": "cm**5/(daN*s)"},
            "mass": "=m",
            "viscous_friction": {"value": 1.2, "unit": "daN*s/cm"},
        },
    },
    "connections": [
        {"from": "reference", "to": "error.in1"},
        {"from": "motor.position", "to": "error.in2"},
        {"from": "error", "to": "controller"},
        {"from": "controller", "to": "motor.flow"},
        {"from": "load", "to": "motor.force"},
    ],
    "outputs": {
        "position": "motor.position",
        "velocity": "motor.velocity",
        "acceleration": "motor.acceleration",
        "control": "controller",
    },
}

#: k / (tau s + 1).
LAG: dict[str, Any] = {
    "name": "lag",
    "parameters": {
        "k": {"value": 1, "lower": 0.1, "upper": 10},
        "tau": {"value": 0.2, "unit": "s", "lower": 0.001, "upper": 1},
    },
    "blocks": {
        "u": {"kind": "input"},
        "plant": {"kind": "transfer_function", "numerator": ["=k"], "denominator": ["=tau", 1]},
    },
    "connections": [{"from": "u", "to": "plant"}],
    "outputs": {"y": "plant"},
}


def chain(masses: int) -> dict[str, Any]:
    """Return masses between springs, lightly damped: it swings for an hour."""
    stiffness = 2.0 * np.eye(masses) - np.eye(masses, k=1) - np.eye(masses, k=-1)
    a = np.block([[np.zeros((masses, masses)), np.eye(masses)], [-1e6 * stiffness, -0.5 * stiffness]])
    b, c = np.zeros((2 * masses, 1)), np.zeros((1, 2 * masses))
    b[masses], c[0, masses - 1] = 1.0, 1.0
    matrices = {"A": a.tolist(), "B": b.tolist(), "C": c.tolist(), "D": [[0]]}
    return {
        "name": "chain",
        "blocks": {"u": {"kind": "input"}, "chain": {"kind": "state_space", **matrices}},
        "connections": [{"from": "u", "to": "chain"}],
        "outputs": {"y": "chain"},
    }


STEP: dict[str, Any] = {"port": "reference", "signal": {"kind": "step"}}


def pneumatic(**blocks: Any) -> dict[str, Any]:
    """Return the pneumatic loop with blocks replaced."""
    document = copy.deepcopy(PNEUMATIC)
    document["blocks"].update(blocks)
    return document


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def lag_recording(*, k: float = 3.0, tau: float = 0.05, offset: float = 0.002, samples: int = 4000) -> bytes:
    """Return u (V) and y (mm) of a first-order lag at 1 kHz, exact for an input that is linear between samples."""
    time = np.arange(samples) / 1000
    u = np.sin(2 * np.pi * (0.5 * time + 2 * time**2 / 2))
    decay = np.exp(-0.001 / tau)
    y = np.zeros(samples)
    for i in range(1, samples):
        slope = (u[i] - u[i - 1]) / 0.001
        # the exact solution of tau y' + y = k (u0 + slope t) over one sample
        steady = k * (u[i - 1] - slope * tau)
        y[i] = (y[i - 1] - steady) * decay + steady + k * slope * 0.001
    noise = np.random.default_rng(1).normal(scale=0.001, size=samples)
    return np.column_stack([u, (y + offset + noise) * 1000]).astype("<f8").tobytes()


def upload(client: httpx.Client, body: dict[str, Any], data: bytes, *, segment: int = 32_000) -> httpx.Response:
    """Create a dataset, send its segments, commit it; return the reply to the commit."""
    created = client.post("/v1/datasets", json=body)
    assert created.status_code == 201, created.text
    where = created.headers["Location"]
    pieces = [data[i : i + segment] for i in range(0, len(data), segment)]
    for piece in pieces:
        assert client.put(f"{where}/segments/{sha256(piece)}", content=piece).status_code in {200, 201}
    return client.post(
        f"{where}/commit", json={"segments": [sha256(piece) for piece in pieces], "sha256": sha256(data)}
    )


RAW: dict[str, Any] = {
    "name": "lag",
    "format": "raw",
    "sample_rate": 1000,
    "start_time": "2026-01-01T08:00:00+01:00",
    "channels": [
        {"name": "u", "quantity": "voltage", "unit": "V"},
        {"name": "y", "quantity": "displacement", "unit": "mm", "sensor": {"model": "LVDT", "serial": "7"}},
    ],
}

OPTIMIZATION = {
    "variables": [{"parameter": "k"}],
    "experiments": [{"name": "step", "input": {"port": "u", "signal": {"kind": "step"}}}],
    "goals": [{"metric": "rise_time", "experiment": "step", "output": "y", "sense": "minimize"}],
    "method": {"kind": "grid", "points": 3},
}
