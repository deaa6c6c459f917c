"""Whatever byte of a database or of a backup is wrong, a sentence says so, and nothing is left where nothing was before."""

from __future__ import annotations

import random
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest
from sqlalchemy import inspect

from api.commands import maintenance
from storage import open_database
from tests.integration.api.test_maintenance import fill

#: Bytes that are changed, one at a time.
FLIPS = 40


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def source(sqlite_template: Path, monkeypatch: pytest.MonkeyPatch) -> bytes:
    """A filled database, in a file without free pages."""
    Path("source.db").write_bytes(sqlite_template.read_bytes())
    database = open_database("sqlite:///source.db")
    fill(database)
    database.dispose()
    with sqlite3.connect("source.db") as connection:
        connection.execute("VACUUM")
    connection.close()
    use("source.db", monkeypatch)
    return Path("source.db").read_bytes()


@pytest.fixture
def whole(source: bytes) -> bytes:
    assert source
    assert maintenance.backup(["whole"]) == 0
    return Path("whole").read_bytes()


def use(file: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SERVOTUNE_DATABASE_URL", f"sqlite:///{file}")


def said(order: Callable[[list[str]], int], *arguments: str, capsys: pytest.CaptureFixture[str]) -> str:
    """Return what a command says that is wrong; nothing where all is well."""
    capsys.readouterr()
    try:
        code = order(list(arguments))
    except SystemExit as error:
        return str(error.code)
    found = capsys.readouterr().err
    assert bool(found) == bool(code)
    return found


def flipped(content: bytes, seed: int) -> list[bytes]:
    """Copies of a file with one bit changed, each somewhere else where there is something."""
    draw = random.Random(seed)
    used = [place for place, byte in enumerate(content) if byte]
    copies = []
    for _ in range(FLIPS):
        copy = bytearray(content)
        copy[draw.choice(used)] ^= 1 << draw.randrange(8)
        copies.append(bytes(copy))
    return copies


def test_a_backup_with_a_wrong_byte_is_refused_with_a_sentence(whole, here, monkeypatch, capsys) -> None:
    use("target.db", monkeypatch)
    refused = 0
    for content in flipped(whole, seed=7):
        Path("copy").write_bytes(content)
        found = said(maintenance.check, "copy", capsys=capsys)
        assert list(here.glob("servotune-*")) == []
        why = said(maintenance.restore, "copy", capsys=capsys)
        assert bool(why) == bool(found)
        assert "reachable" not in found + why
        if why:
            refused += 1
            assert list(here.glob("target.db*")) == []
        for left in here.glob("target.db*"):
            left.unlink()
    assert refused > FLIPS / 2


def test_a_database_with_a_wrong_byte_is_described(source, here, monkeypatch, capsys) -> None:
    use("copy.db", monkeypatch)
    for content in flipped(source, seed=8):
        for order, arguments in (
            (maintenance.check, []),
            (maintenance.backup, ["made"]),
            (maintenance.move, ["sqlite:///other.db"]),
        ):
            Path("copy.db").write_bytes(content)
            why = said(order, *arguments, capsys=capsys)
            assert "reachable" not in why
            assert not why or list(here.glob("other.db*")) == []
            for left in [*here.glob("other.db*"), *here.glob("copy.db-*"), *here.glob("made")]:
                left.unlink()


def _page_of_an_index(file: str) -> None:
    """Make the root of an index a page of another kind."""
    with sqlite3.connect(file) as connection:
        (page,) = connection.execute("SELECT rootpage FROM sqlite_master WHERE name LIKE 'ix_job%'").fetchone()
        (size,) = connection.execute("PRAGMA page_size").fetchone()
    connection.close()
    content = bytearray(Path(file).read_bytes())
    content[(page - 1) * size] ^= 0xFF
    Path(file).write_bytes(content)


def _name_of_a_column(file: str) -> None:
    with sqlite3.connect(file) as connection:
        connection.execute("ALTER TABLE schedule RENAME COLUMN cron TO crom")
    connection.close()


def _version_of_the_format(file: str) -> None:
    """Say that only later versions of SQLite may write into the file."""
    content = bytearray(Path(file).read_bytes())
    content[18] = 3
    Path(file).write_bytes(content)


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (_page_of_an_index, "damaged"),
        (_name_of_a_column, "no such column: schedule.cron"),
        (_version_of_the_format, "SQLite cannot read copy: attempt to write a readonly database"),
    ],
)
def test_what_no_digest_holds_is_found(whole, empty_database_url: str, monkeypatch, capsys, *, damage, says) -> None:
    Path("copy").write_bytes(whole)
    damage("copy")
    assert says in said(maintenance.check, "copy", capsys=capsys)
    monkeypatch.setenv("SERVOTUNE_DATABASE_URL", empty_database_url)
    assert "the backup must be whole" in said(maintenance.restore, "copy", capsys=capsys)
    if not empty_database_url.startswith("sqlite"):
        database = open_database(empty_database_url)
        assert inspect(database.engine).get_table_names() == []
        database.dispose()
