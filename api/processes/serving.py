"""How the service runs under uvicorn: its settings, and memory that is not searched again and again.

A collection of the oldest generation looks at every object there is. The modules and tables that a process loads when it
starts are some million objects, which takes half a second in which nobody is answered; and none of them is ever garbage.
So what is there when the service is ready is left out of all collections.
"""

from __future__ import annotations

import gc
import signal
import socket
import sys
from collections.abc import Sequence
from ipaddress import IPv4Network, IPv6Network

import uvicorn
from starlette.types import ASGIApp

from api.http.limits import BoundedHead
from api.runtime.memory import Memory

Network = IPv4Network | IPv6Network

#: New objects before the youngest are looked at; a page of a list alone makes hundreds that live for a moment.
_YOUNG = 10_000
#: s after which a thread that computes lets another one go on. A request asks for its turn some twenty times, each time that it
#: has waited for a socket or the database; the usual 5 ms of each made 0.3 s beside two threads that read large documents.
_TURN = 1e-4


class _Server(uvicorn.Server):
    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Begin to listen, with a collector that has nothing old to look at."""
        await super().startup(sockets)
        gc.collect()
        gc.freeze()
        gc.set_threshold(_YOUNG)
        sys.setswitchinterval(_TURN)
        Memory().keep_small()


def configuration(
    app: ASGIApp, *, host: str = "127.0.0.1", port: int = 0, grace: int = 3, proxies: Sequence[Network] = ()
) -> uvicorn.Config:
    """Return how uvicorn is to serve the application; open event streams would hold a shutdown up longer than ``grace`` (s).

    Who called is read from X-Forwarded-For only where one of the ``proxies`` has sent it: anybody can write that header,
    another program of this machine too.
    """
    return uvicorn.Config(
        app,
        host=host,
        port=port,
        # As everything else, by the root logger; requests have lines of their own (api.telemetry.metrics).
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=bool(proxies),
        forwarded_allow_ips=[str(network) for network in proxies],
        http=BoundedHead,
        # Longer than clients keep theirs, so that none sends a request into a connection that just closes.
        timeout_keep_alive=75,
        # Curves are float32, which compress badly, and a slider waits for each of them.
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=grace,
    )


def run(
    app: ASGIApp,
    *,
    host: str,
    port: int,
    listeners: list[socket.socket] | None = None,
    proxies: Sequence[Network] = (),
) -> bool:
    """Answer requests, at listeners where there are some, until the process is told to stop (SIGTERM, SIGINT); return whether it ever began to."""
    server = _Server(configuration(app, host=host, port=port, proxies=proxies))
    # uvicorn stops in good order and then raises the signal again; the worker is still to be stopped after that.
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: None)
    server.run(listeners)
    return server.started
