"""/sign-in: to the OpenID provider and back, for people with a browser."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import RedirectResponse

from api.http import cookies
from api.http.auth import COOKIE
from api.http.calls import InstallationDep
from api.problems.documents import Problem
from api.services.access import sign_ins
from api.services.access.openid import Attempt, Provider
from api.services.operation.app_context import Installation

router = APIRouter(prefix="/sign-in", include_in_schema=False)

_ATTEMPT = "servotune_openid"
_ATTEMPT_LASTS = 600  # s
_Given = Annotated[str, Query(max_length=4000)]


def _provider(service: Installation) -> Provider:
    if service.openid is None:
        raise Problem(404, "not-found", "the service must have an OpenID provider for this; sign in with a key")
    return service.openid


@router.get("")
def begin(service: InstallationDep) -> Response:
    """Send the browser to the provider."""
    where, attempt = _provider(service).begin()
    response = RedirectResponse(where, status_code=303)
    kept = service.vault.lend(attempt.text())
    cookies.put(response, _ATTEMPT, kept, seconds=_ATTEMPT_LASTS, encrypted=service.settings.encrypted)
    return response


@router.get("/callback")
def finish(
    request: Request, service: InstallationDep, state: _Given = "", code: _Given = "", error: _Given = ""
) -> Response:
    """Sign the browser in that comes back."""
    provider = _provider(service)
    encrypted = service.settings.encrypted
    kept = cookies.read(request.headers, _ATTEMPT, encrypted=encrypted)
    attempt = Attempt.of(service.vault.take_back(kept or "", seconds=_ATTEMPT_LASTS))
    if error or not code:
        raise Problem(403, "sign-in-refused", f"the provider must send a code, got {error[:100] or 'none'!r}")
    person = provider.finish(attempt, state=state, code=code)
    with service.database.session() as session:
        token = sign_ins.admit(service, session, person)
    response = RedirectResponse("/", status_code=303)
    lasts = int(service.settings.sign_in_hours * 3600)
    cookies.forget(response, _ATTEMPT, encrypted=encrypted)
    cookies.put(response, COOKIE, token, seconds=lasts, encrypted=encrypted)
    return response
