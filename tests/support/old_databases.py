"""Databases as earlier versions left them, made by the migrations of those versions and rows as those versions wrote them.

In each: a system with two revisions, a recording of two channels, a finished job with a result and one that waits, a key; and, once there
were any, a schedule that has run.
"""

from __future__ import annotations

import hashlib
import struct
import zlib
from datetime import UTC, datetime
from io import BytesIO
from typing import Any

import numpy as np
from alembic import command
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, MetaData, insert

from storage import Database
from storage.migrations import configuration
from storage.models import DEFAULT_WORKSPACE

KEY = "st_the_key_of_an_old_installation"
WAVE = np.sin(np.arange(20) / 3)
_AT = datetime(2026, 5, 1, 12, 0, tzinfo=UTC)

Rows = dict[str, list[dict[str, Any]]]


def revisions() -> list[str]:
    """Return every revision of the tables but the last, the oldest first."""
    found = [script.revision for script in ScriptDirectory.from_config(configuration()).walk_revisions()]
    return found[:0:-1]


def make(database: Database, revision: str) -> None:
    """Bring an empty database to a revision, and write what was written then."""
    config = configuration()
    with database.engine.begin() as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, revision)
    with database.engine.begin() as connection:
        _write(connection, _rows())


def _write(connection: Connection, rows: Rows) -> None:
    """Write the rows of the tables and columns that there are."""
    tables = MetaData()
    tables.reflect(connection)
    naive = connection.dialect.name == "sqlite"
    for name, found in rows.items():
        if name not in tables.tables:
            continue
        table = tables.tables[name]
        for row in found:
            there = {key: value for key, value in row.items() if key in table.c}
            if naive:
                there = {
                    key: value.replace(tzinfo=None) if isinstance(value, datetime) else value
                    for key, value in there.items()
                }
            connection.execute(insert(table).values(there))


def _rows() -> Rows:
    rows: Rows = {"blob": [], "blob_chunk": []}

    def blob(data: bytes, encoding: str, packed: bytes) -> str:
        sha256 = hashlib.sha256(data).hexdigest()
        rows["blob"].append({"sha256": sha256, "size": len(data), "created_at": _AT})
        rows["blob_chunk"].append({"sha256": sha256, "number": 0, "encoding": encoding, "data": packed})
        return sha256

    sent = np.arange(40.0).tobytes()
    channels = [sent_channel.tobytes() for sent_channel in np.arange(40.0).reshape(20, 2).T]
    file = BytesIO()
    np.save(file, WAVE)
    segment = blob(sent, "zlib/1", zlib.compress(sent, 1))
    blocks = [
        blob(channels[0], "zlib/8", zlib.compress(_shuffled(channels[0]), 1)),
        blob(channels[1], "planes/8", _planes(channels[1])),
    ]
    array = blob(file.getvalue(), "raw", file.getvalue())
    own = {"workspace_id": DEFAULT_WORKSPACE, "created_at": _AT}
    described = [{"name": name, "unit": "mm"} for name in ("u", "y")]
    return rows | {
        "api_key": [{"id": "key_1", "name": "old key", "prefix": KEY[:10], "sha256": hashlib.sha256(KEY.encode()).hexdigest(), "scopes": ["admin"], **own}],
        "system": [{"id": "sys_1", "name": "lag", "revision": 2, "updated_at": _AT, **own}],
        "system_revision": [
            {"system_id": "sys_1", "number": number, "document": {"parameters": {"k": {"value": 1 + number}}}, "schema_version": 1, "created_at": _AT}
            for number in (1, 2)
        ],
        "dataset": [{
            "id": "ds_1", "name": "0A", "format": "raw", "status": "ready", "channels": described, "sample_rate": 1000.0, "sample_count": 20,
            "manifest": [segment], "sha256": segment, "size": len(sent), **own,
        }],
        "dataset_segment": [{"dataset_id": "ds_1", "sha256": segment, "size": len(sent), "created_at": _AT}],
        "channel_block": [
            {"dataset_id": "ds_1", "channel": channel, "level": 0, "number": 0, "sha256": sha256} for channel, sha256 in enumerate(blocks)
        ],
        "result": [{"id": "res_1", "kind": "optimization", "body": {"parameters": {"k": 3.0}, "y": {"$array": 0}}, "versions": {}, **own}],
        "result_array": [{"result_id": "res_1", "position": 0, "sha256": array}],
        "job": [
            {
                "id": f"job_{status}", "kind": "optimization", "status": status, "progress": 0.0, "message": "", "body": {}, "attempts": 1,
                "last_event": 1, "result_id": result, "finished_at": ended, **own,
            }
            for status, result, ended in (("succeeded", "res_1", _AT), ("queued", None, None))
        ],
        "job_event": [
            {"job_id": f"job_{status}", "id": 1, "type": "status", "payload": {"status": status}, "at": _AT} for status in ("succeeded", "queued")
        ],
        "schedule": [{
            "id": "sch_1", "name": "nightly", "cron": "30 2 * * *", "time_zone": "UTC", "kind": "optimization", "body": {}, "overlap": "skip",
            "missed": "one", "paused": True, "revision": 1, **own,
        }],
        "schedule_run": [{"id": "run_1", "schedule_id": "sch_1", "due_at": _AT, "outcome": "skipped", "created_at": _AT}],
    }  # fmt: skip


def _shuffled(data: bytes) -> bytes:
    return b"".join(data[place::8] for place in range(8))


def _planes(data: bytes) -> bytes:
    """Return samples as they were once packed: each plane of bytes by itself, or as it is."""
    planes = [min(plane, zlib.compress(plane, 1), key=len) for plane in (data[place::8] for place in range(8))]
    return struct.pack("<8I", *map(len, planes)) + b"".join(planes)
