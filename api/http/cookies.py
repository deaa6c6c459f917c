"""The cookies of browsers: out of reach of scripts and of other sites, and over HTTPS of other hosts of the same domain, too.

A browser takes a cookie whose name begins with ``__Host-`` only over HTTPS, for the very host that sends it and for all of
its paths (RFC 6265bis, 4.1.3.2); so nobody else can put one in its place.
"""

from __future__ import annotations

from starlette.datastructures import Headers
from starlette.requests import cookie_parser
from starlette.responses import Response


def _name(plain: str, *, encrypted: bool) -> str:
    return f"__Host-{plain}" if encrypted else plain


def read(headers: Headers, plain: str, *, encrypted: bool) -> str | None:
    """Return the value of a cookie, None for one that is absent or empty."""
    return cookie_parser(headers.get("cookie", "")).get(_name(plain, encrypted=encrypted)) or None


def put(response: Response, plain: str, value: str, *, seconds: int, encrypted: bool) -> None:
    """Have the browser keep a cookie; it also comes along when another site, a sign-in's provider, sends the browser here."""
    name = _name(plain, encrypted=encrypted)
    response.set_cookie(name, value, max_age=seconds, path="/", secure=encrypted, httponly=True, samesite="lax")


def forget(response: Response, plain: str, *, encrypted: bool) -> None:
    """Have the browser forget a cookie."""
    name = _name(plain, encrypted=encrypted)
    response.delete_cookie(name, path="/", secure=encrypted, httponly=True, samesite="lax")
