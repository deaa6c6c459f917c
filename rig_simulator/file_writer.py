"""The bench as a program that writes files into a folder: the other side of the driver `file` of docs/agent.md."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from rig_simulator.bench import Bench
from rig_simulator.controller import Controller, ControllerError

_PAUSE = 0.005
_SECONDS = 0.1
"""Of one file."""
_MOST = 1_000_000
"""Numbers in one file."""
_AHEAD = 8
"""Files that wait to be read where the bench has no clock of its own."""


class Writer:
    """Answers what is asked for in a folder.

    Parameters
    ----------
    bench : Bench
    folder : Path
    watchdog : float
        s without a sign of life after which outputs go to 0 V.
    """

    def __init__(self, bench: Bench, folder: Path, *, watchdog: float = 5.0) -> None:
        self.bench = bench
        self._folder, self._watchdog = folder, watchdog
        self._controller = Controller(bench)
        self._run: _Run | None = None
        self._over = threading.Event()
        folder.mkdir(parents=True, exist_ok=True)
        self._thread = threading.Thread(target=self._work, name="writer", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop, whoever is still waiting."""
        self._over.set()
        self.bench.awake.set()
        self._thread.join()

    def _work(self) -> None:
        while not self._over.is_set():
            self.bench.awake.wait()
            for request in sorted(self._folder.glob("*/request.json")):
                self._take(request)
            if self._run is not None:
                self._go_on(self._run)
            time.sleep(_PAUSE)

    def _take(self, request: Path) -> None:
        """Begin what is new."""
        asked = _read(request)
        if asked is None:
            return
        place = request.parent
        request.unlink(missing_ok=True)
        match asked["what"]:
            case "device":
                self._answering(place, lambda: _write(place / "device.json", self._description()))
            case "rest":
                self._answering(place, lambda: self._rest(place, asked))
            case "run":
                self._run = None
                self._answering(place, lambda: self._prepare(place, asked))

    def _description(self) -> dict[str, Any]:
        described = {
            "name": "logger",
            "model": "simulated logger",
            "serial": self._controller.serial,
            "simulated": True,
        }
        channels = {
            place: [{"name": name, "range": limit} for name, limit in self._controller.ranges(kind).items()]
            for place, kind in (("inputs", "ai"), ("outputs", "ao"))
        }
        return {**described, **channels}

    def _rest(self, place: Path, asked: dict[str, Any]) -> None:
        self._run = None
        self._controller.rest(asked["output"], np.load(place / "drive.npy"), rate=float(asked["rate"]))
        _write(place / "rested.json", {})

    def _prepare(self, place: Path, asked: dict[str, Any]) -> None:
        rate = self._controller.prepare(float(asked["rate"]), asked["inputs"])
        self._run = _Run(place, rate=rate, columns=len(asked["inputs"]), suffix=str(asked["format"]))
        _write(place / "ready.json", {"rate": rate})

    def _go_on(self, run: _Run) -> None:
        if not run.place.exists():  # the agent has taken it away
            self._controller.stop()
            self._run = None
            return
        self._answering(run.place, lambda: self._do(run))

    def _do(self, run: _Run) -> None:
        place = run.place
        if not run.armed:
            asked = _read(place / "arm.json")
            if asked is not None:
                run.armed, run.samples = True, int(asked["samples"])
                drive = np.load(place / "drive.npy") if asked["output"] is not None else np.zeros(0)
                self._controller.arm(run.samples, asked["output"], drive)
                _write(place / "armed.json", {})
        elif _read(place / "stop.json") is not None:
            self._controller.stop()
            self._run = None
            _write(place / "stopped.json", {"played": self._controller.played})
        elif not run.started:
            if _read(place / "start.json") is not None:
                run.started, run.heard = True, time.monotonic()
                self._controller.start()
                _write(place / "started.json", {})
        else:
            self._record(run)

    def _record(self, run: _Run) -> None:
        beat = (_read(run.place / "alive.json") or {}).get("count", 0)
        if beat != run.beat:
            run.beat, run.heard = beat, time.monotonic()
        if time.monotonic() > run.heard + self._watchdog:
            self._controller.to_zero()
            raise ControllerError(
                "heartbeat_lost", f"no sign of life came within {self._watchdog:g} s: the outputs are at 0 V"
            )
        if self.bench.speed == 0.0 and len(list(run.place.glob(f"0*.{run.suffix}"))) >= _AHEAD:
            return
        most = int(min(max(run.rate * _SECONDS, 1), _MOST // run.columns))
        values = self._controller.take(most, within=_SECONDS)
        if values.shape[1]:
            run.store(values)

    def _answering(self, place: Path, work: Callable[[], None]) -> None:
        """Do something, and say in the folder what goes wrong with it."""
        try:
            work()
        except FileNotFoundError:
            self._run = None  # whoever asked has gone
            self._controller.stop()
        except ControllerError as error:
            self._run = None
            self._controller.stop()
            if place.exists():
                _write(place / "error.json", {"code": error.code, "detail": str(error)})


class _Run:
    """One run, in its folder."""

    def __init__(self, place: Path, *, rate: float, columns: int, suffix: str) -> None:
        self.place, self.rate, self.columns, self.suffix = place, rate, columns, suffix
        self.armed = self.started = False
        self.samples = self.written = self.beat = 0
        self.heard = 0.0

    def store(self, values: np.ndarray[Any, np.dtype[np.float64]]) -> None:
        """Write a file, which is there under its name when it is complete."""
        path = self.place / f"{self.written:012}.{self.suffix}"
        part = path.with_name(f"{path.name}.part")
        with part.open("wb") as file:
            if self.suffix == "npy":
                np.save(file, values.T)
            else:
                np.savetxt(file, values.T, fmt="%.17g", delimiter=",")
        part.replace(path)
        self.written += values.shape[1]


def _read(path: Path) -> dict[str, Any] | None:
    try:
        found: dict[str, Any] = json.loads(path.read_bytes())
    except FileNotFoundError:
        return None
    return found


def _write(path: Path, document: dict[str, Any]) -> None:
    part = path.with_name(f"{path.name}.part")
    part.write_text(json.dumps(document))
    part.replace(path)
