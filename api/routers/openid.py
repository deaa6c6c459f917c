"""/sign-in: to the OpenID provider and back, for people with a browser."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import RedirectResponse

from api.auth import COOKIE
from api.calls import InstallationDep
from api.problems import Problem
from api.services import sign_ins
from api.services.installation import Installation
from api.services.openid import Attempt, Provider

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
    response.set_cookie(
        _ATTEMPT,
        attempt.text(),
        max_age=_ATTEMPT_LASTS,
        path="/sign-in",
        secure=service.settings.encrypted,
        httponly=True,
        samesite="lax",  # it must come along when the provider sends the browser back
    )
    return response


@router.get("/callback")
def finish(
    request: Request, service: InstallationDep, state: _Given = "", code: _Given = "", error: _Given = ""
) -> Response:
    """Sign the browser in that comes back."""
    provider = _provider(service)
    attempt = Attempt.of(request.cookies.get(_ATTEMPT, ""))
    if error or not code:
        raise Problem(403, "sign-in-refused", f"the provider must send a code, got {error[:100] or 'none'!r}")
    person = provider.finish(attempt, state=state, code=code)
    with service.database.session() as session:
        token = sign_ins.admit(service, session, person)
    response = RedirectResponse("/", status_code=303)
    secure = service.settings.encrypted
    response.delete_cookie(_ATTEMPT, path="/sign-in", secure=secure, httponly=True, samesite="lax")
    response.set_cookie(
        COOKIE,
        token,
        max_age=int(service.settings.sign_in_hours * 3600),
        path="/",
        secure=secure,
        httponly=True,
        samesite="lax",
    )
    return response
