"""A typed client of the service: one method for each thing the API does; documents in, replies out."""

from __future__ import annotations

import os
import time
from types import TracebackType
from typing import Any, Self, cast

from servotune.access import Keys, Workspaces
from servotune.acquisitions import Acquisitions
from servotune.catalog import Catalog
from servotune.datasets import Datasets
from servotune.errors import ApiError, ServiceUnreachableError
from servotune.jobs import Jobs
from servotune.lineage import Lineage
from servotune.measured import Measured
from servotune.schedules import Schedules
from servotune.searches import Searches
from servotune.studies import Studies
from servotune.systems import Systems
from servotune.transport import Transport
from servotune.webhooks import Alerts, Webhooks


class Client(Studies, Measured, Searches):
    """A connection to a Servotune service; made by `servotune.connect`.

    Attributes
    ----------
    systems : Systems
        Stored system documents and their revisions.
    datasets : Datasets
        Recordings.
    jobs : Jobs
        Long work.
    lineage : Lineage
        What was made from what; one file that repeats it elsewhere.
    acquisitions : Acquisitions
        Measurements on rigs.
    schedules : Schedules
        Jobs that are run again and again.
    webhooks, alerts : Webhooks, Alerts
        Who is told when something ends, and what somebody should look at.
    catalog : Catalog
        The elements, metrics, methods and signals that the service knows.
    keys, workspaces : Keys, Workspaces
        Who may come in, and where to.
    """

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self.systems = Systems(transport)
        self.datasets = Datasets(transport)
        self.jobs = Jobs(transport)
        self.lineage = Lineage(transport)
        self.schedules = Schedules(transport)
        self.acquisitions = Acquisitions(transport)
        self.webhooks = Webhooks(transport)
        self.alerts = Alerts(transport)
        self.catalog = Catalog(transport)
        self.keys = Keys(transport)
        self.workspaces = Workspaces(transport)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection."""
        self._transport.close()

    def ready(self) -> dict[str, Any]:
        """Return the readiness report of the service.

        Raises
        ------
        ServerError
            It is up but not ready; `problem` holds its report.
        ServiceUnreachableError
            It does not answer.
        """
        return cast("dict[str, Any]", self._transport.body(self._transport.send("GET", "/readyz", attempts=1)))


URL, KEY = "SERVOTUNE_URL", "SERVOTUNE_KEY"
"""Environment variables that `connect` and the commands read."""
_HERE = "http://127.0.0.1:8000"


def connect(
    url: str | None = None,
    *,
    key: str | None = None,
    wait: float = 0.0,
    timeout: float = 120.0,
    attempts: int = 4,
) -> Client:
    """Return a client of the service at an address.

    Parameters
    ----------
    url : str, optional
        Address of the service; that of the environment variable ``SERVOTUNE_URL``, or ``http://127.0.0.1:8000``, where none is given.
    key : str, optional
        API key; that of ``SERVOTUNE_KEY`` where none is given. `servotune serve` prints the first one when it starts for the first time.
    wait : float
        How long to wait for a service that is still starting (s); 0 does not ask.
    timeout : float
        Longest silence of the service that is taken for work (s).
    attempts : int
        How often a request is sent before its failure is reported.

    Raises
    ------
    ServiceUnreachableError
        Not ready after `wait` seconds.
    ValueError
        The address is none.
    """
    address, secret = url or os.environ.get(URL) or _HERE, key or os.environ.get(KEY) or None
    if not address.startswith(("http://", "https://")):
        raise ValueError(f"the address of the service must begin with http:// or https://, got {address!r}")
    client = Client(Transport(address, key=secret, timeout=timeout, attempts=attempts))
    if wait > 0.0:
        _wait_until_ready(client, wait)
    return client


def _wait_until_ready(client: Client, wait: float) -> None:
    deadline = time.monotonic() + wait
    while True:
        try:
            client.ready()
        except (ServiceUnreachableError, ApiError) as error:
            if time.monotonic() >= deadline:
                client.close()
                message = f"the service is not ready after {wait:g} s: {error}"
                raise ServiceUnreachableError(message) from error
            time.sleep(0.1)
        else:
            return
