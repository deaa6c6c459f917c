"""Workers: who is alive, under which name."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta

from sqlalchemy import delete, select, update
from sqlalchemy.orm import Session

from storage.insertion import insert_if_absent
from storage.models import Worker
from storage.models.base import utc_now

#: A worker writes its heartbeat this often (s) ...
HEARTBEAT_INTERVAL = 2.0
#: ... and counts as dead when it has not for this long.
STALE_AFTER = timedelta(seconds=10)
#: A dead worker's row is kept this long.
FORGOTTEN_AFTER = timedelta(days=1)


class WorkerRepository:
    """The workers of the installation; they serve every workspace."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def get(self, identifier: str) -> Worker | None:
        """Return a worker by its name."""
        return self._session.get(Worker, identifier, populate_existing=True)

    def claim(self, identifier: str, *, token: str, replaces: str | None, host: str, pid: int, slots: int) -> bool:
        """Take a worker's name: a new one, or that of a dead worker whose token is ``replaces``."""
        now = utc_now()
        values = {"token": token, "host": host, "pid": pid, "slots": slots, "started_at": now, "seen_at": now}
        if replaces is None:
            return insert_if_absent(self._session, Worker, id=identifier, **values)
        return self._update(identifier, replaces, **values)

    def beat(self, identifier: str, token: str) -> bool:
        """Write a heartbeat; False when somebody else has taken the name."""
        return self._update(identifier, token, seen_at=utc_now())

    def retire(self, identifier: str, token: str) -> None:
        """Say that the worker stops, so that its jobs are free at once."""
        self._update(identifier, token, seen_at=utc_now() - STALE_AFTER)

    def alive(self) -> Sequence[Worker]:
        """Return the workers with a fresh heartbeat."""
        return self._session.scalars(select(Worker).where(Worker.seen_at >= utc_now() - STALE_AFTER)).all()

    def last_seen(self) -> datetime | None:
        """Return the latest heartbeat of any worker, None when none has ever been here."""
        return self._session.scalar(select(Worker.seen_at).order_by(Worker.seen_at.desc()).limit(1))

    def dead(self) -> Sequence[str]:
        """Return the names of workers that have stopped or gone silent."""
        return self._session.scalars(select(Worker.id).where(Worker.seen_at < utc_now() - STALE_AFTER)).all()

    def forget(self) -> None:
        """Delete what is left of workers that have been dead for a day; one that comes back then must stop."""
        self._session.execute(delete(Worker).where(Worker.seen_at < utc_now() - FORGOTTEN_AFTER))

    def _update(self, identifier: str, holder: str, **values: object) -> bool:
        updated = self._session.execute(
            update(Worker)
            .where(Worker.id == identifier, Worker.token == holder)
            .values(**values)
            .returning(Worker.id)
            .execution_options(synchronize_session=False)
        )
        return updated.one_or_none() is not None
