"""Several records as one: experiments after one another, or channels beside one another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from engine.model.errors import ProcessingError
from engine.recordings.processing.record import Record

_SAME = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class Merged:
    """One record, and the samples of each experiment in it, in order."""

    record: Record
    experiments: tuple[int, ...]


def appended(records: Sequence[Record]) -> Merged:
    """Return experiments after one another; where one ends and the next begins is remembered, nothing joins them.

    Raises
    ------
    ProcessingError
        If they differ in rate, channels or units.
    """
    first = records[0]
    for number, record in enumerate(records[1:], start=1):
        _same_rate(first, record, number)
        if set(record.channels) != set(first.channels):
            known, got = ", ".join(first.channels), ", ".join(record.channels)
            raise ProcessingError(f"channels must be those of the first ({known}), got {got}", at=("sources", number))
        for name in first.channels:
            if record.unit(name) != first.unit(name):
                msg = f"unit of {name} must be that of the first ({first.unit(name)}), got {record.unit(name)}"
                raise ProcessingError(msg, at=("sources", number))
    channels = {name: np.concatenate([record.channels[name] for record in records]) for name in first.channels}
    whole = Record(rate=first.rate, channels=channels, units=first.units, begin=first.begin)
    return Merged(record=whole, experiments=tuple(record.samples for record in records))


def side_by_side(records: Sequence[Record]) -> Merged:
    """Return the channels of records of one rate and length, which began at the same instant, as one record.

    Raises
    ------
    ProcessingError
        If they differ in rate or length, or a name comes twice.
    """
    first = records[0]
    channels, units = dict(first.channels), dict(first.units)
    for number, record in enumerate(records[1:], start=1):
        _same_rate(first, record, number)
        if record.samples != first.samples:
            msg = f"samples must be as many as those of the first ({first.samples}), got {record.samples}"
            raise ProcessingError(msg, at=("sources", number))
        twice = [name for name in record.channels if name in channels]
        if twice:
            raise ProcessingError(f"names must differ, got channel {twice[0]} twice", at=("sources", number))
        channels.update(record.channels)
        units.update(record.units)
    whole = Record(rate=first.rate, channels=channels, units=units, begin=first.begin)
    return Merged(record=whole, experiments=(first.samples,))


def _same_rate(first: Record, record: Record, number: int) -> None:
    if abs(record.rate / first.rate - 1) > _SAME:
        msg = f"rate must be that of the first ({first.rate:.10g} samples/s), got {record.rate:.10g}: resample it"
        raise ProcessingError(msg, at=("sources", number))
