"""A typed client of the service: one method for each thing the API does; documents in, replies out."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self, cast

from servotune.access import Keys, Workspaces
from servotune.acquisitions import Acquisitions
from servotune.catalog import Catalog
from servotune.comments import Comments
from servotune.datasets import Datasets
from servotune.errors import ApiError, ServiceUnreachableError
from servotune.jobs import Jobs
from servotune.lineage import Lineage
from servotune.measured import Measured
from servotune.results import Results
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
    results : Results
        Studies that were asked to be kept.
    comments : Comments
        What people write about systems, recordings and results.
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
        self.closing: list[Callable[[], object]] = []
        """What else is done when the connection is closed."""
        self.systems = Systems(transport)
        self.datasets = Datasets(transport)
        self.jobs = Jobs(transport)
        self.results = Results(transport)
        self.comments = Comments(transport)
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

    @property
    def url(self) -> str:
        """The address of the service."""
        return self._transport.url

    @property
    def key(self) -> str | None:
        """The key that is sent, None where none is."""
        return self._transport.key

    def close(self) -> None:
        """Close the connection."""
        self._transport.close()
        while self.closing:
            self.closing.pop()()

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


URL, KEY, PROFILE = "SERVOTUNE_URL", "SERVOTUNE_KEY", "SERVOTUNE_PROFILE"
"""Environment variables that `connect` and the commands read."""
HERE = "http://127.0.0.1:8000"


def connect(
    url: str | None = None,
    *,
    key: str | None = None,
    profile: str | None = None,
    wait: float = 0.0,
    timeout: float = 120.0,
    attempts: int = 4,
) -> Client:
    """Return a client of the service at an address.

    Parameters
    ----------
    url : str, optional
        Address of the service; where none is given, that of the environment variable ``SERVOTUNE_URL``, of the profile, or
        ``http://127.0.0.1:8000``.
    key : str, optional
        API key; where none is given, that of ``SERVOTUNE_KEY``, or of the profile if the address is the profile's. `servotune serve`
        prints the first one when it starts for the first time.
    profile : str, optional
        What `servotune login` has kept under this name; ``SERVOTUNE_PROFILE``, or ``default``, where none is given.
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
        The address is none, or there is no such profile.
    """
    address, secret = _whom_to_ask(
        url or os.environ.get(URL), key or os.environ.get(KEY), profile or os.environ.get(PROFILE)
    )
    if not address.startswith(("http://", "https://")):
        raise ValueError(f"the address of the service must begin with http:// or https://, got {address!r}")
    client = Client(Transport(address, key=secret, timeout=timeout, attempts=attempts))
    if wait > 0.0:
        _wait_until_ready(client, wait)
    return client


def _whom_to_ask(url: str | None, key: str | None, profile: str | None) -> tuple[str, str | None]:
    """Return address and key: a key is sent to no other address than the one that it was kept with."""
    if (url and key) and not profile:
        return url, key
    from servotune import profiles  # noqa: PLC0415 - most scripts need none

    kept = profiles.load(profile or profiles.DEFAULT)
    if profile and kept is None:
        known = ", ".join(profiles.names()) or "none"
        raise ValueError(f"profile must be one of `servotune login`, got {profile!r}: there is {known}")
    address = url or (kept.url if kept else HERE)
    own = kept is not None and kept.url.rstrip("/") == address.rstrip("/")
    return address, key or (kept.key if kept is not None and own else None)


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
