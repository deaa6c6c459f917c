"""Eight channels at 51.2 kS/s, ten seconds of them (30 minutes in `make proof`): bounded memory, every sample arrives exactly once.

In the long run service and worker are processes of their own. Agent, simulator and worker are held to the limit, and so is what the
service needs on top of what it is at rest, because it has the engine in its memory before anybody measures.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from subprocess import Popen

import pytest
from hypothesis import settings

from tests.integration.agent import sines
from tests.integration.agent.lab import RIG
from tests.integration.agent.test_kills import answers, free_port, process

LONG = settings().max_examples > 1000
SECONDS = 1800 if LONG else 10
MOST = 200e6


def peak(pid: int) -> int:
    """Return the most memory (bytes) that a process has had."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM"))


@contextmanager
def outside(lab) -> Iterator[dict[str, Popen[str]]]:
    """Give the lab a service and a worker in processes of their own."""
    port, database_url = free_port(), lab.service.database_url
    lab.service = replace(lab.service, url=f"http://127.0.0.1:{port}")
    with ExitStack() as stack:
        commands = {"service": ("serve", "--port", str(port), "--no-worker"), "worker": ("worker",)}
        started = {
            name: stack.enter_context(process(*command, SERVOTUNE_DATABASE_URL=database_url))
            for name, command in commands.items()
        }
        lab.client = stack.enter_context(lab.service.client())
        answers(lab.client)
        yield started


@pytest.mark.skipif(sys.platform != "linux", reason="memory must be told by /proc")
def test_memory_does_not_grow_with_the_length_of_a_run(lab, tmp_path) -> None:
    before, _, after = RIG.format(rig=lab.rig).partition("[[inputs]]")
    rig = before + after[after.index("[[outputs]]") :]  # a channel belongs to one entry
    for short, usual in (
        ("chunk = 0.1", "chunk = 0.25"),
        ("segment = 0.1", "segment = 2.0"),
        ("deadline = 5.0", "deadline = 60"),
    ):
        rig = rig.replace(short, usual)
    path, port = tmp_path / "agent.toml", free_port()
    path.write_text(rig + sines.inputs())
    description = tmp_path / "rig.toml"
    description.write_text(sines.rig(speed=0.0))
    with ExitStack() as stack:
        processes = stack.enter_context(outside(lab)) if LONG else {}
        simulator = stack.enter_context(process("rig-simulator", str(description), "--port", str(port)))
        arguments = (
            "agent", "--settings", str(path), "--url", lab.service.url, "--daq-server", f"127.0.0.1:{port}",
            "--spool", str(lab.spool),
        )  # fmt: skip
        agent = stack.enter_context(process(*arguments, SERVOTUNE_AGENT_KEY=lab.service.keys["acquire"]))
        processes |= {"agent": agent, "simulator": simulator}
        assert simulator.stdout.readline()
        lab.client.timeout = 120
        at_rest = {"service": peak(processes["service"].pid)} if LONG else {}
        began = time.monotonic()
        asked = lab.ask(
            duration=SECONDS, pre_trigger=0, sample_rate=sines.RATE, channels=list(sines.PLACES), drive=None
        )
        done = lab.wait(asked, within=60 * SECONDS)
        took = time.monotonic() - began
        lab.until(lambda: lab.runs() == [], within=60 + SECONDS)
        used = {name: peak(started.pid) - at_rest.get(name, 0) for name, started in processes.items()}
        told = ", ".join(f"{name} {size / 1e6:.0f} MB" for name, size in used.items())
        sys.stderr.write(f"{SECONDS} s of {len(sines.PLACES)} x {sines.RATE}/s in {took:.0f} s: {told}\n")
        assert done["status"] == "done", done["error"]
        assert sines.samples_in_their_places(lab.client, done["dataset"]) == SECONDS * sines.RATE
        assert max(used.values()) < MOST, told
