"""Units of derivatives and integrals over time, as texts.

[dx/dt] = [x]/s,   [∫ x dt] = [x] s
"""

from __future__ import annotations

import re

_PER_SECONDS = re.compile(r"^(?P<head>.+?)/s(?:(?:\*\*|\^)(?P<power>\d))?$")


def per_second(unit: str) -> str:
    """Return the unit of a derivative by time, "" where the unit is not known.

    >>> per_second("mm"), per_second("m/s"), per_second("m/s**2"), per_second("N*m")
    ('mm/s', 'm/s**2', 'm/s**3', 'N*m/s')
    """
    return _turned(unit, 1)


def times_second(unit: str) -> str:
    """Return the unit of an integral over time, "" where the unit is not known.

    >>> times_second("m/s**2"), times_second("m/s"), times_second("N"), times_second("1/s")
    ('m/s', 'm', 'N*s', '1')
    """
    return _turned(unit, -1)


def _turned(unit: str, by: int) -> str:
    if not unit:
        return ""
    plain = unit.replace("²", "**2").replace("³", "**3").replace(" ", "")
    found = _PER_SECONDS.match(plain)
    head = found["head"] if found else plain
    power = by + (int(found["power"] or 1) if found else 0)
    if power == 0:
        return head
    if power < 0:
        return f"{head}*s"
    return f"{head}/s" if power == 1 else f"{head}/s**{power}"
