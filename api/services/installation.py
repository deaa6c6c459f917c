"""What every use case works with: the open database, the limits, the door to the workers, and who is calling."""

from __future__ import annotations

from dataclasses import dataclass

from api.services.computing import Computing
from api.settings import Settings
from storage.jobs.queue import JobQueue
from storage.session import Database


@dataclass(frozen=True, slots=True, kw_only=True)
class Caller:
    """The key behind a request: what it may do, and in which workspace."""

    key: str
    workspace: str
    scopes: frozenset[str]

    def may(self, *scopes: str) -> bool:
        """Return whether the key has one of the scopes; admin has them all."""
        return "admin" in self.scopes or not self.scopes.isdisjoint(scopes)


@dataclass(frozen=True, slots=True, kw_only=True)
class Installation:
    """One running service."""

    settings: Settings
    database: Database
    queue: JobQueue
    computing: Computing
    expects_worker: bool = False
