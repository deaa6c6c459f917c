"""/v1/catalog: every element, signal, metric and method."""

from __future__ import annotations

from fastapi import APIRouter, Response

from api.http.auth import Reader
from api.http.calls import answer, respond
from api.schemas.replies import ElementEntry, MethodEntry, MetricEntry, Page, SignalEntry
from api.services.systems import catalog

router = APIRouter(prefix="/v1/catalog", tags=["catalog"])


@router.get("/elements", response_model=Page[ElementEntry], summary="List the kinds of blocks")
def elements(_: Reader) -> Response:
    """Ports, parameters, equation and source of every kind."""
    return respond(answer(catalog.element_list()))


@router.get("/signals", response_model=Page[SignalEntry], summary="List the kinds of commands")
def signals(_: Reader) -> Response:
    """Parameters and equation of every kind."""
    return respond(answer(catalog.signal_list()))


@router.get("/metrics", response_model=Page[MetricEntry], summary="List the metrics")
def metrics(_: Reader) -> Response:
    """Unit, definition and source of every metric."""
    return respond(answer(catalog.metric_list()))


@router.get("/methods", response_model=Page[MethodEntry], summary="List the optimisation methods")
def methods(_: Reader) -> Response:
    """Options of every method."""
    return respond(answer(catalog.method_list()))
