"""Which channels of a file belong together: those of one time base, which one recording holds.

A file of one time base is one recording. A file of several keeps its groups apart, each with its own time: nothing is
resampled until somebody asks for it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from api.formats import FormatError, Recording, Series, Values
from api.services.recordings.importing import Plan, place_of, settle

_SHOWN = 20
_SHARED = ("gaps", "time_zone", "uneven")
"""What a description says of all groups."""
_OWN = {"columns", "time"}
"""What it says of the group that has it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Channels of one time base.

    Parameters
    ----------
    name : str
        As the file has it, or made up where it has none; "" for everything in a file of one time base.
    recording : Recording
        The file as if it held nothing else.
    """

    name: str
    recording: Recording


@dataclass(frozen=True, slots=True)
class _Base:
    """What the times of a channel are told by; None where the file does not say."""

    count: int | None
    axes: tuple[int, ...] | None
    rate: float | None


def groups_of(recording: Recording) -> list[Group]:
    """Return the groups of a file in its order, at least one.

    Channels share a time base as long as nothing that is known of it differs: samples, rate, axes of time. Where
    something differs, the file's own groups are kept, and cut further where they have several bases themselves.
    """
    series = recording.series
    bases = {place: _base(series, place) for place, one in enumerate(series) if one.role == "channel"}
    if _one(bases.values()):
        return [Group(name="", recording=recording)]
    labelled: dict[str, dict[_Base, list[int]]] = {}
    for place, base in bases.items():
        parts = labelled.setdefault(series[place].group, {})
        known = next((other for other in parts if _one([base, other])), base)
        parts.setdefault(known, []).append(place)
    found: list[Group] = []
    for label, parts in labelled.items():
        for number, places in enumerate(parts.values(), start=1):
            plain = label or "group"
            name = plain if label and len(parts) == 1 else f"{plain} {number}"
            axes = {axis for place in places for axis in bases[place].axes or ()}
            found.append(Group(name=name, recording=narrowed(recording, sorted({*places, *axes}))))
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A group that becomes a recording: the file as if it held nothing else, and what is taken from it."""

    name: str
    recording: Recording
    plan: Plan


def parts_of(format_: str, recording: Recording, given: Mapping[str, Any]) -> list[Part]:
    """Return what is taken from a file, the group that was asked for, or the first, before the others.

    What the description says of columns and a time is about the group that has them, a sample rate about the first. Where it
    names columns, they are all that is taken, each group of them a part unless it names the group, too. Another group that cannot be taken as it is, is refused by its name in the
    first recording.

    Raises
    ------
    FormatError
        For a group that is not there, or a first part that cannot be taken.
    """
    wanted, chosen = given.get("group"), given.get("columns")
    groups = groups_of(_of_columns(recording, given) if chosen and wanted is None else recording)
    first = _picked(groups, wanted)
    if len(groups) == 1:
        return [Part(name="", recording=recording, plan=settle(format_, recording, given))]
    others = [] if chosen and wanted is not None else [group for group in groups if group is not first]
    parts, refused = [], dict(recording.refused)
    for group in others:
        try:
            shared = {key: given[key] for key in _SHARED if key in given}
            plan = settle(format_, group.recording, shared | _own(recording, group, given))
            parts.append(Part(name=group.name, recording=group.recording, plan=plan))
        except FormatError as error:
            names = ", ".join(one.name for one in group.recording.series[:_SHOWN])
            refused[group.name] = f"{error.message} ({names}): send the file once more with this group in import"
    whole = replace(first.recording, refused=refused)
    there = ", ".join(group.name for group in groups[:_SHOWN])
    said = f"the file holds {len(groups)} groups of channels, each with its own time: {there}; this is {first.name}"
    asked = given
    if wanted is None:
        given = {key: value for key, value in given.items() if key not in _OWN} | _own(recording, first, given)
    try:
        plan = settle(format_, whole, given)
    except FormatError as error:
        if chosen and wanted is None:
            settle(format_, recording, asked)  # together they say better what is wrong with them
        raise FormatError(f"{error.message} ({said})", line=error.line, column=error.column) from error
    plan.document["group"] = first.name
    plan.remarks.append(said)
    return [Part(name=first.name, recording=whole, plan=plan), *parts]


def _of_columns(recording: Recording, given: Mapping[str, Any]) -> Recording:
    """Return a file as if its only channels were the columns that a description names."""
    chosen = {place_of(recording, column) for column in given["columns"]}
    kept = chosen | {place for place, one in enumerate(recording.series) if one.role == "time"}
    if given.get("time"):
        kept.add(place_of(recording, given["time"]))
    found = narrowed(recording, sorted(kept))
    return replace(
        found, series=[replace(one, role="channel") if one.role == "counter" else one for one in found.series]
    )


def _own(recording: Recording, group: Group, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a description says of the series of one group: its columns, its time."""
    own = {one.index for one in group.recording.series}

    def is_own(column: Mapping[str, Any]) -> bool:
        return recording.series[place_of(recording, column)].index in own

    columns = [column for column in given.get("columns") or () if is_own(column)]
    time = given.get("time")
    return {**({"columns": columns} if columns else {}), **({"time": time} if time and is_own(time) else {})}


def _picked(groups: Sequence[Group], name: str | None) -> Group:
    """Return the group of a name, the first where none is given."""
    found = groups if name is None else [group for group in groups if group.name == name]
    if not found:
        there = ", ".join(group.name for group in groups[:_SHOWN]) if len(groups) > 1 else "none: all have one time"
        raise FormatError(f"group must be one of the file's ({there}), got {str(name)[:80]!r}")
    return found[0]


def narrowed(recording: Recording, places: Sequence[int]) -> Recording:
    """Return a recording as if it held these of its series alone."""

    def read(wanted: Sequence[int]) -> Iterator[tuple[int, Values]]:
        return recording.read([places[one] for one in wanted])

    return replace(recording, series=[recording.series[place] for place in places], read=read)


def _base(series: Sequence[Series], place: int) -> _Base:
    one = series[place]
    if one.sample_rate is not None:
        return _Base(count=one.count, axes=None, rate=float(f"{one.sample_rate:.12g}"))
    return _Base(count=one.count, axes=_axes(series, one) or None, rate=None)


def _axes(series: Sequence[Series], one: Series) -> tuple[int, ...]:
    """Return the places of the times that a channel may have: those of its own group, else any of its length."""
    fitting = [place for place, other in enumerate(series) if other.role == "time" and other.count == one.count]
    own = [place for place in fitting if series[place].group == one.group]
    return tuple(own or fitting)


def _one(bases: Collection[_Base]) -> bool:
    """Whether nothing that is known of them differs."""
    return all(len({getattr(base, what) for base in bases} - {None}) <= 1 for what in ("count", "axes", "rate"))
