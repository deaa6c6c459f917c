"""Runs by files: the agent says in a folder what is to be done, the other program puts the samples there."""

from __future__ import annotations

import contextlib
import time
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np

from agent.drivers.file.exchange import complain, load, put, remove, save, wait
from agent.drivers.file.settings import FileSettings
from agent.drivers.interface import Channel, Driver, Running, Samples
from agent.drivers.synchronisation import listed
from agent.errors import AttemptError, about
from agent.safety import Drive, way_home
from agent.settings import InputSettings, OutputSettings

_LOOK = 0.01
_HOME_RATE = 1000.0
_DIGITS = 12


class Files(Driver):
    """The folder of a rig."""

    settings = FileSettings

    def __init__(self, settings: FileSettings, *, rig: str) -> None:
        self._settings, self._rig = settings, rig
        self._folder = Path(settings.folder)

    @property
    def description(self) -> str:
        """Where the folder is."""
        return f"files in {self._folder}"

    def devices(self) -> list[dict[str, Any]]:
        """Return what the other program calls itself, which it has to answer for: a file alone could be years old."""
        described = self._described()
        return [
            {
                "name": str(described.get("name", "")),
                "model": str(described.get("model", "")),
                "serial": str(described.get("serial", "")),
                "simulated": bool(described.get("simulated", False)),
            }
        ]

    def channels(self) -> list[Channel]:
        """Return the channels that the other program has."""
        described = self._described()
        try:
            return [
                *(_channel(entry, "input") for entry in described.get("inputs", [])),
                *(_channel(entry, "output") for entry in described.get("outputs", [])),
            ]
        except (KeyError, TypeError, ValueError) as error:
            raise AttemptError(
                "wrong_file", f"{self._folder / 'device.json'}: each channel must have a name and a range ({error!r})"
            ) from error

    def _described(self) -> dict[str, Any]:
        """Ask the other program for itself."""
        place = self._ask("device", {})
        try:
            return wait(place / "device.json", within=self._settings.deadline)
        finally:
            remove(place)

    def clean(self) -> None:
        """Stop what an earlier agent has left running."""
        for place in sorted(self._folder.glob("run-*")):
            put(place / "stop.json", {})
            with contextlib.suppress(AttemptError):
                wait(place / "stopped.json", within=self._settings.deadline)
            remove(place)

    def rest(self, output: OutputSettings, *, level: float | None = None) -> None:
        """Bring an output to its safe value, softly where it is known where it stands."""
        self.admit((), output)
        way = way_home(output, output.safe if level is None else level, _HOME_RATE)
        self.clean()
        place = self._ask("rest", {"output": output.channel, "rate": _HOME_RATE}, drive=way)
        try:
            wait(place / "rested.json", within=way.size / _HOME_RATE + self._settings.deadline)
        finally:
            remove(place)

    @contextmanager
    def run(self, inputs: Sequence[InputSettings], rate: float, *, seconds: float) -> Iterator[Running]:
        """Ask for a run; the rate that it really has is then known."""
        del seconds
        self.admit(inputs)
        asked = {"rate": rate, "inputs": [entry.channel for entry in inputs], "format": self._settings.format}
        place = self._ask("run", asked)
        running = FileRunning(place, self._settings, columns=len(inputs))
        try:
            told = listed([entry.name for entry in inputs])
            with about(f"sample rate {rate:g} of {told} ({self._folder})"):
                ready = wait(place / "ready.json", within=self._settings.deadline)
            running.rate = _positive(ready.get("rate"), place / "ready.json")
            yield running
        finally:
            running.halt()
            remove(place)

    def _ask(self, what: str, document: dict[str, Any], *, drive: Samples | None = None) -> Path:
        """Make the folder of a request, which is complete when `request.json` is in it."""
        place = self._folder / f"{what}-{uuid.uuid4().hex}"
        try:
            place.mkdir()
        except OSError as error:
            raise AttemptError("folder_refuses", f"daq.folder must be a writable folder: {error}") from error
        if drive is not None:
            save(place / "drive.npy", drive)
        put(place / "request.json", {"what": what, **document})
        return place


class FileRunning(Running):
    """A run of the other program."""

    def __init__(self, place: Path, settings: FileSettings, *, columns: int) -> None:
        self._place, self._settings, self._columns = place, settings, columns
        self._samples = self._read = self._beat = 0
        self._drive: Drive | None = None
        self._begun = False
        self._held: set[str] = set()
        self._next_beat = 0.0

    def prepare(self, samples: int, drive: Drive | None) -> None:
        """Set the length of the run, and write its drive down."""
        self._samples, self._drive = samples, drive
        if drive is not None:
            save(self._place / "drive.npy", np.concatenate(list(drive.blocks())))
        output = None if drive is None else drive.output.channel
        put(self._place / "arm.json", {"samples": samples, "output": output})
        wait(self._place / "armed.json", within=self._settings.deadline)

    def start(self) -> None:
        """Let inputs and drive begin."""
        self._begun = True
        put(self._place / "start.json", {})
        wait(self._place / "started.json", within=self._settings.deadline)

    def read(self) -> Samples:
        """Return the samples of the next file, shape (channels, n); none when the run is over."""
        if self._read >= self._samples:
            return np.empty((self._columns, 0))
        path = self._file(self._read)
        give_up_at = time.monotonic() + self._settings.deadline + 2.0 * self._settings.chunk
        while True:
            self._live()
            values = load(path, columns=self._columns)
            if values is not None:
                break
            complain(self._place)
            self._look_for_others(path)
            if time.monotonic() > give_up_at:
                word, state = (
                    ("timeout", "it is not complete") if path.exists() else ("server_unreachable", "it did not")
                )
                raise AttemptError(
                    word, f"{path} must come within {self._settings.deadline:g} s, {state}: see the other program"
                )
            time.sleep(_LOOK)
        try:
            path.unlink()
        except OSError:  # the other program holds it open; what is read is not read again
            self._held.add(path.name)
        self._read += values.shape[0]
        if self._read > self._samples:
            raise AttemptError(
                "out_of_order", f"{path} must end with sample {self._samples - 1}, it ends with {self._read - 1}"
            )
        return np.ascontiguousarray(values.T)

    def _live(self) -> None:
        """Tell the other program that somebody reads."""
        if time.monotonic() >= self._next_beat:
            self._beat += 1
            put(self._place / "alive.json", {"count": self._beat})
            self._next_beat = time.monotonic() + self._settings.chunk

    def _file(self, first: int) -> Path:
        return self._place / f"{first:0{_DIGITS}}.{self._settings.format}"

    def _look_for_others(self, path: Path) -> None:
        """See whether the next file can still come: files are named by their first sample, and come in order."""
        for other in self._place.glob(f"*.{self._settings.format}"):
            if not other.stem.isdigit() or other == path:
                continue
            first = int(other.stem)
            if first > self._read and not path.exists():
                raise AttemptError("overrun", f"samples are lost from {self._read} on: {other.name} came instead")
            if first < self._read and other.name not in self._held:
                raise AttemptError("out_of_order", f"{other.name} came after sample {self._read - 1} had been read")

    def halt(self) -> float | None:
        """Stop the other program, and return where its output stands then."""
        played = self._read
        if self._begun:
            self._begun = False
            with contextlib.suppress(AttemptError):
                put(self._place / "stop.json", {})
                stopped = wait(self._place / "stopped.json", within=self._settings.deadline)
                played = int(stopped.get("played", played))
        if self._drive is None:
            return None
        if not played:
            return self._drive.output.safe
        return float(self._drive.block(min(played, self._drive.samples) - 1, 1)[0])


def _channel(entry: dict[str, Any], direction: Literal["input", "output"]) -> Channel:
    return Channel(name=str(entry["name"]), direction=direction, ranges=(float(entry["range"]),))


def _positive(value: Any, path: Path) -> float:
    if isinstance(value, int | float) and not isinstance(value, bool) and 0.0 < value < float("inf"):
        return float(value)
    raise AttemptError("wrong_file", f"{path}: rate must be > 0 samples/s, got {value!r}")
