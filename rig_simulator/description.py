"""A simulated rig as its user describes it: a TOML file with devices, a plant, and what is connected to what.

::

    speed = 1.0
    [plant]
    system = "axis.json"
    [[devices]]
    name = "cDAQ1Mod1"
    inputs = 4
    [[drives]]
    channel = "cDAQ1Mod2/ao0"
    input = "valve"
    [[sensors]]
    channel = "cDAQ1Mod1/ai1"
    output = "position"
    sensitivity = 100.0
"""

from __future__ import annotations

import difflib
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from api.convert.systems import diagram_from_wire
from api.problems.documents import Problem
from api.schemas.systems import SystemDocument
from rig_simulator.bench import Bench
from rig_simulator.checks import exists
from rig_simulator.devices import Device
from rig_simulator.families import FAMILIES
from rig_simulator.faults import DriverError
from rig_simulator.plant import Plant
from rig_simulator.sensors import Converter, HiddenMode, Sensor, Teds

_INPUTS = {"ai": "AI", "ctr": "CI", "port": "DI"}
_OUTPUTS = {"ao": "AO", "port": "DO"}
"""How a channel's name begins -> what it is a part of."""


class DescriptionError(ValueError):
    """A description of which no rig can be made."""


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class PlantTable(_Table):
    """The system document, by its file's name beside the description."""

    system: str


class DeviceTable(_Table):
    """A module; what is left out is what its family has."""

    name: str = Field(min_length=1)
    model: str = "NI 9234"
    serial: Annotated[str, Field(pattern="^[0-9A-Fa-f]{1,8}$")] = "01A2B3C4"
    inputs: int = Field(default=0, ge=0, le=128)
    outputs: int = Field(default=0, ge=0, le=128)
    max_rate: float = Field(default=0.0, ge=0)
    divider: int | None = Field(default=None, ge=0)
    range: float | None = Field(default=None, gt=0)
    bits: int | None = Field(default=None, ge=2, le=32)
    delay: float = Field(default=0.0, ge=0, le=1000, description="samples")


class DriveTable(_Table):
    """An output of the rig, and the input of the plant that it drives."""

    channel: str
    input: str
    gain: float = 1.0


class HiddenModeTable(_Table):
    """A structural mode between plant and sensor; Hz."""

    frequency: float = Field(gt=0)
    damping_ratio: float = Field(default=0.02, ge=0)
    share: float = 0.1


class TedsTable(_Table):
    """The data sheet in an accelerometer; ``sensitivity`` V/(m/s²)."""

    manufacturer: int = Field(ge=17, le=16381)
    model: int = Field(ge=0, le=32767)
    serial: int = Field(ge=0, le=16777215)
    version: int = Field(default=1, ge=0, le=63)
    letter: Annotated[str, Field(pattern="^[A-Z]$")] = "A"
    sensitivity: float = Field(default=0.01, ge=5e-7, le=170)


class SensorTable(_Table):
    """What is connected to an input."""

    channel: str
    output: str = ""
    loopback: str = ""
    sensitivity: float = 1.0
    offset: float = 0.0
    noise: float = Field(default=0.0, ge=0)
    hum: float = 0.0
    mains: float = Field(default=50.0, gt=0)
    highpass: float = Field(default=0.0, ge=0)
    breaks: float = Field(default=math.inf, ge=0)
    hidden_mode: HiddenModeTable | None = None
    teds: TedsTable | None = None


class Description(_Table):
    """A simulated rig."""

    speed: float = Field(default=1.0, ge=0, le=1000)
    seed: int = 1
    plant: PlantTable | None = None
    devices: list[DeviceTable] = Field(min_length=1)
    drives: list[DriveTable] = Field(default_factory=list)
    sensors: list[SensorTable] = Field(default_factory=list)


def read(path: Path) -> Bench:
    """Return the bench that a file describes.

    Raises
    ------
    DescriptionError
        With the file, the place and the rule.
    """
    try:
        given = Description.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
        plant = _plant(path.parent / given.plant.system) if given.plant is not None else None
    except OSError as error:
        raise DescriptionError(f"{error.filename} must be readable: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise DescriptionError(f"{path} must be TOML: {error}") from error
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise DescriptionError(f"{path}: {place}: {first['msg']}") from error
    _check(path, given, plant)
    try:
        devices = [_device(table) for table in given.devices]
        _connected(given, {device.name: device for device in devices})
    except ValueError as error:
        raise DescriptionError(f"{path}: {error}") from error
    return Bench(
        devices,
        plant=plant,
        drives={table.channel: (table.input, table.gain) for table in given.drives},
        sensors={table.channel: _sensor(table) for table in given.sensors},
        speed=given.speed,
        seed=given.seed,
    )


def _plant(path: Path) -> Plant:
    try:
        document = SystemDocument.model_validate_json(path.read_text(encoding="utf-8"))
        return Plant(diagram=diagram_from_wire(document))
    except ValidationError as error:
        first = error.errors()[0]
        raise DescriptionError(f"{path}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error
    except (Problem, ValueError) as error:
        raise DescriptionError(f"{path}: {error}") from error


def _check(path: Path, given: Description, plant: Plant | None) -> None:
    inputs = plant.inputs if plant else ()
    outputs = plant.outputs if plant else ()
    for drive in given.drives:
        if drive.input not in inputs:
            raise DescriptionError(
                f"{path}: input must be one of the plant's ({', '.join(inputs)}), got {drive.input!r}"
            )
    for sensor in given.sensors:
        if sensor.output and sensor.output not in outputs:
            raise DescriptionError(
                f"{path}: output must be one of the plant's ({', '.join(outputs)}), got {sensor.output!r}"
            )


def _connected(given: Description, devices: Mapping[str, Device]) -> None:
    """Make sure that everything is connected to a channel that a device has, and nothing twice."""
    if len(devices) < len(given.devices):
        names = [table.name for table in given.devices]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"name of a device must be given once, got {twice!r} twice")
    wired = [(f"drives.{i}.channel", table.channel, _OUTPUTS) for i, table in enumerate(given.drives)]
    wired += [(f"sensors.{i}.channel", table.channel, _INPUTS) for i, table in enumerate(given.sensors)]
    seen: set[str] = set()
    for place, channel, _ in wired:
        if channel in seen:
            raise ValueError(f"{place}: a channel must be connected once, got {channel!r} twice")
        seen.add(channel)
    wired += [
        (f"sensors.{i}.loopback", table.loopback, _OUTPUTS) for i, table in enumerate(given.sensors) if table.loopback
    ]
    for place, channel, subsystems in wired:
        name, _, number = channel.partition("/")
        if name not in devices:
            raise ValueError(f"{place}: device must be one of {', '.join(devices)}, got {channel!r}")
        kinds = {stem: subsystem for stem, subsystem in subsystems.items() if number.startswith(stem)}
        try:
            for subsystem in kinds.values():
                exists(devices[name], subsystem, number)
        except DriverError:
            kinds = {}
        if not kinds:
            stems = ", ".join(f"{name}/{stem}..." for stem in subsystems)
            raise ValueError(f"{place}: channel must be one that {name} has ({stems}), got {channel!r}")


def _device(table: DeviceTable) -> Device:
    row = FAMILIES.get(table.model)
    if row is None and not (table.inputs or table.outputs):
        near = difflib.get_close_matches(table.model, FAMILIES, n=3, cutoff=0.5)
        raise ValueError(
            f"model of {table.name} must be in the table of families ({', '.join(near or sorted(FAMILIES))}), or its inputs and "
            f"outputs be given, got {table.model!r}"
        )
    most = max(row.ranges, default=10.0) if row is not None else 5.0
    return Device(
        name=table.name,
        model=table.model,
        serial=int(table.serial, 16),
        inputs=table.inputs,
        outputs=table.outputs,
        max_rate=table.max_rate,
        divider=-1 if table.divider is None else table.divider,
        converter=Converter(
            range=table.range or most, bits=table.bits or (row.bits if row is not None else 24), delay=table.delay
        ),
    )


def _sensor(table: SensorTable) -> Sensor:
    mode = table.hidden_mode
    hidden = None
    if mode is not None:
        hidden = HiddenMode(frequency=2 * math.pi * mode.frequency, damping_ratio=mode.damping_ratio, share=mode.share)
    sheet = Teds(**table.teds.model_dump()) if table.teds is not None else None
    return Sensor(**table.model_dump(exclude={"channel", "hidden_mode", "teds"}), hidden_mode=hidden, teds=sheet)
