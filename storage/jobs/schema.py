"""The job engine's own tables, in the same database as ours."""

from __future__ import annotations

from dbos import DBOS, DBOSClient
from dbos._error import DBOSInitializationError
from sqlalchemy import Engine


def upgrade(url: str) -> None:
    """Create or update the job engine's tables."""
    DBOS.migrate(url)


def is_current(engine: Engine) -> bool:
    """Return whether the job engine's tables are as this version of it needs them."""
    client = DBOSClient(system_database_engine=engine, lazy=True, retry_connection_errors=False)
    try:
        client._sys_db.verify_migrations()  # noqa: SLF001 - there is no public question; held by a test
    except DBOSInitializationError:
        return False
    finally:
        client.destroy()
    return True
