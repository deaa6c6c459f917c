"""Channels of a stretch of a recording in SI, experiment by experiment: what spectra are made of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from api.convert.recordings import Values, in_si
from api.convert.recordings import window as part_of
from api.pointers import Place
from api.problems import invalid
from api.services.datasets import channel_of
from api.services.installation import Caller, Installation
from storage.errors import NotFoundError
from storage.models import Dataset
from storage.repositories import DatasetRepository, ProcessingRepository

MOST_NUMBERS = 20_000_000
"""Samples times channels that one request looks at: 160 MB."""
_PIECE = 1 << 19
"""Samples that are read and calibrated together (a whole number of stored blocks), so that each exists only once."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """A stretch of some channels; ``spans`` are its experiments as (first, stop)."""

    rate: float
    channels: Mapping[str, Values]
    units: Mapping[str, str]
    spans: tuple[tuple[int, int], ...]

    def experiments(self, name: str) -> list[Values]:
        """Return a channel, experiment by experiment."""
        return [self.channels[name][first:stop] for first, stop in self.spans]

    @property
    def longest(self) -> int:
        """Samples of the longest experiment."""
        return max(stop - first for first, stop in self.spans)


def read_part(
    service: Installation,
    caller: Caller,
    dataset: str,
    places: Mapping[Place, str],
    given: list[Any] | None,
    *,
    check: Callable[[float, int], None] | None = None,
) -> Part:
    """Read channels of a recording between two times.

    Parameters
    ----------
    dataset : str
    places : mapping
        Place in the request -> name of a channel.
    given : list or None
        ``part`` of the request: [t0, t1].
    check : callable, optional
        Told the rate and the samples of the longest experiment before any sample is read: raises what can be refused.

    Raises
    ------
    Problem
        422 with the place of a dataset or channel that does not exist, of missing samples, or of a part that is empty or
        too long; 409 for a dataset not ready.
    """
    with service.database.session() as session:
        repository = DatasetRepository(session, caller.workspace)
        row = _row(repository, dataset)
        described = {name: _described(row, name, place) for place, name in places.items()}
        assert row.sample_rate is not None
        assert row.sample_count is not None
        counts = ProcessingRepository(session, caller.workspace).experiments(dataset) or (row.sample_count,)
        first, stop = _stretch(row.sample_count, row.sample_rate, given, channels=len(described))
        rate = row.sample_rate
        ends = np.cumsum(counts)
        spans = [(max(int(end) - count, first), min(int(end), stop)) for end, count in zip(ends, counts, strict=True)]
        inside = tuple((a - first, b - first) for a, b in spans if b - a > 1)
        if not inside:
            got = max(stop - first, 0)
            raise invalid(f"part must hold at least 2 samples at {rate:g} samples/s, got {got}", "part")
        if check is not None:
            check(rate, max(b - a for a, b in inside))
        channels: dict[str, Values] = {}
        units: dict[str, str] = {}
        for place, name in places.items():
            channels[name], units[name] = _read(repository, row, described[name], first, stop, place=place)
    return Part(rate=rate, channels=channels, units=units, spans=inside)


def _read(
    repository: DatasetRepository, row: Dataset, channel: Mapping[str, Any], first: int, stop: int, *, place: Place
) -> tuple[Values, str]:
    """Return the samples first <= i < stop of a channel in SI, none missing, and the name of the unit."""
    assert row.sample_rate is not None
    name, unit = str(channel["name"]), ""
    values = np.empty(stop - first)
    for start in range(first - first % _PIECE, stop, _PIECE):
        begin, end = max(start, first), min(start + _PIECE, stop)
        piece, unit = in_si(repository.read_channel(row.id, name, begin, end), channel, place=place)
        missing = np.flatnonzero(~np.isfinite(piece))
        if missing.size:
            at = (begin + int(missing[0])) / row.sample_rate
            detail = f"channel {name!r} must have no missing samples in the part looked at, got one at {at:g} s"
            raise invalid(detail, *place)
        values[begin - first : end - first] = piece
    return values, unit


def _row(repository: DatasetRepository, dataset: str) -> Dataset:
    try:
        row = repository.get(dataset)
    except NotFoundError as error:
        raise invalid(f"dataset must be one that exists, got {dataset!r}", "dataset") from error
    if row.sample_rate is None and row.sample_count is not None:
        raise invalid(f"dataset must have a sample_rate, {dataset!r} has none", "dataset")
    return row


def _described(row: Dataset, name: str, place: Place) -> Mapping[str, Any]:
    try:
        return channel_of(row, name)
    except NotFoundError as error:
        known = ", ".join(str(channel["name"]) for channel in row.channels)
        raise invalid(f"channel must be one of the dataset's ({known}), got {name!r}", *place) from error


def _stretch(count: int, rate: float, given: list[Any] | None, *, channels: int) -> tuple[int, int]:
    begin, end = part_of(given, length=count / rate, name="part") or (0.0, count / rate)
    first, stop = round(begin * rate), min(round(end * rate), count)
    if (stop - first) * channels > MOST_NUMBERS:
        detail = (
            f"part must hold at most {MOST_NUMBERS // channels} samples of {channels} channels, got {stop - first}: "
            "look at a shorter one, or decimate the recording"
        )
        raise invalid(detail, "part")
    return first, stop


def check_lines(service: Installation, lines: int, *, curves: int) -> None:
    """Refuse a reply with more lines than one reply may hold.

    Raises
    ------
    Problem
        422 at ``segment``.
    """
    most = service.settings.max_numbers // curves
    if lines > most:
        detail = (
            f"segment must be so short that there are at most {most} lines, got {lines}: or look at a band, or a part"
        )
        raise invalid(detail, "segment")
