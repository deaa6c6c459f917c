"""One HTTP connection to the service: the key, the retries, and problem documents turned into exceptions.

A request is repeated after a network failure and after 429, 502, 503, 504. That is safe for every call made here: reads and
uploads are idempotent by nature, and whatever creates something carries an `Idempotency-Key` that stays the same when repeated.
"""

from __future__ import annotations

import random
import time
import uuid
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from servotune.encoding import encoded
from servotune.errors import ServiceUnreachableError, UnexpectedReplyError, VersionWarning, api_error
from servotune.replies.base import Reply

if TYPE_CHECKING:
    import httpx

_RETRIED = frozenset({429, 502, 503, 504})
_LONGEST_PAUSE = 20.0
_JITTER = random.SystemRandom()


class Transport:
    """Sends requests below one base address.

    Parameters
    ----------
    url : str
        Address of the service, `http://127.0.0.1:8000`.
    key : str or None
        API key, sent as `Authorization: Bearer`.
    timeout : float
        Longest silence of the service that is taken for work (s).
    attempts : int
        How often a request is sent before its failure is reported.
    """

    def __init__(self, url: str, *, key: str | None, timeout: float, attempts: int) -> None:
        import httpx  # noqa: PLC0415 - half of what the whole client takes to load

        headers = {"Accept": "application/json", "User-Agent": "servotune-python"}
        if key is not None:
            headers["Authorization"] = f"Bearer {key}"
        self.url, self.key = url.rstrip("/"), key
        self._attempts = attempts
        self._compared = False
        self._http = httpx.Client(
            base_url=self.url, headers=headers, timeout=httpx.Timeout(timeout, connect=5.0), follow_redirects=False
        )

    def close(self) -> None:
        """Close the connection."""
        self._http.close()

    def get(self, path: str, *, params: Mapping[str, Any] | None = None) -> Any:
        """Return the JSON body found at a path."""
        return self.body(self.send("GET", path, params=params))

    def post(
        self,
        path: str,
        document: Mapping[str, Any],
        *,
        creates: bool = False,
        params: Mapping[str, Any] | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> Any:
        """Post a JSON document; with `creates`, under a fresh idempotency key."""
        sent = {**(headers or {}), **({"Idempotency-Key": str(uuid.uuid4())} if creates else {})}
        return self.body(self.send("POST", path, json=document, params=params, headers=sent or None))

    def items(self, path: str, kind: type[Reply] = Reply, *, params: Mapping[str, Any] | None = None) -> Iterator[Any]:
        """Yield every item of a paginated list as a reply of that kind, following its cursors."""
        query = dict(params or {})
        while True:
            page = self.get(path, params=query)
            yield from map(kind, page["items"])
            cursor = page.get("next_cursor")
            if cursor is None:
                return
            query["cursor"] = cursor

    def send(
        self,
        method: str,
        path: str,
        *,
        json: Mapping[str, Any] | None = None,
        content: bytes | None = None,
        params: Mapping[str, Any] | None = None,
        headers: Mapping[str, str] | None = None,
        attempts: int | None = None,
    ) -> httpx.Response:
        """Send one request, repeating it as the module says, and return a successful response.

        Raises
        ------
        DocumentError
            The document holds what JSON cannot say.
        ApiError
            The service refused; the subclass says how.
        ServiceUnreachableError
            No answer in any attempt.
        """
        import httpx  # noqa: PLC0415 - as above

        body = None if json is None else encoded(json)
        tries = self._attempts if attempts is None else attempts
        for attempt in range(1, tries + 1):
            try:
                response = self._http.request(method, path, json=body, content=content, params=params, headers=headers)
            except httpx.TransportError as error:
                if attempt == tries:
                    raise self.unreachable(error) from error
                time.sleep(pause(attempt))
                continue
            if response.status_code in _RETRIED and attempt < tries:
                time.sleep(_asked_pause(response) or pause(attempt))
                continue
            return self.checked(response)
        message = f"attempts must be at least 1, got {tries}"
        raise ValueError(message)

    @contextmanager
    def stream(self, path: str, *, headers: Mapping[str, str], silence: float) -> Iterator[httpx.Response]:
        """Open a response that is read as it comes; the caller sees `httpx.TransportError` when it breaks off."""
        import httpx  # noqa: PLC0415 - as above

        timeout = httpx.Timeout(silence, connect=5.0)
        with self._http.stream("GET", path, headers=headers, timeout=timeout) as response:
            if response.is_error:
                response.read()
            yield self.checked(response)

    def checked(self, response: httpx.Response) -> httpx.Response:
        """Return a successful response; raise the problem that any other one describes."""
        self._compare(response.headers.get("Servotune-Version", ""))
        if response.is_success:
            return response
        request = f"{response.request.method} {response.request.url.path}"
        problem: Any = None
        if "json" in response.headers.get("Content-Type", ""):
            problem = self.body(response)
        if not isinstance(problem, Mapping):
            problem = {"title": response.reason_phrase, "detail": response.text.strip()[:200]}
        raise api_error(response.status_code, problem, request)

    def _compare(self, service: str) -> None:
        """Warn once where the service is of another version than this client, as far as its API may differ."""
        if self._compared or not service:
            return
        self._compared, own = True, _own_version()
        if own and service.split(".")[:2] != own.split(".")[:2]:
            warnings.warn(
                f"the service at {self.url} is of version {service}, this client of {own}, and each may not know what is new in the "
                f"other: pip install 'servotune=={service}'",
                VersionWarning,
                stacklevel=2,
            )

    def body(self, response: httpx.Response) -> Any:
        """Return the JSON body of a response, `None` when it is empty."""
        if not response.content:
            return None
        try:
            return response.json()
        except ValueError as error:
            message = f"the answer of {response.request.url} is not JSON: is this a Servotune service?"
            raise UnexpectedReplyError(message) from error

    def unreachable(self, error: httpx.TransportError) -> ServiceUnreachableError:
        """Return the exception that tells which address does not answer and what to try."""
        reason = str(error) or type(error).__name__
        return ServiceUnreachableError(
            f"no answer from {self.url}: {reason}. Is the service running (`servotune serve`)?"
        )


def _own_version() -> str:
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415 - a third of what the whole client takes to load

    try:
        return version("servotune")
    except PackageNotFoundError:  # run from its sources
        return ""


def pause(attempt: int) -> float:
    """Return how long to wait before the next attempt (s): doubling from 0.2 s, with jitter so that clients spread."""
    return float(min(_LONGEST_PAUSE, 0.2 * 2.0 ** (attempt - 1)) * _JITTER.uniform(0.5, 1.0))


def _asked_pause(response: httpx.Response) -> float | None:
    asked = response.headers.get("Retry-After", "")
    return min(float(asked), _LONGEST_PAUSE) if asked.isdigit() else None
