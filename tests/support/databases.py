"""Fixtures: every test that asks for a database runs on SQLite and on Postgres."""

from __future__ import annotations

import itertools
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import delete

from storage import Database, open_database
from storage.models import DEFAULT_WORKSPACE, Base, Workspace
from tests.support import postgres

_numbers = itertools.count()


@pytest.fixture(scope="session")
def postgres_url() -> Iterator[str]:
    """The URL of a running Postgres, with ``{name}`` for the name of a database."""
    with postgres.server() as url:
        yield url


@pytest.fixture(scope="session")
def sqlite_template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A migrated SQLite database to copy."""
    path = tmp_path_factory.mktemp("template") / "template.db"
    _migrate(f"sqlite:///{path}")
    return path


@pytest.fixture(scope="session")
def postgres_template(postgres_url: str) -> str:
    """The name of a migrated Postgres database to copy."""
    _migrate(postgres.create_database(postgres_url, "migrated"))
    return "migrated"


@pytest.fixture(params=["sqlite", "postgres"])
def empty_database_url(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """The URL of a database without tables."""
    if request.param == "sqlite":
        yield f"sqlite:///{tmp_path / 'test.db'}"
        return
    url = request.getfixturevalue("postgres_url")
    name = f"test_{next(_numbers)}"
    yield postgres.create_database(url, name)
    postgres.drop_database(url, name)


@pytest.fixture(params=["sqlite", "postgres"])
def database_url(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """The URL of a fresh migrated database."""
    yield from _fresh(request, tmp_path)


@pytest.fixture(scope="module", params=["sqlite", "postgres"])
def module_database_url(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The URL of a migrated database that the tests of one module share."""
    yield from _fresh(request, tmp_path_factory.mktemp("shared"))


@pytest.fixture(scope="session", params=["sqlite", "postgres"])
def shared_database(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Database]:
    """A migrated database that all tests of the session share."""
    for url in _fresh(request, tmp_path_factory.mktemp("session")):
        opened = open_database(url)
        yield opened
        opened.dispose()


@pytest.fixture
def database(shared_database: Database) -> Iterator[Database]:
    """A migrated database without rows but the default workspace."""
    yield shared_database
    with shared_database.session() as session:
        for table in reversed(Base.metadata.sorted_tables):
            session.execute(delete(table))
        session.add(Workspace(id=DEFAULT_WORKSPACE, name="default"))


@pytest.fixture
def fresh_database(database_url: str) -> Iterator[Database]:
    """A database that is this test's alone, open."""
    opened = open_database(database_url)
    yield opened
    opened.dispose()


def _fresh(request: pytest.FixtureRequest, directory: Path) -> Iterator[str]:
    if request.param == "sqlite":
        path = directory / "test.db"
        shutil.copyfile(request.getfixturevalue("sqlite_template"), path)
        yield f"sqlite:///{path}"
        return
    url = request.getfixturevalue("postgres_url")
    name = f"test_{next(_numbers)}"
    yield postgres.create_database(url, name, template=request.getfixturevalue("postgres_template"))
    postgres.drop_database(url, name)


def _migrate(url: str) -> None:
    database = open_database(url)
    database.migrate()
    database.dispose()
