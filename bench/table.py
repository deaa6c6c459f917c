"""The one table that the benchmark prints: jobs, who did them, time, ratio to this engine, error against exact values."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table


@dataclass(frozen=True, kw_only=True)
class Row:
    """One contender at one job; ``milliseconds`` and ``error`` (relative, worst of its metrics) are None where there is none."""

    who: str
    milliseconds: float | None = None
    error: float | None = None
    remark: str = ""


@dataclass(frozen=True, kw_only=True)
class Job:
    """A job and its rows; the times of the others are divided by that of the first. ``clock`` says what was counted."""

    title: str
    rows: Sequence[Row]
    clock: str = "CPU"


HEADINGS = ("ms", "clock", "ratio", "worst error", "remark")


def render(jobs: Iterable[Job], *, title: str) -> Table:
    """Return the table of all jobs, for a terminal."""
    from rich.table import Table  # noqa: PLC0415 - only where a table is printed

    table = Table(title=title, title_justify="left", show_lines=False)
    table.add_column("job / contender", overflow="fold")
    for heading in HEADINGS[:-1]:
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column(HEADINGS[-1], overflow="fold")
    for job in jobs:
        table.add_section()
        table.add_row(f"[bold]{job.title}[/bold]")
        for row in job.rows:
            table.add_row(f"  {row.who}", *_cells(job, row))
    return table


def markdown(jobs: Iterable[Job], *, title: str) -> str:
    """Return the same table as text for a page."""
    lines = [title, "", f"| | {' | '.join(HEADINGS)} |", "|---|--:|--:|--:|--:|---|"]
    for job in jobs:
        lines.append(f"| **{job.title}** |" + " |" * len(HEADINGS))
        lines += [f"| {row.who} | {' | '.join(_cells(job, row))} |" for row in job.rows]
    return "\n".join(lines)


def _cells(job: Job, row: Row) -> tuple[str, ...]:
    base = job.rows[0].milliseconds
    return (
        "-" if row.milliseconds is None else _short(row.milliseconds),
        "" if row.milliseconds is None else job.clock,
        "-" if row.milliseconds is None or base is None else f"{_short(row.milliseconds / base)}x",
        "-" if row.error is None else f"{row.error:.0e}",
        row.remark,
    )


def _short(value: float) -> str:
    """Return three digits, without exponent."""
    if value >= 100:
        return f"{value:,.0f}"
    return f"{value:.3g}"
