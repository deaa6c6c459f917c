"""`servotune backup`, `restore`, `check` and `move`: everything arrives, counted and verified, or nothing does."""

from __future__ import annotations

import itertools
import os
import sqlite3
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import delete, select, update

from api.commands import maintenance
from storage import Database, open_database
from storage.checking import check
from storage.copying import content, copy, snapshot
from storage.errors import CopyError
from storage.jobs.queue import JobQueue
from storage.jobs.worker import Worker as JobWorker
from storage.models import DEFAULT_WORKSPACE, Base, Blob, BlobChunk, Job, JobStatus, ResultArray, Worker
from storage.models.base import utc_now
from storage.repositories import (
    AlertRepository,
    ApiKeyRepository,
    DatasetRepository,
    JobRepository,
    ResultRepository,
    ScheduleRepository,
    SystemRepository,
    WebhookRepository,
    authenticate,
    jobs,
)
from storage.repositories.systems import StoredSystem
from tests.integration.api.documents import LAG, lag_recording, sha256
from tests.support import postgres
from tests.support.desk import Desk
from tests.support.patience import PATIENCE

DATA = lag_recording(samples=700)
_numbers = itertools.count()


def fill(database: Database) -> dict[str, str]:
    """Write something into most tables; return the ids that a test looks for."""
    queue = JobQueue(database)
    with database.session() as session:
        ApiKeyRepository(session, DEFAULT_WORKSPACE).create(name="k", scopes=["read"], token="st_a_key_that_is_moved")
        system: StoredSystem = SystemRepository(session, DEFAULT_WORKSPACE).create(
            name="Äquivalente Trägheit ≥ 0", document=LAG
        )
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        channels = [{"name": name, "unit": "V", "scale": 1, "offset": 0} for name in ("u", "y")]
        dataset = datasets.create(name="d", format="raw", channels=channels, sample_rate=1000.0)
        datasets.put_segment(dataset.id, sha256(DATA), DATA)
        datasets.commit(dataset.id, segments=[sha256(DATA)], sha256=sha256(DATA))
        datasets.ingest_raw(dataset.id)
        result = ResultRepository(session, DEFAULT_WORKSPACE).create(
            kind="simulation",
            body={"y": np.linspace(0.0, 1.0, 5000), "tiny": 5e-324, "third": 1 / 3},
            system_id=system.id,
            system_revision=1,
        )
        WebhookRepository(session, DEFAULT_WORKSPACE).create(
            name="w", url="https://example.com/", events=["job.failed"], active=True, secret="whsec_"
        )
        AlertRepository(session, DEFAULT_WORKSPACE).raise_once(
            kind="validation", source="job_0", detail="d", data={"z": 1, "a": [None, True]}
        )
        ScheduleRepository(session, DEFAULT_WORKSPACE).create(
            name="s", cron="* * * * *", time_zone="UTC", kind="optimization", body={}, overlap="skip", missed="one",
            paused=False, next_at=utc_now(),
        )  # fmt: skip
        waiting = queue.enqueue(session, kind="echo", body={"say": "waiting"}, workspace_id=DEFAULT_WORKSPACE)
        running = queue.enqueue(session, kind="echo", body={"say": "running"}, workspace_id=DEFAULT_WORKSPACE)
        ended = queue.enqueue(session, kind="echo", body={"say": "ended"}, workspace_id=DEFAULT_WORKSPACE)
    with database.session() as session:
        jobs.begin(session, running.id, worker="gone-0", ticket=running.ticket)
        jobs.begin(session, ended.id, worker="gone-0", ticket=ended.ticket)
        jobs.finish(session, ended.id, status=JobStatus.FAILED, attempt=1)
    queue.close()
    return {"waiting": waiting.id, "running": running.id, "dataset": dataset.id, "result": result.id}


@pytest.fixture
def filled(fresh_database) -> tuple[Database, dict[str, str]]:
    return fresh_database, fill(fresh_database)


@pytest.fixture(params=["sqlite", "postgres"])
def other_url(request, tmp_path):
    """The URL of another database, without tables."""
    if request.param == "sqlite":
        yield f"sqlite:///{tmp_path / 'other.db'}"
        return
    url, name = request.getfixturevalue("postgres_url"), f"other_{next(_numbers)}"
    yield postgres.create_database(url, name)
    postgres.drop_database(url, name)


def run(command, *arguments, url: str, monkeypatch) -> int:
    monkeypatch.setenv("SERVOTUNE_DATABASE_URL", url)
    return int(command([str(argument) for argument in arguments]))


def refused(command, *arguments, url: str, monkeypatch) -> str:
    with pytest.raises(SystemExit) as caught:
        run(command, *arguments, url=url, monkeypatch=monkeypatch)
    assert isinstance(caught.value.code, str)
    return caught.value.code


def require_all(url: str, ids: dict[str, str]) -> None:
    """What is asked of a copy as its user would."""
    database = open_database(url)
    assert database.is_current()
    with database.session() as session:
        samples = DatasetRepository(session, DEFAULT_WORKSPACE).read_channel(ids["dataset"], "u")
        np.testing.assert_array_equal(samples, np.frombuffer(DATA, "<f8").reshape(-1, 2)[:, 0])
        results = ResultRepository(session, DEFAULT_WORKSPACE)
        body = results.body(results.get(ids["result"]))
        np.testing.assert_array_equal(body["y"], np.linspace(0.0, 1.0, 5000))
        assert (body["tiny"], body["third"]) == (5e-324, 1 / 3)
        assert authenticate(session, "st_a_key_that_is_moved") is not None
        states = [JobRepository(session, DEFAULT_WORKSPACE).get(ids[name]).status for name in ("waiting", "running")]
        assert states == ["queued", "queued"]
    database.dispose()


def test_a_backup_brings_everything_back_into_either_kind_of_database(
    filled, other_url, tmp_path, monkeypatch, capsys
) -> None:
    database, ids = filled
    file = tmp_path / "night.backup"
    assert run(maintenance.backup, file, url=database.url, monkeypatch=monkeypatch) == 0
    assert "read back and verified" in capsys.readouterr().out
    assert file.stat().st_mode & 0o777 == 0o600
    assert [path.name for path in tmp_path.iterdir() if "partial" in path.name] == []
    assert run(maintenance.check, file, url="sqlite:///nothing.db", monkeypatch=monkeypatch) == 0
    assert run(maintenance.restore, file, url=other_url, monkeypatch=monkeypatch) == 0
    assert "2 unfinished jobs queued" in capsys.readouterr().out
    other = open_database(other_url)
    with snapshot(database.engine) as old, snapshot(other.engine) as new:
        before, after = content(old), content(new)
    other.dispose()
    assert set(before) == set(Base.metadata.tables) - {"elected", "worker"}
    differing = {name for name in before if before[name] != after[name]}
    assert differing == {"job"}  # the one that ran waits again
    assert sum(part.rows > 0 for part in before.values()) >= 14
    require_all(other_url, ids)


def test_a_move_is_counted_and_the_unfinished_jobs_are_computed_there(filled, other_url, monkeypatch, capsys) -> None:
    database, ids = filled
    assert run(maintenance.move, other_url, url=database.url, monkeypatch=monkeypatch) == 0
    said = capsys.readouterr().out
    assert "rows moved and verified; 2 unfinished jobs queued" in said
    require_all(other_url, ids)
    if not other_url.startswith("sqlite") or database.engine.dialect.name != "sqlite":
        return  # once is enough
    stop = threading.Event()
    worker = JobWorker(other_url, compute="tests.support.computing:run", slots=1)
    thread = threading.Thread(target=worker.run, args=(stop,))
    thread.start()
    desk = Desk(open_database(other_url))
    try:
        ended = {desk.wait(ids[name]).status for name in ("waiting", "running")}
    finally:
        stop.set()
        thread.join(timeout=PATIENCE)
        desk.database.dispose()
    assert ended <= {"succeeded", "failed"}


def test_a_backup_is_one_moment_of_a_database_in_use(fresh_database, tmp_path, monkeypatch) -> None:
    """Every job has as many events as it says, however many were written meanwhile."""
    fill(fresh_database)
    stop = threading.Event()

    def work() -> None:
        queue = JobQueue(fresh_database)
        while not stop.is_set():
            with fresh_database.session() as session:
                job = queue.enqueue(session, kind="echo", body={}, workspace_id=DEFAULT_WORKSPACE)
            with fresh_database.session() as session:
                jobs.begin(session, job.id, worker="w", ticket=job.ticket)
        queue.close()

    thread = threading.Thread(target=work)
    thread.start()
    try:
        time.sleep(0.2)
        assert run(maintenance.backup, tmp_path / "b", url=fresh_database.url, monkeypatch=monkeypatch) == 0
    finally:
        stop.set()
        thread.join(timeout=PATIENCE)
    with sqlite3.connect(tmp_path / "b") as connection:
        rows = connection.execute(
            "SELECT last_event, (SELECT count(*) FROM job_event WHERE job_id = job.id) FROM job"
        ).fetchall()
    assert len(rows) > 3
    assert all(last == count for last, count in rows)


def test_an_old_backup_is_brought_up_to_date(tmp_path, monkeypatch) -> None:
    """Made of the database that an early version left, as that version's backup would have been."""
    from storage.backup import _seal

    old = tmp_path / "old.backup"
    dump = Path(__file__).parents[1] / "storage" / "databases" / "0003.sql"
    with sqlite3.connect(old) as connection:
        connection.executescript(dump.read_text(encoding="utf-8"))
    _seal(old, version="0.1.0")
    url = f"sqlite:///{tmp_path / 'new.db'}"
    assert run(maintenance.restore, old, url=url, monkeypatch=monkeypatch) == 0
    database = open_database(url)
    with database.session() as session:
        assert authenticate(session, "st_the_key_of_an_old_installation") is not None
        assert session.scalars(select(Job.status).order_by(Job.status)).all() == ["queued", "succeeded"]
    database.dispose()


@pytest.fixture
def whole(sqlite_template, tmp_path, monkeypatch) -> tuple[Path, str]:
    """A backup and the URL of the database that it is of."""
    path = tmp_path / "source.db"
    path.write_bytes(sqlite_template.read_bytes())
    database = open_database(f"sqlite:///{path}")
    fill(database)
    database.dispose()
    assert run(maintenance.backup, tmp_path / "whole", url=database.url, monkeypatch=monkeypatch) == 0
    return tmp_path / "whole", database.url


def _flip(file: Path) -> None:
    """Change one byte in the middle of the largest piece of a recording."""
    with sqlite3.connect(file) as connection:
        ((data,),) = connection.execute("SELECT data FROM blob_chunk ORDER BY length(data) DESC LIMIT 1").fetchall()
    content_of_file = bytearray(file.read_bytes())
    content_of_file[content_of_file.index(data[:64])] ^= 1
    file.write_bytes(content_of_file)


def _cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def _lose_a_row(file: Path) -> None:
    with sqlite3.connect(file) as connection:
        connection.execute("DELETE FROM audit_entry WHERE rowid = (SELECT min(rowid) FROM audit_entry)")


def _lose_a_table(file: Path) -> None:
    with sqlite3.connect(file) as connection:
        connection.execute("DROP TABLE ticket")


def _scribble(file: Path) -> None:
    file.write_bytes(b"no database at all" * 100)


def _say_later_version(file: Path) -> None:
    with sqlite3.connect(file) as connection:
        connection.execute("UPDATE servotune_backup SET value = '\"9999\"' WHERE key = 'revision'")


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (_flip, "table blob_chunk must hold what was written"),
        (_cut, "the backup must be"),
        (_lose_a_row, "table audit_entry must hold what was written"),
        (_lose_a_table, "table ticket must hold what was written"),
        (_scribble, "must be one that `servotune backup` wrote"),
        (_say_later_version, "of this or an earlier version"),
    ],
)
def test_a_damaged_backup_is_refused_and_nothing_is_restored(whole, tmp_path, monkeypatch, damage, says) -> None:
    file, _url = whole
    damage(file)
    url = f"sqlite:///{tmp_path / 'target.db'}"
    assert says in refused(maintenance.restore, file, url=url, monkeypatch=monkeypatch)
    assert list(tmp_path.glob("target.db*")) == []


def test_nothing_is_overwritten(whole, tmp_path, monkeypatch) -> None:
    file, url = whole
    before = file.read_bytes()
    assert "must be empty, got" in refused(maintenance.restore, file, url=url, monkeypatch=monkeypatch)
    assert "must be a new file" in refused(maintenance.backup, file, url=url, monkeypatch=monkeypatch)
    assert "must be another one" in refused(maintenance.move, url, url=url, monkeypatch=monkeypatch)
    assert file.read_bytes() == before
    other = f"sqlite:///{tmp_path / 'other.db'}"
    assert run(maintenance.move, other, url=url, monkeypatch=monkeypatch) == 0
    assert "must be empty, got" in refused(maintenance.move, other, url=url, monkeypatch=monkeypatch)


@pytest.mark.parametrize(
    ("order", "url", "says"),
    [
        (["backup", "b"], "sqlite:///{tmp}/none.db", "the database must exist, got"),
        (["backup", "none/b"], "{source}", "directory that exists"),
        (["backup", "b"], "postgresql+psycopg://nobody@127.0.0.1:1/none", "the database must be reachable"),
        (["backup", "b"], "oracle://x", "must be sqlite or postgresql"),
        (["backup", "b"], "no url", "must be sqlite:///"),
        (["restore", "none"], "sqlite:///{tmp}/t.db", "the backup must be a file"),
        (["check", "none"], "sqlite:///{tmp}/t.db", "the backup must be a file"),
        (["check"], "sqlite:///{tmp}/none.db", "the database must exist"),
        (["move", "oracle://x"], "{source}", "must be sqlite or postgresql"),
        (["move", "postgresql+psycopg://nobody:secret@127.0.0.1:1/none"], "{source}", "the database must be reachable"),
    ],
)
def test_wrong_orders_end_with_a_sentence(whole, tmp_path, monkeypatch, *, order, url, says) -> None:
    monkeypatch.chdir(tmp_path)
    url = url.format(tmp=tmp_path, source=whole[1])
    command, *arguments = order
    said = refused(getattr(maintenance, command), *arguments, url=url, monkeypatch=monkeypatch)
    assert says in said
    assert "secret" not in said
    assert not (tmp_path / "none.db").exists()


def test_a_move_waits_for_the_workers_to_stop(whole, tmp_path, monkeypatch) -> None:
    _file, url = whole
    database = open_database(url)
    with database.session() as session:
        values = {"id": "w-0", "token": "t", "host": "h", "pid": 1, "slots": 1}
        session.add(Worker(**values, started_at=utc_now(), seen_at=utc_now()))
    database.dispose()
    other = f"sqlite:///{tmp_path / 'other.db'}"
    assert "a worker was seen" in refused(maintenance.move, other, url=url, monkeypatch=monkeypatch)


def test_an_unmigrated_database_is_not_backed_up(tmp_path, monkeypatch, capsys) -> None:
    path = tmp_path / "old.db"
    dump = Path(__file__).parents[1] / "storage" / "databases" / "0003.sql"
    with sqlite3.connect(path) as connection:
        connection.executescript(dump.read_text(encoding="utf-8"))
    url = f"sqlite:///{path}"
    assert "as this version needs it" in refused(maintenance.backup, tmp_path / "b", url=url, monkeypatch=monkeypatch)
    assert run(maintenance.check, url=url, monkeypatch=monkeypatch) == 1
    assert "`servotune serve` migrates it" in capsys.readouterr().err


def test_a_check_finds_what_is_wrong_with_blobs(filled, monkeypatch, capsys) -> None:
    database, ids = filled
    assert run(maintenance.check, url=database.url, monkeypatch=monkeypatch) == 0
    assert "the database is sound" in capsys.readouterr().out
    with database.session() as session:
        array = session.scalars(select(ResultArray.sha256).where(ResultArray.result_id == ids["result"])).one()
        session.execute(update(BlobChunk).where(BlobChunk.sha256 == array).values(encoding="raw"))
        other, third = session.scalars(select(Blob.sha256).where(Blob.sha256 != array).limit(2)).all()
        session.execute(delete(BlobChunk).where(BlobChunk.sha256 == other))
        session.execute(update(BlobChunk).where(BlobChunk.sha256 == third).values(encoding="zlib/1", data=b"no zlib"))
    assert run(maintenance.check, url=database.url, monkeypatch=monkeypatch) == 1
    said = capsys.readouterr().err
    assert f"blob {array} must have" in said
    assert f"blob {other} must have" in said
    assert f"blob {third} cannot be unpacked" in said


def test_a_check_finds_references_that_lead_nowhere(sqlite_template, tmp_path) -> None:
    path = tmp_path / "loose.db"
    path.write_bytes(sqlite_template.read_bytes())
    with sqlite3.connect(path) as connection:
        connection.execute("INSERT INTO blob_chunk (sha256, number, encoding, data) VALUES ('x', 0, 'raw', x'00')")
    database = open_database(f"sqlite:///{path}")
    findings = check(database.engine)
    database.dispose()
    assert findings.faults == ("row 1 of table blob_chunk refers to a row of blob that is not there",)


def test_a_copy_that_does_not_arrive_whole_is_taken_back(sqlite_template, tmp_path) -> None:
    """A trigger of the target changes one row on its way."""
    opened = []
    for name in ("one", "two"):
        (tmp_path / name).write_bytes(sqlite_template.read_bytes())
        opened.append(open_database(f"sqlite:///{tmp_path / name}"))
    source, target = opened
    fill(source)
    with sqlite3.connect(tmp_path / "two") as connection:
        connection.execute(
            "CREATE TRIGGER t AFTER INSERT ON dataset BEGIN UPDATE dataset SET name = 'x' WHERE id = new.id; END"
        )
    with (
        pytest.raises(CopyError, match="table dataset must arrive as it was sent: 1 rows"),
        snapshot(source.engine) as old,
        target.engine.begin() as new,
    ):
        copy(old, new)
    with target.session() as session:
        assert session.scalars(select(Job)).all() == []
    for database in opened:
        database.dispose()


def test_the_commands_are_there(tmp_path) -> None:
    command = [sys.executable, "-m", "servotune", "backup", str(tmp_path / "b")]
    environment = os.environ | {"SERVOTUNE_DATABASE_URL": f"sqlite:///{tmp_path / 'none.db'}"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 1
    assert "the database must exist" in done.stderr
    assert "Traceback" not in done.stderr


def test_migrate_makes_the_tables_once(empty_database_url: str, monkeypatch, capsys) -> None:
    monkeypatch.setenv("SERVOTUNE_DATABASE_URL", empty_database_url)
    assert maintenance.migrate([]) == 0
    assert "have been brought up to date" in capsys.readouterr().out
    database = open_database(empty_database_url)
    assert database.is_current()
    database.dispose()
    assert maintenance.migrate([]) == 0
    assert "the tables are up to date" in capsys.readouterr().out
