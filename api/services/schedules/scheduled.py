"""The kinds of work that can be scheduled: how each is proven to make sense, and handed to the workers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from pydantic import ValidationError
from sqlalchemy.orm import Session

from api.problems.documents import invalid
from api.schemas.acquisitions import AcquisitionRequest
from api.schemas.identifications import IdentificationRequest
from api.schemas.optimizations import OptimizationRequest
from api.schemas.validations import ValidationRequest
from api.services.identifications import identifications
from api.services.operation.app_context import Caller, Installation
from api.services.optimizations import optimizations
from api.services.rigs import acquisitions
from api.services.validations import validations
from storage.repositories.acquisitions import KIND

Submit = Callable[[Session], str]
"""Writes a job down in a transaction and returns its id."""


def prepare(service: Installation, caller: Caller, kind: str, body: Mapping[str, Any]) -> Submit:
    """Prove that a job can be run as things are now; return what hands it to the workers.

    Raises
    ------
    Problem, EngineError
        422 with the place in ``body`` of what is wrong.
    """
    try:
        return _KINDS[kind](service, caller, body)
    except ValidationError as error:  # a body that was kept by another version
        first = error.errors()[0]
        raise invalid(f"body must be one that this version reads: {first['msg']}", *first["loc"]) from error


def _optimization(service: Installation, caller: Caller, body: Mapping[str, Any]) -> Submit:
    request = OptimizationRequest.model_validate(body)
    prepared = optimizations.prepare(service, caller, request)
    return lambda session: str(optimizations.submit(service, session, caller, request, prepared)["id"])


def _identification(service: Installation, caller: Caller, body: Mapping[str, Any]) -> Submit:
    request = IdentificationRequest.model_validate(body)
    prepared = identifications.prepare(service, caller, request)
    return lambda session: str(identifications.submit(service, session, caller, request, prepared)["id"])


def _validation(service: Installation, caller: Caller, body: Mapping[str, Any]) -> Submit:
    request = ValidationRequest.model_validate(body)
    subject = validations.prove(service, caller, request)
    return lambda session: str(validations.submit(service, session, caller, request, subject)["id"])


def _acquisition(service: Installation, caller: Caller, body: Mapping[str, Any]) -> Submit:
    prepared = acquisitions.prepare(service, caller, AcquisitionRequest.model_validate(body))
    return lambda session: str(acquisitions.submit(session, caller, prepared)["job"])


_KINDS: Mapping[str, Callable[[Installation, Caller, Mapping[str, Any]], Submit]] = {
    optimizations.KIND: _optimization,
    identifications.KIND: _identification,
    validations.KIND: _validation,
    KIND: _acquisition,
}
