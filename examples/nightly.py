"""A servo axis that is looked after every night: checked, identified again, tuned again; somebody is told when it has changed.

Three schedules follow the newest recording of the axis: at 1:30 a validation of the present model, at 2:00 an identification, at 3:00 an
optimisation of the gain. The service tells this script by a signed webhook what has ended, and the script stores what was found
as the next revision of the model and of the loop. Start a service that may call this machine,

    SERVOTUNE_WEBHOOK_NETWORKS='["127.0.0.0/8"]' make serve

then

    .venv/bin/python examples/nightly.py --key KEY             # every night, until it is stopped
    .venv/bin/python examples/nightly.py --key KEY --tonight   # one night at once, with recordings of a simulated axis

where KEY is an admin key. Recordings come from a data acquisition, or from anything that sends them under the name of the axis.
"""

from __future__ import annotations

import argparse
import queue
import random
import struct
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import deepcopy
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import servotune
from servotune.webhooks import SignatureError, verify

AXIS = "axis 7"
LIMIT = 5.0
"""Relative error (%) of the model's velocity beyond which somebody is told."""

EVENTS = ("job.succeeded", "job.failed", "alert.validation", "alert.schedule")

#: What the command (V) makes of the axis' velocity (m/s): the model that is identified.
DRIVE: dict[str, Any] = {
    "name": f"{AXIS}: drive",
    "parameters": {
        "gain": {"value": 0.12, "lower": 0.02, "upper": 0.5, "doc": "velocity for a command of 1 V"},
        "lag": {"value": 0.030, "unit": "s", "lower": 0.002, "upper": 0.2, "doc": "time constant of the drive"},
    },
    "blocks": {
        "command": {"kind": "input"},
        "drive": {"kind": "transfer_function", "numerator": ["=gain"], "denominator": ["=lag", 1]},
    },
    "connections": [{"from": "command", "to": "drive"}],
    "outputs": {"velocity": "drive"},
}
#: The position loop around it, whose gain is tuned.
LOOP: dict[str, Any] = {
    "name": f"{AXIS}: position loop",
    "parameters": {
        **DRIVE["parameters"],
        "kp": {"value": 60, "lower": 5, "upper": 1000, "scale": "log", "doc": "proportional gain, V/m"},
    },
    "blocks": {
        "reference": {"kind": "input"},
        "error": {"kind": "sum", "signs": "+-"},
        "controller": {"kind": "gain", "gain": "=kp"},
        "axis": {"kind": "transfer_function", "numerator": ["=gain"], "denominator": ["=lag", 1, 0]},
    },
    "connections": [
        {"from": "reference", "to": "error.in1"},
        {"from": "axis", "to": "error.in2"},
        {"from": "error", "to": "controller"},
        {"from": "controller", "to": "axis"},
    ],
    "outputs": {"position": "axis"},
}
MEASURED = {"inputs": {"command": "command"}, "outputs": {"velocity": "velocity"}}
SAMPLE_RATE, SECONDS = 1000, 2.0


class Night:
    """What is kept for one axis in the service: two systems, three schedules, one webhook."""

    def __init__(self, client: servotune.Client, address: str) -> None:
        self._client = client
        self._drive = client.systems.create(DRIVE)["id"]
        self._loop = client.systems.create(LOOP)["id"]
        made = client.webhooks.create(AXIS, url=address, events=EVENTS)
        self.webhook, self.secret = made["id"], str(made["secret"])
        self.schedules: dict[str, str] = {}

    def plan(self, recording: str) -> None:
        """Make the schedules; each follows the newest recording of the axis, of which there is one."""
        fit = {"system": self._drive, "dataset": recording, **MEASURED}
        tuning = {
            "system": self._loop,
            "variables": [{"parameter": "kp"}],
            "experiments": [{"name": "step", "input": {"port": "reference", "signal": {"kind": "step"}}}],
            "goals": [
                {"metric": "response_time", "experiment": "step", "output": "position", "sense": "minimize"},
                {"metric": "overshoot", "experiment": "step", "output": "position", "upper": 0.02},
            ],
            "method": {"kind": "gradient", "starts": 4, "seed": 1},
        }
        for kind, cron, body in (
            ("validation", "30 1 * * *", fit | {"limit_percent": LIMIT, "points": 500}),
            ("identification", "0 2 * * *", fit | {"parameters": ["gain", "lag"]}),
            ("optimization", "0 3 * * *", tuning),
        ):
            newest = None if kind == "optimization" else AXIS
            made = self._client.schedules.create(
                f"{AXIS}: {kind}", cron=cron, time_zone="Europe/Bucharest", kind=kind, body=body, newest=newest
            )
            self.schedules[kind] = made["id"]
            print(f"  {kind:<15} next at {made['next_at']}")

    def hear(self, message: dict[str, Any]) -> None:
        """Do what a message of the service calls for."""
        event, data = message["type"], message["data"]
        if event.startswith("alert."):
            print(f"  ALERT: {data['detail']}")
        elif event == "job.failed":
            print(f"  FAILED: {data['kind']}: {data['error']['detail']}")
        elif data["schedule"] == self.schedules.get("identification"):
            found = self._client.jobs.get(data["id"]).result()["parameters"]
            values = {name: entry["value"] for name, entry in found.items()}
            for system in (self._drive, self._loop):
                self._store(system, values)
            intervals = ", ".join(
                f"{name} {entry['value']:.4g} {entry['unit']} ({entry['lower95']:.4g} to {entry['upper95']:.4g})"
                for name, entry in found.items()
            )
            print(f"  identified: {intervals}")
        elif data["schedule"] == self.schedules.get("optimization"):
            found = self._client.jobs.get(data["id"]).result()
            before, after = (found["goals"][0][when]["value"] for when in ("before", "after"))
            if found["certificate"]["valid"]:
                self._store(self._loop, found["best"])
            kp = found["best"]["kp"]
            print(
                f"  tuned: kp {kp:.4g} V/m, response time {1e3 * before:.3g} -> {1e3 * after:.3g} ms ({found['status']})"
            )

    def _store(self, system: str, values: Mapping[str, float]) -> None:
        """Give a stored system new values, as its next revision."""
        document = deepcopy(self._client.systems.get(system)["document"])
        for name, value in values.items():
            entry = document["parameters"][name]
            entry["value"] = value
            if "unit" in entry:
                entry["value"] = {"value": value, "unit": "s"}
        self._client.systems.update(system, document)

    def forget(self) -> None:
        """Take the schedules and the webhook away; systems, recordings and results stay."""
        for schedule in self.schedules.values():
            self._client.schedules.delete(schedule)
        self._client.webhooks.delete(self.webhook)


@contextmanager
def receiving(port: int) -> Iterator[tuple[str, queue.Queue[tuple[dict[str, str], bytes]]]]:
    """Receive what the service sends; give the address and a queue of headers and bodies."""
    came: queue.Queue[tuple[dict[str, str], bytes]] = queue.Queue()

    class Receiver(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            length = min(int(self.headers.get("Content-Length", 0)), 1 << 20)
            came.put((dict(self.headers.items()), self.rfile.read(length)))
            self.send_response(204)
            self.end_headers()

        def log_message(self, *_: Any) -> None:
            """Say nothing: what matters is printed by the script."""

    server = ThreadingHTTPServer(("127.0.0.1", port), Receiver)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/", came
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def record(client: servotune.Client, *, gain: float, lag: float, seed: int) -> str:
    """Send a recording of a simulated axis, with noise of 1 mm/s, and return its id."""
    chirp = {
        "kind": "chirp",
        "amplitude": 1,
        "start_frequency": {"value": 0.5, "unit": "Hz"},
        "end_frequency": {"value": 25, "unit": "Hz"},
        "duration": SECONDS,
    }
    observed = deepcopy(DRIVE)
    observed["outputs"]["command"] = "command"
    reply = client.simulate(
        observed,
        input={"port": "command", "signal": chirp},
        outputs=["command", "velocity"],
        duration=SECONDS,
        samples=int(SECONDS * SAMPLE_RATE) + 1,
        metrics=[],
        variants=[{"gain": gain, "lag": lag}],
    )
    curves, noise = reply["variants"][0]["outputs"], random.Random(seed)  # noqa: S311 -- noise, no secret
    samples = [
        value
        for command, velocity in zip(curves["command"], curves["velocity"], strict=True)
        for value in (command, velocity + noise.gauss(0.0, 1e-3))
    ]
    document = {
        "name": AXIS,
        "format": "raw",
        "sample_rate": SAMPLE_RATE,
        "start_time": "2026-11-20T22:00:00Z",
        "channels": [
            {"name": "command", "quantity": "voltage", "unit": "V", "scale": 1, "offset": 0},
            {"name": "velocity", "quantity": "velocity", "unit": "m/s", "scale": 1, "offset": 0},
        ],
    }
    return str(client.datasets.upload(document, struct.pack(f"<{len(samples)}d", *samples))["id"])


def tonight(client: servotune.Client, night: Night, hear: Callable[[], None]) -> None:
    """Play two nights at once: one in which nothing has changed, one after the drive has become slower."""
    for title, gain, lag in (("as it was", 0.12, 0.030), ("slower", 0.10, 0.045)):
        print(f"\nThe axis is {title}: {gain} m/s for 1 V, {1e3 * lag:g} ms")
        recording = record(client, gain=gain, lag=lag, seed=7)
        if not night.schedules:
            night.plan(recording)
        for kind in ("validation", "identification", "optimization"):
            run = client.schedules.trigger(night.schedules[kind])
            client.jobs.get(str(run["job"])).wait(progress=False)
            expected = 2 if kind == "validation" and list(client.alerts.list(source=str(run["job"]))) else 1
            for _ in range(expected):
                hear()


def main(arguments: Sequence[str] | None = None) -> int:
    """Look after the axis; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url", default="http://127.0.0.1:8000")
    parser.add_argument("--key", required=True, help="an admin key")
    parser.add_argument(
        "--port", type=int, default=0, help="where the service reaches this script (default: a free one)"
    )
    parser.add_argument("--tonight", action="store_true", help="do not wait for the night")
    options = parser.parse_args(arguments)
    try:
        with servotune.connect(options.url, key=options.key) as client, receiving(options.port) as (address, came):
            night = Night(client, address)

            def hear() -> None:
                """Wait for the next message, and do what it calls for."""
                headers, body = came.get(timeout=120 if options.tonight else None)
                try:
                    night.hear(verify(night.secret, headers, body))
                except SignatureError as error:
                    print(f"  not from the service: {error}")

            try:
                if options.tonight:
                    tonight(client, night, hear)
                    return 0
                newest = next((row["id"] for row in client.datasets.list() if row.get("name") == AXIS), None)
                night.plan(newest or record(client, gain=0.12, lag=0.030, seed=7))
                while True:
                    hear()
            finally:
                night.forget()
    except servotune.ServotuneError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    except KeyboardInterrupt:
        return 0


if __name__ == "__main__":
    sys.exit(main())
