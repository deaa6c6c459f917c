"""kill -9 of each process: what was acquired arrives exactly once, and nothing is left moving."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import httpx
import pytest

from storage import open_database
from tests.integration.agent.lab import LAG, RIG
from tests.integration.api.conftest import Service, make_keys
from tests.support.patience import PATIENCE

STEP = {"output": "valve", "signal": {"kind": "step", "amplitude": 1}}


@contextmanager
def process(*command: str, **environment: str) -> Iterator[subprocess.Popen[str]]:
    """Run one of our commands."""
    started = subprocess.Popen(
        [sys.executable, "-m", "servotune", *command],
        env=os.environ | environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        yield started
    finally:
        started.kill()
        started.wait()
        for stream in (started.stdin, started.stdout):
            assert stream is not None
            stream.close()


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])


def agent_of(lab) -> tuple[str, ...]:
    """Return the command of an agent of the lab's rig."""
    lab.settings()
    return (
        "agent", "--settings", str(lab.folder / "agent.toml"), "--url", lab.service.url,
        "--daq-server", f"127.0.0.1:{lab.server.port}", "--spool", str(lab.spool),
    )  # fmt: skip


def recording(lab, *, segments: int) -> None:
    """Wait until some segments are on the disk of the lab PC."""
    lab.until(lambda: lab.runs() != [] and len(list(lab.runs()[0].glob("*.f64"))) > segments)


def test_kill_of_the_agent(lab) -> None:
    lab.bench.speed = 1.0
    with process(*agent_of(lab), SERVOTUNE_AGENT_KEY=lab.service.keys["acquire"]) as agent:
        asked = lab.ask(duration=20, drive=STEP)
        recording(lab, segments=5)
        agent.send_signal(signal.SIGKILL)
        agent.wait()
    (run,) = lab.runs()
    kept = b"".join(path.read_bytes() for path in sorted(run.glob("*.f64")))
    assert lab.level() == pytest.approx(1.0)  # a device server goes on
    assert lab.bench.tasks
    with lab.agent():
        lab.until(lambda: lab.runs() == [])
        assert lab.level() == 0.0
        assert not lab.bench.tasks
        attempt = lab.attempt(asked)
        assert (attempt["status"], attempt["number"]) == ("failed", 1)
        assert attempt["error"]["type"] == "urn:servotune:problem:agent_died"
        assert attempt["facts"]["complete"] is False
        # Every whole segment, once; the samples between the last one and the kill had never been on the disk.
        assert lab.samples(attempt["dataset"]).tobytes() == kept
        assert lab.client.post(f"/v1/agents/{attempt['agent']}/claim").status_code == 204  # not repeated


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_agent_that_is_told_to_end_leaves_the_rig_at_rest(lab, number) -> None:
    """Ctrl-C at a terminal, and what systemd sends."""
    lab.bench.speed = 1.0
    with process(*agent_of(lab), SERVOTUNE_AGENT_KEY=lab.service.keys["acquire"]) as agent:
        asked = lab.ask(duration=60)
        recording(lab, segments=2)
        agent.send_signal(number)
        assert agent.wait(60) == 0
    failed = lab.get(asked)
    assert failed["attempts"][0]["error"]["type"] == "urn:servotune:problem:stopped"
    assert failed["attempts"][0]["facts"]["output_at_rest"] is True
    assert lab.level() == 0.0
    assert not lab.bench.tasks
    lab.whole(asked)


def test_kill_of_the_service(lab, tmp_path) -> None:
    url = f"sqlite:///{tmp_path / 'own.db'}"
    database = open_database(url)
    database.migrate()
    database.dispose()
    port = free_port()
    keys = make_keys(url)
    lab.service = Service(url=f"http://127.0.0.1:{port}", database_url=url, keys=keys)
    lab.bench.speed = 1.0
    command = ("serve", "--port", str(port), "--no-worker")
    with lab.agent(), lab.service.client() as client:
        lab.client = client
        with process(*command, SERVOTUNE_DATABASE_URL=url) as service:
            answers(client)
            asked = lab.ask(duration=3)
            lab.wait(asked, "running")
            service.send_signal(signal.SIGKILL)
            service.wait()
        recording(lab, segments=10)  # the run goes on without anybody to talk to
        with process(*command, SERVOTUNE_DATABASE_URL=url):
            answers(client)
            done = lab.wait(asked)
            assert done["status"] == "done", done
            assert lab.whole(asked).shape[0] == round(0.1 * 51200 / 31) + round(3 * 51200 / 31)
            lab.until(lambda: lab.runs() == [])


def answers(client: httpx.Client) -> None:
    """Wait until a service is there."""
    give_up_at = time.monotonic() + PATIENCE
    while True:
        try:
            if client.get("/healthz").status_code == 200:
                return
        except httpx.TransportError:
            assert time.monotonic() < give_up_at
            time.sleep(0.1)


def test_kill_of_the_device_server(lab, tmp_path) -> None:
    """The simulator as its users start it: killed, and then frozen, while it measures."""
    (tmp_path / "lag.json").write_text(json.dumps(LAG))
    description = tmp_path / "rig.toml"
    description.write_text(
        '[plant]\nsystem = "lag.json"\n[[devices]]\nname = "cDAQ1Mod1"\n\n'
        '[[devices]]\nname = "cDAQ1Mod2"\nmodel = "NI 9260"\n'
        '[[drives]]\nchannel = "cDAQ1Mod2/ao0"\ninput = "u"\n'
        '[[sensors]]\nchannel = "cDAQ1Mod1/ai0"\nloopback = "cDAQ1Mod2/ao0"\n'
        '[[sensors]]\nchannel = "cDAQ1Mod1/ai1"\noutput = "y"\nsensitivity = 0.5\n'
    )
    port = free_port()
    command = ("rig-simulator", str(description), "--port", str(port))
    with lab.agent(lab.settings(**{"daq.server": f"127.0.0.1:{port}", "daq.deadline": 2.0})):
        with process(*command) as simulator:
            assert "stands in for hardware" in simulator.stdout.readline()
            asked = lab.ask(duration=60)
            recording(lab, segments=2)
            simulator.send_signal(signal.SIGKILL)
            failed = lab.wait(asked)
        assert failed["attempts"][0]["error"]["type"] == "urn:servotune:problem:server_unreachable"
        lab.whole(asked)
        with process(*command) as simulator:
            asked = lab.ask(duration=60)
            lab.wait(asked, "running")
            recording(lab, segments=2)
            simulator.send_signal(signal.SIGSTOP)
            failed = lab.wait(asked)
            assert failed["attempts"][0]["error"]["type"] == "urn:servotune:problem:server_unreachable"
            assert "could not be brought to 0 V" in failed["attempts"][0]["error"]["detail"]
            lab.whole(asked)
            simulator.send_signal(signal.SIGCONT)
            assert lab.wait(lab.ask(duration=0.2))["status"] == "done"
            simulator.stdin.write("levels\ncrash\n")
            simulator.stdin.flush()
            assert simulator.stdout.read().splitlines()[-1] == "cDAQ1Mod2/ao0=0"
            assert simulator.wait(PATIENCE) == 1


def test_settings_that_make_no_sense_end_it_at_once(tmp_path) -> None:
    path = tmp_path / "agent.toml"
    path.write_text(RIG.replace("amplitude = 4.0", ""))
    done = subprocess.run(
        [sys.executable, "-m", "servotune", "agent", "--settings", str(path)],
        capture_output=True, text=True, check=False, env=os.environ | {"SERVOTUNE_AGENT_KEY": "x"},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (2, "servotune agent: outputs[0].amplitude must be given\n")
