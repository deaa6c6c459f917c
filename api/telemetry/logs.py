"""The log on standard error: lines for people, or one JSON object for each line, with the ids of request and job in it."""

from __future__ import annotations

import json
import logging
import re
import sys
import threading
from contextvars import ContextVar
from datetime import UTC, datetime
from types import TracebackType
from typing import Literal

from storage.jobs.compute import ASKED_BY, CURRENT_JOB

#: The id of the request that is being answered.
CURRENT_REQUEST: ContextVar[str | None] = ContextVar("current_request", default=None)

_LINE = "%(asctime)s %(levelname)s %(name)s: %(message)s"
_TICKET = re.compile(r"ticket=[^\s&\"']+")
#: What a caller of a logger may add to a line of JSON.
_MORE = ("method", "path", "status", "seconds")


class Structured(logging.Formatter):
    """Makes each record a JSON object on one line."""

    def format(self, record: logging.LogRecord) -> str:
        """Return time, level, logger and message, and the ids of job and request where there are any.

        The request of a job is the one that asked for it.
        """
        line: dict[str, object] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            "process": record.process,
        }
        request = CURRENT_REQUEST.get() or ASKED_BY.get()
        line |= {name: value for name, value in (("request", request), ("job", CURRENT_JOB.get())) if value}
        line |= {name: getattr(record, name) for name in _MORE if hasattr(record, name)}
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        return json.dumps(line, ensure_ascii=False, default=str)


class _WithoutTickets(logging.Filter):
    """Hides tickets, which are in the address of a WebSocket because a browser can send nothing else with it."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Let every record through, with its tickets hidden."""
        message = record.getMessage()
        if "ticket=" in message:
            record.msg, record.args = _TICKET.sub("ticket=...", message), ()
        return True


def configure(level: str, *, form: Literal["text", "json"]) -> None:
    """Let this process write its log on standard error; what was configured before is replaced."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(Structured() if form == "json" else logging.Formatter(_LINE))
    handler.addFilter(_WithoutTickets())
    root = logging.getLogger()
    root.handlers = [handler]
    root.setLevel(level.upper())
    # The database library would write down every row that it reads.
    for library in ("alembic", "dbos", "sqlalchemy"):
        logging.getLogger(library).setLevel(logging.WARNING)
    # The job engine would write lines of its own form when it starts, where its logger has no handler yet.
    engine = logging.getLogger("dbos")
    engine.handlers, engine.propagate = [logging.NullHandler()], True
    logging.captureWarnings(capture=True)
    sys.excepthook = _log_uncaught
    threading.excepthook = _log_uncaught_in_thread


def _log_uncaught(kind: type[BaseException], error: BaseException, traceback: TracebackType | None) -> None:
    if issubclass(kind, KeyboardInterrupt):
        sys.__excepthook__(kind, error, traceback)
        return
    logging.getLogger(__name__).critical("the process ends by an error", exc_info=(kind, error, traceback))


def _log_uncaught_in_thread(given: threading.ExceptHookArgs) -> None:
    if given.exc_value is not None and not issubclass(given.exc_type, SystemExit):
        name = "without a name" if given.thread is None else given.thread.name
        logging.getLogger(__name__).error(
            "thread %s ends by an error", name, exc_info=(given.exc_type, given.exc_value, given.exc_traceback)
        )
