"""/v1/datasets: recordings in verified segments."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Path, Query, Request, Response
from fastapi.responses import StreamingResponse
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool

from api.http.auth import Reader, Uploader, Writer
from api.http.bodies import DocumentRoute, read_limited
from api.http.calls import (
    CreationDep,
    Cursor,
    Force,
    IfMatch,
    InstallationDep,
    Limit,
    OfAName,
    answer,
    etag,
    expected_revision,
    respond,
)
from api.problems.documents import MEDIA_TYPE
from api.schemas.datasets import CommitRequest, DatasetRequest, PreviewRequest
from api.schemas.replies import ChannelReply, DatasetHead, DatasetReply, FunctionReply, Page, PreviewReply, SegmentReply
from api.services.operation.app_context import Caller, Installation
from api.services.recordings import datasets, functions, recorded_exports
from storage.repositories import Answer

router = APIRouter(prefix="/v1/datasets", tags=["datasets"], route_class=DocumentRoute)


@router.post("", status_code=201, response_model=DatasetReply, summary="Open a recording")
def create(request: DatasetRequest, caller: Uploader, creation: CreationDep) -> Response:
    """Describe the channels (raw) or how the file is read, then send the segments."""

    def work(session: Session) -> Answer:
        body = datasets.create(session, caller, request)
        headers = {"Location": f"/v1/datasets/{body['id']}", "ETag": etag(body["revision"])}
        return answer(body, status=201, headers=headers)

    return creation.create(work)


Status = Literal["open", "parsing", "ready", "failed"]


@router.get("", response_model=Page[DatasetHead], summary="List the recordings")
def page(
    caller: Reader,
    service: InstallationDep,
    narrowing: OfAName,
    file_format: Annotated[str | None, Query(alias="format", max_length=64)] = None,
    status: Status | None = None,
    cursor: Cursor = None,
    limit: Limit = 100,
) -> Response:
    """Newest first."""
    with service.database.session() as session:
        body = datasets.page(
            session, caller, file_format=file_format, status=status, narrowing=narrowing, cursor=cursor, limit=limit
        )
    return respond(answer(body))


@router.get("/{identifier}", response_model=DatasetReply, summary="Get a recording")
def get(identifier: str, caller: Reader, service: InstallationDep) -> Response:
    """Return its channels, its status and how it was made, without the samples."""
    with service.database.session() as session:
        body = datasets.get(session, caller, identifier)
    return respond(answer(body, headers={"ETag": etag(body["revision"])}))


@router.delete("/{identifier}", status_code=204, summary="Delete a recording")
def delete(
    identifier: str, caller: Writer, service: InstallationDep, *, if_match: IfMatch = None, force: Force = False
) -> Response:
    """Forget the recording; 409 lists what depends on it, unless it is forced."""
    with service.database.session() as session:
        expected = expected_revision(if_match, lambda: datasets.get(session, caller, identifier)["revision"])
        datasets.delete(session, caller, identifier, expected_revision=expected, force=force)
    return Response(status_code=204)


Sha256 = Annotated[str, Path(pattern="^[0-9a-f]{64}$")]


@router.put(
    "/{identifier}/segments/{sha256}",
    summary="Send a segment",
    response_model=SegmentReply,
    responses={201: {"model": SegmentReply, "description": "it is new"}},
    openapi_extra={
        "requestBody": {
            "required": True,
            "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
        }
    },
)
async def put_segment(
    identifier: str, sha256: Sha256, request: Request, caller: Uploader, service: InstallationDep
) -> Response:
    """Keep the bytes when they have this SHA-256; the same segment twice is kept once."""
    settings = service.settings
    data = await read_limited(request, settings.segment_limit, "a segment", seconds=settings.body_seconds)
    new = await run_in_threadpool(_store, service, caller, identifier, sha256, data)
    return respond(answer({"sha256": sha256, "size": len(data)}, status=201 if new else 200))


def _store(service: Installation, caller: Caller, identifier: str, sha256: str, data: bytes) -> bool:
    with service.database.session() as session:
        return datasets.put_segment(session, caller, identifier, sha256, data)


@router.get("/{identifier}/segments", response_model=Page[SegmentReply], summary="List the segments that are there")
def segments(
    identifier: str, caller: Reader, service: InstallationDep, cursor: Cursor = None, limit: Limit = 1000
) -> Response:
    """In the order of their arrival: what is missing can be sent again."""
    with service.database.session() as session:
        return respond(answer(datasets.segments(session, caller, identifier, cursor=cursor, limit=limit)))


@router.post(
    "/{identifier}/commit",
    response_model=DatasetReply,
    responses={202: {"model": DatasetReply, "description": "a file, or many raw samples: a job reads it"}},
    summary="Close a recording",
)
def commit(
    identifier: str, request: CommitRequest, caller: Uploader, service: InstallationDep, creation: CreationDep
) -> Response:
    """Say the order of the segments and the SHA-256 of the whole; up to 64 MiB of raw samples are ready at once."""

    def work(session: Session) -> Answer:
        found = datasets.commit(service, session, caller, identifier, request)
        if found.job is None:
            status = 202 if found.dataset["status"] == "parsing" else 200
            return answer(found.dataset, status=status)
        headers = {"Location": f"/v1/jobs/{found.job['id']}", "Retry-After": "1"}
        return answer({**found.dataset, "job": found.job}, status=202, headers=headers)

    return creation.create(work)


@router.post(
    "/{identifier}/preview", status_code=202, response_model=PreviewReply, summary="Look at a file before it is read"
)
def preview(
    identifier: str, request: PreviewRequest, caller: Uploader, service: InstallationDep, creation: CreationDep
) -> Response:
    """Start a job whose result is the import description that the service proposes, with the first samples of each channel."""

    def work(session: Session) -> Answer:
        body = datasets.preview(service, session, caller, identifier, request)
        headers = {"Location": f"/v1/jobs/{body['job']['id']}", "Retry-After": "1"}
        return answer(body, status=202, headers=headers)

    return creation.create(work)


Seconds = Annotated[float | None, Query(allow_inf_nan=False, description="s from the beginning of the recording")]


@router.get("/{identifier}/functions/{name:path}", response_model=FunctionReply, summary="Read a function of frequency")
def function(identifier: str, name: str, caller: Reader, service: InstallationDep) -> Response:
    """Lines in rad/s and complex values in the units of the file: a response, a coherence, a spectrum."""
    return respond(answer(functions.function(service, caller, identifier, name)))


@router.get("/{identifier}/channels/{name:path}", response_model=ChannelReply, summary="Read a channel")
def channel(
    identifier: str,
    name: str,
    caller: Reader,
    service: InstallationDep,
    start: Seconds = None,
    end: Seconds = None,
    points: Annotated[
        int | None,
        Query(
            ge=1,
            le=100_000,
            description="minimum and maximum of at most so many stretches of equal length, where there are more samples",
        ),
    ] = None,
) -> Response:
    """Calibrated values in the channel's unit, or their envelope where there are more than `points`."""
    body = datasets.channel(service, caller, identifier, name, start=start, end=end, points=points)
    return respond(answer(body))


FILE = {"schema": {"type": "string", "format": "binary"}}


@router.get(
    "/{identifier}/export",
    summary="Get a recording as a file of another program",
    response_class=StreamingResponse,
    responses={200: {"content": {media_type: FILE for _, media_type, _ in recorded_exports.WRITERS.values()}}},
)
def export(
    identifier: str,
    caller: Reader,
    service: InstallationDep,
    file_format: Annotated[Literal["csv", "mat", "parquet", "hdf5"], Query(alias="format")] = "csv",
    channel: Annotated[list[str] | None, Query(max_length=500, description="all unless given; may be repeated")] = None,
    start: Seconds = None,
    end: Seconds = None,
) -> Response:
    """Return calibrated samples with their times, units and names, as they are read: a recording of any length needs little memory."""
    found = recorded_exports.export(
        service, caller, identifier, format_=file_format, channels=channel, start=start, end=end
    )
    headers = {"Content-Disposition": f'attachment; filename="{found.filename}"'}
    return StreamingResponse(found.pieces, media_type=found.media_type, headers=headers)


@router.get(
    "/{identifier}/original",
    summary="Get the bytes back",
    response_class=StreamingResponse,
    responses={
        200: {"content": {"application/octet-stream": {}}},
        410: {
            "description": "it was left out, as this installation is set",
            "content": {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/ProblemReply"}}},
        },
    },
)
def original(identifier: str, caller: Reader, service: InstallationDep) -> Response:
    """Return the recording as it was received."""
    with service.database.session() as session:
        size = datasets.check_committed(session, caller, identifier)
    return StreamingResponse(
        recorded_exports.begun(datasets.original(service, caller, identifier)),
        media_type="application/octet-stream",
        headers={"Content-Length": str(size)},
    )
