"""What settings an agent has: its service, its rig, the hardware with its channels, the disk."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from agent.errors import SettingsError


@dataclass(frozen=True, slots=True, kw_only=True)
class ServiceSettings:
    """Where the service is, and what opens it."""

    url: str = "http://127.0.0.1:8000"
    key: str = field(default="", repr=False)
    key_file: str = ""
    timeout: float = 30.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RigSettings:
    """The rig; ``confirm`` lets a person at the terminal agree to every drive."""

    name: str = ""
    confirm: bool = False
    confirm_seconds: float = 120.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DaqSettings:
    """How the hardware is reached; every driver adds what it needs.

    ``driver`` is the name of an entry point of ``servotune.drivers``. ``deadline`` is what a call may take beyond its own
    timeout, ``chunk`` what is read in one go, both in s.
    """

    driver: str = "nidaqmx"
    deadline: float = 10.0
    chunk: float = 0.25

    def check(self) -> None:
        """Make sure that the values make sense.

        Raises
        ------
        SettingsError
            With the name, the rule and the value.
        """
        for name in ("deadline", "chunk"):
            value = getattr(self, name)
            if not value > 0.0:
                raise SettingsError(f"daq.{name} must be > 0 s, got {value:g}")
            if value == math.inf:
                raise SettingsError(f"daq.{name} must be finite, got {value:g}")


@dataclass(frozen=True, slots=True, kw_only=True)
class SpoolSettings:
    """Where samples are kept until the service has them: at most ``limit`` bytes, ``reserve`` left free on the disk."""

    folder: str = "servotune-spool"
    limit: float = 50e9
    reserve: float = 1e9
    segment: float = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceSettings:
    """A module that must be there; an empty model or serial is any."""

    name: str
    model: str = ""
    serial: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationSettings:
    """What the certificate of a sensor says; days as 2027-03-02."""

    certificate: str = ""
    laboratory: str = ""
    calibrated_on: str = ""
    due: str = ""
    uncertainty_percent: float | None = None
    reference_frequency: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class StageSettings:
    """What is between a sensor and its input, an amplifier say; ``gain`` is what it delivers for one that it is given."""

    model: str = ""
    serial: str = ""
    gain: float = 1.0
    calibration: CalibrationSettings = field(default_factory=CalibrationSettings)


@dataclass(frozen=True, slots=True, kw_only=True)
class InputSettings:
    """An input with its sensor: physical value = (measured - zero) / (sensitivity · gains of its chain) + offset, in ``unit``.

    Measured are V; of a bridge V/V, of a current A, of a thermocouple K, of an encoder rad or, with ``distance``, m; of a counter edges.
    ``wiring`` is rse, nrse, diff or pseudo (empty: what the module has); ``bridge`` full, half or quarter, its ``resistance``
    Ohm; ``pulses`` those of an encoder in a turn, ``distance`` m of one pulse; ``excitation`` V, of IEPE sensors A.
    """

    name: str
    channel: str
    kind: str = "voltage"
    quantity: str = ""
    unit: str = "V"
    sensitivity: float = 1.0
    zero: float = 0.0
    offset: float = 0.0
    range: float = 10.0
    excitation: float = 0.0
    wiring: str = ""
    bridge: str = "full"
    resistance: float = 350.0
    thermocouple: str = "K"
    pulses: float = 0.0
    distance: float = 0.0
    model: str = ""
    serial: str = ""
    calibration: CalibrationSettings = field(default_factory=CalibrationSettings)
    chain: tuple[StageSettings, ...] = ()

    @property
    def overall_sensitivity(self) -> float:
        """What is measured for one ``unit`` at the input, behind every stage."""
        return self.sensitivity * math.prod(stage.gain for stage in self.chain)

    @property
    def overall_offset(self) -> float:
        """What is added to measured / ``overall_sensitivity``, in ``unit``."""
        return self.offset - self.zero / self.overall_sensitivity

    @property
    def uncertainty_percent(self) -> float | None:
        """Of the whole chain, as independent parts add up (GUM, 5.1.2); None unless each certificate says its own."""
        calibrations = [self.calibration, *(stage.calibration for stage in self.chain)]
        parts = [calibration.uncertainty_percent for calibration in calibrations]
        return None if None in parts else math.hypot(*(part for part in parts if part is not None))


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputSettings:
    """An output and the limits that no job can exceed: V, V/s, s; of ``kind`` current A and A/s; of ``kind`` digital 0 or 1."""

    name: str
    channel: str
    kind: str = "voltage"
    amplitude: float
    slew: float = math.inf
    duration: float = math.inf
    soft_start: float = 0.0
    soft_stop: float = 0.0
    safe: float = 0.0

    @property
    def unit(self) -> str:
        """What it gives is told in."""
        return {"current": "A", "digital": ""}.get(self.kind, "V")


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """All of them."""

    service: ServiceSettings
    rig: RigSettings
    daq: DaqSettings
    spool: SpoolSettings
    devices: tuple[DeviceSettings, ...] = ()
    inputs: tuple[InputSettings, ...] = ()
    outputs: tuple[OutputSettings, ...] = ()

    def channels(self) -> dict[str, Any]:
        """Return inputs and outputs as the service has them."""
        inputs = [
            _told(entry, leave=("excitation", "zero")) | {"offset": entry.overall_offset} for entry in self.inputs
        ]
        return {"inputs": inputs, "outputs": [_told(entry) for entry in self.outputs]}

    def key(self) -> str:
        """Return the key, read anew each time: a new one in the file is taken without a restart.

        Raises
        ------
        SettingsError
            When there is none.
        """
        if self.service.key:
            return self.service.key
        if not self.service.key_file:
            raise SettingsError("a key must be given: SERVOTUNE_AGENT_KEY, or key_file in [service]")
        try:
            return (
                Path(self.service.key_file).read_text(encoding="utf-8-sig").strip()
            )  # Notepad writes a mark before it
        except OSError as error:
            raise SettingsError(f"key_file must be readable, got {self.service.key_file}: {error.strerror}") from error
        except UnicodeDecodeError as error:
            raise SettingsError(f"key_file must be UTF-8, got {self.service.key_file}: {error}") from error


def _told(entry: InputSettings | OutputSettings, *, leave: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return settings of a channel as the service has them; a limit that there is none of is left out."""
    return {
        key: value
        for key, value in asdict(entry).items()
        if key not in leave and not (isinstance(value, float) and math.isinf(value))
    }
