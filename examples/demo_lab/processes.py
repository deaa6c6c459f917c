"""The processes of a lab: service and worker, simulated rig, agent; each with its log, all gone at the end."""

from __future__ import annotations

import json
import os
import secrets
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import servotune
from examples.demo_lab.axis import AGENT, DRIVERS, RIG

_READY_WITHIN = 180.0
_STOPS_WITHIN = 15.0


class LabError(Exception):
    """A process of the lab did not come up."""


class Lab:
    """A running lab.

    Parameters
    ----------
    folder : Path
        Databases, samples and logs.
    driver : str
        By which the agent reaches the rig.
    """

    def __init__(self, folder: Path, stack: ExitStack, *, driver: str) -> None:
        self._folder, self._stack, self._driver = folder, stack, driver
        self._rig: subprocess.Popen[bytes] | None = None
        self._port = _free_port()
        key, port = secrets.token_urlsafe(24), _free_port()
        self._url = f"http://127.0.0.1:{port}"
        settings = {
            "SERVOTUNE_DATABASE_URL": f"sqlite:///{(folder / 'lab.db').resolve()}",
            "SERVOTUNE_BOOTSTRAP_KEY": key,
        }
        self._start("service", "serve", "--port", str(port), environment=settings)
        self.client = stack.enter_context(_client(self._url, key))

    def set_law(self, document: Mapping[str, Any]) -> None:
        """Put a law on the rig: here its simulator is started anew, in a lab somebody turns a knob."""
        if self._rig is not None:
            _stop(self._rig)
        (self._folder / "axis.json").write_text(json.dumps(document))
        (self._folder / "rig.toml").write_text(RIG)
        self._rig = self._start(
            "rig", "rig-simulator", str(self._folder / "rig.toml"), "--port", str(self._port), "--as", self._driver
        )
        give_up_at = time.monotonic() + _READY_WITHIN
        while not _answers(self._port):
            if self._rig.poll() is not None or time.monotonic() > give_up_at:
                raise LabError(f"the simulated rig is not there: see {self._folder / 'rig.log'}")
            time.sleep(0.1)

    def start_agent(self) -> None:
        """Start the agent with a key of its own, and wait until it has its rig."""
        key = self.client.keys.create("lab PC", scopes=["acquire"])["key"]
        device, server = DRIVERS[self._driver]
        (self._folder / "agent.toml").write_text(AGENT.format(driver=self._driver, device=device))
        self._start(
            "agent", "agent", "--settings", str(self._folder / "agent.toml"), "--url", self._url,
            "--daq-server", server.format(port=self._port), "--spool", str(self._folder / "spool"),
            environment={"SERVOTUNE_AGENT_KEY": str(key)},
        )  # fmt: skip
        give_up_at = time.monotonic() + _READY_WITHIN
        while not any(self.client.acquisitions.rigs()):
            if time.monotonic() > give_up_at:
                raise LabError(f"the agent has not registered: see {self._folder / 'agent.log'}")
            time.sleep(0.2)

    def _start(self, name: str, *command: str, environment: Mapping[str, str] | None = None) -> subprocess.Popen[bytes]:
        with (self._folder / f"{name}.log").open("ab") as log:
            process = subprocess.Popen(  # noqa: S603 -- our own commands, no shell
                [sys.executable, "-m", "servotune", *command],
                env={**os.environ, **(environment or {})},
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
            )
        self._stack.callback(_stop, process)
        return process


@contextmanager
def lab(folder: Path, *, driver: str = "nidaqmx") -> Iterator[Lab]:
    """Start a lab in a folder, and end it.

    Raises
    ------
    LabError
        When one of its processes does not come up.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for old in (*folder.glob("lab.db*"), *folder.glob("*.log")):
        old.unlink()
    with ExitStack() as stack:
        yield Lab(folder, stack, driver=driver)


def _client(url: str, key: str) -> servotune.Client:
    waited = 0.0
    while True:
        try:
            return servotune.connect(url, key=key, wait=1.0)
        except servotune.ServiceUnreachableError:
            waited += 1.0
            if waited > _READY_WITHIN:
                raise


def _stop(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(_STOPS_WITHIN)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    assert process.stdin is not None
    process.stdin.close()


def _answers(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
