"""Workers of a search on other machines: a Dask cluster, reached through its scheduler.

What it is asked is computed by `optimizers.evaluation.spreading`, which computes itself whatever does not come back: a job does not
depend on the cluster for its numbers, nor for its end.
"""

from __future__ import annotations

import logging
import time
from typing import TYPE_CHECKING, Any, Final

from optimizers.evaluation.processes import Processes
from optimizers.evaluation.spreading import Workers

if TYPE_CHECKING:
    from api.settings import Settings
    from optimizers.evaluation.spreading import Provider

ANSWER: Final = 10.0
"""s within which a scheduler has to answer."""
COUNTED: Final = 5.0
"""s for which the number of workers is taken as it was."""
AGAIN: Final = 60.0
"""s after which one is asked again that did not."""
EXPECTED_AGAIN: Final = 600.0
"""s for which no workers are counted on that are to come, once none came."""

_log = logging.getLogger("servotune.cluster")


class Cluster:
    """The workers behind a scheduler; those of this machine while it does not answer.

    Parameters
    ----------
    address : str
        ``tls://host:port`` or ``tcp://host:port``.
    security : dict
        Files for TLS: ``tls_ca_file``, ``tls_client_cert``, ``tls_client_key``.
    adaptive : int
        How many workers may be counted on before they are there, where a cluster grows as it is asked.
    here : Provider
        Who computes meanwhile.
    """

    def __init__(self, address: str, *, security: dict[str, str], adaptive: int, here: Provider) -> None:
        self._address, self._security, self._adaptive, self._here = address, security, adaptive, here
        self._client: Any = None
        self._not_before = self._counted_until = self._expected_from = 0.0
        self._threads = 0

    def open(self) -> Workers | None:
        """Return the workers there are."""
        if self._client is None and time.monotonic() >= self._not_before:
            self._connect()
        if self._client is not None and time.monotonic() >= self._counted_until:
            self._count()
        count = max(self._threads, self._adaptive if time.monotonic() >= self._expected_from else 0)
        if self._client is None or not count:
            return self._here.open()
        return Workers(executor=self._client.get_executor(pure=False, retries=2), count=count, threaded=False)

    def lost(self) -> None:
        """Ask whether the scheduler is still there; one that is not is left alone for a while."""
        if self._client is None:
            self._here.lost()
            return
        self._count()
        if not self._threads:
            self._expected_from = time.monotonic() + EXPECTED_AGAIN

    def close(self) -> None:
        """Leave the cluster, and end what computes here."""
        client, self._client = self._client, None
        if client is not None:
            client.close(timeout=1)
        self._here.close()

    def _connect(self) -> None:
        from distributed import Client  # noqa: PLC0415 - half a second, and most jobs need no cluster
        from distributed.security import Security  # noqa: PLC0415

        try:
            self._client = Client(
                self._address, security=Security(require_encryption=True, **self._security) if self._security else None,
                timeout=ANSWER, set_as_default=False,
            )  # fmt: skip
        except (OSError, ValueError, RuntimeError) as error:
            self._leave(error)

    def _count(self) -> None:
        """Ask how many workers there are; leave a scheduler that does not answer."""
        try:
            told = self._client.sync(self._client.scheduler.identity, n_workers=0, callback_timeout=ANSWER)
        except Exception as error:  # noqa: BLE001 - however it shows, it does not answer
            self._leave(error)
        else:
            self._threads, self._counted_until = int(told["total_threads"]), time.monotonic() + COUNTED

    def _leave(self, error: Exception) -> None:
        _log.warning(
            "the scheduler %s does not answer, and is asked again after %g s: %s: %s",
            self._address, AGAIN, type(error).__name__, error,
        )  # fmt: skip
        self._not_before = time.monotonic() + AGAIN
        client, self._client = self._client, None
        if client is not None:
            client.close(timeout=1)


def workers_of(settings: Settings, processors: int) -> Provider:
    """Return who computes the candidates of a job, of which this machine computes as many as it has slots."""
    here = Processes(processors // settings.worker_slots)
    if settings.cluster is None:
        return here
    files = {
        "tls_ca_file": settings.cluster_ca,
        "tls_client_cert": settings.cluster_cert,
        "tls_client_key": settings.cluster_key,
    }
    security = {name: str(path) for name, path in files.items() if path is not None}
    return Cluster(settings.cluster, security=security, adaptive=settings.cluster_adaptive, here=here)
