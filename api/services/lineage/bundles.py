"""A lineage as one file that says everything: documents, samples, requests, results, versions and seeds.

manifest.json                 the graph, versions, seeds, and the SHA-256 of every other file
models/sys_..@3.json          a system document
datasets/ds_../dataset.json   what is known of a recording, and how it was made
datasets/ds_../original       its bytes as they were received
jobs/job_...json              what was asked, and what came out
studies/res_...json           the same of a kept study
"""

from __future__ import annotations

import hashlib
import json
import tempfile
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from typing import IO, Any

import numpy as np
from sqlalchemy.orm import Session

from api.convert.recordings import physical
from api.convert.values import listed
from api.problems.documents import Problem
from api.services.lineage.lineage import graph_to_wire
from api.services.operation.app_context import Caller
from api.services.recordings.datasets import to_wire
from api.services.studies.results import versions
from optimizers import methods
from storage.imports import RAW
from storage.models import Job
from storage.models.base import utc_now
from storage.originals import is_left_out
from storage.repositories import (
    DatasetRepository,
    JobRepository,
    LineageRepository,
    ResultRepository,
    SystemRepository,
)
from storage.repositories.lineage import Direction, Graph, Node

FORMAT = "servotune-lineage"
VERSION = 1
_IN_MEMORY = 32 << 20
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Of every file inside: the same lineage makes the same bytes."""
_PIECE = 1 << 20


def bundle(session: Session, caller: Caller, identifier: str, *, direction: Direction) -> IO[bytes]:
    """Return the file, open at its beginning; closing it deletes it.

    Raises
    ------
    NotFoundError
        For what is not in this workspace.
    Problem
        409 where something that belongs to it was deleted, has not ended, or there is too much of it.
    """
    found = LineageRepository(session, caller.workspace).graph(identifier, direction=direction)
    _check_complete(identifier, found)
    file = tempfile.SpooledTemporaryFile(max_size=_IN_MEMORY)  # noqa: SIM115 - the caller closes it
    try:
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as archive:
            writer = _Writer(archive)
            seeds: dict[str, int] = {}
            for node in found.nodes:
                _write(session, caller.workspace, node, writer, seeds)
            manifest = {
                "format": FORMAT,
                "version": VERSION,
                "root": identifier,
                "exported_at": utc_now().isoformat(),
                "versions": versions(),
                "seeds": seeds,
                **graph_to_wire(found),
                "files": writer.digests,
            }
            writer.put("manifest.json", [_json(manifest)])
    except BaseException:
        file.close()
        raise
    file.seek(0)
    return file


def pieces(file: IO[bytes]) -> Iterator[bytes]:
    """Give a file piece by piece, and close it."""
    with file:
        while piece := file.read(_PIECE):
            yield piece


def _check_complete(identifier: str, found: Graph) -> None:
    gone = [node.id for node in found.nodes if not node.exists]
    if gone:
        raise Problem(
            409, "incomplete", f"the lineage of {identifier!r} must be complete to be exported, {', '.join(gone)} was deleted",
            extra={"missing": gone},
        )  # fmt: skip
    unfinished = [
        node.id for node in found.nodes if node.facts.get("status") in {"queued", "running", "open", "parsing"}
    ]
    if unfinished:
        raise Problem(
            409, "conflict", f"the lineage of {identifier!r} must have ended to be exported, {unfinished[0]!r} has not"
        )
    if found.truncated:
        raise Problem(
            409, "conflict", f"the lineage of {identifier!r} must be at most {len(found.nodes)} things to be exported"
        )


class _Writer:
    """Puts files into an archive and remembers their checksums."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive
        self.digests: dict[str, str] = {}

    def put(self, name: str, content: Iterable[bytes]) -> None:
        """Write a file piece by piece."""
        digest = hashlib.sha256()
        info = zipfile.ZipInfo(name, date_time=_EPOCH)
        info.compress_type = zipfile.ZIP_DEFLATED
        with self._archive.open(info, "w", force_zip64=True) as target:
            for piece in content:
                digest.update(piece)
                target.write(piece)
        self.digests[name] = digest.hexdigest()


def _write(session: Session, workspace: str, node: Node, writer: _Writer, seeds: dict[str, int]) -> None:
    kind = node.id.partition("_")[0]
    if kind == "sys":
        # also of a system that was deleted since: its revisions stay
        document = SystemRepository(session, workspace).kept_revision(
            str(node.facts["system"]), int(node.facts["revision"])
        )
        writer.put(f"models/{node.id}.json", [_json({**_head(node), "document": document})])
    elif kind == "ds":
        datasets = DatasetRepository(session, workspace)
        row = datasets.get(node.id)
        writer.put(f"datasets/{node.id}/dataset.json", [_json({**_head(node), **to_wire(row)})])
        if row.manifest is not None and (row.format == RAW or not is_left_out(session, row)):
            writer.put(f"datasets/{node.id}/original", datasets.original(node.id))
        else:  # computed, or left out: its samples are what a repetition is compared with, or computes with
            for number, channel in enumerate(row.channels):
                writer.put(f"datasets/{node.id}/channels/{number}.f64", _samples(datasets, node.id, channel))
    elif kind == "job":
        job = JobRepository(session, workspace).get(node.id)
        seed = _seed(job)
        if seed is not None:
            seeds[job.id] = seed
        writer.put(
            f"jobs/{node.id}.json",
            [_json({**_head(node), "body": job.body, **_result(session, workspace, job.result_id)})],
        )
    elif kind == "res":
        results = ResultRepository(session, workspace)
        request = results.get(node.id).request
        writer.put(
            f"studies/{node.id}.json",
            [_json({**_head(node), "request": request, **_result(session, workspace, node.id)})],
        )


def _head(node: Node) -> dict[str, Any]:
    return {"id": node.id, "kind": node.kind, "created_at": node.created_at.isoformat() if node.created_at else None}


def _result(session: Session, workspace: str, identifier: str | None) -> dict[str, Any]:
    if identifier is None:
        return {"result": None, "versions": {}}
    results = ResultRepository(session, workspace)
    row = results.get(identifier)
    return {"result": results.body(row), "versions": row.versions}


def _seed(job: Job) -> int | None:
    """Return the seed of an optimisation, that of its method where the request gives none; None for what has no seed."""
    method = job.body.get("request", {}).get("method")
    if not isinstance(method, Mapping):
        return None
    options = {name: value for name, value in method.items() if name != "kind"}
    seed = methods.catalogue()[str(method["kind"])].resolve(options).get("seed")
    return None if seed is None else int(seed)


def _samples(datasets: DatasetRepository, identifier: str, channel: Mapping[str, Any]) -> Iterator[bytes]:
    """Give the physical values of a channel, little-endian float64, piece by piece."""
    count = datasets.get(identifier).sample_count or 0
    for start in range(0, count, _PIECE):
        raw = datasets.read_channel(identifier, channel["name"], start, min(start + _PIECE, count))
        yield physical(raw, channel).astype("<f8").tobytes()


def _json(document: Any) -> bytes:
    return json.dumps(document, ensure_ascii=False, allow_nan=False, default=_array).encode()


def _array(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return listed(value)
    raise TypeError(f"a bundle must be made of JSON values and arrays, got {type(value).__name__}")
