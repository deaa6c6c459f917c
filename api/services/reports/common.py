"""What every report begins and ends with: what was asked by whom, what was doubted, what it was made from."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from api.services.reports.language import choice, label, say, word, words
from api.services.reports.model import LONGEST_SENTENCE, Part, Section, Sentence, Table, clean, table
from api.services.reports.origins import Told
from api.services.reports.quantities import NOTHING, plain, pretty_unit, quantity
from storage.repositories.lineage import Node

_CHECKSUM = 12
"""Characters of a checksum that tell it from all others."""
_MOST_SENTENCES = 20
_DEEPEST, _MOST_VALUES = 2, 6
"""Of what was asked for: what is nested deeper, and longer lists, are told by their sizes."""


def instant(at: datetime | None) -> str:
    """Return an instant in UTC, to the second."""
    if at is None:
        return NOTHING
    aware = at if at.tzinfo else at.replace(tzinfo=UTC)
    return f"{aware.astimezone(UTC):%Y-%m-%d %H:%M:%S} UTC"


def facts(told: Told) -> Iterator[tuple[str, str]]:
    """Yield what stands on top: the system, who asked for it, when, and the software that computed it."""
    if told.system is not None:
        yield say("System"), clean(str(told.system.get("name") or NOTHING))
    if told.reference is not None:
        yield (
            say("Revision"),
            say("{revision} of {system}", revision=told.reference["revision"], system=told.reference["id"]),
        )
    if told.status:
        yield say("Job"), f"{told.id}, {word(told.status)}"
    else:
        yield say("Kept as"), told.id
    yield say("Asked for by"), clean(told.author) or say("not known any more")
    yield say("Asked for at"), instant(told.created_at)
    if told.status:
        yield say("Finished at"), instant(told.finished_at)
    if told.started_at is not None and told.finished_at is not None:
        yield say("Took"), quantity(max((told.finished_at - told.started_at).total_seconds(), 0.0), "s", 3)
    if told.versions:
        yield say("Software"), ", ".join(f"{name} {number}" for name, number in told.versions.items())


def sentences(texts: Iterable[str], tone: str = "plain") -> list[Part]:
    """Return texts as paragraphs, each once; of very many the first ones, and how many there are."""
    # A sentence may begin with a name, which is another one in capitals.
    found = list(dict.fromkeys(told for text in texts if (told := clean(text, LONGEST_SENTENCE))))
    parts: list[Part] = [Sentence(text, tone) for text in found[:_MOST_SENTENCES]]  # type: ignore[arg-type]
    if len(found) > _MOST_SENTENCES:
        parts.append(
            Sentence(
                say("{count} more are left out; the result holds all of them.", count=len(found) - _MOST_SENTENCES)
            )
        )
    return parts


def warnings(told: Told) -> list[Section]:
    """Return what the service warned of, when it was asked and when it had computed."""
    said = [*told.warned, *(told.result.get("warnings") or [])]
    found = sentences((str(one.get("detail", "")) for one in said), "warning")
    return [Section(say("Warnings"), found)] if found else []


def pairs(rows: Sequence[tuple[str, str]]) -> Table:
    """Return a table of names and what they have."""
    return table(("", ""), rows, total=len(rows))


def written(value: Any, depth: int = 0) -> str:
    """Return a value of a request as a person would write it; what is long or deep is told by its size.

    >>> written({"value": 5, "unit": "mm"}), written({"kind": "step", "amplitude": 2})
    ('5 mm', 'step, amplitude 2')
    """
    match value:
        case None:
            text = NOTHING
        case bool():
            text = say("yes") if value else say("no")
        case int() | float():
            text = plain(float(value), 6)
        case {"value": number, "unit": str(unit)} if len(value) == 2:
            text = f"{written(number)} {pretty_unit(unit)}".rstrip()
        case dict() | list() if depth > _DEEPEST:
            text = say("{count} entries", count=len(value))
        case dict():
            # Names are the contract's where there is a kind, and somebody's own where there may be none.
            naming = word if "kind" in value else words
            told = [_member(naming(str(name)), one, depth) for name, one in value.items() if name != "kind"]
            text = ", ".join([word(str(value["kind"])), *told] if "kind" in value else told)
        case list():
            several = len(value) > _MOST_VALUES
            text = (
                say("{count} values", count=len(value))
                if several
                else ", ".join(written(one, depth + 1) for one in value)
            )
        case _:
            text = str(value)
    return text


def _member(name: str, value: Any, depth: int) -> str:
    """Return "amplitude 2" of a number, "y: channel 3" of a name."""
    return f"{name}{':' if isinstance(value, str) else ''} {written(value, depth + 1)}"


def chosen(field: str, value: Any) -> str:
    """Return the value of a field of a request as a person would write it."""
    return choice(field, value) if isinstance(value, str) else written(value)


def request_rows(request: Mapping[str, Any], left: Iterable[str]) -> list[tuple[str, str]]:
    """Return what was asked for, but for the fields that are ``left`` out or were not given."""
    return [
        (label(name), chosen(name, value)) for name, value in request.items() if name not in left and value is not None
    ]


def commands(given: Any) -> str:
    """Return the commands of a request, ``{"port": ..., "signal": ...}`` or several: "reference: step, amplitude 1"."""
    listed = given if isinstance(given, list) else [given]
    return "; ".join(f"{one.get('port')}: {written(one.get('signal'))}" for one in listed if isinstance(one, Mapping))


def lineage(told: Told) -> Section:
    """Return what it was made from, the first things first."""
    nodes = [node for node in told.lineage.nodes if node.id != told.id]
    parts: list[Part] = []
    if nodes:
        nodes.sort(key=lambda node: (node.created_at is None, node.created_at and instant(node.created_at), node.id))
        columns = (say("What"), say("Name"), say("Identifier"), say("Made at"), say("Facts"))
        parts.append(table(columns, ([*_node(node)] for node in nodes), total=len(nodes)))
    else:
        parts.append(Sentence(say("It was made from nothing that is stored: the request holds all of it.")))
    if told.lineage.truncated:
        parts.append(Sentence(say("More came before; the page of the lineage leads on.")))
    return Section(say("Lineage"), parts)


def _node(node: Node) -> Iterator[str]:
    yield word(node.kind)
    yield (word(node.name) if node.name == node.kind else node.name) if node.exists else say("deleted since")
    yield node.id
    yield instant(node.created_at)
    known = node.facts
    told = [word(str(known[key])) for key in ("format", "status") if known.get(key)]
    if known.get("sha256"):
        told.append(f"SHA-256 {str(known['sha256'])[:_CHECKSUM]}…")
    if known.get("sample_rate"):
        told.append(f"{plain(known['sample_rate'])} Hz")
    if known.get("sample_count"):
        told.append(say("{count} samples", count=known["sample_count"]))
    if known.get("deleted"):
        told.append(say("deleted since"))
    yield ", ".join(told)
