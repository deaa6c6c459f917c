"""A report of a finished job or of a kept study: what is needed of the database is read, the rest is computed and drawn, and one file is written."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Literal

import numpy as np
from sqlalchemy.orm import Session

from api.problems.documents import Problem
from api.services.frequency import frfs
from api.services.identifications import identifications
from api.services.jobs import jobs
from api.services.operation.app_context import Caller
from api.services.optimizations import optimizations
from api.services.reports import as_html, as_pdf, drawing
from api.services.reports.common import facts, lineage, warnings
from api.services.reports.kinds import identified, influenced, measured, optimized, studied, validated
from api.services.reports.language import Language, language, say, speaking
from api.services.reports.model import Report, Section, clean
from api.services.reports.origins import Asked, Told, of_a_job, of_a_kept_study
from api.services.systems.systems import compiled
from api.services.validations import validations
from engine.diagram.diagram import Diagram
from storage.repositories import JobRepository, ResultRepository
from storage.session import Database

KIND = "report"
"""What a process of its own is told that it shall do."""
Form = Literal["html", "pdf"]
Of = Literal["job", "result"]
"""A finished job, or a study that was asked to be kept."""
MEDIA_TYPES: Mapping[Form, str] = MappingProxyType({"html": as_html.MEDIA_TYPE, "pdf": as_pdf.MEDIA_TYPE})

_WRITE: Mapping[Form, Callable[[Report], bytes]] = {"html": as_html.write, "pdf": as_pdf.write}
_SECTIONS: Mapping[str, tuple[str, Callable[[Asked], Iterator[Section]]]] = {
    optimizations.KIND: ("Optimisation", optimized.sections),
    identifications.KIND: ("Identification", identified.sections),
    validations.KIND: ("Validation", validated.sections),
    "influence": ("Influence", influenced.sections),
    "simulation": ("Simulation", studied.simulation),
    "frequency_response": ("Frequency response", studied.frequency),
    "spectrum": ("Spectrum", measured.spectrum),
    frfs.KIND: ("Frequency response function", measured.frf),
}


def warm() -> None:
    """Load what draws and what writes pages: everything that a process would otherwise load with its first report."""
    sketch = drawing.panels(
        [drawing.Panel("", "s", "", [drawing.Line("", *np.array([[1.0, 10.0]] * 2))], logarithmic=True)], ""
    )
    report = Report(
        title="", kind="", author="", made_at="2026-01-01T00:00:00+00:00", facts=(), sections=[Section("", [sketch])]
    )
    for write in _WRITE.values():
        write(report)


def check(session: Session, caller: Caller, of: Of, identifier: str) -> None:
    """Prove that there is something to report of.

    Raises
    ------
    Problem
        409 for a job without a result (yet), and for what is of a kind that has no report.
    """
    job = JobRepository(session, caller.workspace).get(identifier) if of == "job" else None
    kind = ResultRepository(session, caller.workspace).get(identifier).kind if job is None else job.kind
    if kind not in _SECTIONS:
        rule = f"{of} {identifier!r} must be one of {', '.join(_SECTIONS)} to have a report"
        raise Problem(409, "no-report", f"{rule}; it is {kind}")
    if job is not None:
        jobs.result_of(job)


def written(database: Database, workspace: str, of: Of, identifier: str, *, form: Form, spoken: Language) -> bytes:
    """Return the report as a file."""
    tell = of_a_job if of == "job" else of_a_kept_study
    with database.session() as session:
        told = tell(session, workspace, identifier)
    with speaking(spoken):
        return _WRITE[form](report_of(told))


def report_of(told: Told) -> Report:
    """Return all that is said of it."""
    called, sections = _SECTIONS[told.kind]
    kind = say(called)
    asked = Asked(told=told, diagram=_diagram(told))
    finished = told.finished_at or told.created_at
    return Report(
        title=clean(str((told.system or {}).get("name") or "") or kind),
        kind=say("{kind}: report of a study", kind=kind),
        author=clean(told.author),
        language=language(),
        made_at=finished.isoformat(timespec="seconds"),
        facts=list(facts(told)),
        sections=[*warnings(told), *sections(asked), lineage(told)],
    )


def _diagram(told: Told) -> Diagram | None:
    """Return the checked diagram of the system, of several structures that of the chosen one."""
    document = told.system
    for one in told.request.get("alternatives") or []:
        if one.get("name") == told.result.get("chosen"):
            document = one["system"]
    return None if document is None else compiled(document, place=("system",))
