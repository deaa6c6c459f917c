"""The table [daq] of NI hardware."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from agent.errors import SettingsError
from agent.settings import DaqSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class NidaqmxSettings(DaqSettings):
    """How NI hardware is reached.

    ``server`` is the address of an NI gRPC Device Server, empty for the driver of this PC. ``clock`` and ``trigger`` are
    terminals that outputs take their clock and start from; by default those that the driver names for the inputs' task.
    ``ca``, ``certificate`` and ``private_key`` are files in PEM for a device server with TLS: what it is known by, and, where it
    asks for it, what this PC is known by. With ``server_name`` the certificate may be for another name than the address.
    """

    server: str = ""
    ca: str = ""
    certificate: str = ""
    private_key: str = ""
    server_name: str = ""
    clock: str = ""
    trigger: str = ""

    def check(self) -> None:
        """Judge what belongs together, and that the files are there.

        Raises
        ------
        SettingsError
            With the place, the rule and the value.
        """
        DaqSettings.check(self)
        if bool(self.certificate) != bool(self.private_key):
            raise SettingsError("daq: certificate and private_key must be given together, one of them is missing")
        if self.secure and not self.server:
            raise SettingsError("daq.server must be given with ca or certificate: the driver of this PC has no channel")
        for name in ("ca", "certificate", "private_key"):
            self.pem(name)

    @property
    def secure(self) -> bool:
        """Whether the device server is spoken to by TLS."""
        return bool(self.ca or self.certificate)

    def pem(self, name: str) -> bytes | None:
        """Return the content of one of the files, None where it is not given.

        Raises
        ------
        SettingsError
            When it cannot be read, or is no PEM.
        """
        path = getattr(self, name)
        if not path:
            return None
        try:
            content = Path(path).read_bytes()
        except OSError as error:
            raise SettingsError(f"daq.{name} must be readable, got {path}: {error.strerror}") from error
        if b"-----BEGIN " not in content:
            raise SettingsError(f"daq.{name} must be a file in PEM, {path} is none")
        return content
