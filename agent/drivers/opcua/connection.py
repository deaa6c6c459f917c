"""A session with a controller that is opened anew when it is lost; every call ends within the deadline."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
import time
from collections.abc import Awaitable, Callable, Coroutine
from pathlib import Path
from typing import Any, TypeVar

from asyncua.client import Client
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from asyncua.crypto.uacrypto import load_certificate
from asyncua.ua import uaerrors
from cryptography import x509

from agent.drivers.opcua.settings import OpcuaSettings
from agent.errors import AttemptError

Found = TypeVar("Found")

_log = logging.getLogger(__name__)
_PAUSE = 0.1
_GOODBYE = 1.0
_SESSION = 60_000
"""ms that the controller keeps a session of which it hears nothing."""
_LOST = (OSError, TimeoutError, asyncio.TimeoutError, uaerrors.UaError, asyncio.CancelledError)
#: What another session would not change, and what to do about it.
_REFUSED: dict[type[Exception], tuple[str, str]] = {
    uaerrors.BadNodeIdUnknown: ("unknown_channel", "the controller has no such node: check daq.object"),
    uaerrors.BadNoMatch: ("unknown_channel", "the controller has no such node: check daq.object"),
    uaerrors.BadTypeMismatch: (
        "controller_differs",
        "a variable of the controller has another type than docs/agent.md",
    ),
    uaerrors.BadNotWritable: ("server_refuses", "the variable must be writable for the agent: allow it there"),
    uaerrors.BadUserAccessDenied: ("server_refuses", "the controller does not let this agent: check daq.user there"),
    uaerrors.BadIdentityTokenRejected: ("server_refuses", "the controller refuses user or password: check daq.user"),
    uaerrors.BadCertificateUntrusted: ("server_refuses", "the controller must trust daq.certificate: allow it there"),
    uaerrors.BadSecurityChecksFailed: ("server_refuses", "the controller must trust daq.certificate: allow it there"),
    uaerrors.BadSecurityPolicyRejected: ("server_refuses", "the controller must offer Basic256Sha256: allow it there"),
}


class Connection:
    """The session, in a thread with an event loop of its own.

    Parameters
    ----------
    settings : OpcuaSettings
    """

    def __init__(self, settings: OpcuaSettings) -> None:
        self._settings = settings
        self._client: Client | None = None
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="opcua", daemon=True)
        self._thread.start()
        self.sessions = 0
        """How many have been opened: a subscription lives no longer than its own."""

    def close(self) -> None:
        """End the session."""
        self._run(self._drop())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def call(self, work: Callable[[Client], Awaitable[Found]]) -> Found:
        """Do something that may be done twice, on a new session when the old one is lost.

        Raises
        ------
        AttemptError
            `server_unreachable` when there is no session within the deadline, `server_refuses` ...
        """
        return self._run(self._patiently(work))

    def _run(self, work: Coroutine[Any, Any, Found]) -> Found:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()

    async def _patiently(self, work: Callable[[Client], Awaitable[Found]]) -> Found:
        deadline = self._settings.deadline
        give_up_at = time.monotonic() + deadline
        while True:
            left, was_there = give_up_at - time.monotonic(), self._client is not None
            try:
                return await asyncio.wait_for(self._once(work), max(left, _PAUSE))
            except tuple(_REFUSED) as error:
                await self._drop()
                word, advice = _REFUSED[type(error)]
                raise AttemptError(word, f"{advice} ({type(error).__name__})") from error
            except _LOST as error:
                await self._drop()
                if time.monotonic() + _PAUSE > give_up_at:
                    raise self._given_up(error) from error
                if was_there:
                    _log.warning("the session with the controller is lost, and opened anew: %s", type(error).__name__)
            await asyncio.sleep(_PAUSE)

    def _given_up(self, error: BaseException) -> AttemptError:
        """Return what a call has become of that had no session within the deadline."""
        settings = self._settings
        if type(error) is uaerrors.UaError:  # asyncua's own: nothing of what the controller offers fits
            return AttemptError(
                "server_refuses",
                f"the controller {settings.server} offers no connection that fits [daq]: certificate, private_key and "
                f"server_certificate belong there where it wants encryption, and only there ({error})",
            )
        trust = ", and whether it and this agent have each other's certificates" if settings.secure else ""
        return AttemptError(
            "server_unreachable",
            f"the controller {settings.server} must answer within {settings.deadline:g} s: see whether it runs, whether the "
            f"network reaches it{trust} ({type(error).__name__}: {error})",
        )

    async def _once(self, work: Callable[[Client], Awaitable[Found]]) -> Found:
        if self._client is None:
            client = await self._made()
            try:
                await client.connect()
            except BaseException:
                with contextlib.suppress(Exception):
                    client.disconnect_socket()
                raise
            self._client = client
            self.sessions += 1
        return await work(self._client)

    async def _made(self) -> Client:
        settings = self._settings
        client = Client(settings.server, timeout=max(settings.deadline / 2, _PAUSE))
        client.name = client.description = "servotune agent"
        client.session_timeout = _SESSION
        if settings.secure:
            try:
                own = await load_certificate(Path(settings.certificate))
                client.application_uri = _uri(own)
                await client.set_security(
                    SecurityPolicyBasic256Sha256,
                    certificate=settings.certificate,
                    private_key=settings.private_key,
                    server_certificate=settings.server_certificate,
                )
            except FileNotFoundError as error:
                raise AttemptError("no_certificate", f"the file {error.filename} must be there: check [daq]") from error
            except ValueError as error:
                raise AttemptError(
                    "no_certificate", f"certificates and key in [daq] must be DER or PEM: {error}"
                ) from error
        if settings.user:
            client.set_user(settings.user)
            client.set_password(_first_line(settings.password_file))
        return client

    async def _drop(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            with contextlib.suppress(Exception, asyncio.CancelledError):
                await asyncio.wait_for(client.disconnect(), _GOODBYE)


def _uri(certificate: x509.Certificate) -> str:
    """Return the name of the application in a certificate, which the session must carry as well."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound as error:
        raise ValueError("a certificate must name its application as URI in subjectAltName, it does not") from error
    found = names.get_values_for_type(x509.UniformResourceIdentifier)
    if not found:
        raise ValueError("a certificate must name its application as URI in subjectAltName, it does not")
    return str(found[0])


def _first_line(path: str) -> str:
    try:
        return Path(path).read_text(encoding="utf-8").splitlines()[0]
    except (OSError, IndexError) as error:
        raise AttemptError("no_password", f"daq.password_file must be readable and not empty, got {path!r}") from error
