"""How recordings in files become numbers: one module for each format, a file in, pieces of channels out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from api.formats.exactness import Reading, Rounded

Values = npt.NDArray[np.float64]

PIECE = 1 << 17
"""Samples of one channel that are in memory at a time."""
MOST_CHANNELS = 500
"""Channels of one recording."""
MOST_VALUES = 2_000_000_000
"""Samples times channels of one recording: 16 GB before compression."""
LEAST_UNPACKED, MOST_RATIO = 256 << 20, 64
"""Bytes that any file may unpack to, and how many times its size a larger one may."""

NUMBERS = "a channel must hold numbers"
SAMPLES = "a channel must hold at least 2 samples"
NO_VALUES = "it has no values, a channel must hold samples: nothing was written to it, leave it out"
ANOTHER = ": is it another format? leave format out, and the file tells it"
ONE_COMPLEX = (
    f"it is a single complex number, {SAMPLES}: save its two parts as numbers, which are kept beside the channels"
)
_SHOWN = 40

TIME_OF_DAY = "time of day"
"""Quantity of instants that begin again at midnight."""


def text_reason(shown: str = "") -> str:
    """Return why a text is no channel, with its beginning."""
    got = f" such as {shown[:_SHOWN]!r}" if shown else ""
    return f"it is a text{got}, {NUMBERS}: write what it stands for as numbers"


class FormatError(ValueError):
    """A file that cannot be read as its description says.

    Parameters
    ----------
    message : str
        What is wrong, with the line and the column when they are known.
    line : int, optional
        Line of the file, from 1.
    column : int, optional
        Column of the file, from 0 as in the import description.
    """

    def __init__(self, message: str, *, line: int | None = None, column: int | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.line = line
        self.column = column


class DamagedFileError(FormatError):
    """A file whose bytes contradict its format or themselves: what is to be done is the same for all of them."""

    def __init__(self, message: str, *, line: int | None = None, column: int | None = None) -> None:
        remedy = "the file is cut off or damaged, copy it again from where it was recorded or write it anew with what made it"
        super().__init__(f"{message}: {remedy}", line=line, column=column)


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """A channel that a file holds.

    Parameters
    ----------
    name : str
        As the file has it; different for each channel of a file.
    index : int
        Its place in the file, from 0.
    count : int, optional
        Samples; None where only reading the file would tell.
    unit, quantity : str
        As the file has them, not interpreted.
    sample_rate : float, optional
        Samples per second, where the file states it.
    start_time : datetime, optional
        Of the first sample; naive where the file names no time zone.
    role : str
        ``time`` for the instants of the samples (s, or as ``unit`` says), ``counter`` for sample numbers.
    group : str
        What the file calls those that were recorded together, "" where it has no such thing.
    doubt : str
        What must be said before it can be read, "" for nothing.
    """

    name: str
    index: int
    count: int | None = None
    unit: str = ""
    quantity: str = ""
    sample_rate: float | None = None
    start_time: datetime | None = None
    role: Literal["channel", "time", "counter"] = "channel"
    group: str = ""
    doubt: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class SpectralFunction:
    """A function of frequency that a file holds: a measured response, a coherence, a spectrum.

    Parameters
    ----------
    name : str
        Different for each function of a file.
    kind : str
        What it is, in the words of the file's format.
    response, reference : str
        The points that it is of, "" where the file names none.
    response_unit, reference_unit : str
        As the file has them, not interpreted.
    count : int
        Lines.
    read : callable
        Returns the frequencies (Hz), shape (lines,), and the values, complex, shape (lines,).
    """

    name: str
    kind: str
    response: str
    reference: str
    response_unit: str = ""
    reference_unit: str = ""
    count: int
    read: Callable[[], tuple[Values, npt.NDArray[np.complex128]]]


Read = Callable[[Sequence[int]], Iterator[tuple[int, Values]]]
"""From places in `Recording.series` to (position in what was asked for, next samples), each channel in order.

Either all samples of the first channel come before those of the second, or the rows of all channels come together, in
the order of asking: so what is asked for first is never behind.
"""


def _nothing() -> None:
    """Do nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """An open file: what it holds, and how to read that.

    Parameters
    ----------
    series : sequence of Series
    read : callable
        Gives samples in pieces of bounded length.
    refused : mapping
        What cannot be read, by name, with the reason.
    scalars : mapping
        Single numbers beside the channels, by name.
    layout : mapping
        What was found out about the file, in the words of an import description.
    remarks : sequence of str
        Sentences that a person should read before trusting the channels.
    stated_count : int, optional
        Samples of a channel that the file says it has.
    functions : sequence of SpectralFunction
        What is measured over frequency, which is no channel.
    untimed : str
        Why what is called a time in the file has no instants, "" where there is nothing to be said.
    complete : bool
        Whether the channels are all that was recorded: no row that was cut off, no texts in place of numbers, and no beginning that the
        instants do not tell.
    rounded : Rounded
        How many values float64 does not hold, known once they have been read.
    close : callable
        Lets go of what was opened to read the file; the file itself is its owner's.
    """

    series: Sequence[Series]
    read: Read
    refused: Mapping[str, str] = field(default_factory=dict)
    scalars: Mapping[str, float] = field(default_factory=dict)
    layout: Mapping[str, Any] = field(default_factory=dict)
    remarks: Sequence[str] = ()
    stated_count: int | None = None
    functions: Sequence[SpectralFunction] = ()
    untimed: str = ""
    complete: bool = True
    rounded: Rounded = field(default_factory=Rounded)
    close: Callable[[], None] = _nothing


def by_channel(
    series: Sequence[Series],
    part: Callable[[int, int, int], npt.NDArray[Any]],
    rounded: Rounded,
    *,
    scale: float = 1.0,
) -> Read:
    """Return the reading of channels that lie one after the other.

    Parameters
    ----------
    series : sequence of Series
        The channels of the file, with their counts.
    part : callable
        Returns the samples start <= i < stop of a channel (channel, start, stop), in any type of number.
    rounded : Rounded
        Is told how many of them float64 does not hold.
    scale : float
        What they are multiplied by as float64.
    """

    def read(wanted: Sequence[int]) -> Iterator[tuple[int, Values]]:
        reading = Reading(rounded)
        for position, channel in enumerate(wanted):
            one = series[channel]
            assert one.count is not None
            for start in range(0, one.count, PIECE):
                values = reading.floats(one.name, part(channel, start, min(start + PIECE, one.count)))
                yield position, values if scale == 1.0 else values * scale

    return read


def claimed(what: str, values: int, *, size: int, itemsize: float) -> None:
    """Refuse a header that speaks of more numbers than the file has bytes for, before anything is done with them.

    Parameters
    ----------
    values : int
        Numbers that are claimed.
    size : int
        Bytes that are there.
    itemsize : float
        The fewest bytes that a number takes.

    Raises
    ------
    FormatError
        When they cannot be there, or are more than one recording may have.
    """
    if values < 0 or values * itemsize > size:
        raise FormatError(
            f"{what} must fit into the {size} bytes that are there, got {values} values: it is cut off or damaged, send it whole"
        )
    bounded(what, values)


def proportionate(what: str, unpacked: int, *, size: int) -> None:
    """Refuse what unpacks to more than a measurement of this size does, before it is unpacked.

    Parameters
    ----------
    unpacked : int
        Bytes that are claimed or have come so far; a value is 8 of them.
    size : int
        Bytes of the file.

    Raises
    ------
    FormatError
        With the limit.
    """
    if unpacked > max(LEAST_UNPACKED, MOST_RATIO * size):
        raise FormatError(
            f"{what} must unpack to at most {LEAST_UNPACKED >> 20} MiB or {MOST_RATIO} times the size of the file "
            f"({size} bytes), got {unpacked} bytes or more: take fewer channels, or write it with less compression"
        )


def bounded(what: str, values: int) -> None:
    """Refuse what would be more than one recording may have.

    Raises
    ------
    FormatError
        With the limit.
    """
    if values > MOST_VALUES:
        raise FormatError(f"{what} must be at most {MOST_VALUES} values, got {values}: send parts of it")
