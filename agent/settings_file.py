"""The settings of an agent: a TOML file, then environment variables, then arguments; the later one counts.

::

    [service]
    url = "https://servotune.example"      # SERVOTUNE_AGENT_URL, --url
    key_file = "/etc/servotune/key"        # SERVOTUNE_AGENT_KEY holds the key itself
    [rig]
    name = "bench-1"                       # SERVOTUNE_AGENT_RIG, --rig
    [daq]
    driver = "nidaqmx"                     # or another of `servotune.drivers`; the rest of the table is the driver's own
    server = "127.0.0.1:31763"             # absent: the driver of this PC
    [spool]
    folder = "/var/lib/servotune-agent"    # SERVOTUNE_AGENT_SPOOL, --spool
    [[inputs]]
    name = "position"
    channel = "cDAQ1Mod1/ai1"
    [[outputs]]
    name = "valve"
    channel = "cDAQ1Mod2/ao0"
    amplitude = 5.0
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, fields
from datetime import date
from pathlib import Path
from typing import Any, TypeVar

from agent.drivers.loading import load
from agent.errors import SettingsError
from agent.settings import (
    CalibrationSettings,
    DaqSettings,
    DeviceSettings,
    InputSettings,
    OutputSettings,
    RigSettings,
    ServiceSettings,
    Settings,
    SpoolSettings,
    StageSettings,
)

Section = TypeVar("Section")

_NAME, _LONGEST_NAME = re.compile("[A-Za-z][A-Za-z0-9_]*"), 64
"""What the service takes as the name of a channel."""
_WORDS = {
    "wiring": ("", "rse", "nrse", "diff", "pseudo"),
    "bridge": ("full", "half", "quarter"),
    "thermocouple": ("B", "E", "J", "K", "N", "R", "S", "T"),
}
_WITHOUT_UNIT = frozenset({"digital", "counter"})
"""Kinds that deliver a number without a unit."""
_VARIABLES = {
    "SERVOTUNE_AGENT_URL": ("service", "url"),
    "SERVOTUNE_AGENT_KEY": ("service", "key"),
    "SERVOTUNE_AGENT_RIG": ("rig", "name"),
    "SERVOTUNE_AGENT_DAQ_SERVER": ("daq", "server"),
    "SERVOTUNE_AGENT_SPOOL": ("spool", "folder"),
}


def read(path: Path | None, environment: Mapping[str, str], arguments: Mapping[str, Any]) -> Settings:
    """Return the settings.

    Parameters
    ----------
    path : Path, optional
        The TOML file.
    environment : mapping
        Of the process.
    arguments : mapping
        ``section.name`` -> value; None is not given.

    Raises
    ------
    SettingsError
        With the place of what is wrong.
    """
    tables = _tables(path)
    for variable, (section, name) in _VARIABLES.items():
        if environment.get(variable):
            tables.setdefault(section, {})[name] = environment[variable]
    for key, value in arguments.items():
        if value is not None:
            section, _, name = key.partition(".")
            tables.setdefault(section, {})[name] = value
    known = {"service", "rig", "daq", "spool", "devices", "inputs", "outputs"}
    for section in tables:
        if section not in known:
            raise SettingsError(f"section must be one of {', '.join(sorted(known))}, got [{section}]")
    settings = Settings(
        service=_section(ServiceSettings, tables.get("service", {}), "service"),
        rig=_section(RigSettings, tables.get("rig", {}), "rig"),
        daq=_daq(tables.get("daq", {})),
        spool=_section(SpoolSettings, tables.get("spool", {}), "spool"),
        devices=_list(DeviceSettings, tables, "devices"),
        inputs=_list(InputSettings, tables, "inputs"),
        outputs=_list(OutputSettings, tables, "outputs"),
    )
    _check(settings)
    return settings


def _tables(path: Path | None) -> dict[str, Any]:
    if path is None:
        return {}
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise SettingsError(f"{path} must be readable: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise SettingsError(f"{path} must be UTF-8: {error}") from error
    except tomllib.TOMLDecodeError as error:
        told = "; a path of Windows stands in single quotes" if "\\" in str(error) else ""
        raise SettingsError(f"{path} must be TOML: {error}{told}") from error


def _daq(table: Any) -> DaqSettings:
    """Return the settings of the hardware, as their driver has them."""
    named = table.get("driver", DaqSettings().driver) if isinstance(table, dict) else DaqSettings().driver
    return _section(load(_checked(named, "str", "daq.driver")).settings, table, "daq")


def _list(kind: type[Section], tables: Mapping[str, Any], name: str) -> tuple[Section, ...]:
    given = tables.get(name, [])
    if not isinstance(given, list):
        raise SettingsError(f"{name} must be written as [[{name}]], got [{name}]")
    found = tuple(_section(kind, table, f"{name}[{i}]") for i, table in enumerate(given))
    names = [entry.name for entry in found]  # type: ignore[attr-defined] # every one of them has a name
    for entry in names:
        if names.count(entry) > 1:
            raise SettingsError(f"{name}: name must be different for each, got {entry!r} twice")
    return found


def _section(kind: type[Section], table: Any, place: str) -> Section:
    if not isinstance(table, dict):
        raise SettingsError(f"{place} must be a table, got {table!r}")
    declared = {entry.name: entry for entry in fields(kind)}  # type: ignore[arg-type] # they are all dataclasses
    values: dict[str, Any] = {"unit": ""} if kind is InputSettings and table.get("kind") in _WITHOUT_UNIT else {}
    for name, value in table.items():
        if name not in declared:
            raise SettingsError(f"{place}: setting must be one of {', '.join(declared)}, got {name!r}")
        values[name] = _checked(value, str(declared[name].type), f"{place}.{name}")
    for name, entry in declared.items():
        if name not in values and entry.default is MISSING and entry.default_factory is MISSING:
            raise SettingsError(f"{place}.{name} must be given")
    return kind(**values)


def _checked(value: Any, type_: str, place: str) -> Any:
    if type_ == "CalibrationSettings":
        return _section(CalibrationSettings, value, place)
    if type_ == "tuple[StageSettings, ...]":
        if not isinstance(value, list):
            raise SettingsError(f"{place} must be written as [[inputs.chain]], got {value!r}")
        return tuple(_section(StageSettings, table, f"{place}[{i}]") for i, table in enumerate(value))
    if type_ == "str" and type(value) is date:
        return value.isoformat()  # TOML has days of its own
    type_ = type_.removesuffix(" | None")
    if type_ == "float" and isinstance(value, int | float) and not isinstance(value, bool) and not math.isnan(value):
        return float(value)
    if (type_ == "str" and isinstance(value, str)) or (type_ == "bool" and isinstance(value, bool)):
        return value
    word = {"float": "a number", "str": "text", "bool": "true or false"}[type_]
    raise SettingsError(f"{place} must be {word}, got {value!r}")


def _check(settings: Settings) -> None:
    if not settings.rig.name:
        raise SettingsError("rig.name must be given (--rig)")
    settings.daq.check()
    kinds = load(settings.daq.driver).kinds
    for name in [*(entry.name for entry in settings.inputs), *(output.name for output in settings.outputs)]:
        if not _NAME.fullmatch(name) or len(name) > _LONGEST_NAME:
            raise SettingsError(
                f"name of a channel must begin with a letter and have letters, digits and _ only, {_LONGEST_NAME} at most, "
                f"got {name!r}"
            )
    for entry in settings.inputs:
        _check_input(entry, kinds)
    for output in settings.outputs:
        _check_output(output)
    for name, value, least in (
        ("limit", settings.spool.limit, "> 0"),
        ("segment", settings.spool.segment, "> 0"),
        ("reserve", settings.spool.reserve, ">= 0"),
    ):
        if not (value > 0.0 or (value == 0.0 and least == ">= 0")):
            raise SettingsError(f"spool.{name} must be {least}, got {value:g}")
    _check_channels(settings)


def _check_channels(settings: Settings) -> None:
    """Refuse a channel of the hardware that two entries have: drivers take case and a leading / for nothing."""
    taken: dict[str, str] = {}
    entries = [(f"input {entry.name}", entry.channel) for entry in settings.inputs]
    for place, channel in [*entries, *((f"output {output.name}", output.channel) for output in settings.outputs)]:
        first = taken.setdefault(channel.removeprefix("/").casefold(), place)
        if first != place:
            raise SettingsError(
                f"{place}: channel must be one that no other entry has, got {channel!r}, which {first} has"
            )


def _check_input(entry: InputSettings, kinds: tuple[str, ...]) -> None:
    place = f"input {entry.name}"
    if entry.kind not in kinds:
        raise SettingsError(f"{place}: kind must be one of {', '.join(kinds)}, got {entry.kind!r}")
    if entry.sensitivity == 0.0 or not math.isfinite(entry.sensitivity):
        raise SettingsError(f"{place}: sensitivity must be finite and not 0, got {entry.sensitivity:g}")
    for name in ("zero", "offset"):
        if not math.isfinite(getattr(entry, name)):
            raise SettingsError(f"{place}: {name} must be finite, got {getattr(entry, name):g}")
    if entry.kind == "digital" and entry.unit not in {"", "1"}:
        raise SettingsError(f"{place}: unit must be left out for a digital input, which is 0 or 1, got {entry.unit!r}")
    if not 0.0 < entry.range < math.inf:
        raise SettingsError(f"{place}: range must be > 0 V, got {entry.range:g}")
    _check_kind(entry, place)
    _check_calibration(entry.calibration, place)
    for i, stage in enumerate(entry.chain):
        if stage.gain == 0.0 or not math.isfinite(stage.gain):
            raise SettingsError(f"{place}: chain[{i}].gain must be finite and not 0, got {stage.gain:g}")
        _check_calibration(stage.calibration, f"{place}: chain[{i}]")


def _check_calibration(given: CalibrationSettings, place: str) -> None:
    for name in ("calibrated_on", "due"):
        day = getattr(given, name)
        try:
            date.fromisoformat(day or "2000-01-01")
        except ValueError as error:
            raise SettingsError(f"{place}: calibration.{name} must be a day such as 2027-03-02, got {day!r}") from error
    if given.due and given.calibrated_on and given.due < given.calibrated_on:
        raise SettingsError(
            f"{place}: calibration.due must not be before calibrated_on, {given.calibrated_on}, got {given.due}"
        )
    if given.uncertainty_percent is not None and not 0.0 <= given.uncertainty_percent < math.inf:
        raise SettingsError(
            f"{place}: calibration.uncertainty_percent must be finite and >= 0, got {given.uncertainty_percent:g}"
        )


def _check_kind(entry: InputSettings, place: str) -> None:
    """Judge what only some kinds of inputs have."""
    for name, words in _WORDS.items():
        if getattr(entry, name) not in words:
            known = ", ".join(word for word in words if word)
            raise SettingsError(f"{place}: {name} must be one of {known}, got {getattr(entry, name)!r}")
    for name in ("excitation", "resistance", "pulses", "distance"):
        if not 0.0 <= getattr(entry, name) < math.inf:
            raise SettingsError(f"{place}: {name} must be finite and >= 0, got {getattr(entry, name):g}")
    if entry.kind == "encoder" and (entry.pulses >= 1.0) == (entry.distance > 0.0):
        raise SettingsError(
            f"{place}: pulses (of a turn, at least 1) or distance (m of one pulse) must be given, one of them, got "
            f"pulses {entry.pulses:g} and distance {entry.distance:g}"
        )
    counted = "m" if entry.distance else "rad"
    if entry.kind == "encoder" and entry.overall_sensitivity == 1.0 and entry.unit not in {counted, ""}:
        raise SettingsError(
            f"{place}: sensitivity must be given where unit is not {counted}, which an encoder delivers: {counted} for one "
            f"{entry.unit}, got unit {entry.unit!r} and none"
        )
    if entry.kind == "counter" and entry.overall_sensitivity == 1.0 and entry.unit not in {"", "1"}:
        raise SettingsError(
            f"{place}: sensitivity must be given where a counter has a unit: edges for one {entry.unit}, got none"
        )
    if entry.pulses != round(entry.pulses):
        raise SettingsError(f"{place}: pulses must be a whole number, got {entry.pulses:g}")


def _check_output(output: OutputSettings) -> None:
    place = f"output {output.name}"
    if output.kind not in {"voltage", "current", "digital"}:
        raise SettingsError(f"{place}: kind must be one of voltage, current, digital, got {output.kind!r}")
    for name in ("amplitude", "slew", "duration"):
        if not getattr(output, name) > 0.0:
            raise SettingsError(f"{place}: {name} must be > 0, got {getattr(output, name):g}")
    for name in ("soft_start", "soft_stop"):
        if not 0.0 <= getattr(output, name) < math.inf:
            raise SettingsError(f"{place}: {name} must be >= 0 s, got {getattr(output, name):g}")
    if not output.soft_start + output.soft_stop <= output.duration:
        raise SettingsError(
            f"{place}: soft_start and soft_stop must fit into duration, {output.duration:g} s, got {output.soft_start:g} and "
            f"{output.soft_stop:g}"
        )
    if not abs(output.safe) <= output.amplitude:
        raise SettingsError(f"{place}: safe must be within {output.amplitude:g} {output.unit}, got {output.safe:g}")
    if output.kind == "digital":
        _check_line(output, place)


def _check_line(output: OutputSettings, place: str) -> None:
    rules = {"amplitude": (1.0,), "safe": (0.0, 1.0), "slew": (math.inf,), "soft_start": (0.0,), "soft_stop": (0.0,)}
    for name, values in rules.items():
        if getattr(output, name) not in values:
            raise SettingsError(
                f"{place}: {name} must be {' or '.join(f'{value:g}' for value in values)} for a digital output, got "
                f"{getattr(output, name):g}"
            )
