"""What a worker computes: one function from a job to its result, run in a child process of its own."""

from __future__ import annotations

import importlib
import logging
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final

from api.problems.documents import Problem
from api.problems.exceptions import KNOWN, problem_of
from api.processes.cluster import workers_of
from api.processes.memory import bound_memory
from api.services.identifications import identifications
from api.services.jobs.computing import Computing
from api.services.operation.app_context import Installation
from api.services.optimizations import optimizations
from api.services.recordings import datasets, parsing, processing
from api.services.studies import studied
from api.services.studies.results import versions
from api.services.validations import validations
from api.services.webhooks import alerts
from api.settings import Settings
from api.telemetry import logs
from engine.batch import warm as ahead
from optimizers.evaluation.spreading import spread
from storage.jobs.compute import ComputeJob, Refusal, Reporter
from storage.jobs.queue import JobQueue
from storage.jobs.zygote import Later
from storage.session import Database, open_database

#: Compiles the kernels, and ends with the process that started it.
_COMPILE = """
import ctypes, signal, sys
if sys.platform == "linux":
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)
from engine.batch.warm import warm
warm()
"""
#: A job has the time that its queue says, not that of a request (s).
_A_JOB_S = 1e6
#: What is read from a file that somebody sent may take this much memory (bytes): samples come in pieces, chunks are bounded.
_READING, _READERS = 1 << 30, {datasets.PARSING, datasets.PREVIEW}

_log = logging.getLogger("servotune.worker")


class _Watch:
    """The monitor of an optimisation, told to whoever follows the job.

    Parameters
    ----------
    reporter : Reporter
    kept : mapping, optional
        The state that this search kept before it was cut off.
    """

    def __init__(self, reporter: Reporter, *, kept: Mapping[str, Any] | None = None) -> None:
        self._reporter = reporter
        reporter.listen()
        self._kept = kept

    def progress(self, fraction: float, message: str) -> None:
        """Pass the finished share on."""
        self._reporter.progress(fraction, message)

    def best(self, evaluation: int, objective: float, violation: float, variables: Mapping[str, float]) -> None:
        """Pass a new best point on as a line."""
        values = ", ".join(f"{name} = {value:.6g}" for name, value in variables.items())
        self._reporter.message(
            f"best after {evaluation} evaluations: objective {objective:.6g}, violation {violation:.3g} at {values}"
        )

    def cancelled(self) -> bool:
        """Return whether the job was cancelled: the process is killed soon, but may hand over its best point before."""
        return self._reporter.ending()

    def keep(self, state: Mapping[str, Any]) -> None:
        """Keep a state, for the next worker if this one dies."""
        self._kept = state
        self._reporter.keep(state)

    def kept(self) -> Mapping[str, Any] | None:
        """Return the last state."""
        return self._kept


_compiling: Final[list[int]] = []
"""The process that compiles kernels, if there is one."""
_LOOK_INTERVAL: Final = 0.2


def prepare() -> Later | None:
    """Load the compiled kernels and the packages of searches, so that no job waits for them, and write the log as the worker does.

    Kernels that are not compiled yet are compiled by a process beside this one: that takes minutes on a busy machine, and most
    jobs need none of them.
    """
    settings = Settings()
    logs.configure(settings.log_level, form=settings.log_format)
    for package in ("scipy.signal", "scipy.stats"):  # searches and identifications load them where they need them
        importlib.import_module(package)
    if ahead.compiled_before():
        _load_compiled()
        return None
    _log.warning(
        "kernels are being compiled, a minute or more: searches wait until then, and batches take so much longer"
    )
    compiling = subprocess.Popen([sys.executable, "-c", _COMPILE])  # noqa: S603 - our own code
    _compiling.append(compiling.pid)
    return Later(process=compiling.pid, work=_load_compiled)


def _lives(process: int) -> bool:
    """Return whether there still is that process; its parent may be the one of this one."""
    try:
        os.kill(process, 0)
    except (ProcessLookupError, PermissionError):  # gone, or its number is another user's by now
        return False
    return True


def await_compiled(reporter: Reporter) -> None:
    """Wait for what a process beside compiles, with progress: compiling it here, too, would take as long, and nothing could end it.

    It happens once for a machine and version, and is no time of the search's.
    """
    while _compiling and not ahead.compiled_before() and _lives(_compiling[0]) and not reporter.ending():
        reporter.progress(0.0, "waiting for kernels that are compiled, once for this machine: a minute or more")
        time.sleep(_LOOK_INTERVAL)


def _load_compiled() -> None:
    if ahead.compiled_before():
        ahead.warm()


def run(job: ComputeJob, reporter: Reporter) -> Mapping[str, Any]:
    """Compute a job.

    Raises
    ------
    Refusal
        With the problem that the user should read.
    """
    limit = bound_memory(Settings().job_memory, more=_READING if job.kind in _READERS else None)
    with opened(job.database_url) as database:
        try:
            return {**_RUN[job.kind](job, database, reporter), "versions": versions()}
        except MemoryError as error:
            detail = f"a job must need at most {limit} bytes of memory (SERVOTUNE_JOB_MEMORY), got one that needs more"
            raise Refusal(**Problem(422, "too-large", detail).document()) from error
        except KNOWN as error:
            problem = problem_of(error)
            assert problem is not None
            document = problem.document()
            raise Refusal(**document) from error


def _optimization(job: ComputeJob, database: Database, reporter: Reporter) -> Mapping[str, Any]:
    watch = _Watch(reporter, kept=job.state)
    await_compiled(reporter)
    with spread(workers_of(Settings(), processors=len(os.sched_getaffinity(0)))):
        return optimizations.run(
            job.body, database=database, workspace=job.workspace_id, monitor=watch, seconds=job.seconds
        )  # fmt: skip


def _identification(job: ComputeJob, database: Database, reporter: Reporter) -> Mapping[str, Any]:
    watch = _Watch(reporter, kept=job.state)
    await_compiled(reporter)
    with spread(workers_of(Settings(), processors=len(os.sched_getaffinity(0)))):
        return identifications.run(
            job.body, database=database, workspace=job.workspace_id, monitor=watch, seconds=job.seconds
        )  # fmt: skip


def _validation(job: ComputeJob, database: Database, reporter: Reporter) -> Mapping[str, Any]:
    result = validations.run(job.body, database=database, workspace=job.workspace_id, tell=reporter.progress)
    with database.session() as session:
        alerts.on_validation(session, job.workspace_id, job=job.id, result=result)
    return result


def _dataset(job: ComputeJob, database: Database, reporter: Reporter) -> Mapping[str, Any]:
    leaving_out = Settings().keep_originals == "until-verified"
    return parsing.run(
        job.body, database=database, workspace=job.workspace_id, progress=reporter.progress, leaving_out=leaving_out
    )


def _preview(job: ComputeJob, database: Database, reporter: Reporter) -> Mapping[str, Any]:
    return parsing.look(job.body, database=database, workspace=job.workspace_id, progress=reporter.progress)


def _processing(job: ComputeJob, database: Database, reporter: Reporter) -> Mapping[str, Any]:
    return processing.run(job.body, database=database, workspace=job.workspace_id, progress=reporter.progress)


def installed(database: Database, settings: Settings) -> Installation:
    """Return what computes as the service does, in this process."""
    return Installation(settings=settings, database=database, queue=JobQueue(database), computing=Computing(settings))


def _study(job: ComputeJob, database: Database, _: Reporter) -> Mapping[str, Any]:
    settings = Settings().model_copy(update={"request_seconds": _A_JOB_S})
    return studied.run(job.body, kind=job.kind, service=installed(database, settings), workspace=job.workspace_id)


_RUN = {
    **dict.fromkeys(studied.MODELS, _study),
    optimizations.KIND: _optimization,
    identifications.KIND: _identification,
    validations.KIND: _validation,
    datasets.PARSING: _dataset,
    datasets.PREVIEW: _preview,
    processing.KIND: _processing,
}


@contextmanager
def opened(url: str) -> Iterator[Database]:
    """Open the database for as long as this process computes."""
    database = open_database(url, objects=Settings().objects)
    try:
        yield database
    finally:
        database.dispose()
