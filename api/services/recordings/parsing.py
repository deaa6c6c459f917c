"""Parsing of uploaded files (by a worker): from the bytes as received to channels, or to a first look at them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from itertools import islice
from typing import Any, BinaryIO

import numpy as np

from api.convert.values import listed, numbers
from api.formats import MOST_VALUES, FormatError, Recording, Values, catalogue
from api.formats.text.txt import lines_of
from api.services.recordings import raw_samples
from api.services.recordings.functions import described
from api.services.recordings.groups import Part, parts_of
from api.services.recordings.importing import Plan, options, stated
from api.services.recordings.leaving_out import MOST_SCALARS, InstantsHeld, all_taken
from api.services.recordings.spooling import Progress, refusing, spooled
from api.services.recordings.timing import Sink, Timing, axis_of, said_of_uneven, timing_of
from engine.recordings.signal_quality import ChannelQuality, remarks, said_of_rounded
from storage.imports import RAW, Import, open_groups, publish
from storage.originals import Comparison, leave_out
from storage.repositories import DatasetRepository
from storage.session import Database

_LOOK_ROWS = 5
_MOST_SHOWN = 200
_HEADER_LINES = 50
_HEAD = 1 << 18
_WHOLE = 64 << 20
"""Bytes of a file that is looked at as a whole."""
_NO_CHANNELS = (
    "the file holds functions of frequency and no channels: `functions` lists them, POST /v1/frfs takes responses"
)


def run(
    body: Mapping[str, Any], *, database: Database, workspace: str, progress: Progress, leaving_out: bool = False
) -> dict[str, Any]:
    """Read the channels of a committed file, or of raw samples.

    ``leaving_out`` asks to forget the file once all that is in it is found in the channels.

    Raises
    ------
    Problem
        422 that says where the file is not what its description says; whoever keeps the job then says so on the
        dataset.
    """
    identifier = str(body["dataset"])
    with database.session() as session:
        repository = DatasetRepository(session, workspace)
        row = repository.get(identifier)
        given = stated((row.description or {}).get("import"))
        told = _recognition(row.description)
        format_, size, stated_start = row.format, row.size or 1, row.start_time
        segments = list(row.manifest or ())
    if format_ == RAW:
        return raw_samples.run(
            identifier, database=database, workspace=workspace, progress=progress, leaving_out=leaving_out
        )
    with refusing(), ExitStack() as undo:
        file = undo.enter_context(spooled(database, workspace, identifier, segments, progress))
        recording = catalogue.open_file(format_, file, options(format_, given))
        undo.callback(recording.close)
        if _without_channels(recording):
            with Import(database, workspace, identifier) as writing:
                writing.finish(channels=[], report=_report_of_functions(recording, told))
            return {"dataset": identifier, "sample_count": 0}
        parts = parts_of(format_, recording, given)
        further = {part.name: {"group": part.name} for part in parts[1:]}
        made = open_groups(database, workspace, identifier, further) if further else {}
        known: list[dict[str, Any]] = []
        groups: list[dict[str, Any]] = []
        imports: list[Import] = []
        timings: list[Timing] = []
        for number, (part, target) in enumerate(zip(parts, (identifier, *made.values()), strict=True)):
            writing = undo.enter_context(Import(database, workspace, target))
            steps = _part_of(progress, number, len(parts))
            taken = _Taking(part.recording, part.plan, writing, steps, read=lambda: file.tell() / size)
            taken.all()
            known.append(taken.report(told))
            timings.append(taken.times)
            count = writing.prepare(
                channels=taken.times.channels(part.plan.channels),
                sample_rate=taken.times.rate,
                start_time=part.plan.start_time if stated_start is None else None,
                report=known[-1],
                uneven=taken.times.rate is None,
            )
            names = [channel["name"] for channel in taken.times.channels(part.plan.channels)]
            groups.append({"name": part.name, "dataset_id": target, "sample_rate": taken.times.rate,
                           "sample_count": count, "channels": names})  # fmt: skip
            imports.append(writing)
        if recording.functions:
            known[0]["functions"] = described(recording.functions)
        if further:
            for report in known:
                report["groups"] = groups
        publish(imports)
        if leaving_out and len(parts) == 1 and all_taken(recording, parts[0]):
            progress(1.0, "comparing what is kept with the file")
            compared = Comparison(database.session, identifier)
            axis, rate = timings[0].axis, timings[0].rate
            held = None if axis is None else InstantsHeld(axis, rate)
            instants = None if held is None else held.add
            _Taking(parts[0].recording, parts[0].plan, compared, _silent, read=lambda: 1.0, instants=instants).all()
            if compared.same and (held is None or held.all_held):
                with database.session() as session:
                    leave_out(session, workspace, identifier, raw=False)
    return {"dataset": identifier, "sample_count": groups[0]["sample_count"]}


def _silent(_share: float, _said: str) -> None:
    """Tell nobody how far it is."""


def _without_channels(recording: Recording) -> bool:
    """Whether a file holds functions of frequency alone."""
    return bool(recording.functions) and not any(one.role == "channel" for one in recording.series)


def _report_of_functions(recording: Recording, told: Sequence[str]) -> dict[str, Any]:
    """Return what is known of a file without channels, which holds functions of frequency alone."""
    return {
        "functions": described(recording.functions),
        "channels": {},
        "refused": dict(islice(recording.refused.items(), _MOST_SHOWN)),
        "remarks": [*told, *recording.remarks, _NO_CHANNELS],
    }


def _part_of(progress: Progress, number: int, parts: int) -> Progress:
    """Return the progress of one of several parts."""
    return lambda done, said: progress((number + done) / parts, said)


def look(body: Mapping[str, Any], *, database: Database, workspace: str, progress: Progress) -> dict[str, Any]:
    """Return what would be taken from a file, with the first samples; nothing is kept.

    Raises
    ------
    Problem
        422 that says why nothing can be taken.
    """
    identifier, given = str(body["dataset"]), stated(body.get("import"))
    with database.session() as session:
        row = DatasetRepository(session, workspace).get(identifier)
        format_, told = row.format, _recognition(row.description)
    with refusing(), ExitStack() as undo:
        file = undo.enter_context(spooled(database, workspace, identifier, body["segments"], progress))
        recording = catalogue.open_file(format_, file, options(format_, given))
        undo.callback(recording.close)
        refused = dict(islice(recording.refused.items(), _MOST_SHOWN))
        there = [
            {
                "index": one.index,
                "name": one.name,
                "sample_count": one.count,
                "unit": one.unit,
                "role": one.role,
                "group": one.group,
            }
            for one in recording.series[:_MOST_SHOWN]
        ]
        found: dict[str, Any] = {
            "dataset": identifier,
            "format": format_,
            "series": there,
            "functions": described(recording.functions),
            "refused": refused,
        }
        if _without_channels(recording):
            return _without_plan(found, recording, [*told, *recording.remarks, _NO_CHANNELS])
        try:
            parts = parts_of(format_, recording, given)
        except FormatError as error:
            # what there is to choose from is what helps now
            return _without_plan(found, recording, [*told, *recording.remarks, error.message])
        recording, plan = parts[0].recording, parts[0].plan
        refused |= islice(recording.refused.items(), _MOST_SHOWN)
        first = [_first(recording, place) for place in plan.places]
        times = _times(recording, plan, whole=file.seek(0, 2) <= _WHOLE)
        said = [*told, *plan.remarks, *times.pop("remarks")]
        channels = []
        for place, channel, values in zip(plan.places, plan.channels, first, strict=True):
            quality = ChannelQuality()
            quality.add(values)
            noticed = quality.document()
            rounded = recording.rounded.of(recording.series[place].name)
            said += remarks(f"the beginning of {channel['name']}", noticed, values.size, rounded=rounded)
            channels.append({**channel, "first": listed(numbers(values[:_LOOK_ROWS])), "noticed": noticed})
        return {
            **found,
            "import": plan.document,
            "groups": [_proposal(part) for part in parts] if len(parts) > 1 else [],
            "header": _header(file, plan.document.get("header_lines", 0)),
            "channels": channels,
            **times,
            "start_time": plan.start_time.isoformat() if plan.start_time else None,
            "scalars": dict(recording.scalars),
            "remarks": said,
        }


def _proposal(part: Part) -> dict[str, Any]:
    """Return what would be taken of a group: its columns as a description has them, and its time."""
    document = part.plan.document
    return {
        "name": part.name,
        "sample_rate": part.plan.sample_rate,
        "sample_count": part.recording.series[part.plan.places[0]].count,
        **{key: document[key] for key in ("columns", "time") if key in document},
        "first": [listed(numbers(_first(part.recording, place)[:_LOOK_ROWS])) for place in part.plan.places],
    }


def _without_plan(found: dict[str, Any], recording: Recording, remarks: Sequence[str]) -> dict[str, Any]:
    """Return a look at a file of which no channel is taken."""
    nothing = dict.fromkeys(("import", "sample_rate", "sample_count", "uneven", "start_time"))
    return {
        **found,
        **nothing,
        "groups": [],
        "header": [],
        "channels": [],
        "scalars": dict(recording.scalars),
        "remarks": [*remarks],
    }


def _times(recording: Recording, plan: Plan, *, whole: bool) -> dict[str, Any]:
    """Return the rate, the samples and how uneven they are, with remarks; of a long file its beginning tells."""
    count = recording.series[plan.places[0]].count
    looked_at = None if whole else 1
    if plan.time is None:
        if count is None and whole:
            count = sum(values.size for _, values in recording.read([plan.places[0]]))
        said = [] if count is None else _counted(recording, count)
        return {"sample_rate": plan.sample_rate, "sample_count": count, "uneven": None, "remarks": said}
    pieces = [values for _, values in islice(recording.read([plan.time]), looked_at)]
    axis = axis_of(recording, plan, judging=True)
    for piece in pieces:
        axis.add(piece)
    uneven = axis.uneven()
    rate: float | None
    if axis.regular:
        axis = axis_of(recording, plan)
        for piece in pieces:
            axis.add(piece)
        filled = axis.missing
        rate, said = axis.rate, axis.remarks()
    else:
        filled, said = 0, [said_of_uneven(axis, plan)]
        asked = plan.document["uneven"]
        rate = None if asked == "keep" else asked["resample"]["rate"]
    if whole:
        said = [*_counted(recording, axis.count), *said]
    else:
        said.append(f"the instants are those of the first {axis.count} samples: the import looks at all of them")
    return {
        "sample_rate": rate,
        "sample_count": axis.count + filled if whole else None,
        "uneven": uneven,
        "remarks": said,
    }


def _header(file: BinaryIO, count: int) -> list[str]:
    """Return the lines before the rows of a text, the first of many."""
    if not count:
        return []
    file.seek(0)
    return [line[:_MOST_SHOWN] for line in islice(lines_of([file.read(_HEAD)]), min(count, _HEADER_LINES))]


def _counted(recording: Recording, count: int) -> list[str]:
    """Return a sentence where a file has other samples than it says."""
    if recording.stated_count in {None, count}:
        return []
    return [f"the file says that it has {recording.stated_count} samples, {count} are there: is it cut?"]


def _recognition(description: Mapping[str, Any] | None) -> list[str]:
    """Return what is to be said of a format that nobody named."""
    found = (description or {}).get("recognised")
    return [f"the format {found['format']} is told from {found['by']}"] if found else []


def _first(recording: Recording, place: int) -> Values:
    for _, values in recording.read([place]):
        return values
    raise FormatError(f"channel {recording.series[place].name!r} must have samples, got none: name others in columns")


class _Taking:
    """The samples of the chosen channels on their way, watched.

    ``read`` is the share of the file that has been read, ``instants`` is told those that the file has.
    """

    def __init__(
        self,
        recording: Recording,
        plan: Plan,
        writing: Sink,
        progress: Progress,
        *,
        read: Callable[[], float],
        instants: Callable[[Values], None] | None = None,
    ) -> None:
        self._instants = instants
        self._recording = recording
        self._plan = plan
        self._progress = progress
        self._read = read
        self._qualities = [ChannelQuality() for _ in plan.places]
        self.times: Timing = timing_of(recording, plan, writing)

    def all(self) -> None:
        """Hand all samples on."""
        wanted: Sequence[int] = self._plan.places
        shift = 0
        if self._plan.time is not None:
            wanted, shift = (self._plan.time, *wanted), 1
        counts = [self._recording.series[place].count for place in wanted]
        total = sum(count for count in counts if count is not None)
        done = 0
        for position, values in self._recording.read(wanted):
            done += values.size
            if done > MOST_VALUES:
                raise FormatError(
                    f"a recording must be at most {MOST_VALUES} values, got more: name those that matter in columns, or send it in parts"
                )
            channel = position - shift
            if channel < 0:
                self.times.add(values)
                if self._instants is not None:
                    self._instants(values)
            else:
                self._hand_on(channel, values)
            share = done / total if total else self._read()
            self._progress(0.1 + 0.9 * min(share, 1.0), f"{done} values")
        self._check()
        self.times.finish()

    def _hand_on(self, channel: int, values: Values) -> None:
        if np.isinf(values).any():
            at = self._qualities[channel].count + int(np.flatnonzero(np.isinf(values))[0])
            name = self._plan.channels[channel]["name"]
            raise FormatError(
                f"channel {name!r} must be finite or missing, got an infinity at sample {at}: write it as a missing one (NaN)"
            )
        self._qualities[channel].add(values)
        self.times.hand_on(channel, values)

    def _check(self) -> None:
        counts = {channel["name"]: one.count for channel, one in zip(self._plan.channels, self._qualities, strict=True)}
        if self.times.count is not None:
            counts["time"] = self.times.count
        if len(set(counts.values())) != 1:
            said = ", ".join(f"{name} {count}" for name, count in counts.items())
            raise FormatError(f"the channels of a recording must have the same number of samples, got {said}")
        if not next(iter(counts.values())):
            raise FormatError("a recording must have samples, got none: was it begun?")

    def _rounded_beside(self) -> list[str]:
        """Return sentences on rounded values that are in no channel: instants, and single numbers."""
        recording, time = self._recording, self._plan.time
        counts = {} if time is None else {recording.series[time].name: self._qualities[0].count}
        counts |= dict.fromkeys(recording.scalars, 1)
        found = ((name, recording.rounded.of(name), count) for name, count in counts.items())
        return [said_of_rounded(name, rounded, count) for name, rounded, count in found if rounded]

    def report(self, before: Sequence[str]) -> dict[str, Any]:
        """Return what was noticed; some sentences come before all others."""
        count = self._qualities[0].count
        said = [*before, *self._plan.remarks, *_counted(self._recording, count), *self.times.remarks()]
        noticed = {}
        said += self._rounded_beside()
        for place, channel, quality in zip(self._plan.places, self._plan.channels, self._qualities, strict=True):
            noticed[channel["name"]] = quality.document()
            rounded = self._recording.rounded.of(self._recording.series[place].name)
            said += remarks(channel["name"], noticed[channel["name"]], quality.count, rounded=rounded)
        refused = dict(islice(self._recording.refused.items(), _MOST_SHOWN))
        return {
            "import": self._plan.document,
            "time": self.times.document(),
            "channels": noticed,
            "refused": refused,
            "scalars": dict(islice(self._recording.scalars.items(), MOST_SCALARS)),
            "remarks": said[:_MOST_SHOWN],
        }
