"""The catalogue of the service."""

from __future__ import annotations

from typing import TYPE_CHECKING

from servotune.transport import Transport

if TYPE_CHECKING:
    from servotune.replies import CatalogItem


class Catalog:
    """What the service knows: element kinds, metrics, optimisation methods, signals."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def elements(self) -> list[CatalogItem]:
        """Return every element kind: ports, parameters, equation, source."""
        return list(self._transport.items("/v1/catalog/elements"))

    def metrics(self) -> list[CatalogItem]:
        """Return every metric: definition, unit, source."""
        return list(self._transport.items("/v1/catalog/metrics"))

    def methods(self) -> list[CatalogItem]:
        """Return every optimisation method and its options."""
        return list(self._transport.items("/v1/catalog/methods"))

    def signals(self) -> list[CatalogItem]:
        """Return every command signal and its parameters."""
        return list(self._transport.items("/v1/catalog/signals"))
