"""The table [daq] of a controller with an OPC UA server."""

from __future__ import annotations

from dataclasses import dataclass, field

from agent.errors import SettingsError
from agent.settings import DaqSettings

_WAYS = ("arrays", "subscription")


@dataclass(frozen=True, slots=True, kw_only=True)
class OpcuaSettings(DaqSettings):
    """How a controller is reached.

    ``server`` is its address, ``object`` the node of the object `Acquisition` (docs/agent.md). ``way`` is "arrays" where the
    ring is looked at once in a while, "subscription" where the controller tells each new block. The connection is signed and
    encrypted (Basic256Sha256) where ``certificate`` and ``private_key`` (of this agent) and ``server_certificate`` are given:
    files in DER or PEM. ``user`` and the first line of ``password_file`` are sent over such a connection alone.
    """

    server: str = "opc.tcp://127.0.0.1:4840"
    object: str = "ns=2;s=Acquisition"
    way: str = "arrays"
    certificate: str = ""
    private_key: str = ""
    server_certificate: str = ""
    user: str = ""
    password_file: str = field(default="", repr=False)

    @property
    def secure(self) -> bool:
        """Whether the connection is encrypted."""
        return bool(self.certificate)

    def check(self) -> None:
        """Make sure that the values make sense."""
        DaqSettings.check(self)  # a dataclass with slots is made anew: super() would mean the first one
        if not self.server.startswith("opc.tcp://"):
            raise SettingsError(f"daq.server must begin with opc.tcp://, got {self.server!r}")
        if "@" in self.server:
            raise SettingsError("daq.server must hold neither user nor password: set daq.user and daq.password_file")
        if self.way not in _WAYS:
            raise SettingsError(f"daq.way must be one of {', '.join(_WAYS)}, got {self.way!r}")
        files = {name: getattr(self, name) for name in ("certificate", "private_key", "server_certificate")}
        if any(files.values()) and not all(files.values()):
            missing = next(name for name, value in files.items() if not value)
            raise SettingsError(f"daq.{missing} must be given: an encrypted connection needs all of {', '.join(files)}")
        if (self.user or self.password_file) and not self.secure:
            raise SettingsError("daq.user must be sent over an encrypted connection alone: set daq.certificate")
