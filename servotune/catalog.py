"""The catalogue of the service."""

from __future__ import annotations

from servotune.replies import CatalogItem
from servotune.transport import Transport


class Catalog:
    """What the service knows: element kinds, metrics, optimisation methods, signals."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def elements(self) -> list[CatalogItem]:
        """Return every element kind: ports, parameters, equation, source."""
        return list(self._transport.items("/v1/catalog/elements", CatalogItem))

    def metrics(self) -> list[CatalogItem]:
        """Return every metric: definition, unit, source."""
        return list(self._transport.items("/v1/catalog/metrics", CatalogItem))

    def methods(self) -> list[CatalogItem]:
        """Return every optimisation method and its options."""
        return list(self._transport.items("/v1/catalog/methods", CatalogItem))

    def signals(self) -> list[CatalogItem]:
        """Return every command signal and its parameters."""
        return list(self._transport.items("/v1/catalog/signals", CatalogItem))
