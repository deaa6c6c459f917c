from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from sqlalchemy import func, select

from storage import blobs
from storage.errors import NotFoundError
from storage.models import DEFAULT_WORKSPACE, ApiKey, Blob, BlobChunk
from storage.repositories import (
    ApiKeyRepository,
    JobRepository,
    ResultRepository,
    SystemRepository,
    authenticate,
    note_uses,
)


@pytest.mark.parametrize(
    "array",
    [
        np.array(3.5),
        np.empty((0, 3)),
        np.arange(12, dtype=np.int16).reshape(3, 4),
        np.asfortranarray(np.random.default_rng(0).normal(size=(7, 5))),
        np.array([1 + 2j, np.nan, np.inf]),
        np.array(["a", "ü"]),
        np.zeros((1200, 1200)),  # more than one chunk
    ],
)
def test_an_array_comes_back_as_it_was(database, array):
    with database.session() as session:
        ref = blobs.put_array(session, array)
    with database.session() as session:
        back = blobs.get_array(session, ref)
    np.testing.assert_array_equal(back, array)
    assert back.dtype == array.dtype
    assert not back.flags.writeable


def test_python_objects_are_no_arrays(database):
    with database.session() as session, pytest.raises(ValueError, match="allow_pickle"):
        blobs.put_array(session, np.array([object()]))


def test_bytes_are_cut_compressed_and_kept_once(database):
    data = bytes(blobs.CHUNK_SIZE) + b"tail"
    with database.session() as session:
        ref = blobs.put_bytes(session, data)
        assert blobs.put_bytes(session, data) == ref
        chunks = session.execute(select(BlobChunk.number, func.length(BlobChunk.data)).order_by(BlobChunk.number)).all()
        assert [number for number, _size in chunks] == [0, 1]
        assert chunks[0][1] < 50_000
        assert session.scalar(select(func.count()).select_from(Blob)) == 1
        assert [len(piece) for piece in blobs.iterate_bytes(session, ref)] == [blobs.CHUNK_SIZE, 4]
        assert blobs.get_bytes(session, ref) == data
        with pytest.raises(NotFoundError):
            blobs.get_bytes(session, "0" * 64)


def test_incompressible_bytes_do_not_grow(database):
    data = np.random.default_rng(3).bytes(100_000)
    with database.session() as session:
        ref = blobs.put_bytes(session, data, itemsize=8)
        assert session.scalar(select(func.length(BlobChunk.data)).where(BlobChunk.sha256 == ref)) <= len(data)
        assert blobs.get_bytes(session, ref) == data


def test_a_result_keeps_its_arrays_beside_its_body(database):
    curve = np.linspace(0, 1, 5)
    body = {"variants": [{"time": curve, "verdict": "ok", "count": np.int64(3)}, {"time": curve * 2}], "note": None}
    with database.session() as session:
        system = SystemRepository(session, DEFAULT_WORKSPACE).create(name="x", document={})
        result = ResultRepository(session, DEFAULT_WORKSPACE).create(
            kind="simulation",
            body=body,
            request={"samples": 5},
            system_id=system.id,
            system_revision=1,
            versions={"servotune": "0.1.0"},
        )
    with database.session() as session:
        results = ResultRepository(session, DEFAULT_WORKSPACE)
        row = results.get(result.id)
        assert row.body["variants"][1] == {"time": {"$array": 1}}
        assert (row.system_id, row.system_revision, row.versions) == (system.id, 1, {"servotune": "0.1.0"})
        back = results.body(row)
        np.testing.assert_array_equal(back["variants"][1]["time"], curve * 2)
        assert back["variants"][0]["count"] == 3
        assert [item.id for item in results.page(kind="simulation").items] == [result.id]
        assert results.page(kind="influence").items == []
        results.delete(result.id)
        with pytest.raises(NotFoundError):
            results.get(result.id)


def test_a_result_cannot_name_an_array_itself(database):
    with database.session() as session, pytest.raises(ValueError, match=r"\$array"):
        ResultRepository(session, DEFAULT_WORKSPACE).create(kind="x", body={"a": {"$array": 0}})


def test_results_and_jobs_belong_to_their_workspace(database):
    with database.session() as session:
        result = ResultRepository(session, DEFAULT_WORKSPACE).create(kind="x", body={})
        job = JobRepository(session, DEFAULT_WORKSPACE).create(kind="x", body={})
        results, jobs = ResultRepository(session, "ws_other"), JobRepository(session, "ws_other")
        for ask in (
            lambda: results.get(result.id),
            lambda: results.delete(result.id),
            lambda: jobs.get(job.id),
            lambda: jobs.events(job.id),
            lambda: jobs.cancel(job.id),
        ):
            with pytest.raises(NotFoundError):
                ask()
        assert results.page().items == []
        assert jobs.page().items == []


def test_jobs_are_listed_by_kind_and_status(database):
    with database.session() as session:
        jobs = JobRepository(session, DEFAULT_WORKSPACE)
        kept = [jobs.create(kind=kind, body={}).id for kind in ("optimization", "identification", "optimization")]
        jobs.cancel(kept[0])
        assert [job.id for job in jobs.page(kind="optimization").items] == [kept[2], kept[0]]
        assert [job.id for job in jobs.page(kind="optimization", status="cancelled").items] == [kept[0]]


def test_a_key_opens_until_it_is_revoked(database):
    with database.session() as session:
        keys = ApiKeyRepository(session, DEFAULT_WORKSPACE)
        assert not keys.has_admin()
        key, token = keys.create(name="laptop", scopes=["admin", "run"])
        assert keys.has_admin()
        assert token.startswith(key.prefix)
        assert len(token) > 40
        assert token not in str(session.execute(select(*ApiKey.__table__.columns)).all())
    with database.session() as session:
        found = authenticate(session, token)
        assert (found.id, found.workspace_id, found.scopes) == (key.id, DEFAULT_WORKSPACE, ["admin", "run"])
        assert authenticate(session, token[:-1]) is None
        assert authenticate(session, "") is None
    with database.session() as session:
        keys = ApiKeyRepository(session, DEFAULT_WORKSPACE)
        revoked_at = keys.revoke(key.id).revoked_at
        assert keys.revoke(key.id).revoked_at == revoked_at
        assert authenticate(session, token) is None
        assert not keys.has_admin()
        assert [row.id for row in keys.page().items] == [key.id]
        with pytest.raises(NotFoundError):
            ApiKeyRepository(session, "ws_other").revoke(key.id)


def test_the_last_use_of_a_key_is_written_once_a_minute(database):
    with database.session() as session:
        key, token = ApiKeyRepository(session, DEFAULT_WORKSPACE).create(name="k", scopes=[])

        def used() -> datetime:
            assert authenticate(session, token).id == key.id
            note_uses(session, {key.id, "key_of_nobody"})
            session.refresh(key)
            return key.last_used_at

        first = used()
        assert datetime.now(UTC) - first < timedelta(seconds=30)
        assert used() == first
        key.last_used_at = first - timedelta(minutes=2)
        session.flush()
        assert used() >= first


def test_a_bootstrap_key_is_made_once(database):
    with database.session() as session:
        keys = ApiKeyRepository(session, DEFAULT_WORKSPACE)
        first, token = keys.create(name="bootstrap", scopes=["admin"], token="chosen by the operator")
        second, _token = keys.create(name="bootstrap", scopes=["admin"], token="chosen by the operator")
        assert token == "chosen by the operator"
        assert first.id == second.id
