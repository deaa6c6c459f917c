"""What every use case works with: the open database, the limits, the door to the workers, and who is calling."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime

from api.runtime.child_process import Beside
from api.services.access.openid import Provider
from api.services.access.principal_cache import Callers, Count
from api.services.jobs.computing import Computing
from api.settings import Settings
from api.telemetry.tracing import Traces
from storage import key_file
from storage.jobs.queue import JobQueue
from storage.models import DEFAULT_WORKSPACE
from storage.session import Database
from storage.vault import Vault


@dataclass(frozen=True, slots=True, kw_only=True)
class Caller:
    """Who makes a request: a key or a browser that has signed in, what it may do, and in which workspace.

    ``expires_at`` is the end of a browser's sign-in, None for a key.
    """

    principal: str
    workspace: str
    scopes: frozenset[str]
    name: str = ""
    expires_at: datetime | None = None

    def may(self, *scopes: str) -> bool:
        """Return whether the key has one of the scopes; admin has them all."""
        return "admin" in self.scopes or not self.scopes.isdisjoint(scopes)

    @property
    def is_operator(self) -> bool:
        """Whether the caller runs the installation: an admin of its first workspace."""
        return "admin" in self.scopes and self.workspace == DEFAULT_WORKSPACE


def vault_of(settings: Settings) -> Vault:
    """Return the vault of the keys of the settings, or of the file beside the database; raises `VaultError` for a wrong key."""
    return Vault(settings.secret_keys or key_file.read(settings.database_url), plain=settings.plain_secrets)


@dataclass(frozen=True, slots=True, kw_only=True)
class Installation:
    """One running service."""

    settings: Settings
    database: Database
    queue: JobQueue
    computing: Computing
    openid: Provider | None = None
    beside: Beside | None = None
    vault: Vault = field(default_factory=Vault)
    traces: Traces = field(default_factory=Traces)
    revocations: Count | None = None
    callers: Callers = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "callers", Callers(self.database, revocations=self.revocations))
