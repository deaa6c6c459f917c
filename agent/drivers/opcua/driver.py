"""A controller behind OPC UA: it times inputs and output itself, so nothing on the way disturbs a sample."""

from __future__ import annotations

import contextlib
import queue
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Literal

import numpy as np
from asyncua.client import Client

from agent.drivers.interface import Channel, Driver, Running, Samples
from agent.drivers.opcua.controller import ARM, FAILED, IDLE, PREPARE, REST, START, STOP, Controller
from agent.drivers.opcua.settings import OpcuaSettings
from agent.drivers.synchronisation import listed
from agent.errors import AttemptError, about
from agent.safety import Drive, way_home
from agent.settings import InputSettings, OutputSettings

_HEADER = 3
"""Numbers in front of the samples of a block: the run, its first sample, how many samples."""
_LOOK = 0.01
_AT_ONCE = 4_000_000
"""Bytes of blocks in one request."""
_HOME_RATE = 1000.0


class Opcua(Driver):
    """The controller of a rig."""

    settings = OpcuaSettings

    def __init__(self, settings: OpcuaSettings, *, rig: str) -> None:
        self._settings, self._rig = settings, rig
        self._controller = Controller(settings)

    @property
    def description(self) -> str:
        """How the controller is reached."""
        how = "signed and encrypted" if self._settings.secure else "not encrypted"
        return f"OPC UA {self._settings.server} ({how})"

    def close(self) -> None:
        """End the session."""
        self._controller.connection.close()

    def devices(self) -> list[dict[str, Any]]:
        """Return the controller."""
        name, model, serial = self._controller.read("Name", "Model", "Serial")
        simulated = "Simulated" in self._controller.nodes() and bool(self._controller.read("Simulated")[0])
        return [{"name": str(name), "model": str(model), "serial": str(serial), "simulated": simulated}]

    def channels(self) -> list[Channel]:
        """Return its channels."""
        inputs, lows, outputs, highs = self._controller.read("Inputs", "InputRanges", "Outputs", "OutputRanges")
        return [*_channels(inputs, lows, "input"), *_channels(outputs, highs, "output")]

    def clean(self) -> None:
        """Stop what an earlier agent has left running."""
        self._controller.obey(STOP, within=self._settings.deadline)

    def rest(self, output: OutputSettings, *, level: float | None = None) -> None:
        """Bring an output to its safe value, softly where it is known where it stands."""
        room = self._room()
        way = way_home(output, output.safe if level is None else level, _HOME_RATE)
        rate = _HOME_RATE * min(1.0, room / way.size)
        if way.size > room:  # a long way in fewer steps
            way = way_home(output, output.safe if level is None else level, rate)[-room:]
        played = {"Output": self._number(output), "Samples": way.size, "Rate": rate, **self._parts(way)}
        self.clean()
        self._controller.obey(REST, played, within=way.size / rate + self._settings.deadline)

    @contextmanager
    def run(self, inputs: Sequence[InputSettings], rate: float, *, seconds: float) -> Iterator[Running]:
        """Prepare the controller; the rate that it really has is then known."""
        del seconds
        self.admit(inputs)
        names = [entry.name for entry in self.channels() if entry.direction == "input"]
        (size,) = self._controller.read("BlockSize")
        block = int(min(max(rate * self._settings.chunk, 1), (size - _HEADER) // len(names)))
        asked = {"Rate": rate, "BlockSamples": block}
        told = listed([entry.name for entry in inputs])
        with about(f"sample rate {rate:g} of {told} ({self._settings.server})"):
            self._controller.obey(PREPARE, asked, within=self._settings.deadline)
        (actual,) = self._controller.read("ActualRate")
        columns = [names.index(entry.channel) for entry in inputs]
        running = OpcuaRunning(
            self, self._controller, self._settings, columns=columns, width=len(names), rate=float(actual)
        )
        try:
            yield running
        finally:
            running.end()

    def arm(self, samples: int, drive: Drive | None) -> None:
        """Give the controller the length of a run, and all of its drive."""
        asked: dict[str, Any] = {"Samples": samples, "Output": -1}
        if drive is not None:
            room = self._room()
            if samples > room:
                raise AttemptError(
                    "unsupported_setting",
                    f"drive of {drive.output.name} must have at most {room} samples (the controller's Drive0 ...), it has "
                    f"{samples}: lower the sample rate or the duration",
                )
            asked |= {"Output": self._number(drive.output), **self._parts(drive.block(0, samples))}
        self._controller.obey(ARM, asked, within=self._settings.deadline)

    def _number(self, output: OutputSettings) -> int:
        names = [entry.name for entry in self.channels() if entry.direction == "output"]
        self.admit((), output)
        return names.index(output.channel)

    def _room(self) -> int:
        return self._controller.count("Drive") * int(self._controller.read("BlockSize")[0])

    def _parts(self, values: Samples) -> dict[str, list[float]]:
        """Return what plays some values: arrays of a controller have one length, so the last one is filled up."""
        size = int(self._controller.read("BlockSize")[0])
        whole = np.concatenate([values, np.full(-values.size % size, values[-1])])
        return {f"Drive{i}": part.tolist() for i, part in enumerate(whole.reshape(-1, size))}


class OpcuaRunning(Running):
    """A run of the controller."""

    def __init__(
        self,
        driver: Opcua,
        controller: Controller,
        settings: OpcuaSettings,
        *,
        columns: list[int],
        width: int,
        rate: float,
    ) -> None:
        self._driver, self._controller, self._settings = driver, controller, settings
        self._columns, self._width, self.rate = columns, width, rate
        self._ring = controller.count("Block")
        self._samples = self._read = self._block = self._run = self._beat = 0
        self._drive: Drive | None = None
        self._told: queue.Queue[list[float]] = queue.Queue(maxsize=self._ring)
        self._session = -1

    def prepare(self, samples: int, drive: Drive | None) -> None:
        """Set the length of the run, and give the controller its drive."""
        self._samples, self._drive = samples, drive
        self._driver.arm(samples, drive)

    def start(self) -> None:
        """Let inputs and drive begin."""
        self._subscribe()
        self._run = self._controller.obey(START, within=self._settings.deadline)

    def end(self) -> None:
        """Stop the controller where it is still running; whatever has gone wrong before is told, not this."""
        if self._run:
            with contextlib.suppress(AttemptError):
                self._controller.obey(STOP, within=self._settings.deadline)
        self._run = 0

    def read(self) -> Samples:
        """Return the samples of the next blocks, shape (channels, n); none when the run is over."""
        if self._read >= self._samples:
            return np.empty((len(self._columns), 0))
        give_up_at = time.monotonic() + self._settings.deadline + 2.0 * self._settings.chunk
        while True:
            values = self._new()
            self._beat = (self._beat + 1) % 2**32
            self._controller.write({"Heartbeat": self._beat, "Taken": self._block})
            if values:
                return np.concatenate(values, axis=1)
            if time.monotonic() > give_up_at:
                raise AttemptError(
                    "timeout", f"sample {self._read} must come within the deadline, it did not: see the program"
                )

    def halt(self) -> float | None:
        """Stop the controller, and return where its output stands then."""
        played = self._read
        with contextlib.suppress(AttemptError):
            self._controller.obey(STOP, within=self._settings.deadline)
            played = int(self._controller.read("Played")[0])
        self._run = 0
        if self._drive is None:
            return None
        if not played:
            return self._drive.output.safe
        return float(self._drive.block(min(played, self._drive.samples) - 1, 1)[0])

    def _new(self) -> list[Samples]:
        """Return what has come; waits a little where nothing has."""
        if self._settings.way == "subscription":
            self._subscribe()
            try:
                told = self._told.get(timeout=self._settings.chunk)
            except queue.Empty:
                return self._of_ring()
            if self._index(told) == self._read:
                return [self._accept(told)]
            # One from before, or one too far ahead: what lies between is in the ring.
            return self._of_ring() if self._index(told) > self._read else []
        return self._of_ring()

    def _of_ring(self) -> list[Samples]:
        written, state = self._controller.read("Written", "State")
        waiting = int(written) - self._block
        if waiting > self._ring:
            raise self._missing(f"{waiting} blocks had to be read, the ring holds {self._ring}")
        if waiting < 0:
            raise AttemptError("server_restarted", "the controller has forgotten the run: it was restarted meanwhile")
        if not waiting:
            if state == FAILED:
                raise self._controller.failure()
            if state == IDLE and int(self._controller.read("Written")[0]) == self._block:
                raise AttemptError(
                    "stopped_early",
                    f"the controller must record {self._samples} samples, it has ended after {self._read}",
                )
            time.sleep(_LOOK)
            return []
        most = max(_AT_ONCE // int(8 * (_HEADER + self._width * self.rate * self._settings.chunk)), 1)
        numbers = [(self._block + i) % self._ring for i in range(min(waiting, most))]
        return [self._accept(block) for block in self._controller.blocks(numbers)]

    def _index(self, block: Sequence[float]) -> int:
        """Return the number of the first sample of a block, -1 for one of another run."""
        return int(block[1]) if len(block) > _HEADER and int(block[0]) == self._run else -1

    def _accept(self, block: Sequence[float]) -> Samples:
        """Take a block that must be the next one: each sample has its number, so that none is lost or counted twice."""
        first = self._index(block)
        if first > self._read:
            raise self._missing(f"sample {first} came where {self._read} was expected")
        count = int(block[2]) if first >= 0 else 0
        end = _HEADER + count * self._width
        if first < self._read or not 0 < count <= self._samples - first or end > len(block):
            raise AttemptError(
                "out_of_order",
                f"a block must begin with sample {self._read} of run {self._run} and hold what its head says, got "
                f"{list(block[:_HEADER])} and {len(block)} numbers: see the program in the controller",
            )
        self._read += count
        self._block += 1
        values = np.array(block[_HEADER:end], dtype=np.float64).reshape(count, self._width)
        return np.ascontiguousarray(values[:, self._columns].T)

    def _missing(self, what: str) -> AttemptError:
        return AttemptError(
            "overrun", f"samples are lost from {self._read} on: {what}; lower the sample rate, or make the ring longer"
        )

    def _subscribe(self) -> None:
        """Let the controller tell of new blocks, once in each session."""
        connection = self._controller.connection
        if self._settings.way != "subscription" or connection.sessions == self._session:
            return
        newest = self._controller.nodes()["Newest"]

        async def work(client: Client) -> None:
            period = 1e3 * min(self._settings.chunk, 0.1)
            made = await client.create_subscription(period, _Told(self._told))
            await made.subscribe_data_change(client.get_node(newest), queuesize=self._ring, sampling_interval=0.0)

        connection.call(work)
        self._session = connection.sessions


def _channels(names: Sequence[str], ranges: Sequence[float], direction: Literal["input", "output"]) -> list[Channel]:
    """Return channels of two arrays, which may be longer than there are channels."""
    named = [str(name) for name in names or [] if name]
    if len(ranges or []) < len(named):
        raise AttemptError(
            "controller_differs", f"each {direction} must have a range, there are {len(named)} and {len(ranges or [])}"
        )
    return [
        Channel(name=name, direction=direction, ranges=(float(limit),))
        for name, limit in zip(named, ranges, strict=False)
    ]


class _Told:
    """Hands over what the controller tells, from asyncua's thread."""

    def __init__(self, told: queue.Queue[list[float]]) -> None:
        self._queue = told

    def datachange_notification(self, node: Any, val: Any, data: Any) -> None:
        """Take a new value; asyncua's name and arguments."""
        del node, data
        with contextlib.suppress(queue.Full):  # what does not fit is missed by its number, and looked for in the ring
            self._queue.put_nowait(list(val))
