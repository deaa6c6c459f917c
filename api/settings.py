"""Every setting of the service, in one table.

| environment variable | default | meaning |
|---|---|---|
| ``SERVOTUNE_DATABASE_URL`` | ``sqlite:///./servotune.db`` | SQLAlchemy URL of the one database |
| ``SERVOTUNE_BOOTSTRAP_KEY`` | (random, printed once) | the first admin key |
| ``SERVOTUNE_PUBLIC_URL`` | (that of the request) | address under which browsers reach the service |
| ``SERVOTUNE_SIGN_IN_HOURS`` | 12 | how long a browser stays signed in, h |
| ``SERVOTUNE_REQUESTS_PER_MINUTE`` | 30000 | requests of one key or browser, for each process; 0: no limit |
| ``SERVOTUNE_WRONG_KEYS_PER_MINUTE`` | 60 | wrong keys of one address, for each process; 0: no limit |
| ``SERVOTUNE_OIDC_ISSUER`` | (none) | OpenID provider through which people sign in |
| ``SERVOTUNE_OIDC_CLIENT_ID`` | (none) | name of this service at the provider |
| ``SERVOTUNE_OIDC_CLIENT_SECRET`` | (none) | its secret there, for a provider that wants one |
| ``SERVOTUNE_OIDC_CLAIM`` | ``groups`` | claim that names a person's groups |
| ``SERVOTUNE_OIDC_ROLES`` | ``{}`` | group -> workspace and scopes, as JSON; the first one counts |
| ``SERVOTUNE_BODY_LIMIT`` | 1048576 | largest JSON body, bytes |
| ``SERVOTUNE_BODY_SECONDS`` | 120 | longest time in which a body arrives, s |
| ``SERVOTUNE_SEGMENT_LIMIT`` | 8388608 | largest segment of a dataset, bytes |
| ``SERVOTUNE_MAX_SAMPLES`` | 100000 | samples of one curve |
| ``SERVOTUNE_MAX_VARIANTS`` | 1000 | variants of one request |
| ``SERVOTUNE_MAX_NUMBERS`` | 5000000 | samples x curves x variants of one reply |
| ``SERVOTUNE_COMPUTE_SLOTS`` | (CPU cores) | requests that compute at the same time |
| ``SERVOTUNE_WORKER_SLOTS`` | 1 | jobs that a worker computes at the same time |
| ``SERVOTUNE_REQUEST_SECONDS`` | 60 | longest computation inside a request, s |
| ``SERVOTUNE_JOB_MEMORY`` | 8589934592 | memory that one job may use, bytes; 0: no limit |
| ``SERVOTUNE_WORKER_STALE_SECONDS`` | 30 | age at which a worker's heartbeat counts as missing, s |
| ``SERVOTUNE_IDEMPOTENCY_HOURS`` | 24 | how long a stored reply is replayed, h |
| ``SERVOTUNE_WEBHOOK_NETWORKS`` | ``[]`` | private networks that webhooks may call, as JSON: ``["10.1.0.0/16"]`` |
| ``SERVOTUNE_SECRET_KEY`` | (none) | encrypts the secrets of webhooks in the database; several, separated by commas: the first encrypts |
| ``SERVOTUNE_AUDIT_DAYS`` | 400 | how long the audit log reaches back, days |
| ``SERVOTUNE_JOB_DAYS`` | 400 | how long a job that has ended is kept with its result, days |
| ``SERVOTUNE_LOG_LEVEL`` | ``info`` | level of the log on standard error |
| ``SERVOTUNE_LOG_FORMAT`` | ``text`` | lines for people, or ``json`` |
| ``SERVOTUNE_OTLP_ENDPOINT`` | (none) | who collects traces of requests and jobs, by OTLP over HTTP |
"""

from __future__ import annotations

import base64
import os
from ipaddress import IPv4Network, IPv6Network
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, SecretStr, ValidationInfo, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

_KEY_BYTES = 32


class Role(BaseModel):
    """What people of one group may do, and where."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    workspace: str = "ws_default"
    scopes: list[Literal["read", "write", "run", "acquire", "admin"]] = Field(min_length=1)


class Settings(BaseSettings):
    """The settings of one process, read from ``SERVOTUNE_*``; the module docstring is their table."""

    model_config = SettingsConfigDict(env_prefix="SERVOTUNE_", extra="ignore", frozen=True, hide_input_in_errors=True)

    database_url: str = Field(default="sqlite:///./servotune.db", repr=False)
    bootstrap_key: str | None = Field(default=None, min_length=16, max_length=200, repr=False)
    public_url: str | None = Field(default=None, pattern="^https?://[^/?#]+/?$")
    sign_in_hours: float = Field(default=12.0, gt=0, le=8760)
    requests_per_minute: int = Field(default=30_000, ge=0)
    wrong_keys_per_minute: int = Field(default=60, ge=0)
    oidc_issuer: str | None = Field(default=None, pattern="^https?://[^?#]+$")
    oidc_client_id: str | None = Field(default=None, min_length=1)
    oidc_client_secret: SecretStr | None = None
    oidc_claim: str = "groups"
    oidc_roles: dict[str, Role] = Field(default_factory=dict, validate_default=True)
    body_limit: int = Field(default=1 << 20, ge=1 << 10)
    body_seconds: float = Field(default=120.0, gt=0)
    segment_limit: int = Field(default=8 << 20, ge=1 << 10)
    max_samples: int = Field(default=100_000, ge=10)
    max_variants: int = Field(default=1000, ge=1)
    max_numbers: int = Field(default=5_000_000, ge=1000)
    compute_slots: int = Field(default_factory=lambda: os.cpu_count() or 1, ge=1)
    worker_slots: int = Field(default=1, ge=1)
    job_memory: int = Field(default=8 << 30, ge=0)
    request_seconds: float = Field(default=60.0, gt=0)
    worker_stale_seconds: float = Field(default=30.0, gt=0)
    idempotency_hours: float = Field(default=24.0, gt=0)
    webhook_networks: list[IPv4Network | IPv6Network] = Field(default_factory=list)
    secret_key: SecretStr | None = None
    audit_days: float = Field(default=400.0, gt=0)
    job_days: float = Field(default=400.0, gt=0)
    log_level: Literal["debug", "info", "warning", "error"] = "info"
    log_format: Literal["text", "json"] = "text"
    otlp_endpoint: str | None = Field(default=None, pattern="^https?://[^?#]+$")

    @field_validator("oidc_roles")
    @classmethod
    def _complete(cls, roles: dict[str, Role], given: ValidationInfo) -> dict[str, Role]:
        """Check what belongs together; this is the last field of those that do."""
        if given.data.get("oidc_issuer") is not None:
            for name in ("oidc_client_id", "public_url"):
                if given.data.get(name) is None:
                    raise ValueError(f"SERVOTUNE_{name.upper()} must be given with SERVOTUNE_OIDC_ISSUER, got none")
            if not roles:
                raise ValueError("roles must be given with SERVOTUNE_OIDC_ISSUER, or nobody could sign in, got none")
        return roles

    @field_validator("secret_key")
    @classmethod
    def _keys(cls, given: SecretStr | None) -> SecretStr | None:
        for number, key in enumerate(_keys_of(given), start=1):
            try:
                length = len(base64.b64decode(key, altchars=b"-_", validate=True))
            except ValueError:
                length = 0
            if length != _KEY_BYTES:  # what was got is a secret
                raise ValueError(
                    f"key {number} must be {_KEY_BYTES} bytes in base64 (openssl rand -base64 32), got others"
                )
        return given

    @property
    def secret_keys(self) -> tuple[str, ...]:
        """The keys that encrypt (the first one) and decrypt secrets in the database."""
        return _keys_of(self.secret_key)

    @property
    def encrypted(self) -> bool:
        """Whether browsers reach the service by HTTPS, and only so."""
        return self.public_url is not None and self.public_url.startswith("https://")


def _keys_of(given: SecretStr | None) -> tuple[str, ...]:
    """Return the keys of a list, in URL-safe base64; none of an empty one, as compose files give it."""
    if given is None or not given.get_secret_value():
        return ()
    return tuple(key.strip().replace("+", "-").replace("/", "_") for key in given.get_secret_value().split(","))
