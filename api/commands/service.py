"""`servotune serve`, `servotune worker`, `servotune openapi`; cheap to import, so that `servotune --help` is."""

from __future__ import annotations

import logging
import os
import re
import signal
import sys
from collections.abc import Callable, Sequence
from functools import wraps
from typing import TYPE_CHECKING, TypeVar

from api.runtime.arguments import at_end_of_input, parser_of, stopped_by_signals, whole
from storage.loading import uncollected

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

    from api.settings import Settings


_UNREACHABLE = "the database of SERVOTUNE_DATABASE_URL must be reachable"
_Given = TypeVar("_Given")


def _told_in_the_log(command: Callable[[_Given], int]) -> Callable[[_Given], int]:
    """Let the sentence that a command ends with be a line of its log where that is JSON: a program reads it as it reads the others."""

    @wraps(command)
    def run(given: _Given) -> int:
        try:
            return command(given)
        except SystemExit as end:
            if not isinstance(end.code, str) or os.environ.get("SERVOTUNE_LOG_FORMAT") != "json":
                raise
            from api.telemetry import logs

            logs.configure("INFO", form="json")
            logging.getLogger(__name__).critical(end.code)
            return 1

    return run


@_told_in_the_log
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
    parser = parser_of("serve", "Start the service. Settings are environment variables SERVOTUNE_*.")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default: %(default)s)")
    parser.add_argument("--port", type=whole(0, 65535), default=8000, help="port to listen on (default: %(default)s)")
    parser.add_argument("--no-worker", action="store_true", help="start no worker beside the service")
    parser.add_argument("--with-parent", action="store_true", help="stop when standard input closes")
    parser.add_argument(
        "--processes",
        type=whole(1, 64),
        metavar="N",
        help="processes that answer requests, at most 64 (default: SERVOTUNE_PROCESSES)",
    )
    given = parser.parse_args(argv)

    settings = read_settings()
    if given.with_parent:
        at_end_of_input(lambda: os.kill(os.getpid(), signal.SIGTERM))
    _prepare(settings)
    processes = settings.processes if given.processes is None else given.processes
    if processes > 1:
        from api.processes.listeners import run

        try:
            run(host=given.host, port=given.port, count=processes, worker=not given.no_worker)
        except OSError as error:
            raise SystemExit(f"the service must be able to listen at {given.host}:{given.port}: {error}") from error
        return 0

    with uncollected():
        from api.app.main import create_app
        from api.processes import serving
        from api.runtime.child_process import worker_beside

    beside = None if given.no_worker else worker_beside()
    try:
        app = create_app(settings, beside=beside)
        ran = serving.run(app, host=given.host, port=given.port, proxies=settings.trusted_proxies)
        return 0 if ran else 1
    finally:
        if beside is not None:
            beside.stop()


@_told_in_the_log
def answer(told: str) -> int:
    """Be one process of a service that has several, as ``told`` by the one that started it.

    Returns
    -------
    int
        Exit code.
    """
    with uncollected():
        from api.processes import listeners

    return 0 if listeners.answer(read_settings(), told) else 1


@_told_in_the_log
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
    parser = parser_of("worker", "Compute jobs. Settings are environment variables SERVOTUNE_*.")
    parser.add_argument("--slots", type=whole(1, 1024), help="jobs at the same time (default: SERVOTUNE_WORKER_SLOTS)")
    parser.add_argument("--with-parent", action="store_true", help="stop when standard input closes")
    given = parser.parse_args(argv)

    with uncollected():
        from api.telemetry.tracing import traces_of
        from storage.errors import UNAVAILABLE, DatabaseUrlError, StateError, full_disk
        from storage.jobs.worker import Worker

    settings = read_settings()
    stop = stopped_by_signals()
    if given.with_parent:
        at_end_of_input(stop.set)
    slots = settings.worker_slots if given.slots is None else given.slots
    traces = traces_of(settings, "servotune-worker")
    unreachable: tuple[type[Exception], ...] = (*UNAVAILABLE, DatabaseUrlError)
    try:
        Worker(
            settings.database_url,
            compute="api.processes.worker:run",
            slots=slots,
            traced=traces.job,
            direct=settings.direct_database_url,
            objects=settings.objects,
        ).run(stop)
    except unreachable as error:
        raise SystemExit(full_disk(error) or f"{_UNREACHABLE}: {getattr(error, 'orig', None) or error}") from error
    except StateError as error:
        raise SystemExit(str(error)) from error
    finally:
        traces.close()
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
    parser_of("openapi", "Print the OpenAPI document.").parse_args(argv)

    from api.app.export_openapi import render

    sys.stdout.write(render())
    return 0


def read_settings() -> Settings:
    """Return the settings of this process, let it write its log, and make its files its user's alone.

    Wrong settings end it with a sentence.
    """
    from pydantic import ValidationError
    from pydantic_settings import SettingsError

    from api.settings import Settings
    from api.telemetry import logs

    try:
        settings = Settings()
    except ValidationError as error:
        raise SystemExit("; ".join(dict.fromkeys(map(_wrong, error.errors())))) from error
    except SettingsError as error:
        found = re.search('field "(.*?)"', str(error))
        raise SystemExit(f"SERVOTUNE_{found[1].upper() if found else ''} must be JSON") from error
    logs.configure(settings.log_level, form=settings.log_format)
    os.umask(0o077)
    return settings


def _wrong(error: ErrorDetails) -> str:
    """Return what is wrong with a setting, by the name of its variable; validators of ours name what they mean."""
    from api.problems.faults import sentence

    first, *inside = error["loc"]
    variable = f"SERVOTUNE_{str(first).upper()}"
    if error["type"] == "value_error":
        return f"{variable}: {error['msg'].removeprefix('Value error, ')}"
    # pydantic also counts the alternatives of a union as places, by descriptions in brackets
    return sentence("/".join([variable, *(str(part) for part in inside if "[" not in str(part))]), error)


def _prepare(settings: Settings) -> None:
    """Migrate the database, and make the first key where there is none."""
    with uncollected():
        from api.services.access.keys import bootstrap
        from api.services.operation.app_context import vault_of
        from storage import key_file
        from storage.errors import UNAVAILABLE, DatabaseUrlError, VaultError, full_disk
        from storage.repositories.webhooks import renew_secrets
        from storage.session import open_database

    unreachable: tuple[type[Exception], ...] = (*UNAVAILABLE, DatabaseUrlError)
    try:
        _migrate(settings.direct_database_url or settings.database_url)
        database = open_database(settings.database_url)
        try:
            with database.session() as session:
                renew_secrets(session, vault_of(settings).renewed)  # fails where the key is lost under which they are
            if not settings.secret_keys and not settings.plain_secrets and key_file.make(settings.database_url):
                with database.session() as session:
                    renew_secrets(session, vault_of(settings).renewed)
            _tell_what_lies_open(settings)
            token = bootstrap(database, settings.bootstrap_key)
        finally:
            database.dispose()
    except unreachable as error:
        raise SystemExit(full_disk(error) or f"{_UNREACHABLE}: {getattr(error, 'orig', None) or error}") from error
    except VaultError as error:
        place = key_file.path_of(settings.database_url)
        also = "" if place is None else f" (without that setting, the one in {place})"
        raise SystemExit(f"SERVOTUNE_SECRET_KEY: {error.message}{also}") from error
    if token is not None:
        sys.stdout.write(
            f"\n  First admin key: {token}\n  It is shown only now. Send it as `Authorization: Bearer <key>`.\n\n"
        )
        sys.stdout.flush()


def _migrate(url: str) -> None:
    from storage.session import open_database

    database = open_database(url)
    try:
        database.migrate()
    finally:
        database.dispose()


def _tell_what_lies_open(settings: Settings) -> None:
    """Say which files others can read and which secrets are stored as they are."""
    from storage import key_file
    from storage.session import readable_by_others
    from storage.vault import NO_KEY

    log = logging.getLogger(__name__)
    path = readable_by_others(settings.database_url)
    if path is not None:
        log.warning("the database %s can be read by other users of this machine: chmod 600 %s*", path, path)
    if settings.secret_keys or key_file.read(settings.database_url):
        return
    if settings.plain_secrets:
        log.warning(
            "secrets of webhooks are stored as they are, in the database and its backups, as SERVOTUNE_PLAIN_SECRETS allows"
        )
    else:
        log.warning("webhooks and sign-ins through an OpenID provider are refused: %s", NO_KEY)
