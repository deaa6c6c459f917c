"""Eight channels at 51.2 kS/s, ten seconds of them (30 minutes in `make proof`): the agent's memory is bounded, no sample is missing."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest
from hypothesis import settings

from tests.integration.agent.lab import RIG
from tests.integration.agent.test_kills import free_port, process

SECONDS = 1800 if settings().max_examples > 1000 else 10
MOST = 200e6
CHANNELS = [f"ai{i}" for i in range(8)]


def peak(pid: int) -> int:
    """Return the most memory (bytes) that a process has had."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM"))


@pytest.mark.skipif(sys.platform != "linux", reason="memory must be told by /proc")
def test_memory_does_not_grow_with_the_length_of_a_run(lab, tmp_path) -> None:
    rig = RIG.format(rig=lab.rig).replace("chunk = 0.1", "chunk = 0.25").replace("segment = 0.1", "segment = 2.0")
    inputs = "".join(f'[[inputs]]\nname = "{name}"\nchannel = "cDAQ1Mod1/{name}"\n' for name in CHANNELS)
    path, port = tmp_path / "agent.toml", free_port()
    path.write_text(rig + inputs)
    description = tmp_path / "rig.toml"
    description.write_text(
        'speed = 0\n[[devices]]\nname = "cDAQ1Mod1"\ninputs = 8\n'
        '[[devices]]\nname = "cDAQ1Mod2"\noutputs = 1\ndivider = 0\n'
    )
    arguments = (
        "agent", "--settings", str(path), "--url", lab.service.url, "--daq-server", f"127.0.0.1:{port}",
        "--spool", str(lab.spool),
    )  # fmt: skip
    key = lab.service.keys["acquire"]
    with (
        process("rig-simulator", str(description), "--port", str(port)) as simulator,
        process(*arguments, SERVOTUNE_AGENT_KEY=key) as agent,
    ):
        assert simulator.stdout.readline()
        began = time.monotonic()
        asked = lab.ask(duration=SECONDS, pre_trigger=0, sample_rate=51200, channels=CHANNELS, drive=None)
        done = lab.wait(asked, within=60 * SECONDS)
        took, used = time.monotonic() - began, peak(agent.pid)
        lab.until(lambda: lab.runs() == [])
    assert done["status"] == "done", done
    dataset = lab.client.get(f"/v1/datasets/{done['dataset']}").json()
    assert dataset["sample_count"] == SECONDS * 51200
    assert dataset["size"] == SECONDS * 51200 * 8 * 8
    sys.stderr.write(f"{SECONDS} s of 8 x 51200/s in {took:.0f} s, agent {used / 1e6:.0f} MB\n")
    assert used < MOST
