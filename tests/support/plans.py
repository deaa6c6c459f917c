"""Watches what a database does for each statement: how it looks for rows, and how many it looks at in vain."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import event

from storage import Database

#: Instructions of SQLite between two counts.
_STEP = 100


@dataclass(frozen=True, slots=True)
class Plan:
    """One statement: its text, the tables that it reads from end to end, and what it costs.

    ``cost`` counts rows that were read and left out (Postgres), or instructions (SQLite): neither depends on the machine.
    """

    statement: str
    scanned: frozenset[str]
    cost: int


@dataclass
class Watch:
    """The plans of all statements since it began."""

    plans: list[Plan] = field(default_factory=list)


@contextmanager
def watched(database: Database) -> Iterator[Watch]:
    """Explain every statement that looks for rows, as it is about to be executed."""
    watch, engine = Watch(), database.engine
    explain = _explain_sqlite if engine.dialect.name == "sqlite" else _explain_postgres

    def look(_connection: Any, cursor: Any, statement: str, parameters: Any, _context: Any, many: bool) -> None:
        if not many and re.match(r"SELECT|UPDATE|DELETE|WITH", statement):
            watch.plans.append(explain(cursor.connection, statement, parameters))

    event.listen(engine, "before_cursor_execute", look)
    try:
        yield watch
    finally:
        event.remove(engine, "before_cursor_execute", look)


def _explain_sqlite(connection: Any, statement: str, parameters: Any) -> Plan:
    rows = connection.execute(f"EXPLAIN QUERY PLAN {statement}", parameters).fetchall()
    scanned = frozenset(found[1] for row in rows if (found := re.match(r"SCAN (\w+)", row[3])))
    counted = 0

    def count() -> int:
        nonlocal counted
        counted += _STEP
        return 0

    if statement.startswith("SELECT"):  # whatever writes is executed once, by who asked
        connection.set_progress_handler(count, _STEP)
        connection.execute(statement, parameters).fetchall()
        connection.set_progress_handler(None, 0)
    return Plan(statement, scanned, counted)


def _explain_postgres(connection: Any, statement: str, parameters: Any) -> Plan:
    """Execute the statement and take it back."""
    with connection.cursor() as cursor:
        inside = not connection.autocommit
        if inside:
            cursor.execute("SAVEPOINT looking")
        cursor.execute(f"EXPLAIN (ANALYZE, FORMAT JSON) {statement}", parameters)
        (plan,) = cursor.fetchone()
        if inside:
            cursor.execute("ROLLBACK TO SAVEPOINT looking")
    nodes = list(_nodes(plan[0]["Plan"]))
    scanned = frozenset(node["Relation Name"] for node in nodes if node["Node Type"] == "Seq Scan")
    return Plan(statement, scanned, sum(node.get("Rows Removed by Filter", 0) for node in nodes))


def _nodes(plan: dict[str, Any]) -> Iterator[dict[str, Any]]:
    yield plan
    for part in plan.get("Plans", ()):
        yield from _nodes(part)
