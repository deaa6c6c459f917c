"""Instants that count from 1970 (UTC), as controllers and web services write them: their size tells the unit.

1.7e9 s  =  1.7e12 ms  =  1.7e15 us  =  1.7e18 ns  ->  November 2023
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_FROM, _TO = (datetime(year, 1, 1, tzinfo=UTC).timestamp() for year in (2000, 2100))
_UNITS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


def epoch_of(first: float, unit: str = "") -> tuple[str, datetime] | None:
    """Return the unit and the date of an instant that counts from 1970, None for one that lies in no year 2000 ... 2099.

    Parameters
    ----------
    first : float
        As the file has it.
    unit : str
        Where the file says it, otherwise "".

    Examples
    --------
    >>> epoch_of(1_700_000_000_250.0)
    ('ms', datetime.datetime(2023, 11, 14, 22, 13, 20, 250000, tzinfo=datetime.timezone.utc))
    >>> epoch_of(12.5)
    """
    for name, per_second in _UNITS.items():
        if unit.replace("µ", "u") in {"", name} and _FROM <= first / per_second < _TO:
            return name, _EPOCH + timedelta(seconds=first / per_second)
    return None
