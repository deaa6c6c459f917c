"""What becomes of the samples of a file with its instants: an even axis, the instants kept beside them, or resampled ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from api.formats import TIME_OF_DAY, FormatError, Recording, Values
from api.services.recordings.importing import Plan
from api.services.recordings.sampling import TimeAxis
from engine.model.errors import ProcessingError
from engine.recordings.processing.uneven import evened

MOST_RESAMPLED = 50_000_000
"""Values that are resampled in one import: they are in memory together."""


class Sink(Protocol):
    """Takes the samples of each channel in order."""

    def add(self, channel: int, samples: Values) -> None:
        """Take the next samples (n,) of a channel."""


class Timing:
    """Samples at the rate that is stated."""

    def __init__(self, plan: Plan, writing: Sink, axis: TimeAxis | None = None) -> None:
        self._plan = plan
        self._writing = writing
        self.axis = axis
        """What is known of the instants, None where none are looked at."""

    @property
    def count(self) -> int | None:
        """Instants until now, None where none are looked at."""
        return None

    @property
    def rate(self) -> float | None:
        """Samples per second, None where the instants are uneven."""
        return self._plan.sample_rate

    def channels(self, described: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
        """Return the channels that are written."""
        return list(described)

    def add(self, instants: Values) -> None:
        """Take the next instants, which come before the samples at them."""
        raise NotImplementedError

    def hand_on(self, channel: int, values: Values) -> None:
        """Write the next samples of a channel."""
        self._writing.add(channel, values)

    def finish(self) -> None:
        """Write what could not be written before the last sample was there."""

    def document(self) -> dict[str, Any]:
        """Return what is known of the instants."""
        return {"requested": self._plan.sample_rate, "actual": None, "gaps": [], "gap_count": 0}

    def remarks(self) -> list[str]:
        """Return sentences on what a person should know."""
        return []


class _Even(Timing):
    """Samples on an even axis; gaps are filled with missing ones, or closed."""

    def __init__(self, plan: Plan, writing: Sink, axis: TimeAxis) -> None:
        super().__init__(plan, writing, axis)
        self._axis = axis
        self._counts: dict[int, int] = {}

    @property
    def count(self) -> int | None:
        return self._axis.count

    @property
    def rate(self) -> float | None:
        return self._axis.rate

    def add(self, instants: Values) -> None:
        self._axis.add(instants)

    def hand_on(self, channel: int, values: Values) -> None:
        start = self._counts.get(channel, 0)
        self._counts[channel] = start + values.size
        self._writing.add(channel, self._axis.filled(start, values))

    def document(self) -> dict[str, Any]:
        return self._axis.document()

    def remarks(self) -> list[str]:
        return self._axis.remarks()


class _Kept(Timing):
    """Samples with their instants as the first channel."""

    def __init__(self, plan: Plan, writing: Sink, axis: TimeAxis) -> None:
        super().__init__(plan, writing, axis)
        self._axis = axis
        taken = {str(channel["name"]) for channel in plan.channels}
        self._name = next(name for name in ("time", "instants", "time of the samples") if name not in taken)

    @property
    def count(self) -> int | None:
        return self._axis.count

    @property
    def rate(self) -> float | None:
        return None

    def channels(self, described: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
        return [{"name": self._name, "quantity": "time", "unit": "s"}, *described]

    def add(self, instants: Values) -> None:
        self._writing.add(0, self._axis.add(instants))

    def hand_on(self, channel: int, values: Values) -> None:
        self._writing.add(channel + 1, values)

    def document(self) -> dict[str, Any]:
        return _document(self._plan, self._axis) | {"channel": self._name}

    def remarks(self) -> list[str]:
        return [said_of_uneven(self._axis, self._plan)]


class _Resampled(Timing):
    """Samples that are interpolated to an even axis, once all of them are there."""

    def __init__(self, plan: Plan, writing: Sink, axis: TimeAxis) -> None:
        super().__init__(plan, writing, axis)
        self._axis = axis
        self._asked: Mapping[str, Any] = plan.document["uneven"]["resample"]
        self._instants: list[Values] = []
        self._values: dict[int, list[Values]] = {}
        self._held = 0

    @property
    def count(self) -> int | None:
        return self._axis.count

    @property
    def rate(self) -> float | None:
        return float(self._asked["rate"])

    def add(self, instants: Values) -> None:
        self._instants.append(self._axis.add(instants))

    def hand_on(self, channel: int, values: Values) -> None:
        self._held += values.size
        if self._held > MOST_RESAMPLED:
            raise FormatError(
                f"a recording must have at most {MOST_RESAMPLED} values to be resampled while it is imported, got more: "
                'say uneven: "keep", and resample parts of it'
            )
        self._values.setdefault(channel, []).append(values)

    def finish(self) -> None:
        instants = np.concatenate(self._instants)
        try:
            for channel, pieces in self._values.items():
                found = evened(
                    instants,
                    np.concatenate(pieces),
                    rate=self._asked["rate"],
                    method=self._asked.get("method", "linear"),
                )
                self._writing.add(channel, found)
        except ProcessingError as error:
            raise FormatError(error.message) from error

    def document(self) -> dict[str, Any]:
        return _document(self._plan, self._axis) | {"actual": self.rate}

    def remarks(self) -> list[str]:
        return [said_of_uneven(self._axis, self._plan)]


def _document(plan: Plan, axis: TimeAxis) -> dict[str, Any]:
    return {
        "requested": plan.sample_rate,
        "first": axis.first,
        "actual": None,
        "mean": (axis.count - 1) / axis.span,
        "duration": axis.span,
        "uneven": axis.uneven(),
        "gaps": [],
        "gap_count": 0,
        "filled": 0,
    }


def said_of_uneven(axis: TimeAxis, plan: Plan) -> str:
    """Return the sentence on uneven instants, and what becomes of them."""
    off = f"the instants are uneven, up to {axis.uneven():.3g} samples off an even axis of {axis.usual_rate:.6g} samples/s"
    asked = plan.document["uneven"]
    if asked == "keep":
        return f"{off}: they are kept as a channel (uneven: resample in import, or the step resample of a processing, makes them even)"
    method = asked["resample"].get("method", "linear")
    return f"{off}: all channels are resampled to {asked['resample']['rate']:.9g} samples/s ({method})"


def axis_of(recording: Recording, plan: Plan, *, judging: bool = False) -> TimeAxis:
    """Return the axis that the instants of a file will tell."""
    assert plan.time is not None
    return TimeAxis(
        requested=plan.sample_rate,
        fill=plan.document["gaps"] == "fill",
        # times of day without a date begin again at midnight
        of_day=recording.series[plan.time].quantity == TIME_OF_DAY,
        scale=plan.time_scale,
        judging=judging,
    )


def timing_of(recording: Recording, plan: Plan, writing: Sink) -> Timing:
    """Return what becomes of the samples: the instants are read once before them, to see whether they are even."""
    if plan.time is None:
        return Timing(plan, writing)
    judged = axis_of(recording, plan, judging=True)
    for _, instants in recording.read([plan.time]):
        judged.add(instants)
    if judged.regular:
        return _Even(plan, writing, axis_of(recording, plan))
    fresh = axis_of(recording, plan, judging=True)
    return (_Kept if plan.document["uneven"] == "keep" else _Resampled)(plan, writing, fresh)
