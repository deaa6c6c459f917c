"""Channels of a stretch of a recording in SI, experiment by experiment: what spectra are made of, read as it is looked at."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from api.convert.recordings import Values, in_si
from api.convert.recordings import window as part_of
from api.problems.documents import invalid
from api.problems.pointers import Place
from api.services.operation.app_context import Caller, Installation
from api.services.recordings.datasets import channel_of
from api.services.recordings.instants import even_rate, uneven
from engine.recordings.spectra.frf import Frf
from storage.errors import NotFoundError
from storage.models import Dataset
from storage.repositories import DatasetRepository, ProcessingRepository
from storage.session import Database

MOST_NUMBERS = 20_000_000
"""Samples times channels that one request looks at: 160 MB."""
_PIECE = 1 << 19
"""Samples that are read and calibrated together (a whole number of stored blocks), so that each exists only once."""


class Recorded:
    """Samples first <= i < stop of a channel in SI, read from the database whenever some of them are looked at.

    What was read last is kept: segments overlap.

    Raises
    ------
    Problem
        When they are looked at: 422 at the channel's place in the request for a missing sample.
    """

    def __init__(self, read: Callable[[int, int], Values], first: int, stop: int) -> None:
        self._read = read
        self._first = first
        self.size = stop - first
        self._kept_from, self._kept = 0, np.empty(0)

    def __getitem__(self, span: slice) -> Values:
        """Return the samples of a span without a step, not to be changed."""
        start, stop, _ = span.indices(self.size)
        end = self._kept_from + self._kept.size
        if not self._kept_from <= start < end:
            values = self._read(self._first + start, self._first + stop)
        elif stop <= end:
            return self._kept[start - self._kept_from : stop - self._kept_from]
        else:
            rest = self._read(self._first + end, self._first + stop)
            values = np.concatenate([self._kept[start - self._kept_from :], rest])
        self._kept_from, self._kept = start, values
        return values


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """A stretch of some channels, each experiment by experiment; or the responses that a file holds, and no channels."""

    rate: float
    channels: Mapping[str, list[Recorded]]
    units: Mapping[str, str]
    frfs: Mapping[str, Frf] = field(default_factory=dict)

    def experiments(self, name: str) -> list[Values]:
        """Return all samples of a channel."""
        return [recorded[:] for recorded in self.channels[name]]

    @property
    def longest(self) -> int:
        """Samples of the longest experiment."""
        return max(recorded.size for channel in self.channels.values() for recorded in channel)


def part_of_recording(
    service: Installation,
    caller: Caller,
    dataset: str,
    places: Mapping[Place, str],
    given: list[Any] | None,
    *,
    check: Callable[[float, int], None] | None = None,
) -> Part:
    """Return channels as :func:`stored_part`, read while other requests may compute."""
    quiet = service.computing.quiet
    return stored_part(service.database, caller.workspace, dataset, places, given, check=check, quiet=quiet)


def stored_part(
    database: Database,
    workspace: str,
    dataset: str,
    places: Mapping[Place, str],
    given: list[Any] | None,
    *,
    check: Callable[[float, int], None] | None = None,
    quiet: Callable[[], AbstractContextManager[object]] = nullcontext,
) -> Part:
    """Return channels of a recording between two times, of which no sample is read yet.

    Parameters
    ----------
    dataset : str
    places : mapping
        Place in the request -> name of a channel.
    given : list or None
        ``part`` of the request: [t0, t1].
    check : callable, optional
        Told the rate and the samples of the longest experiment: raises what can be refused.
    quiet : callable
        Held while samples are read.

    Raises
    ------
    Problem
        422 with the place of a dataset or channel that does not exist, of a unit without a factor, or of a part that is
        empty or too long; 409 for a dataset not ready.
    """
    with database.session() as session:
        repository = DatasetRepository(session, workspace)
        row = _row(repository, dataset)
        described = {name: _described(row, name, place) for place, name in places.items()}
        assert row.sample_rate is not None
        assert row.sample_count is not None
        counts = ProcessingRepository(session, workspace).experiments(dataset) or (row.sample_count,)
        first, stop = _stretch(row.sample_count, row.sample_rate, given, channels=len(described))
        rate = row.sample_rate
        ends = np.cumsum(counts)
        spans = [(max(int(end) - count, first), min(int(end), stop)) for end, count in zip(ends, counts, strict=True)]
        inside = [(begin, end) for begin, end in spans if end - begin > 1]
        if not inside:
            got = max(stop - first, 0)
            raise invalid(f"part must hold at least 2 samples at {rate:g} samples/s, got {got}", "part")
        if check is not None:
            check(rate, max(end - begin for begin, end in inside))
    channels: dict[str, list[Recorded]] = {}
    units: dict[str, str] = {}
    for place, name in places.items():
        _, units[name] = in_si(np.empty(0), described[name], place=place)
        read = partial(
            _read, database, workspace, dataset, quiet=quiet, channel=described[name], rate=rate, place=place
        )
        channels[name] = [Recorded(read, begin, end) for begin, end in inside]
    return Part(rate=rate, channels=channels, units=units)


def _read(
    database: Database,
    workspace: str,
    dataset: str,
    first: int,
    stop: int,
    *,
    quiet: Callable[[], AbstractContextManager[object]],
    channel: Mapping[str, Any],
    rate: float,
    place: Place,
) -> Values:
    """Return the samples first <= i < stop of a channel in SI, none missing."""
    name = str(channel["name"])
    values = np.empty(stop - first)
    with quiet(), database.session() as session:
        repository = DatasetRepository(session, workspace)
        for start in range(first - first % _PIECE, stop, _PIECE):
            begin, end = max(start, first), min(start + _PIECE, stop)
            piece, _ = in_si(repository.read_channel(dataset, name, begin, end), channel, place=place)
            missing = np.flatnonzero(~np.isfinite(piece))
            if missing.size:
                at = (begin + int(missing[0])) / rate
                detail = f"channel {name!r} must have no missing samples in the part looked at, got one at {at:g} s"
                raise invalid(detail, *place)
            values[begin - first : end - first] = piece
    return values


def _row(repository: DatasetRepository, dataset: str) -> Dataset:
    try:
        row = repository.get(dataset)
    except NotFoundError as error:
        raise invalid(f"dataset must be one that exists, got {dataset!r}", "dataset") from error
    if uneven(row):
        even_rate(row, "dataset")
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
