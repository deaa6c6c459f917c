"""`servotune serve`, `servotune worker`, `servotune openapi`; cheap to import, so that `servotune --help` is."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import subprocess

    from api.settings import Settings


def serve(argv: Sequence[str]) -> int:
    """Start the service, with one worker beside it.

    Parameters
    ----------
    argv : sequence of str
        Arguments after the command's name.

    Returns
    -------
    int
        Exit code.
    """
    parser = argparse.ArgumentParser(
        prog="servotune serve", description="Start the service. Settings are environment variables SERVOTUNE_*."
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default: %(default)s)")
    parser.add_argument("--port", type=int, default=8000, help="port to listen on (default: %(default)s)")
    parser.add_argument("--no-worker", action="store_true", help="start no worker beside the service")
    given = parser.parse_args(argv)

    import signal

    import uvicorn

    from api.main import create_app

    settings = read_settings()
    _prepare(settings)
    worker = None if given.no_worker else _start_worker()
    try:
        app = create_app(settings, expects_worker=worker is not None)
        config = uvicorn.Config(
            app,
            host=given.host,
            port=given.port,
            log_level=settings.log_level,
            access_log=settings.log_level == "debug",
            server_header=False,
            # Longer than clients keep theirs, so that none sends a request into a connection that just closes.
            timeout_keep_alive=75,
            # Open event streams would hold a shutdown up for ever.
            timeout_graceful_shutdown=3,
        )
        server = uvicorn.Server(config)
        # uvicorn stops in good order and then raises the signal again; the worker is still to be stopped after that.
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: None)
        server.run()
        return 0 if server.started else 1
    finally:
        if worker is not None:
            _stop_worker(worker)


def worker(argv: Sequence[str]) -> int:
    """Compute jobs from the service's database; start as many as there are machines or cores.

    Parameters
    ----------
    argv : sequence of str
        Arguments after the command's name.

    Returns
    -------
    int
        Exit code.
    """
    parser = argparse.ArgumentParser(
        prog="servotune worker", description="Compute jobs. Settings are environment variables SERVOTUNE_*."
    )
    parser.add_argument("--slots", type=int, help="jobs at the same time (default: SERVOTUNE_WORKER_SLOTS)")
    parser.add_argument("--with-parent", action="store_true", help="stop when standard input closes")
    given = parser.parse_args(argv)

    import signal
    import threading

    from storage.jobs.worker import Worker

    settings = read_settings()
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    if given.with_parent:
        threading.Thread(target=_wait_for_end_of_input, args=(stop,), daemon=True).start()
    Worker(settings.database_url, compute="api.worker:run", slots=given.slots or settings.worker_slots).run(stop)
    return 0


def openapi(argv: Sequence[str]) -> int:
    """Print the OpenAPI document of the service.

    Parameters
    ----------
    argv : sequence of str
        Arguments after the command's name.

    Returns
    -------
    int
        Exit code.
    """
    argparse.ArgumentParser(prog="servotune openapi", description="Print the OpenAPI document.").parse_args(argv)

    from api.export_openapi import render

    sys.stdout.write(render())
    return 0


def read_settings() -> Settings:
    """Return the settings of this process, and let it write its log; wrong ones end it with a sentence."""
    import logging

    from pydantic import ValidationError

    from api.settings import Settings

    try:
        settings = Settings()
    except ValidationError as error:
        wrong = "; ".join(f"SERVOTUNE_{str(e['loc'][0]).upper()}: {e['msg']}" for e in error.errors())
        raise SystemExit(f"settings must be valid: {wrong}") from error
    logging.basicConfig(level=settings.log_level.upper(), format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    # The database library would write down every row that it reads.
    for library in ("alembic", "dbos", "sqlalchemy"):
        logging.getLogger(library).setLevel(logging.WARNING)
    return settings


def _prepare(settings: Settings) -> None:
    """Migrate the database, and make the first key where there is none."""
    from api.services.keys import bootstrap
    from storage.errors import UNAVAILABLE, DatabaseUrlError
    from storage.session import open_database

    unreachable: tuple[type[Exception], ...] = (*UNAVAILABLE, DatabaseUrlError)
    try:
        database = open_database(settings.database_url)
        try:
            database.migrate()
            token = bootstrap(database, settings.bootstrap_key)
        finally:
            database.dispose()
    except unreachable as error:
        raise SystemExit(f"the database of SERVOTUNE_DATABASE_URL must be reachable: {error}") from error
    if token is not None:
        sys.stdout.write(
            f"\n  First admin key: {token}\n  It is shown only now. Send it as `Authorization: Bearer <key>`.\n\n"
        )
        sys.stdout.flush()


def _start_worker() -> subprocess.Popen[bytes]:
    """Start a worker that ends with this process: the pipe to its standard input closes however this one dies."""
    import subprocess

    return subprocess.Popen(
        [sys.executable, "-c", "import sys; from api.commands import worker; sys.exit(worker(['--with-parent']))"],
        stdin=subprocess.PIPE,
    )


def _stop_worker(process: subprocess.Popen[bytes]) -> None:
    import subprocess

    assert process.stdin is not None
    process.stdin.close()
    process.terminate()
    try:
        process.wait(timeout=15)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _wait_for_end_of_input(stop: object) -> None:
    import threading

    assert isinstance(stop, threading.Event)
    sys.stdin.buffer.read()
    stop.set()
