"""A lab in one process: a service with a key for agents, a simulated rig behind NI's gRPC interface, an agent in a thread."""

from __future__ import annotations

import hashlib
import json
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from agent.measuring import Confirm
from agent.process import Agent
from agent.settings import Settings
from agent.settings_file import read
from api.convert.systems import diagram_from_wire
from api.schemas.systems import SystemDocument
from rig_simulator.bench import Bench
from rig_simulator.devices import Device
from rig_simulator.grpc_server import Server
from rig_simulator.plant import Plant
from rig_simulator.sensors import Sensor
from tests.integration.api.conftest import Service
from tests.support.patience import PATIENCE

RIG = """
[rig]
name = "{rig}"
[daq]
deadline = 5.0
chunk = 0.1
[spool]
reserve = 0.0
segment = 0.1
[[devices]]
name = "cDAQ1Mod1"
model = "NI 9234"
serial = "01A2B3C4"
[[inputs]]
name = "loopback"
channel = "cDAQ1Mod1/ai0"
range = 5.0
[[inputs]]
name = "position"
channel = "cDAQ1Mod1/ai1"
range = 5.0
quantity = "displacement"
unit = "mm"
sensitivity = 0.5
[inputs.calibration]
certificate = "C-17"
[[outputs]]
name = "valve"
channel = "cDAQ1Mod2/ao0"
amplitude = 4.0
slew = 5000.0
duration = 100.0
soft_stop = 0.02
"""
LAG = {
    "name": "lag",
    "blocks": {
        "u": {"kind": "input"},
        "plant": {"kind": "transfer_function", "numerator": [2], "denominator": [0.05, 1]},
    },
    "connections": [{"from": "u", "to": "plant"}],
    "outputs": {"y": "plant"},
}
MEASUREMENT = {
    "name": "sine of the valve",
    "channels": ["loopback", "position"],
    "sample_rate": 1000,
    "duration": 1,
    "pre_trigger": 0.1,
    "drive": {"output": "valve", "signal": {"kind": "sine", "amplitude": 2, "frequency": {"value": 5, "unit": "Hz"}}},
}


def make_bench(*, speed: float = 0.0, devices: Sequence[Device] | None = None, **sensor: Any) -> Bench:
    """Return a rig with the lag between its output and its second input; the first one hears the output."""
    plant = Plant(diagram=diagram_from_wire(SystemDocument.model_validate(LAG)))
    usual = [
        Device(name="cDAQ1Mod1", model="NI 9234", serial=0x01A2B3C4),
        Device(name="cDAQ1Mod2", model="NI 9260", serial=2),
        Device(name="cDAQ1Mod3", model="NI 9234", serial=3),
        Device(name="cDAQ1Mod4", model="NI 9237", serial=4),
    ]
    return Bench(
        devices or usual,
        plant=plant,
        drives={"cDAQ1Mod2/ao0": ("u", 1.0)},
        sensors={
            "cDAQ1Mod1/ai0": Sensor(loopback="cDAQ1Mod2/ao0"),
            "cDAQ1Mod1/ai1": Sensor(output="y", sensitivity=0.5, **sensor),
        },
        speed=speed,
    )


@dataclass
class Lab:
    """What a test works with."""

    service: Service
    client: httpx.Client
    rig: str
    folder: Path
    bench: Bench
    server: Server
    answers: list[bool] = field(default_factory=list)
    person: Confirm | None = None
    """Who is asked instead of the answers."""

    @property
    def spool(self) -> Path:
        return self.folder / "spool"

    def settings(self, *, key: str = "acquire", **arguments: Any) -> Settings:
        path = self.folder / "agent.toml"
        path.write_text(RIG.format(rig=self.rig))
        environment = {"SERVOTUNE_AGENT_KEY": self.service.keys[key]}
        given = {
            "service.url": self.service.url,
            "daq.server": f"127.0.0.1:{self.server.port}",
            "spool.folder": str(self.spool),
        }
        return read(path, environment, given | arguments)

    @contextmanager
    def agent(self, settings: Settings | None = None) -> Iterator[Agent]:
        """Run an agent until the block ends."""
        made = Agent(
            settings or self.settings(), name="lab PC", confirm=self.person or (lambda *_: self.answers.pop(0))
        )
        thread = threading.Thread(target=made.run, daemon=True)
        thread.start()
        try:
            yield made
        finally:
            made.stop()
            thread.join(120)
            assert not thread.is_alive()

    def registered(self) -> None:
        """Wait for the rig to be known."""
        self.until(lambda: any(rig["name"] == self.rig for rig in self.client.get("/v1/rigs").json()["items"]))

    def tried(self) -> None:
        """Wait for the rig to be at rest and its channels to have been tried: only then does an agent ask for work."""
        rigs = lambda: self.client.get("/v1/rigs").json()["items"]  # noqa: E731
        self.until(lambda: any(rig["name"] == self.rig and rig["document"].get("checked_at") for rig in rigs()))

    def ask(self, **change: Any) -> str:
        """Ask for a measurement, and return its id."""
        self.registered()
        reply = self.client.post("/v1/acquisitions", json=MEASUREMENT | {"rig": self.rig} | change)
        assert reply.status_code == 202, reply.text
        return str(reply.json()["id"])

    def get(self, acquisition: str) -> dict[str, Any]:
        return dict(self.client.get(f"/v1/acquisitions/{acquisition}").json())

    def attempt(self, acquisition: str) -> dict[str, Any]:
        return dict(self.get(acquisition)["attempts"][-1])

    def wait(self, acquisition: str, *statuses: str, within: float = PATIENCE) -> dict[str, Any]:
        """Wait for a status, by default for the end."""
        wanted = statuses or ("done", "failed", "lost", "cancelled")
        self.until(lambda: self.get(acquisition)["status"] in wanted, within=within, what=lambda: self.get(acquisition))
        return self.get(acquisition)

    def until(
        self, condition: Callable[[], bool], *, within: float = PATIENCE, what: Callable[[], object] = lambda: ""
    ) -> None:
        began, pause = time.monotonic(), 0.02
        while not condition():
            assert time.monotonic() < began + within, what()
            time.sleep(pause)
            # asking costs the service, which has work to do
            pause = min(1.3 * pause, 0.2 if within <= PATIENCE else 2.0)

    def samples(self, dataset: str, channels: int = 2) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Return what arrived, in V, shape (samples, channels)."""
        data = self.client.get(f"/v1/datasets/{dataset}/original").content
        return np.frombuffer(data, "<f8").reshape(-1, channels)

    def whole(self, acquisition: str) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Return what arrived of a sine of 2 V and 5 Hz, having made sure that it is what was acquired, each sample once."""
        attempt = self.attempt(acquisition)
        facts, data = attempt["facts"], self.client.get(f"/v1/datasets/{attempt['dataset']}/original").content
        assert (
            self.client.get(f"/v1/datasets/{attempt['dataset']}").json()["sha256"] == hashlib.sha256(data).hexdigest()
        )
        values = np.frombuffer(data, "<f8").reshape(-1, 2)
        assert 0 < values.shape[0] == facts["samples"]
        k = np.arange(values.shape[0]) - facts["repeats"]["first"]
        driven = np.where(k > 0, 2 * np.sin(2 * np.pi * 5 * k / facts["actual_rate"]), 0.0)
        played = k < 0.97 * facts["repeats"]["length"]  # then the soft stop begins
        assert np.abs(values[:, 0] - driven)[played].max() < 3e-6  # the converter's step is 1.2e-6 V
        return values

    def runs(self) -> list[Path]:
        return sorted((self.spool / "runs").iterdir())

    def level(self) -> float:
        return self.bench.levels.get("cDAQ1Mod2/ao0", 0.0)


def document(path: Path) -> Mapping[str, Any]:
    """Return a JSON file."""
    found: dict[str, Any] = json.loads(path.read_text())
    return found
