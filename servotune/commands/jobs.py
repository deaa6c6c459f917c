"""`servotune jobs` and `watch`: long work."""

from __future__ import annotations

from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any, Literal

import click

from servotune.client import Client
from servotune.commands.connecting import asking, ids, print_json, print_table, shown_as
from servotune.commands.files import Target, read_json
from servotune.errors import JobCancelledError, JobFailedError
from servotune.jobs import FINAL, Job
from servotune.replies.base import Reply

Kind = Literal["optimization", "identification"]


@click.group
def jobs() -> None:
    """List, show, pause, resume and cancel jobs, and take their results."""


@jobs.command("list")
@click.option("--status", type=click.Choice(["queued", "running", *sorted(FINAL)]), help="Only these.")
@click.option("--kind", metavar="KIND", help="Only these: optimization, identification, import ...")
@click.option(
    "--most", type=click.IntRange(min=1), default=20, show_default=True, help="How many; the newest come first."
)
@asking
@shown_as
def list_(client: Client, *, status: str | None, kind: str | None, most: int, as_json: bool) -> None:
    """List the jobs, newest first."""
    found = [job.state for job in islice(client.jobs.list(kind=kind, status=status), most)]
    if as_json:
        print_json(found)
        return
    rows = [(one.id, one.kind, one.status, f"{one.progress or 0.0:.0%}", one.created_at, one.message) for one in found]
    print_table(("id", "kind", "status", "done", "asked at", "message"), rows, nothing="There is no such job.")


@jobs.command
@click.argument("job", shell_complete=ids("jobs"))
@asking
def show(client: Client, *, job: str) -> None:
    """Print what is known about a job."""
    print_json(client.jobs.get(job).state)


@jobs.command
@click.argument("job", shell_complete=ids("jobs"))
@asking
def request(client: Client, *, job: str) -> None:
    """Print what was asked for; `servotune optimize` and `identify` take it as it is."""
    print_json(client.jobs.get(job).request())


@jobs.command
@click.argument("job", shell_complete=ids("jobs"))
@asking
@shown_as
def result(client: Client, *, job: str, as_json: bool) -> int:
    """Print the result of a job that has ended."""
    return print_result(client.jobs.get(job), as_json=as_json)


@jobs.command
@click.argument("job", shell_complete=ids("jobs"))
@asking
def script(client: Client, *, job: str) -> None:
    """Print a Python script that repeats an optimisation."""
    click.echo(client.jobs.get(job).script())


@jobs.command
@click.argument("job", shell_complete=ids("jobs"))
@click.option(
    "--html", "form", flag_value="html", default=True, help="One page that needs no other file (the default)."
)
@click.option("--pdf", "form", flag_value="pdf", help="Pages of A4.")
@click.option("--language", type=click.Choice(["en", "ro"]), default="en", help="English (the default) or Romanian.")
@click.option("-o", "--output", type=Target(), help="File to write; report_JOB.html by default.")
@asking
def report(
    client: Client, *, job: str, form: Literal["html", "pdf"], language: Literal["en", "ro"], output: Path | None
) -> None:
    """Write a report of a job, or of a kept result by its id: what was asked, what came out, the proof, and what it was made from."""
    target = output or Path(f"report_{job}.{form}")
    found = (
        client.results.report(job, form, target, language=language)
        if job.startswith("res_")
        else client.jobs.get(job).report(form, target, language=language)
    )
    click.echo(f"{target}: {len(found)} bytes")


def _changing(name: str, help_: str) -> None:
    @jobs.command(name, help=help_)
    @click.argument("job", shell_complete=ids("jobs"))
    @asking
    def change(client: Client, *, job: str) -> None:
        found = getattr(client.jobs.get(job), name)()
        click.echo(f"{found.id}: {found.status}{', paused' if found.state.paused else ''}")


_changing("pause", "Take a job from whoever computes it; it keeps its place.")
_changing("resume", "Let a paused job go on from where it was.")
_changing("cancel", "Stop a job. A search proves its best point first and keeps it.")


@click.command
@click.argument("job", shell_complete=ids("jobs"))
@click.option("--timeout", type=float, help="Longest time to wait, s; the job goes on running.")
@asking
@shown_as
def watch(client: Client, *, job: str, timeout: float | None, as_json: bool) -> int:
    """Show how far a job is until it ends, and print its result."""
    return watch_job(client.jobs.get(job), timeout=timeout, as_json=as_json)


def start(client: Client, kind: Kind, file: Path, *, waits: bool, timeout: float | None, as_json: bool) -> int:
    """Start a job from a request in a file; wait for its end where that is wanted."""
    job = client.jobs.start(kind, read_json(file))
    if not waits:
        if as_json:
            print_json(job.state)
        else:
            click.echo(job.id)
        return 0
    click.echo(f"{job.id} is {job.status}; Ctrl-C leaves it running", err=True)
    return watch_job(job, timeout=timeout, as_json=as_json)


def watch_job(job: Job[Any], *, timeout: float | None, as_json: bool) -> int:
    """Wait for the end of a job, and print its result."""
    with suppress(JobFailedError, JobCancelledError):  # said below, as of one that had ended before
        job.wait(timeout=timeout)
    return print_result(job, as_json=as_json)


def print_result(job: Job[Any], *, as_json: bool) -> int:
    """Print the result of a job as a table of names and texts, and return 0 where it is one to build on."""
    if not job.done:
        click.echo(f"{job.id} is still {job.status} ({job.progress:.0%} done): servotune watch {job.id}", err=True)
        return 1
    found = job.result()
    if as_json:
        print_json(found)
        return 0
    click.echo(found.summary() if isinstance(found, Reply) else str(found))
    if job.kind == "optimization":
        rows = [
            (goal.metric, goal.output, goal.before.summary(), goal.after.summary(), "met" if goal.met else "not met")
            for goal in found.goals
        ]
        print_table(("goal", "output", "before", "after", ""), rows, nothing="It had no goals.")
        click.echo(f"certificate: {'valid' if found.certificate.valid else 'NOT valid'}; {found.advice}".rstrip("; "))
    elif isinstance(found, Reply):
        print_table(("", ""), list(found.table()), nothing="It is empty.")
    return 0
