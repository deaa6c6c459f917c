"""Server-sent events, as the HTML standard defines them (section 9.2, "Server-sent events")."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """One event of a job: its name, its data and the id from which a broken stream resumes."""

    name: str
    data: Any
    id: str = ""


def parse(lines: Iterable[str]) -> Iterator[Event]:
    """Yield the events of a stream of lines.

    Data that is JSON is decoded, other data stays text; an event that breaks off before its empty line is dropped, as the
    standard asks, and comes again after the reconnect.

    Examples
    --------
    >>> list(parse(["id: 7", "event: progress", "data: 0.5", ""]))
    [Event(name='progress', data=0.5, id='7')]
    """
    name, data, last_id = "message", list[str](), ""
    for line in lines:
        if line:
            field, _, value = line.partition(":")
            value = value.removeprefix(" ")
            if field == "event":
                name = value
            elif field == "data":
                data.append(value)
            elif field == "id":
                last_id = value
            continue
        if data:
            yield Event(name=name, data=_decoded("\n".join(data)), id=last_id)
        name, data = "message", []


def _decoded(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text
