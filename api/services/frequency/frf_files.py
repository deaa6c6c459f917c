"""Kept frequency response functions as universal files, which modal analysis programs read."""

from __future__ import annotations

from typing import Any

import numpy as np
from sqlalchemy.orm import Session

from api.formats import FormatError
from api.formats.writing.uff import FrequencyResponse, write
from api.problems.documents import Problem
from api.services.frequency.frfs import KIND
from api.services.operation.app_context import Caller
from storage.errors import NotFoundError
from storage.repositories import ResultRepository

_QUANTITIES = {
    "m": "displacement",
    "m/s": "velocity",
    "m/s**2": "acceleration",
    "N": "force",
    "Pa": "pressure",
}


def universal_file(session: Session, caller: Caller, identifier: str) -> bytes:
    """Return the responses of a kept result as datasets 58 in text, coherences behind them; lines in Hz.

    Raises
    ------
    Problem
        409 for lines that such a file cannot hold: uneven ones, or lines without a value.
    """
    repository = ResultRepository(session, caller.workspace)
    row = repository.get(identifier)
    if row.kind != KIND:
        raise NotFoundError("frequency response function", identifier)
    body = repository.body(row)
    functions = [_function(body, name, output) for name, output in body["outputs"].items()]
    try:
        return b"".join(write(functions, recorded=row.created_at))
    except FormatError as error:
        raise Problem(409, "conflict", error.message) from error


def _function(body: dict[str, Any], name: str, output: dict[str, Any]) -> FrequencyResponse:
    values = np.asarray(output["real"], dtype=np.float64) + 1j * np.asarray(output["imag"], dtype=np.float64)
    if not np.isfinite(values).all():
        detail = f"{name} must have a value on every line to be written: leave out those without excitation by `band`"
        raise Problem(409, "conflict", detail)
    coherence = output["coherence"]
    return FrequencyResponse(
        frequency=np.asarray(body["frequency"], dtype=np.float64) / (2 * np.pi),
        values=values,
        name=f"{name} / {body['input']}, {body['estimator']}",
        response=name,
        reference=body["input"],
        response_quantity=_QUANTITIES.get(output["response_unit"], ""),
        reference_quantity=_QUANTITIES.get(body["input_unit"], ""),
        response_unit=output["response_unit"],
        reference_unit=body["input_unit"],
        coherence=None if coherence is None else np.asarray(coherence, dtype=np.float64),
    )
