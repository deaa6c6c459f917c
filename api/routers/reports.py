"""Reports of finished jobs and of kept results: one file that needs no other."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query, Request, Response
from starlette.concurrency import run_in_threadpool

from api.http.auth import Reader
from api.http.calls import InstallationDep, recalled
from api.services.operation.app_context import Caller
from api.services.reports import reports
from api.services.reports.language import Language
from storage.jobs.compute import ComputeJob

router = APIRouter(prefix="/v1")


class Report(Response):
    """A file to keep."""


_CONTENT: dict[str, Any] = {
    reports.MEDIA_TYPES["html"]: {"schema": {"type": "string"}},
    reports.MEDIA_TYPES["pdf"]: {"schema": {"type": "string", "format": "binary"}},
}
_RESPONSES: dict[int | str, dict[str, Any]] = {200: {"content": _CONTENT}}


class Writer:
    """What writes the report that a request asks for, in a process of its own."""

    def __init__(
        self,
        caller: Reader,
        service: InstallationDep,
        http: Request,
        form: Annotated[reports.Form, Query(alias="format", description="one HTML file, or a PDF")] = "html",
        language: Annotated[
            Language,
            Query(description="what it is written in; what people wrote and the service advised stays as it is"),
        ] = "en",
    ) -> None:
        self._caller: Caller = caller
        self._service = service
        self._http = http
        self._form: reports.Form = form
        self._language: Language = language

    async def write(self, of: reports.Of, identifier: str) -> Report:
        """Return the file; 409 where there is nothing to report of."""

        def check() -> None:
            with self._service.database.session() as session:
                reports.check(session, self._caller, of, identifier)

        await run_in_threadpool(check)
        job = ComputeJob(
            id=self._http.state.request_id,
            kind=reports.KIND,
            body={
                "settings": self._service.settings,
                "wanted": {"of": of, "identifier": identifier, "form": self._form, "spoken": self._language},
            },
            workspace_id=self._caller.workspace,
            database_url=self._service.database.url,
            request_id=self._http.state.request_id,
        )
        async with recalled(self._http.receive) as recall:
            found = await self._service.computing.in_child(job, self._caller.principal, recall=recall)
        headers = {
            "Content-Disposition": f'attachment; filename="report_{identifier}.{self._form}"',
            "Content-Language": self._language,
        }
        return Report(found["report"], media_type=reports.MEDIA_TYPES[self._form], headers=headers)


WriterDep = Annotated[Writer, Depends()]


@router.get(
    "/jobs/{identifier}/report",
    tags=["jobs"],
    response_class=Report,
    responses=_RESPONSES,
    summary="Write a report of a job",
)
async def of_a_job(identifier: str, writer: WriterDep) -> Report:
    """What was asked by whom, what came out with its figures and its proof, and what it was made from, as a file that needs no other.

    Of optimisations, identifications, validations, influence studies, simulations, spectra and frequency responses that have a
    result; 409 for others.
    """
    return await writer.write("job", identifier)


@router.get(
    "/results/{identifier}/report",
    tags=["results"],
    response_class=Report,
    responses=_RESPONSES,
    summary="Write a report of a kept result",
)
async def of_a_result(identifier: str, writer: WriterDep) -> Report:
    """The same of a study that was asked to be kept: simulation, influence, spectrum, frequency response; 409 for others."""
    return await writer.write("result", identifier)
