"""Every setting of the service: its name, default and limits; what each one means is in ``docs/settings.md``, in one table.

::

    SERVOTUNE_<NAME>=<value>
"""

from __future__ import annotations

import base64
import importlib.util
import math
import os
from ipaddress import IPv4Network, IPv6Network
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, FilePath, SecretStr, ValidationInfo, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from storage.objects import ADDRESS, ObjectStore

_KEY_BYTES = 32


class Role(BaseModel):
    """What people of one group may do, and where."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    workspace: str = "ws_default"
    scopes: list[Literal["read", "write", "run", "acquire", "admin"]] = Field(min_length=1)


class Settings(BaseSettings):
    """The settings of one process, read from ``SERVOTUNE_*``."""

    model_config = SettingsConfigDict(env_prefix="SERVOTUNE_", extra="ignore", frozen=True, hide_input_in_errors=True)

    database_url: str = Field(default="sqlite:///./servotune.db", repr=False)
    direct_database_url: str | None = Field(default=None, repr=False)
    blob_store: Literal["database", "objects"] = "database"
    keep_originals: Literal["always", "until-verified"] = "always"
    object_store: str | None = Field(default=None, pattern=ADDRESS, validate_default=True)
    bootstrap_key: str | None = Field(default=None, min_length=16, max_length=200, repr=False)
    public_url: str | None = Field(default=None, pattern="^https?://[^/?#]+/?$")
    sign_in_hours: float = Field(default=12.0, gt=0, le=8760)
    requests_per_minute: int = Field(default=30_000, ge=0)
    wrong_keys_per_minute: int = Field(default=60, ge=0)
    trusted_proxies: list[IPv4Network | IPv6Network] = Field(default_factory=list)
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
    processes: int = Field(default=1, ge=1, le=64)
    compute_slots: int = Field(default_factory=lambda: os.cpu_count() or 1, ge=1)
    worker_slots: int = Field(default=1, ge=1)
    job_memory: int = Field(default=8 << 30, ge=0)
    cluster: str | None = Field(default=None, pattern=r"^(tls|tcp)://[^/?#@]+:[0-9]+$")
    cluster_ca: FilePath | None = None
    cluster_cert: FilePath | None = None
    cluster_key: FilePath | None = Field(default=None, validate_default=True)
    cluster_adaptive: int = Field(default=0, ge=0, le=100_000)
    request_seconds: float = Field(default=60.0, gt=0)
    request_memory: int = Field(default=4 << 30, ge=0)
    quick_seconds: float = Field(default=1.0, gt=0)
    waiting_requests: int = Field(default=64, ge=0)
    worker_stale_seconds: float = Field(default=30.0, gt=0)
    idempotency_hours: float = Field(default=24.0, gt=0)
    webhook_networks: list[IPv4Network | IPv6Network] = Field(default_factory=list)
    secret_key: SecretStr | None = None
    plain_secrets: bool = False
    audit_days: float = Field(default=400.0, gt=0)
    job_days: float = Field(default=400.0, gt=0)
    event_days: float = Field(default=30.0, gt=0)
    log_level: Literal["debug", "info", "warning", "error"] = "info"
    log_format: Literal["text", "json"] = "text"
    otlp_endpoint: str | None = Field(default=None, pattern="^https?://[^?#]+$")

    @field_validator("object_store", mode="before")
    @classmethod
    def _there(cls, address: str | None, given: ValidationInfo) -> str | None:
        address = address or None  # as compose files give it
        if address is None and given.data.get("blob_store") == "objects":
            raise ValueError("an address must be given with SERVOTUNE_BLOB_STORE=objects, got none")
        return address

    @field_validator("cluster", "cluster_ca", "cluster_cert", "cluster_key", mode="before")
    @classmethod
    def _given(cls, value: str | None) -> str | None:
        return value or None  # as compose files give it

    @field_validator("cluster")
    @classmethod
    def _installed(cls, address: str | None) -> str | None:
        if address is not None and importlib.util.find_spec("distributed") is None:
            raise ValueError(
                "distributed must be installed for a cluster (pip install 'servotune-server[cluster]'), got no such package"
            )
        return address

    @field_validator("cluster_key")
    @classmethod
    def _encrypted(cls, key: Path | None, given: ValidationInfo) -> Path | None:
        """Check what belongs to TLS; this is the last field of those that do. Where another one is wrong, that is what is told."""
        if not {"cluster", "cluster_ca", "cluster_cert"} <= given.data.keys():
            return key
        address = given.data.get("cluster") or ""
        for name, file in (
            ("CA", given.data.get("cluster_ca")),
            ("CERT", given.data.get("cluster_cert")),
            ("KEY", key),
        ):
            if (file is not None) != address.startswith("tls://"):
                rule = (
                    "left out without SERVOTUNE_CLUSTER=tls://..."
                    if file is not None
                    else "given with SERVOTUNE_CLUSTER=tls://..."
                )
                raise ValueError(f"SERVOTUNE_CLUSTER_{name} must be {rule}, got {file or 'none'}")
        if key is not None:
            _require_chain(given.data["cluster_ca"], given.data["cluster_cert"], key)
        return key

    @field_validator("oidc_roles")
    @classmethod
    def _complete(cls, roles: dict[str, Role], given: ValidationInfo) -> dict[str, Role]:
        """Check what belongs together; this is the last field of those that do."""
        if given.data.get("oidc_issuer") is not None:
            for name in ("oidc_client_id", "public_url"):
                if given.data.get(name, "wrong, and told by itself") is None:
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
    def objects(self) -> ObjectStore | None:
        """Where blobs may lie beside the database."""
        return ObjectStore(self.object_store, preferred=self.blob_store == "objects") if self.object_store else None

    @property
    def job_plan(self) -> float:
        """Bytes that a job may be expected to need before it begins: half of what it may have, for expectations are rough."""
        return self.job_memory / 2 or math.inf

    @property
    def encrypted(self) -> bool:
        """Whether browsers reach the service by HTTPS, and only so."""
        return self.public_url is not None and self.public_url.startswith("https://")


def _require_chain(ca: Path, certificate: Path, key: Path) -> None:
    """Make sure that a connection over TLS can be begun with these files: a search would notice hours later."""
    import ssl  # noqa: PLC0415 - only where there is a cluster

    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    for name, file in (("CA", ca), ("CERT", certificate)):
        try:
            context.load_verify_locations(file)
        except OSError as error:
            raise ValueError(
                f"SERVOTUNE_CLUSTER_{name} must hold a certificate in PEM, got {file} ({error})"
            ) from error
    try:
        context.load_cert_chain(certificate, key, password=lambda: "")  # none is asked for at a terminal
    except OSError as error:
        rule = f"the key of the certificate in {certificate}, in PEM and without a password"
        raise ValueError(f"SERVOTUNE_CLUSTER_KEY must hold {rule}, got {key} ({error})") from error


def _keys_of(given: SecretStr | None) -> tuple[str, ...]:
    """Return the keys of a list, in URL-safe base64; none of an empty one, as compose files give it."""
    if given is None or not given.get_secret_value():
        return ()
    return tuple(key.strip().replace("+", "-").replace("/", "_") for key in given.get_secret_value().split(","))
