"""A simulated rig for each driver, as a process of its own: the same plant, devices and faults behind every door."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from agent.drivers.interface import Driver
from agent.drivers.loading import load
from agent.settings import InputSettings, OutputSettings
from tests.integration.agent.lab import LAG
from tests.integration.agent.test_kills import free_port

VARIANTS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "nidaqmx": ("nidaqmx", {}),
    "opcua-arrays": ("opcua", {"way": "arrays"}),
    "opcua-subscription": ("opcua", {"way": "subscription"}),
    "file-npy": ("file", {"format": "npy"}),
    "file-csv": ("file", {"format": "csv"}),
}
"""Name -> (driver, what is special in its settings). A new driver needs a simulated rig, and a line here."""

DESCRIPTION = """
speed = {speed}
[plant]
system = "lag.json"
[[devices]]
name = "cDAQ1Mod1"
model = "of no known family"
inputs = 8
range = 10.0
[[devices]]
name = "cDAQ1Mod2"
model = "of no known family"
outputs = 2
range = 10.0
divider = 0
[[drives]]
channel = "cDAQ1Mod2/ao0"
input = "u"
[[sensors]]
channel = "cDAQ1Mod1/ai0"
loopback = "cDAQ1Mod2/ao0"
[[sensors]]
channel = "cDAQ1Mod1/ai1"
output = "y"
sensitivity = 0.5
"""
LOOPBACK = InputSettings(name="loopback", channel="cDAQ1Mod1/ai0")
POSITION = InputSettings(name="position", channel="cDAQ1Mod1/ai1", sensitivity=0.5)
VALVE = OutputSettings(name="valve", channel="cDAQ1Mod2/ao0", amplitude=4.0, soft_stop=0.02)


class Rig:
    """A simulated rig.

    Parameters
    ----------
    variant : str
        One of ``VARIANTS``.
    speed : float
        0: samples come as fast as they are read.
    watchdog : float
        s after which a controller that hears nothing comes to rest by itself.
    """

    def __init__(self, folder: Path, variant: str, *, speed: float, watchdog: float = 60.0) -> None:
        self.kind, special = VARIANTS[variant]
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "lag.json").write_text(json.dumps(LAG))
        (folder / "rig.toml").write_text(DESCRIPTION.format(speed=speed))
        self.port = free_port()
        self._command = (
            "rig-simulator", str(folder / "rig.toml"), "--as", self.kind, "--port", str(self.port),
            "--folder", str(folder / "exchange"), "--watchdog", str(watchdog),
        )  # fmt: skip
        place = {
            "nidaqmx": {"server": f"127.0.0.1:{self.port}"},
            "opcua": {"server": f"opc.tcp://127.0.0.1:{self.port}"},
            "file": {"folder": str(folder / "exchange")},
        }[self.kind]
        self.settings: dict[str, Any] = {"driver": self.kind, "chunk": 0.1, "deadline": 60.0, **place, **special}
        self.start()

    def start(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "servotune", *self._command],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        assert "stands in for hardware" in self._line()

    def say(self, line: str) -> str:
        """Give a command, and return the answer."""
        assert self.process.stdin is not None
        self.process.stdin.write(f"{line}\n")
        self.process.stdin.flush()
        return self._line()

    def level(self) -> float:
        """Return the V at which the output really stands."""
        found = dict(entry.split("=") for entry in self.say("levels").split())
        return float(found[VALVE.channel])

    def driver(self, **settings: Any) -> Driver:
        """Return a driver that is connected to this rig."""
        made = load(self.kind)
        return made(made.settings(**self.settings | settings), rig="bench-1")

    def end(self) -> None:
        self.process.kill()
        self.process.wait()
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        self.process.stdout.close()

    def _line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline()
