"""The job engine's own tables, in the same database as ours."""

from __future__ import annotations

from dbos import DBOS, DBOSClient
from dbos._error import DBOSInitializationError
from sqlalchemy import Engine


def upgrade(engine: Engine, url: str) -> None:
    """Create or update the job engine's tables."""
    del engine
    DBOS.migrate(url)


def is_current(engine: Engine) -> bool:
    """Return whether the job engine's tables are as this version of it needs them."""
    client = DBOSClient(system_database_engine=engine, lazy=True, retry_connection_errors=False)
    try:
        # Private, for want of a public question; held by a test.
        client._sys_db.verify_migrations()
    except DBOSInitializationError:
        return False
    finally:
        client.destroy()
    return True
