"""What a report says, whatever it is written as: facts, and sections of sentences, tables and figures."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Literal

from api.services.reports.language import say

Tone = Literal["plain", "good", "warning", "bad"]

MOST_ROWS = 200
"""Rows of a table; the result that the report is about has them all."""
LONGEST = 300
"""Characters of a cell: a row must fit on a page."""
LONGEST_SENTENCE = 2000


def clean(text: str, longest: int = LONGEST) -> str:
    r"""Return what somebody wrote as one line of printable characters, of a long one the beginning.

    >>> clean("a\n\tb\x00c", 4)
    'a b…'
    """
    plain = " ".join("".join(" " if unicodedata.category(c)[0] == "C" else c for c in text).split())
    return plain if len(plain) <= longest else plain[: longest - 1] + "…"


@dataclass(frozen=True, slots=True)
class Sentence:
    """One paragraph, and how it is meant."""

    text: str
    tone: Tone = "plain"


@dataclass(frozen=True, slots=True)
class Table:
    """Columns, ``numeric`` those that are read by their right ends, and rows of as many texts; ``note`` stands below."""

    columns: tuple[str, ...]
    numeric: frozenset[int]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


@dataclass(frozen=True, slots=True)
class Figure:
    """A drawing as SVG, ``width`` and ``height`` in points, with what it shows in words."""

    svg: str
    caption: str
    width: float
    height: float


Part = Sentence | Table | Figure


@dataclass(frozen=True, slots=True)
class Section:
    """A heading and what stands below it."""

    title: str
    parts: Sequence[Part]


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """The whole of it; ``made_at`` is the end of the job in ISO 8601, so that a report of a job is always the same."""

    title: str
    kind: str
    author: str
    made_at: str
    language: str = "en"
    facts: Sequence[tuple[str, str]]
    sections: Sequence[Section]


def table(columns: Sequence[str], rows: Iterable[Sequence[str]], *, numeric: Iterable[int] = (), total: int) -> Table:
    """Return a table of the first `MOST_ROWS` rows, of ``total``, which says so where there are more.

    Columns in which nothing stands are left out.
    """
    found = [tuple(clean(cell) for cell in row) for row in islice(rows, MOST_ROWS)]
    full = [i for i in range(len(columns)) if any(row[i] for row in found)]
    kept = tuple(tuple(row[i] for i in full) for row in found)
    note = ""
    if total > MOST_ROWS:
        note = say("The first {most} of {total} rows; the result holds all of them.", most=MOST_ROWS, total=total)
    right = set(numeric)
    ends = frozenset(place for place, i in enumerate(full) if i in right)
    return Table(tuple(clean(columns[i]) for i in full), ends, kept, note)
