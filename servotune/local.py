"""The engine without a service of one's own: started with a script or notebook, and gone with it."""

from __future__ import annotations

import os
import secrets
import socket
import subprocess
import sys
import tempfile
import time
import weakref
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

from servotune.client import Client, connect
from servotune.errors import ApiError, ServiceUnreachableError, ServotuneError

_LONGEST_START = 300.0
"""s; the first start on a machine compiles the kernels."""
_STOPS_WITHIN = 10.0


def local(folder: Path | str | None = None, *, timeout: float = 120.0) -> Client:
    """Return a client of an engine on this computer: the same objects as `connect`, with nothing to set up.

    A child process answers on a port of this computer alone, under a key that only this client has. It ends with ``close``, the
    ``with`` block, or this process, however that ends.

    Parameters
    ----------
    folder : pathlib.Path or str, optional
        Where systems, recordings and results are kept; a temporary folder, removed at the end, unless given.
    timeout : float
        Longest silence that is taken for work (s).

    Raises
    ------
    ServotuneError
        The engine is not installed, or does not start.

    Examples
    --------
    ::

        with servotune.local() as client:
            client.simulate(document, input={"port": "reference", "signal": {"kind": "step"}}).plot()
    """
    if find_spec("uvicorn") is None or find_spec("api") is None:
        raise ServotuneError("an engine on this computer needs more than the client: pip install servotune-server")
    place = Path(tempfile.mkdtemp(prefix="servotune-") if folder is None else folder)
    place.mkdir(parents=True, exist_ok=True)
    key = f"st_{secrets.token_urlsafe(32)}"
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = int(free.getsockname()[1])
    log = place / "log.txt"
    process = _started(place, port, key, log)
    client = connect(f"http://127.0.0.1:{port}", key=key, timeout=timeout)
    end = weakref.finalize(client, _stop, process, place if folder is None else None)
    client.closing.append(end)
    try:
        _wait(client, process, log)
    except BaseException:
        client.close()
        raise
    return client


def _started(place: Path, port: int, key: str, log: Path) -> subprocess.Popen[bytes]:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("SERVOTUNE_")}
    environment |= {
        "SERVOTUNE_DATABASE_URL": f"sqlite:///{(place / 'servotune.db').resolve()}",
        "SERVOTUNE_BOOTSTRAP_KEY": key,
        "SERVOTUNE_REQUESTS_PER_MINUTE": "0",
        "SERVOTUNE_WORKER_SLOTS": str(os.cpu_count() or 1),
    }
    command = [sys.executable, "-m", "servotune", "serve", "--port", str(port), "--with-parent"]
    with log.open("wb") as written:
        # its standard input closes when this process ends, however it ends
        return subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=written, stderr=written)  # noqa: S603 - our own


def _wait(client: Client, process: subprocess.Popen[bytes], log: Path) -> None:
    until = time.monotonic() + _LONGEST_START
    while True:
        with suppress(ServiceUnreachableError, ApiError):
            client.ready()
            next(client.systems.list(), None)  # who answers at this port knows the key: it is no other program
            return
        if process.poll() is not None or time.monotonic() > until:
            said = log.read_text(errors="replace").strip().splitlines()[-3:]
            raise ServotuneError(f"the engine on this computer does not start: {' '.join(said) or 'it said nothing'}")
        time.sleep(0.05)


def _stop(process: subprocess.Popen[bytes], place: Path | None) -> None:
    """End the engine in good order; forget what it kept where nobody asked to keep it."""
    assert process.stdin is not None
    process.stdin.close()
    try:
        process.wait(timeout=_STOPS_WITHIN)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if place is not None:
        import shutil  # noqa: PLC0415 - most scripts need none

        shutil.rmtree(place, ignore_errors=True)
