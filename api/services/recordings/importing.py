"""What is taken from a file: its channels, their units, the sample rate; what an import description leaves open is settled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from api.formats import MOST_CHANNELS, FormatError, Recording, Series
from api.formats.catalogue import TABLES
from api.formats.text.guess import Known
from api.formats.text.tables import TableOptions
from api.units.conversion import UnitError, known, to_si
from engine.recordings.sample_rates import refusal

_SHOWN = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """What is taken from a file.

    Parameters
    ----------
    places : tuple of int
        Of the channels, in `Recording.series`.
    channels : list of dict
        Name, unit, scale ... of each, as the contract has them.
    time : int, optional
        Place of the instants, which are multiplied by ``time_scale`` to be s.
    sample_rate : float, optional
        Samples per second: the one asked for, where there are instants.
    start_time : datetime, optional
        Of the first sample.
    document : dict
        The import description with everything filled in.
    remarks : list of str
    """

    places: tuple[int, ...]
    channels: list[dict[str, Any]]
    time: int | None
    time_scale: float
    sample_rate: float | None
    start_time: datetime | None
    document: dict[str, Any]
    remarks: list[str]


def stated(given: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return what an import description says, without what it leaves open."""
    return {key: value for key, value in (given or {}).items() if value is not None}


def options(format_: str, given: Mapping[str, Any]) -> TableOptions:
    """Return what an import description says of the layout of a text table.

    A text file whose columns are given by their indices has the layout that the contract states by default: nothing of
    it is found out.
    """
    columns = given.get("columns") or []
    indices = [column["index"] for column in columns if column.get("index") is not None]
    settled = format_ == "txt" and bool(indices) and len(indices) == len(columns)
    time = given.get("time") or {}
    return TableOptions(
        known=Known(
            delimiter=given.get("delimiter", "," if settled else None),
            decimal=given.get("decimal", "." if settled else None),
            thousands=given.get("thousands", "" if settled else None),
            comment=given.get("comment", "" if settled else None),
            header_lines=given.get("header_lines", 0 if settled else None),
            order=time.get("order"),
        ),
        columns=indices,
        missing=given.get("missing", () if settled else None),
        time=time.get("index"),
        allow_truncated=given.get("allow_truncated", False),
        over_time="sample_rate" in given or "time" in given,
    )


def settle(format_: str, recording: Recording, given: Mapping[str, Any]) -> Plan:
    """Return what is taken from a file.

    Parameters
    ----------
    format_ : str
    recording : Recording
    given : mapping
        The import description, which may leave anything open.

    Raises
    ------
    FormatError
        For a channel that is not there or cannot be read, channels that do not belong together, a sample rate that
        nothing tells.
    """
    chosen = _chosen(recording, given.get("columns"))
    series = [recording.series[place] for place, _ in chosen]
    _check_lengths(series)
    time = _time(recording, series, given)
    if time is not None and recording.series[time].doubt:
        raise FormatError(recording.series[time].doubt)
    remarks = list(recording.remarks)
    stated = _stated_rate(recording, series)
    rate = given.get("sample_rate", stated)
    if time is None and rate is None:
        raise FormatError(_why_no_rate(recording, series))
    if recording.untimed and "sample_rate" in given:
        remarks.append(recording.untimed)
    if rate is not None and (refused := refusal(rate)):
        raise FormatError(f"{refused}: say in import at which the samples were taken")
    channels = []
    for one, (_, column) in zip(series, chosen, strict=True):
        channels.append(_described(one, column, remarks))
    scale = 1.0
    if time is not None:
        unit = (given.get("time") or {}).get("unit") or recording.series[time].unit or "s"
        scale = _time_scale(unit, recording.series[time].name, remarks)
    start, zone = _start(series, given)
    document: dict[str, Any] = {
        **{key: value for key, value in recording.layout.items() if key != "sample_rate"},
        **({"sample_rate": rate} if rate is not None else {}),
        "columns": [
            {_handle(format_): one.index if format_ in TABLES else one.name, **channel}
            for one, channel in zip(series, channels, strict=True)
        ],
        **({"time": _time_document(recording.series[time], format_, given, scale)} if time is not None else {}),
        "gaps": given.get("gaps", "fill"),
        **({"uneven": given.get("uneven", "keep")} if time is not None else {}),
        **({"time_zone": zone} if zone else {}),
    }
    return Plan(
        places=tuple(place for place, _ in chosen),
        channels=channels,
        time=time,
        time_scale=scale,
        sample_rate=rate,
        start_time=start,
        document=document,
        remarks=remarks,
    )


def _handle(format_: str) -> str:
    return "index" if format_ in TABLES else "source"


def _chosen(recording: Recording, columns: Sequence[Mapping[str, Any]] | None) -> list[tuple[int, Mapping[str, Any]]]:
    """Return the places of the channels that are taken, each with what is said of it."""
    if not columns:
        found: list[tuple[int, Mapping[str, Any]]] = [
            (place, {}) for place, one in enumerate(recording.series) if one.role == "channel"
        ]
        if not found:
            raise FormatError(f"file must hold a channel of numbers, got none{_refusals(recording)}")
        if len(found) > MOST_CHANNELS:
            raise FormatError(
                f"a recording must have at most {MOST_CHANNELS} channels, got {len(found)}: name those to take in columns"
            )
        return found
    return [(place_of(recording, column), column) for column in columns]


def place_of(recording: Recording, column: Mapping[str, Any]) -> int:
    """Return the place of the series that a description names.

    Raises
    ------
    FormatError
        For one that the file does not have.
    """
    name, index = column.get("source"), column.get("index")
    for place, one in enumerate(recording.series):
        if one.name == name if name is not None else one.index == index:
            return place
    if name is not None and name in recording.refused:
        raise FormatError(f"{name} cannot be read: {recording.refused[name]}")
    names = [one.name for one in recording.series]
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    raise FormatError(
        f"a column must be one of the file's ({', '.join(names[:_SHOWN])}{more}), got {name if name is not None else index!r}"
    )


def _refusals(recording: Recording) -> str:
    said = [f"{name}: {reason}" for name, reason in list(recording.refused.items())[:_SHOWN]]
    return f" ({'; '.join(said)})" if said else ""


def _check_lengths(series: Sequence[Series]) -> None:
    by_count: dict[int, str] = {}
    for one in series:
        if one.count is not None:
            by_count.setdefault(one.count, one.name)
    if len(by_count) > 1:
        said = ", ".join(f"{name} {count}" for count, name in list(by_count.items())[:_SHOWN])
        raise FormatError(
            f"the channels of a recording must have the same number of samples, got {said}: "
            "name those that belong together in columns"
        )


def _stated_rate(recording: Recording, series: Sequence[Series]) -> float | None:
    rates = {float(f"{one.sample_rate:.12g}"): one.name for one in series if one.sample_rate is not None}
    if len(rates) > 1:
        said = ", ".join(f"{name} {rate:g}" for rate, name in rates.items())
        raise FormatError(
            f"the channels of a recording must have the same sample rate, got {said} samples/s: "
            "name those that belong together in columns"
        )
    return next(iter(rates), recording.layout.get("sample_rate"))


def _time(recording: Recording, series: Sequence[Series], given: Mapping[str, Any]) -> int | None:
    """Return the place of the instants: as given, or found where no sample rate is given."""
    if given.get("time") is not None:
        place = place_of(recording, given["time"])
        _check_lengths([recording.series[place], *series])
        return place
    if "sample_rate" in given or any(one.sample_rate is not None for one in series):
        return None
    first = min(one.index for one in series)
    fitting = [
        place
        for place, one in enumerate(recording.series)
        if one.role == "time" and one not in series and one.count == series[0].count
    ]
    # in files with several axes of time, each stands before its channels
    before = [place for place in fitting if recording.series[place].index < first]
    return before[-1] if before else next(iter(fitting), None)


def _why_no_rate(recording: Recording, series: Sequence[Series]) -> str:
    """Return why a file tells no sample rate."""
    if recording.untimed:
        return f"{recording.untimed}, or say sample_rate in import, and the instants are not looked at"
    needed = "sample_rate must be given in import: the file states none"
    other = next((one for one in recording.series if one.role == "time" and one not in series), None)
    if other is None:
        return f"{needed} and has no column of time"
    return (
        f"{needed}, and its time {other.name} must have as many instants as there are samples, got {other.count} for the "
        f"{series[0].count} of {series[0].name}"
    )


def _time_scale(unit: str, name: str, remarks: list[str]) -> float:
    try:
        return to_si(1.0, unit, "s")
    except UnitError:
        remarks.append(f"the unit {unit!r} of {name} is no unit of time: s is assumed")
        return 1.0


def _time_document(one: Series, format_: str, given: Mapping[str, Any], scale: float) -> dict[str, Any]:
    order = (given.get("time") or {}).get("order")
    handle = one.index if format_ in TABLES else one.name
    known_units = {1.0: "s", 1e-3: "ms", 1e-6: "us"}
    unit = (given.get("time") or {}).get("unit") or known_units.get(scale, one.unit or "s")
    return {_handle(format_): handle, "unit": unit, **({"order": order} if order else {})}


def _described(one: Series, column: Mapping[str, Any], remarks: list[str]) -> dict[str, Any]:
    """Return a channel as the contract has it: what is said of it, and what the file says where nothing is."""
    described = {key: value for key, value in column.items() if key not in {"index", "source"}}
    described.setdefault("name", _clean(one.name) or f"channel {one.index}")
    if "unit" not in described:
        unit, remark = _unit(one)
        described["unit"] = unit
        remarks += [remark] if remark else []
    if "quantity" not in described and one.quantity:
        described["quantity"] = one.quantity[:100]
    return described


def _clean(text: str) -> str:
    return "".join(letter if letter.isprintable() else " " for letter in text).strip()[:200]


def _unit(one: Series) -> tuple[str, str | None]:
    """Return the unit that a file states, as the unit library has it, and a remark where it is doubtful."""
    text = one.unit.strip()
    for candidate in (text, text.lower()):
        try:
            known(candidate)
        except UnitError:
            continue
        if candidate == "g":
            return "g", f"the unit g of {one.name} is a gram; for standard gravity say g_0 in columns"
        return candidate, None
    return "", f"the unit {text!r} of {one.name} is not known: it is left out"


def _start(series: Sequence[Series], given: Mapping[str, Any]) -> tuple[datetime | None, str | None]:
    """Return when the first sample was taken, and the time zone that was needed to say so."""
    start = next((one.start_time for one in series if one.start_time is not None), None)
    if start is None:
        return None, given.get("time_zone")
    if start.tzinfo is not None:
        return start, None
    zone = str(given.get("time_zone") or "UTC")
    return start.replace(tzinfo=UTC if zone == "UTC" else zone_of(zone)), zone


def zone_of(name: str) -> ZoneInfo:
    """Return a time zone by its name.

    Raises
    ------
    FormatError
        For one that does not exist.
    """
    try:
        return ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError) as error:
        raise FormatError(f"time_zone must be a name like Europe/Bucharest, got {name[:80]!r}") from error
