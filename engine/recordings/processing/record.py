"""Channels of one recording on one clock: what a processing step takes and gives.

t_n = begin + n / rate
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from engine.model.errors import ProcessingError

Real = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """Samples of several channels at the same instants.

    Parameters
    ----------
    rate : float
        Samples per second.
    channels : mapping of str to ndarray, shape (samples,)
    units : mapping of str to str
        Unit of each channel; "" for one that has none.
    begin : float
        Time of the first sample, s from that of the recording which was processed.
    """

    rate: float
    channels: Mapping[str, Real]
    units: Mapping[str, str] = field(default_factory=dict)
    begin: float = 0.0

    def __post_init__(self) -> None:
        lengths = {values.shape for values in self.channels.values()}
        if not lengths or len(lengths) > 1 or len(next(iter(lengths))) != 1:
            msg = f"channels must be at least one, all of the same length, got shapes {sorted(lengths)}"
            raise ProcessingError(msg, at=("channels",))
        if not (np.isfinite(self.rate) and self.rate > 0):
            raise ProcessingError(f"rate must be > 0 samples/s, got {self.rate:g}", at=("rate",))

    @property
    def samples(self) -> int:
        """Samples of each channel."""
        return next(iter(self.channels.values())).size

    def chosen(self, names: Iterable[str] | None) -> tuple[str, ...]:
        """Return the channels a step is about: those named, or all.

        Raises
        ------
        ProcessingError
            For a name that is no channel.
        """
        if names is None:
            return tuple(self.channels)
        listed = tuple(dict.fromkeys(names))
        for name in listed:
            self.values(name)
        return listed

    def values(self, name: str, *, complete: bool = False) -> Real:
        """Return the samples of a channel.

        Parameters
        ----------
        complete : bool
            Whether missing samples (NaN) are refused, too.

        Raises
        ------
        ProcessingError
            For a name that is no channel; for missing samples where they cannot be used.
        """
        if name not in self.channels:
            known = ", ".join(self.channels)
            raise ProcessingError(f"channel must be one of the recording's ({known}), got {name!r}", at=("channel",))
        values = self.channels[name]
        missing = np.flatnonzero(~np.isfinite(values)) if complete else np.empty(0, dtype=np.intp)
        if missing.size:
            msg = (
                f"channel {name} must have no missing samples in this step (cut or fill them first, or resample with a larger "
                f"longest where gaps are to be bridged), got {missing.size}, the first at {self.begin + missing[0] / self.rate:g} s"
            )
            raise ProcessingError(msg, at=("channel",))
        return values

    def unit(self, name: str) -> str:
        """Return the unit of a channel, "" for none."""
        return self.units.get(name, "")

    def changed(self, channels: Mapping[str, Real], units: Mapping[str, str] | None = None) -> Record:
        """Return this record with some channels replaced or added."""
        return replace(
            self, channels={**self.channels, **channels}, units={**self.units, **(units or {})}
        )  # fmt: skip


class Step(Protocol):
    """What is done to a record; the record itself stays as it is."""

    def apply(self, record: Record) -> Record:
        """Return the processed record."""
        ...


def process(record: Record, steps: Iterable[Step], *, first: int = 0) -> Record:
    """Return a record after all steps, in order.

    Parameters
    ----------
    record : Record
    steps : iterable of Step
    first : int
        Number of the first one, for the places of errors.

    Raises
    ------
    ProcessingError
        With the number of the step that cannot be done, and why.
    """
    for number, step in enumerate(steps, start=first):
        try:
            record = step.apply(record)
        except ProcessingError as error:
            raise error.within("steps", number) from error
    return record
