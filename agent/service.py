"""What an agent says to the service, and the three ways in which it is not heard: no answer, no key, no."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import httpx

from agent.errors import SettingsError
from agent.spool import Segment


class ServiceError(Exception):
    """The service has not done what it was asked for."""


class UnreachableError(ServiceError):
    """No answer, or one of something between here and the service: it can be tried again."""


class KeyRefusedError(ServiceError):
    """The key is revoked, expired, or may not acquire: nothing goes on before it is replaced."""


class RefusedError(ServiceError):
    """The service says no; ``kind`` is the last part of the problem's type, ``faults`` pointer and sentence of what is wrong."""

    def __init__(self, status: int, kind: str, detail: str, *, faults: Sequence[tuple[str, str]] = ()) -> None:
        super().__init__(detail)
        self.status = status
        self.kind = kind
        self.faults = tuple(faults)


class Service:
    """The service over HTTP.

    Parameters
    ----------
    url : str
    key : callable
        Gives the key; asked for every request, because it may be replaced.
    timeout : float
        Longest silence, s.
    """

    def __init__(self, url: str, *, key: Callable[[], str], timeout: float) -> None:
        self._key = key
        self._timeout = timeout
        self._http = httpx.Client(
            base_url=url.rstrip("/"), timeout=httpx.Timeout(timeout, connect=min(timeout, 5.0)), follow_redirects=False
        )

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def admits(self) -> None:
        """Make sure that the service answers and the key may acquire: work is asked for of an agent that there is not.

        Raises
        ------
        ServiceError
            No answer, or a key that may not.
        """
        with contextlib.suppress(RefusedError):
            self.claim("nobody", wait=0.0)

    def register(self, document: Mapping[str, Any], *, timeout: float | None = None) -> dict[str, Any]:
        """Take the rig."""
        return self._json("POST", "/v1/agents", document, timeout=min(timeout or self._timeout, self._timeout))

    def judge(self, document: Mapping[str, Any]) -> None:
        """Let the service judge a rig, and register nothing.

        Raises
        ------
        ServiceError
            `RefusedError` with what is wrong of each channel.
        """
        headers = {"Content-Type": "application/json"}
        content = json.dumps(document, allow_nan=False).encode()
        self._send("POST", "/v1/agents", params={"check": "true"}, content=content, headers=headers)

    def claim(self, agent: str, *, wait: float) -> dict[str, Any] | None:
        """Wait for an attempt; None when there was none."""
        reply = self._send(
            "POST", f"/v1/agents/{agent}/claim", params={"wait": f"{wait:g}"}, timeout=wait + self._timeout
        )
        found: dict[str, Any] | None = reply.json() if reply.content else None
        return found

    def heartbeat(self, claim: Mapping[str, Any], document: Mapping[str, Any]) -> dict[str, Any]:
        """Keep the lease of an attempt; a busy service gets a third of it to answer."""
        patience = min(self._timeout, float(claim["lease_seconds"]) / 3)
        return self._json("POST", f"{_attempt(claim)}/heartbeat", document, timeout=patience)

    def open_dataset(self, claim: Mapping[str, Any], document: Mapping[str, Any]) -> str:
        """Open the recording of an attempt, and return its id."""
        return str(self._json("POST", f"{_attempt(claim)}/dataset", document)["id"])

    def finish(self, claim: Mapping[str, Any], document: Mapping[str, Any]) -> dict[str, Any]:
        """End an attempt."""
        return self._json("POST", f"{_attempt(claim)}/finish", document)

    def segments(self, dataset: str) -> set[str]:
        """Return the hashes of what is there."""
        found: set[str] = set()
        query: dict[str, str] = {"limit": "1000"}
        while True:
            page = self._send("GET", f"/v1/datasets/{dataset}/segments", params=query).json()
            found |= {entry["sha256"] for entry in page["items"]}
            if page["next_cursor"] is None:
                return found
            query["cursor"] = page["next_cursor"]

    def put(self, dataset: str, segment: Segment, data: bytes) -> None:
        """Bring a segment; the service hashes it again."""
        headers = {"Content-Type": "application/octet-stream"}
        self._send("PUT", f"/v1/datasets/{dataset}/segments/{segment.sha256}", content=data, headers=headers)

    def commit(self, dataset: str, manifest: Mapping[str, Any]) -> dict[str, Any]:
        """Close a recording; the service hashes the whole, which takes its time."""
        return self._json("POST", f"/v1/datasets/{dataset}/commit", manifest, timeout=max(self._timeout, 900.0))

    def _json(self, method: str, path: str, document: Mapping[str, Any], **given: Any) -> dict[str, Any]:
        headers = {"Content-Type": "application/json"}
        content = json.dumps(document, allow_nan=False).encode()
        found: dict[str, Any] = self._send(method, path, content=content, headers=headers, **given).json()
        return found

    def _send(
        self, method: str, path: str, *, headers: Mapping[str, str] | None = None, **given: Any
    ) -> httpx.Response:
        try:
            key = self._key()
        except SettingsError as error:
            raise KeyRefusedError(str(error)) from error
        told = {"Authorization": f"Bearer {key}", "User-Agent": "servotune-agent", **(headers or {})}
        try:
            reply = self._http.request(method, path, headers=told, **given)
        except httpx.TransportError as error:
            raise UnreachableError(
                f"no answer from {self._http.base_url}: {str(error) or type(error).__name__}"
            ) from error
        if reply.is_success:
            return reply
        problem = _problem(reply)
        detail = str(problem.get("detail") or reply.reason_phrase)
        if reply.status_code in {401, 403} and problem.get("quota") is None:
            raise KeyRefusedError(detail)
        if reply.status_code >= 500 or reply.status_code in {403, 408, 429}:
            raise UnreachableError(f"{reply.status_code} from {self._http.base_url}: {detail}")
        faults = [(str(entry.get("pointer")), str(entry.get("detail"))) for entry in problem.get("errors", ())]
        kind = str(problem.get("type", "")).rpartition(":")[2]
        raise RefusedError(reply.status_code, kind, detail, faults=faults)


def _attempt(claim: Mapping[str, Any]) -> str:
    return f"/v1/acquisitions/{claim['acquisition']}/attempts/{claim['attempt']}"


def _problem(reply: httpx.Response) -> dict[str, Any]:
    try:
        found = reply.json()
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
