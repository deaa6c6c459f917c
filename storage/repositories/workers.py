"""Workers: who is alive, under which name."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import NamedTuple

from sqlalchemy import delete, select, update
from sqlalchemy.orm import Session

from storage.clock import moment, shared_now
from storage.insertion import insert_if_absent
from storage.models import Worker

#: A worker writes its heartbeat this often (s) ...
HEARTBEAT_INTERVAL = 1.0
#: ... and counts as dead when it has not for this many of them, unless somebody sees earlier that its process is gone.
PATIENCE = 8
#: A heartbeat of this age, by the clock of the database, says that nobody is there.
STALE_AFTER = timedelta(seconds=10)
#: The heartbeat of a worker that has stopped in good order: it is dead at once.
RETIRED = datetime(1970, 1, 1, tzinfo=UTC)


class Heartbeat(NamedTuple):
    """What tells whether a worker lives: see `storage.models.Worker`."""

    id: str
    token: str
    seen_at: datetime
    process: str | None


class WorkerRepository:
    """The workers of the installation; they serve every workspace."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def get(self, identifier: str) -> Worker | None:
        """Return a worker by its name."""
        return self._session.get(Worker, identifier, populate_existing=True)

    def claim(
        self,
        identifier: str,
        *,
        token: str,
        replaces: str | None,
        host: str,
        pid: int,
        slots: int,
        process: str | None = None,
    ) -> bool:
        """Take a worker's name: a new one, or that of a dead worker whose token is ``replaces``."""
        now = shared_now(self._session)
        values = {
            "token": token,
            "host": host,
            "pid": pid,
            "process": process,
            "slots": slots,
            "warm_up": None,
            "started_at": now,
            "seen_at": now,
        }
        if replaces is None:
            return insert_if_absent(self._session, Worker, id=identifier, **values)
        return self._update(identifier, replaces, **values)

    def beat(self, identifier: str, token: str) -> bool:
        """Write a heartbeat; False when somebody else has taken the name."""
        return self._update(identifier, token, seen_at=moment(self._session))

    def warmed_up(self, identifier: str, token: str, seconds: float) -> None:
        """Write down how long (s) a worker took to load what computes."""
        self._update(identifier, token, warm_up=seconds)

    def retire(self, identifier: str, token: str) -> None:
        """Say that the worker stops, so that its jobs are free at once."""
        self._update(identifier, token, seen_at=RETIRED)

    def alive(self) -> Sequence[Worker]:
        """Return the workers with a fresh heartbeat."""
        return self._session.scalars(
            select(Worker).where(Worker.seen_at >= shared_now(self._session) - STALE_AFTER)
        ).all()

    def last_seen(self) -> datetime | None:
        """Return the latest heartbeat of any worker, None when none has ever been here."""
        return self._session.scalar(select(Worker.seen_at).order_by(Worker.seen_at.desc()).limit(1))

    def seen_of(self, host: str, pid: int) -> datetime | None:
        """Return the heartbeat of the worker in this process of this host, None while it is none (yet)."""
        return self._session.scalar(select(Worker.seen_at).where(Worker.host == host[:50], Worker.pid == pid))

    def all(self) -> Sequence[Worker]:
        """Return every worker that is known, dead ones among them."""
        return self._session.scalars(select(Worker).order_by(Worker.id)).all()

    def heartbeats(self) -> list[Heartbeat]:
        """Return the heartbeat of every worker that is known, dead ones among them."""
        rows = self._session.execute(select(Worker.id, Worker.token, Worker.seen_at, Worker.process))
        return [Heartbeat(*row) for row in rows]

    def bury(self, identifier: str, *, token: str, seen_at: datetime) -> None:
        """Delete a dead worker, unless it has shown itself since; one that comes back later takes another name."""
        self._session.execute(
            delete(Worker).where(Worker.id == identifier, Worker.token == token, Worker.seen_at == seen_at)
        )

    def _update(self, identifier: str, holder: str, **values: object) -> bool:
        updated = self._session.execute(
            update(Worker)
            .where(Worker.id == identifier, Worker.token == holder)
            .values(**values)
            .returning(Worker.id)
            .execution_options(synchronize_session=False)
        )
        return updated.one_or_none() is not None
