"""Dates and times of day as data acquisition programs write them, as seconds since the midnight before the first.

    06/29/2022 04:05:36.674 PM   ->   57936.674 s

Seconds count from a near midnight, not from 1970, so that float64 keeps nanoseconds.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from datetime import date, datetime, timedelta, timezone
from typing import Literal

import numpy as np
import numpy.typing as npt

from api.formats import FormatError, Values

Order = Literal["ymd", "mdy", "dmy"]

_STAMP = re.compile(
    r"(?:(?P<a>\d{1,4})[./-](?P<b>\d{1,2})[./-](?P<c>\d{1,4})[ T]\s*)?"
    r"(?P<h>\d{1,2}):(?P<m>\d{2})(?::(?P<s>\d{2})(?:[.,:](?P<f>\d{1,9})\d*)?)?\s*(?P<half>[AaPp])?\.?(?:[Mm]\.?)?"
    r"\s*(?P<zone>Z|[+-]\d{2}:?\d{2})?"
)
_DAY = 86_400.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock:
    """How stamps are read.

    Parameters
    ----------
    order : str
        Of day, month and year.
    first : date
        The day from whose midnight seconds count.
    zone : float, optional
        What the clock of the first stamp is ahead of UTC, s; None where stamps name no zone.
    doubt : str
        Why the order cannot be told from the stamps, "" where it can.
    """

    order: Order = "ymd"
    first: date = date(1970, 1, 1)
    zone: float | None = None
    doubt: str = field(default="", compare=False)

    def seconds(self, stamps: Iterable[str]) -> Values:
        """Return the seconds of stamps.

        Raises
        ------
        FormatError
            For what is no stamp.
        """
        texts = [text.strip().strip('"').strip() for text in stamps]
        found = self._of_one_shape(texts)
        return self._one_by_one(texts) if found is None else found

    def _one_by_one(self, texts: Sequence[str]) -> Values:
        days: dict[tuple[str, str, str], float] = {}
        found = []
        for text in texts:
            match = _STAMP.fullmatch(text)
            if match is None:
                raise FormatError(
                    f"a time stamp must be a date and time of day, got {text[:40]!r}: leave the row out, or write it as the others"
                )
            parts = match["a"], match["b"], match["c"]
            if parts not in days:
                days[parts] = 0.0 if match["a"] is None else self._days(*parts) * _DAY
            found.append(days[parts] + _time_of_day(match) - self._ahead(match))
        return np.array(found)

    def _of_one_shape(self, texts: Sequence[str]) -> Values | None:
        """Return the seconds of stamps whose digits all stand at the same places, None for others."""
        match = _STAMP.fullmatch(texts[0]) if texts else None
        columns = _Columns.of(texts, match) if match else None
        if match is None or columns is None:
            return None
        hour = columns.number("h")
        if columns.afternoon is not None:
            hour = hour % 12 + 12 * columns.afternoon
        seconds = (hour * 3600 + columns.number("m") * 60 + columns.number("s")).astype(np.float64)
        if "f" in columns.spans:
            seconds += columns.number("f") / 10 ** columns.width("f")
        if "a" in columns.spans:
            dates, which = np.unique(np.stack([columns.number(name) for name in "abc"]), axis=1, return_inverse=True)
            days = [self._days(str(a).zfill(columns.width("a")), str(b), str(c)) for a, b, c in dates.T.tolist()]
            seconds += _DAY * np.array(days)[which]
        return seconds - self._ahead(match)

    def _ahead(self, match: re.Match[str]) -> float:
        """Return what the clock of a stamp is ahead of that of the first, s: it changes with summer time."""
        zone = _zone(match)
        return 0.0 if zone is None or self.zone is None else zone - self.zone

    def instant(self, seconds: float) -> datetime:
        """Return the time of a stamp: local and naive where stamps name no zone."""
        zone = None if self.zone is None else timezone(timedelta(seconds=self.zone))
        return datetime.combine(self.first, datetime.min.time(), tzinfo=zone) + timedelta(seconds=seconds)

    def _days(self, *parts: str) -> int:
        return (self._date(*parts) - self.first).days

    def _date(self, *parts: str) -> date:
        by_letter = dict(zip(self.order, (int(part) for part in parts), strict=True))
        year = by_letter["y"]
        try:
            return date(year + 2000 if year < 100 else year, by_letter["m"], by_letter["d"])
        except ValueError as error:
            raise FormatError(
                f"a date must have its parts in the order {self.order}, got {'/'.join(parts)!r}: leave the row out, or write it as the others"
            ) from error


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Columns:
    """Stamps of one shape: the digits (n, length) of all, where each part stands, and which are of the afternoon."""

    digits: npt.NDArray[np.int64]
    spans: dict[str, tuple[int, int]]
    afternoon: npt.NDArray[np.bool_] | None

    @staticmethod
    def of(texts: Sequence[str], first: re.Match[str]) -> _Columns | None:
        """Return the stamps, None when they are not all like the first."""
        grid = np.frombuffer("".join(texts).encode("ascii", errors="replace"), dtype=np.uint8)
        length = len(texts[0])
        if grid.size != len(texts) * length or any(len(text) != length for text in texts):
            return None
        grid = grid.reshape(len(texts), length)
        spans = {name: first.span(name) for name in first.groupdict() if first[name]}
        half = spans.pop("half", None)
        spans.pop("zone", None)
        is_digit = np.zeros(length, dtype=bool)
        for start, stop in spans.values():
            is_digit[start:stop] = True
        fixed, afternoon = ~is_digit, None
        if half is not None:
            fixed[half[0]] = False
            letters = grid[:, half[0]] | 0x20
            afternoon = letters == ord("p")
            if not np.all(afternoon | (letters == ord("a"))):
                return None
        digits = grid.astype(np.int64) - ord("0")
        if np.any(grid[:, fixed] != grid[0, fixed]) or np.any(((digits < 0) | (digits > 9)) & is_digit):
            return None
        return _Columns(digits=digits, spans=spans, afternoon=afternoon)

    def number(self, name: str) -> npt.NDArray[np.int64]:
        """Return a part of all stamps, 0 where they have none."""
        if name not in self.spans:
            return np.zeros(len(self.digits), dtype=np.int64)
        columns = self.digits[:, slice(*self.spans[name])]
        return np.asarray(columns @ 10 ** np.arange(columns.shape[1])[::-1])

    def width(self, name: str) -> int:
        """Return how many digits a part has."""
        start, stop = self.spans[name]
        return stop - start


def _time_of_day(match: re.Match[str]) -> float:
    hour = int(match["h"])
    if match["half"]:
        hour = hour % 12 + (12 if match["half"] in "Pp" else 0)
    whole = hour * 3600 + int(match["m"]) * 60 + int(match["s"] or 0)
    return whole + (int(match["f"]) / 10 ** len(match["f"]) if match["f"] else 0.0)


def is_stamp(text: str) -> bool:
    """Say whether a cell looks like a time of day, with or without a date."""
    return _STAMP.fullmatch(text.strip().strip('"').strip()) is not None


def _zone(match: re.Match[str]) -> float | None:
    """Return what the clock of a stamp is ahead of UTC, s."""
    text = match["zone"]
    if not text:
        return None
    if text == "Z":
        return 0.0
    return (-1.0 if text[0] == "-" else 1.0) * (int(text[1:3]) * 3600.0 + int(text[-2:]) * 60.0)


def clock_for(stamps: Sequence[str], order: Order | None = None) -> Clock:
    """Return how stamps are read; what they leave open is its `doubt`.

    Parameters
    ----------
    stamps : sequence of str
        Some of them, in order.
    order : str, optional
        Of day, month and year, where it is known.
    """
    matches = [match for text in stamps if (match := _STAMP.fullmatch(text.strip().strip('"').strip()))]
    dated = [(match["a"], match["b"], match["c"]) for match in matches if match["a"]]
    if not dated:
        return Clock()
    doubt = ""
    if order is None:
        firsts, seconds = {int(a) for a, _, _ in dated}, {int(b) for _, b, _ in dated}
        if any(len(a) == 4 for a, _, _ in dated):
            order = "ymd"
        elif max(firsts) > 12 or "." in "".join(text.partition(":")[0] for text in stamps):
            order = "dmy"  # points stand between day, month and year where that is the order
        elif max(seconds) > 12:
            order = "mdy"
        else:
            order = "dmy"
            doubt = f"the date {'/'.join(dated[0])} may begin with the day or the month: say dmy or mdy in time.order of import"
    zone = next((zone for match in matches if (zone := _zone(match)) is not None), None)
    return Clock(order=order, first=Clock(order=order)._date(*dated[0]), zone=zone, doubt=doubt)  # noqa: SLF001 - the same class
