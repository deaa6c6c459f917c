"""A rig as an agent registers it, and what an agent does over HTTP, without any hardware."""

from __future__ import annotations

from typing import Any

import httpx
import numpy as np

from tests.integration.api.documents import sha256

RIG: dict[str, Any] = {
    "devices": [{"name": "cDAQ1Mod1", "model": "NI 9234", "serial": "01A2B3C4"}],
    "inputs": [
        {"name": "loopback", "channel": "cDAQ1Mod1/ai0", "unit": "V", "range": 5},
        {
            "name": "position",
            "channel": "cDAQ1Mod1/ai1",
            "quantity": "displacement",
            "unit": "mm",
            "sensitivity": 0.1,
            "model": "LVDT 50",
            "serial": "77",
            "calibration": {"certificate": "C-17", "calibrated_on": "2020-01-01", "due": "2021-01-01"},
        },
    ],
    "outputs": [{"name": "valve", "channel": "cDAQ1Mod2/ao0", "amplitude": 5, "slew": 1000, "duration": 60}],
    "understands": ["trigger", "record"],
}
AGENT = {"rig": "bench-1", "instance": "0123456789abcdef", "name": "lab PC 1", "version": "0.1.0", "document": RIG}
MEASUREMENT: dict[str, Any] = {
    "name": "step of the valve",
    "rig": "bench-1",
    "channels": ["loopback", "position"],
    "sample_rate": 1000,
    "duration": 0.5,
    "pre_trigger": 0.1,
    "drive": {"output": "valve", "signal": {"kind": "sine", "amplitude": 2, "frequency": {"value": 5, "unit": "Hz"}}},
}
CHANNELS = [
    {"name": "loopback", "unit": "V"},
    {"name": "position", "unit": "mm", "scale": 10, "quantity": "displacement"},
]


def samples(count: int = 600) -> bytes:
    """Return samples of both channels as an agent sends them."""
    t = np.arange(count) / 1000
    return np.column_stack([np.sin(t), np.cos(t)]).astype("<f8").tobytes()


def deliver(client: httpx.Client, claim: dict[str, Any], agent: str, data: bytes, **finish: Any) -> httpx.Response:
    """Bring the samples of an attempt, and end it."""
    where = f"/v1/acquisitions/{claim['acquisition']}/attempts/{claim['attempt']}"
    opening = {"agent": agent, "start_time": claim["time"], "sample_rate": 1024, "channels": CHANNELS}
    opened = client.post(f"{where}/dataset", json=opening)
    assert opened.status_code == 200, opened.text
    dataset = f"/v1/datasets/{opened.json()['id']}"
    assert client.put(f"{dataset}/segments/{sha256(data)}", content=data).status_code in {200, 201}
    committed = client.post(f"{dataset}/commit", json={"segments": [sha256(data)], "sha256": sha256(data)})
    assert committed.status_code == 200, committed.text
    return client.post(f"{where}/finish", json={"agent": agent, **finish})
