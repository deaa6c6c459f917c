"""The data sheet in a sensor (TEDS of IEEE 1451.4), and where the entry of its input says something else.

Bits, the least significant first: manufacturer 14, model 15, letter 5, version 6, serial 24; selector 2 (0: a template of the
standard follows), template 8. Template 25 for accelerometers (1 bit, 0) without further functions (1 bit, 0) goes on with the
sensitivity, 16 bits: 5e-7 (1 + 2 * 0.00015)^n V/(m/s²). Other templates are not read, of force transducers neither.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

from agent.errors import AttemptError
from agent.settings import InputSettings

_BASIC = 8
"""Bytes that every data sheet has."""
_STANDARD, _ACCELEROMETER = 0, 25
_G = 9.80665
_UNITS = {
    "m/s**2": 1.0,
    "m/s^2": 1.0,
    "m/s²": 1.0,
    "g": _G,
    "g_0": _G,
    "g_n": _G,
    "gravity": _G,
    "standard_gravity": _G,
}
"""m/s² of a unit."""
_CLOSE, _FAR = 0.01, 0.1
"""Shares by which a sensitivity differs: a calibration moves it by less than the first, what is beyond the second is another sensor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DataSheet:
    """What a sensor says of itself; ``sensitivity`` in V/(m/s²), None where it says none that is read here."""

    manufacturer: int
    model: int
    version: str
    serial: int
    sensitivity: float | None = None

    @classmethod
    def of(cls, data: bytes) -> Self:
        """Read a data sheet, without checksums.

        Raises
        ------
        AttemptError
            `no_teds`, where it is too short.
        """
        if len(data) < _BASIC:
            raise AttemptError(
                "no_teds",
                f"the data sheet of a sensor must have at least {_BASIC} bytes, got {len(data)}",
                remedy="see to the sensor and its cable",
            )
        bits = _Bits(int.from_bytes(data, "little"))
        manufacturer, model, letter, version, serial = (bits.take(count) for count in (14, 15, 5, 6, 24))
        kind = [bits.take(count) for count in (2, 8, 1, 1)]
        code = bits.take(16)
        read = kind == [_STANDARD, _ACCELEROMETER, 0, 0] and len(data) >= _BASIC + 4
        return cls(
            manufacturer=manufacturer,
            model=model,
            version=f"{chr(ord('A') + letter - 1) if 1 <= letter <= 26 else ''}{version}",
            serial=serial,
            sensitivity=5e-7 * (1 + 2 * 0.00015) ** code if read else None,
        )

    @property
    def words(self) -> str:
        """It as a sentence."""
        told = f"manufacturer {self.manufacturer}, model {self.model}, version {self.version}, serial {self.serial}"
        return told if self.sensitivity is None else f"{told}, {self.sensitivity:.4g} V/(m/s²)"


@dataclass(frozen=True, slots=True)
class Difference:
    """What an entry says otherwise; ``grave`` where it must be another sensor, or a wrong calibration."""

    told: str
    grave: bool


def differences(entry: InputSettings, sheet: DataSheet) -> Iterator[Difference]:
    """Yield what an entry says otherwise than the sensor that is connected; what it leaves out differs in nothing."""
    if entry.serial and sheet.serial not in _numbers(entry.serial):
        yield Difference(f"the sensor has serial {sheet.serial}, its entry {entry.serial}", grave=True)
    if entry.model and sheet.model not in _numbers(entry.model):
        yield Difference(f"the sensor says model {sheet.model}, its entry {entry.model}", grave=False)
    factor = _UNITS.get(entry.unit)
    if sheet.sensitivity is not None and factor is not None:
        said = entry.sensitivity / factor
        apart = abs(abs(said) / sheet.sensitivity - 1.0)
        if apart > _CLOSE:
            told = f"the sensor says {sheet.sensitivity * factor:.4g} V for one {entry.unit}, its entry {entry.sensitivity:.4g}"
            yield Difference(told, grave=apart > _FAR)


def _numbers(text: str) -> set[int]:
    """Return the numbers in a name: 352 and 33 of 352C33."""
    return {int(digits) for digits in re.findall(r"\d+", text)}


class _Bits:
    """Bits from the least significant one on; zeros beyond the last."""

    def __init__(self, value: int) -> None:
        self._value = value

    def take(self, count: int) -> int:
        """Return the next ones as a number."""
        found = self._value & ((1 << count) - 1)
        self._value >>= count
        return found
