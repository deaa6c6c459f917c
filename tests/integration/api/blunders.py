"""A client that asks wrongly before it asks rightly, and holds what it is told to the contract.

It goes by the operation in the OpenAPI document: what takes an ``If-Match`` is first asked without one, with one that is no tag and
with a stale one, and nothing may have changed; what takes an ``Idempotency-Key`` is asked twice at once, then again, then with
another body and another query, and it is done once.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from typing import Any
from uuid import uuid4

import httpx

from tests.support.contract import OPERATIONS

#: Shown once and kept nowhere: null in a repetition.
SECRETS = {"key", "secret"}
#: What is taken in and done later, and is no job: it stands in the list of deliveries.
NO_JOB = {"POST /v1/webhooks/{identifier}/test"}
_PATTERNS = {name: re.compile(re.sub(r"\\{\w+\\}", "[^/]+", re.escape(name))) for name in OPERATIONS}


def require_problem(reply: httpx.Response, status: int, kind: str | None = None) -> dict[str, Any]:
    """Return the problem document of a refusal (RFC 9457)."""
    assert reply.status_code == status, (reply.request.method, reply.request.url, reply.text)
    assert reply.headers["Content-Type"] == "application/problem+json"
    body: dict[str, Any] = reply.json()
    assert set(body) >= {"type", "title", "status", "detail"}
    assert body["status"] == status
    assert body["type"].startswith("urn:servotune:problem:")
    assert kind is None or body["type"].endswith(f":{kind}"), body
    assert "Traceback" not in reply.text
    return body


def operation_of(method: str, path: str) -> str:
    """Return the operation of the contract that a request means: of two patterns that fit, the one with fewer names."""
    found = [name for name, pattern in _PATTERNS.items() if pattern.fullmatch(f"{method} {path}")]
    return min(found, key=lambda name: name.count("{"))


class Blunderer(httpx.Client):
    """Makes every request wrongly first; ``conditional`` and ``repeated`` count what it did so."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.conditional: Counter[str] = Counter()
        self.repeated: Counter[str] = Counter()

    def request(self, method: str, url: Any, **options: Any) -> httpx.Response:
        """Ask wrongly in every way that the contract has an answer for, then rightly; return the right answer."""
        operation = operation_of(method, str(url))
        takes = {parameter["name"] for parameter in OPERATIONS[operation].get("parameters", ())}
        options["headers"] = dict(options.get("headers") or {})
        if "If-Match" in takes:
            reply = self._conditionally(method, str(url), options)
            self.conditional[operation] += 1
        elif "Idempotency-Key" in takes:
            reply = self._again_and_again(method, str(url), options)
            self.repeated[operation] += 1
        else:
            reply = super().request(method, url, **options)
        if reply.status_code == 202 and operation not in NO_JOB:
            # The job may be looked at from the first moment.
            assert super().request("GET", reply.headers["Location"]).status_code == 200
        return reply

    def _conditionally(self, method: str, url: str, options: dict[str, Any]) -> httpx.Response:
        def ask(tag: str | None) -> httpx.Response:
            headers = {name: value for name, value in options["headers"].items() if name != "If-Match"}
            headers |= {} if tag is None else {"If-Match": tag}
            return super(Blunderer, self).request(method, url, **{**options, "headers": headers})

        def look(**headers: str) -> httpx.Response:
            return super(Blunderer, self).request("GET", url, headers=headers)

        before = look()
        tag = before.headers["ETag"]
        assert look(**{"If-None-Match": tag}).status_code == 304
        require_problem(ask(None), 428, "precondition-required")
        require_problem(ask("no tag"), 412, "revision-conflict")
        require_problem(ask('"999999"'), 412, "revision-conflict")
        after = look()
        assert (after.content, after.headers["ETag"]) == (before.content, tag)
        reply = ask(tag)
        if method == "DELETE":
            require_problem(ask(tag), 404, "not-found")
        else:
            assert reply.headers["ETag"] == look().headers["ETag"] != tag
            require_problem(ask(tag), 412, "revision-conflict")
        return reply

    def _again_and_again(self, method: str, url: str, options: dict[str, Any]) -> httpx.Response:
        headers = {"Idempotency-Key": str(uuid4())} | options["headers"]
        meant = {name: options.get(name) for name in ("json", "content", "params")}
        ready = self.build_request(method, url, headers=headers, **meant)

        def ask(*, more: bytes = b"", query: dict[str, str] | None = None) -> httpx.Response:
            body = ready.content + more
            typed = {"Content-Type": "application/json"} if body else {}
            where = ready.url.copy_merge_params(query or {})
            return super(Blunderer, self).request(method, where, content=body, headers={**headers, **typed})

        with ThreadPoolExecutor(2) as threads:
            pair = [asked.result() for asked in [threads.submit(ask), threads.submit(ask)]]
        late = [reply for reply in pair if reply.status_code == 409 or "Idempotency-Replayed" in reply.headers]
        (first,) = [reply for reply in pair if reply not in late]
        assert first.is_success, first.text
        for reply in [*late, ask()]:
            if reply.status_code == 409:
                require_problem(reply, 409, "idempotency-key-in-use")
            else:
                assert_repeats(first, reply)
        assert "Idempotency-Replayed" in reply.headers
        for other in (ask(more=b"{}" if not ready.content else b" "), ask(query={"another": "1"})):
            require_problem(other, 422, "idempotency-key-reused")
        return first


def assert_repeats(first: httpx.Response, again: httpx.Response) -> None:
    """Hold a repetition to what was answered the first time: all of it but secrets."""
    assert again.headers["Idempotency-Replayed"] == "true"
    assert again.status_code == first.status_code
    assert again.headers.get("Location") == first.headers.get("Location")
    said = json.loads(first.content)
    assert again.json() == {**said, **dict.fromkeys(SECRETS & said.keys())}
