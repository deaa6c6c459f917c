"""Eight channels at 51.2 kS/s for two minutes (30 in `make proof`), and everything that goes wrong meanwhile: no sample is lost, none comes twice.

One recording goes on while the network is cut, the service is killed and frozen, the worker is killed, and, where the driver
bears it, the way to the hardware is cut. Three others end: the agent is killed, the hardware freezes, the disk takes no more.
Of those everything arrives that was on the disk.
"""

from __future__ import annotations

import itertools
import resource
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import pytest
from hypothesis import settings

from tests.integration.agent import sines
from tests.integration.agent.test_kills import process
from tests.integration.api.test_commands import free_port
from tests.integration.drivers.cable import Cable
from tests.integration.faults.conftest import FULL
from tests.integration.faults.test_service_killed import KEY, Service

LONG = settings().max_examples > 1000
SECONDS = 1800 if LONG else 120
OVER = ("done", "failed", "lost", "cancelled")
AGENT = """
[rig]
name = "bench-1"
[daq]
driver = "{driver}"
server = "{server}"
deadline = 20.0
chunk = 0.15
[spool]
folder = "{spool}"
reserve = 0.0
segment = 1.0
"""

pytestmark = [
    pytest.mark.skipif(
        not (FULL or LONG),
        reason="it takes minutes: `make faults`; each trouble by itself is in tests/integration/agent and drivers",
    ),
    pytest.mark.skipif(sys.platform != "linux", reason="a disk is closed to a process that runs by prlimit"),
]


class Setting:
    """A rig, its agent, a service and a worker, each a process of its own that can be killed and frozen."""

    def __init__(self, folder: Path, database_url: str, driver: str, stack: ExitStack) -> None:
        self._driver, self._url, self._stack = driver, database_url, stack
        self.spool = folder / "spool"
        self._log = folder / "service.log"
        self.service, self.client = self._service()
        self.worker = self._process("worker", SERVOTUNE_DATABASE_URL=database_url)
        port = free_port()
        (folder / "rig.toml").write_text(sines.rig(speed=1.0))
        self.rig = self._process(
            "rig-simulator", str(folder / "rig.toml"), "--port", str(port), "--as", driver, "--watchdog", "60"
        )
        assert "stands in for hardware" in self.rig.stdout.readline()
        self.network, self.fieldbus = Cable(self.service.port), Cable(port)
        stack.callback(self.network.close)
        stack.callback(self.fieldbus.close)
        scheme = "opc.tcp://" if driver == "opcua" else ""
        self._settings = folder / "agent.toml"
        server = f"{scheme}127.0.0.1:{self.fieldbus.port}"
        self._settings.write_text(AGENT.format(driver=driver, server=server, spool=self.spool) + sines.inputs())
        self.start_agent()
        self.until(lambda: self.get("/v1/rigs")["items"])

    def _process(self, *command: str, **environment: str) -> Any:
        return self._stack.enter_context(process(*command, **environment))

    def _service(self) -> tuple[Service, httpx.Client]:
        service = Service(self._url, self._log)
        service.start()
        self._stack.callback(service.kill)
        return service, self._stack.enter_context(service.client())

    def start_agent(self) -> None:
        self.agent = self._process(
            "agent", "--settings", str(self._settings), "--url", f"http://127.0.0.1:{self.network.port}",
            SERVOTUNE_AGENT_KEY=KEY,
        )  # fmt: skip

    def get(self, path: str) -> dict[str, Any]:
        return dict(self.client.get(path).raise_for_status().json())

    def until(self, condition: Callable[[], object], *, within: float = 300.0) -> None:
        give_up_at = time.monotonic() + within
        while not condition():
            assert time.monotonic() < give_up_at
            time.sleep(0.2)

    def ask(self, seconds: float) -> str:
        body = {
            "name": "sines",
            "rig": "bench-1",
            "channels": list(sines.PLACES),
            "sample_rate": sines.RATE,
            "duration": seconds,
        }
        reply = self.client.post("/v1/acquisitions", json=body)
        assert reply.status_code == 202, reply.text
        return str(reply.json()["id"])

    def attempt(self, asked: str) -> dict[str, Any]:
        return dict(self.get(f"/v1/acquisitions/{asked}")["attempts"][-1])

    def segments(self) -> int:
        """Return how many pieces of what is recorded now the agent has written so far: the last one's number."""
        return max((int(path.stem) for path in self.spool.glob("runs/*/*.f64")), default=-1) + 1

    def grow(self, count: int = 3) -> None:
        """Wait until the agent has recorded some pieces more."""
        goal = self.segments() + count
        self.until(lambda: self.segments() >= goal or self.attempt_is_over())

    def attempt_is_over(self) -> bool:
        return not list(self.spool.glob("runs/*")) or bool(list(self.spool.glob("runs/*/end.json")))

    def network_is_cut(self) -> None:
        self.network.cut(for_good=True)
        self.grow()
        self.network.whole = True

    def service_is_killed(self) -> None:
        """Another one takes its place: it is ready before, so that a slow machine does not make the gap longer than a lease."""
        service, client = self._service()
        self.service.kill()
        self.grow()
        self.service, self.client, self.network.target = service, client, service.port

    def service_is_frozen(self) -> None:
        self.service.process.send_signal(signal.SIGSTOP)
        self.grow()
        self.service.process.send_signal(signal.SIGCONT)

    def worker_is_killed(self) -> None:
        self.worker.kill()
        self.worker.wait()
        self.worker = self._process("worker", SERVOTUNE_DATABASE_URL=self._url)

    def fieldbus_is_cut(self) -> None:
        """A session with a controller is opened anew; one with a device server is the end of its tasks."""
        if self._driver == "opcua":
            self.fieldbus.cut()

    def arrived(self, asked: str, *, error: str | None) -> int:
        """Wait for the end and for every piece; return how many samples came, each of them the right one."""
        self.until(lambda: self.attempt(asked)["status"] in OVER, within=60 * SECONDS)
        self.until(lambda: not list(self.spool.glob("runs/*")), within=60 * SECONDS)
        attempt = self.attempt(asked)
        told = attempt["error"] and attempt["error"]["type"].removeprefix("urn:servotune:problem:")
        assert told == error, attempt
        self.until(lambda: self.get(f"/v1/datasets/{attempt['dataset']}")["status"] == "ready", within=60 * SECONDS)
        count = sines.samples_in_their_places(self.client, attempt["dataset"])
        assert count == attempt["facts"]["samples"]
        return count


@pytest.fixture(params=["nidaqmx", "opcua"])
def setting(request: pytest.FixtureRequest, sqlite_template: Path, tmp_path: Path) -> Iterator[Setting]:
    path = tmp_path / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    with ExitStack() as stack:
        yield Setting(tmp_path, f"sqlite:///{path}", request.param, stack)


def test_no_sample_is_lost_and_none_comes_twice(setting: Setting) -> None:
    asked = setting.ask(SECONDS)
    setting.until(lambda: setting.segments() >= 2)
    troubles = [
        setting.network_is_cut,
        setting.fieldbus_is_cut,
        setting.service_is_frozen,
        setting.worker_is_killed,
        setting.service_is_killed,
    ]
    done = 0
    for trouble in itertools.cycle(troubles):
        trouble()
        done += 1
        setting.grow(10)
        if setting.attempt_is_over():
            break
    assert done >= len(troubles), setting.attempt(asked)
    assert setting.arrived(asked, error=None) == SECONDS * sines.RATE

    # The agent is killed: every whole piece arrives, what was in memory was never on the disk.
    asked = setting.ask(SECONDS)
    setting.until(lambda: setting.segments() >= 5)
    setting.agent.kill()
    setting.agent.wait()
    on_disk = sum(path.stat().st_size for path in setting.spool.glob("runs/*/*.f64"))
    sent = setting.attempt(asked)
    setting.start_agent()
    assert on_disk == 8 * len(sines.PLACES) * setting.arrived(asked, error="agent_died"), sent

    # The hardware answers nobody, and then everybody again.
    asked = setting.ask(SECONDS)
    setting.until(lambda: setting.segments() >= 5)
    setting.rig.send_signal(signal.SIGSTOP)
    setting.until(lambda: setting.attempt(asked)["status"] in OVER)
    setting.rig.send_signal(signal.SIGCONT)
    assert setting.arrived(asked, error="server_unreachable") > 0

    # The disk takes no more samples; notes of a few bytes still find room.
    asked = setting.ask(SECONDS)
    setting.until(lambda: setting.segments() >= 5)
    resource.prlimit(setting.agent.pid, resource.RLIMIT_FSIZE, (65_536, resource.RLIM_INFINITY))
    assert setting.arrived(asked, error="disk_full") > 0
    resource.prlimit(setting.agent.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    asked = setting.ask(1)
    assert setting.arrived(asked, error=None) == sines.RATE
