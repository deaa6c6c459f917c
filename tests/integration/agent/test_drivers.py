"""A measurement from the service to the service with hardware that is not NI's, cancelled, killed, and with a full disk."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from agent import spool
from agent.errors import AttemptError
from agent.settings import Settings
from agent.settings_file import read
from rig_simulator.file_writer import Writer
from rig_simulator.opcua_server import Server
from rig_simulator.sensors import Sensor
from tests.integration.agent.lab import RIG, Lab, make_bench
from tests.integration.agent.test_kills import STEP, process, recording
from tests.integration.agent.test_triggers import WAITING, found_at_its_sample, slow_sine

WATCHDOG = 60.0
DRIVERS = {
    "opcua-arrays": {"daq.driver": "opcua", "daq.way": "arrays"},
    "opcua-subscription": {"daq.driver": "opcua", "daq.way": "subscription"},
    "file": {"daq.driver": "file"},
}


@dataclass
class OtherLab(Lab):
    """A lab whose hardware is behind another driver."""

    daq: dict[str, Any] = field(default_factory=dict)

    def settings(self, *, key: str = "acquire", **arguments: Any) -> Settings:
        path = self.folder / "agent.toml"
        before, _, rest = RIG.format(rig=self.rig).partition("[[devices]]")
        lines = "".join(f'{name.removeprefix("daq.")} = "{value}"\n' for name, value in self.daq.items())
        inputs = rest[rest.index("[[inputs]]") :]
        path.write_text(before.replace("[daq]\n", f"[daq]\n{lines}") + inputs)
        environment = {"SERVOTUNE_AGENT_KEY": self.service.keys[key]}
        given = {"service.url": self.service.url, "spool.folder": str(self.spool)}
        return read(path, environment, given | arguments)


@pytest.fixture(params=DRIVERS)
def other(lab: Lab, request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[OtherLab]:
    daq = dict(DRIVERS[request.param])
    bench = make_bench()
    door: Server | Writer
    if daq["daq.driver"] == "opcua":
        door = Server(bench, watchdog=WATCHDOG)
        daq["daq.server"] = f"opc.tcp://127.0.0.1:{door.port}"
    else:
        door = Writer(bench, tmp_path / "exchange", watchdog=WATCHDOG)
        daq["daq.folder"] = str(tmp_path / "exchange")
    yield OtherLab(
        service=lab.service, client=lab.client, rig=lab.rig, folder=tmp_path, bench=bench, server=lab.server, daq=daq
    )
    door.close()


def test_a_measurement_arrives_with_every_sample(other) -> None:
    with other.agent():
        done = other.wait(other.ask(duration=2))
        assert done["status"] == "done", done
        facts = done["attempts"][0]["facts"]
        assert facts["complete"] is True
        assert facts["output_at_rest"] is True
        assert other.whole(done["id"]).shape[0] == round(0.1 * 51200 / 31) + round(2 * 51200 / 31)
        (rig,) = [rig for rig in other.client.get("/v1/rigs").json()["items"] if rig["name"] == other.rig]
        assert rig["document"]["daq"] == facts["hardware"]
        refused = other.wait(other.ask(sample_rate=100_000))
        assert refused["attempts"][0]["error"]["type"] == "urn:servotune:problem:unsupported_setting"
    assert other.level() == 0.0


def test_a_trigger_is_found_to_the_sample(other) -> None:
    slow_sine(other.bench)
    with other.agent():
        done = other.wait(other.ask(**WAITING))
        assert done["status"] == "done", done
        found_at_its_sample(other, done)
        # The hardware is free again, although its run was left before its end.
        assert other.wait(other.ask(duration=0.2))["status"] == "done"


def test_an_overload_is_seen(other) -> None:
    other.bench.sensors["cDAQ1Mod1/ai1"] = Sensor(noise=1e-3, hum=6.0, mains=1.0)
    with other.agent():
        done = other.wait(other.ask(drive=None, duration=1, sample_rate=51_200 / 31))
    values = other.samples(done["dataset"])
    seen = done["attempts"][0]["facts"]["channels"]["position"]["overload"]
    assert seen["count"] == (abs(values[:, 1]) >= 0.9995 * 5).sum() > 100
    (warning,) = [entry for entry in done["warnings"] if entry["level"] == "warning"]
    assert warning["detail"].startswith(f"position reached its range of 5 V: {seen['count']} samples, first at ")


def test_a_measurement_that_is_cancelled_leaves_the_output_at_rest(other) -> None:
    other.bench.speed = 1.0
    with other.agent():
        asked = other.ask(duration=60, drive=STEP)
        other.wait(asked, "running")
        recording(other, segments=2)
        other.client.post(f"/v1/acquisitions/{asked}/cancel").raise_for_status()
        assert other.wait(asked)["status"] == "cancelled"
        other.until(lambda: other.level() == 0.0 and other.runs() == [])


def test_what_a_killed_agent_had_on_its_disk_arrives(other) -> None:
    other.bench.speed = 1.0
    other.settings()
    command = (
        "agent", "--settings", str(other.folder / "agent.toml"), "--url", other.service.url, "--spool", str(other.spool),
    )  # fmt: skip
    with process(*command, SERVOTUNE_AGENT_KEY=other.service.keys["acquire"]) as agent:
        asked = other.ask(duration=20, drive=STEP)
        recording(other, segments=5)
        agent.send_signal(signal.SIGKILL)
        agent.wait()
    (run,) = other.runs()
    kept = b"".join(path.read_bytes() for path in sorted(run.glob("*.f64")))
    with other.agent():
        other.until(lambda: other.runs() == [])
        assert other.level() == 0.0
        attempt = other.attempt(asked)
        assert attempt["error"]["type"] == "urn:servotune:problem:agent_died"
        assert other.samples(attempt["dataset"]).tobytes() == kept


def test_a_disk_that_fills_up_stops_the_run_and_the_output_comes_to_rest(other, monkeypatch) -> None:
    append, pieces = spool.Run.append, []

    def full(self: Any, number: int, data: bytes, *, samples: int) -> Any:
        if number == 5:
            raise AttemptError("disk_full", "no space left on device")
        pieces.append(data)
        return append(self, number, data, samples=samples)

    monkeypatch.setattr(spool.Run, "append", full)
    with other.agent():
        failed = other.wait(other.ask(duration=10))
    assert failed["attempts"][0]["error"]["type"] == "urn:servotune:problem:disk_full"
    assert other.level() == 0.0
    assert other.samples(failed["attempts"][0]["dataset"]).tobytes() == b"".join(pieces[:5])
