"""Why a device server is not reached by TLS: gRPC does not tell, so the handshake is done once more by hand."""

from __future__ import annotations

import contextlib
import socket
import ssl
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

from agent.drivers.nidaqmx.settings import NidaqmxSettings
from agent.errors import AttemptError, SettingsError

Peer = tuple[socket.AddressFamily, Any]
"""Family of a server's address, and the address."""


def refusal(settings: NidaqmxSettings) -> AttemptError | None:
    """Return what is wrong with the certificates, None where the reason is another one.

    Parameters
    ----------
    settings : NidaqmxSettings
        With a server.
    """
    try:
        place = urlsplit(f"//{settings.server}")
        host = place.hostname or ""
        with socket.create_connection((host, place.port or 0), timeout=settings.deadline) as plain:
            peer = (plain.family, plain.getpeername())
    except (OSError, ValueError):
        return None  # nobody is there at all
    if not settings.secure:
        return _in_the_open(peer, settings)
    try:
        _shake_hands(peer, settings, settings.server_name or host)
    except ssl.SSLError as error:
        reason = getattr(error, "verify_message", "") or str(error.reason or error).lower().replace("_", " ")
    except (OSError, SettingsError) as error:
        reason = str(error)
    else:
        return None
    return AttemptError(
        "server_not_trusted",
        f"the device server {settings.server} and this PC do not accept each other's certificates: {reason}",
        remedy="see to ca, certificate, private_key and server_name in [daq], and to what the server trusts",
    )


def _context(settings: NidaqmxSettings) -> ssl.SSLContext:
    ca = settings.pem("ca")
    context = ssl.create_default_context(cadata=ca.decode() if ca else None)
    if settings.certificate:
        context.load_cert_chain(settings.certificate, settings.private_key)
    return context


@contextlib.contextmanager
def _secured(
    context: ssl.SSLContext, peer: Peer, settings: NidaqmxSettings, name: str | None
) -> Iterator[ssl.SSLSocket]:
    """Open a connection and shake hands; it is closed however that ends.

    The socket is connected after it was wrapped: Python leaves one open whose peer has gone away before it is wrapped.
    """
    family, address = peer
    context.set_alpn_protocols(["h2"])
    with context.wrap_socket(socket.socket(family), server_hostname=name) as secure:
        secure.settimeout(settings.deadline)
        secure.connect(address)
        yield secure


def _shake_hands(peer: Peer, settings: NidaqmxSettings, name: str) -> None:
    with _secured(_context(settings), peer, settings, name) as secure:
        if not secure.recv(1):  # whether the server takes our certificate is told after the handshake, or by hanging up
            shown = "the certificate of this PC" if settings.certificate else "a PC without a certificate"
            raise ConnectionAbortedError(f"the server does not take {shown}")


def _in_the_open(peer: Peer, settings: NidaqmxSettings) -> AttemptError | None:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE  # who it is does not matter: nothing is sent
    with contextlib.suppress(OSError), _secured(context, peer, settings, None) as secure:
        if secure.version():
            return AttemptError(
                "server_not_trusted",
                f"the device server {settings.server} speaks TLS alone, this PC spoke in the open",
                remedy="name the server's certificate or its authority as `ca` in [daq]",
            )
    return None
