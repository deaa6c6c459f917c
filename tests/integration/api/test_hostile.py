"""What somebody with bad intentions writes into a document: refused in words at once, and the service goes on."""

from __future__ import annotations

import copy
import json

import httpx
import pytest

from tests.integration.api.documents import LAG

EXPRESSIONS = [
    "=__import__('os').system('id')",
    "=().__class__.__bases__[0].__subclasses__()",
    "=k.__class__(1)",
    "=eval('1')",
    "=exec('1')",
    "=open('/etc/passwd')",
    "=lambda: 1",
    "=[k for k in (1, 2)]",
    "={k: 1}",
    "=k if k else 1",
    "=k := 1",
    "=k; k",
    "=k\nk",
    "=k == 1",
    "=f'{k}'",
    "=$(id)",
    "=`id`",
    "=' OR 1=1 --",
    "=9**9**9**9",
    "=1e999",
    "=exp(exp(exp(k)))**999",
    "=" + "(" * 10_000 + "1" + ")" * 10_000,
    "=" + "+".join(["k"] * 100_000),
]
COMMAND = {"port": "u", "signal": {"kind": "step"}}


def in_a_parameter(text: str) -> dict[str, object]:
    system = copy.deepcopy(LAG)
    system["blocks"]["plant"]["numerator"] = [text]
    return system


def in_a_function(text: str) -> dict[str, object]:
    system = copy.deepcopy(LAG)
    system["blocks"]["law"] = {"kind": "function", "expression": text.removeprefix("=")}
    system["connections"].append({"from": "plant", "to": "law"})
    return system


@pytest.mark.parametrize("place", [in_a_parameter, in_a_function])
@pytest.mark.parametrize("text", EXPRESSIONS, ids=range(len(EXPRESSIONS)))
def test_an_expression_that_is_more_than_one_is_refused(sqlite_service, text, place) -> None:
    with sqlite_service.client() as client:
        reply = client.post("/v1/simulations", json={"system": place(text), "input": COMMAND})
        assert reply.status_code == 422, reply.text
        assert reply.headers["Content-Type"] == "application/problem+json"
        assert len(reply.content) < 5000  # what was got is shown short
        assert "Traceback" not in reply.text
        assert client.get("/healthz").status_code == 200


def nested(levels: int) -> str:
    return '{"system":' + '{"blocks":' * levels + "1" + "}" * levels + "}"


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ('{"system": NaN}', "numbers must be finite, got NaN at /system"),
        ('{"system": -Infinity}', "numbers must be finite, got -Infinity at /system"),
        ('{"system": 1e400}', "numbers must be below 1.8e308, got 1e400 at /system"),
        (f'{{"system": 1{"0" * 400}}}', "numbers must be below 1.8e308, got 401 digits at /system"),
        (nested(200), "at most 128 levels deep"),
        (nested(20_000), "at most 128 levels deep"),
        ('{"system": "\\u0000"}', "text must be Unicode without NUL"),
        ('{"system": "\\ud800"}', "text must be Unicode without NUL"),
        ('{"system": 1, "system": 2}', "a key must stand once in an object, got 'system' twice"),
        ('{"system": "' + "\\\\" * 200_000, "the body must be JSON"),
    ],
    ids=range(10),
)
def test_a_body_that_breaks_parsers_is_refused(sqlite_service, body, says) -> None:
    with sqlite_service.client() as client:
        reply = client.post("/v1/simulations", content=body, headers={"Content-Type": "application/json"})
        assert reply.status_code == 422, reply.text
        assert says in reply.json()["detail"]


def test_more_keys_than_a_document_may_have_are_refused_at_once(sqlite_service) -> None:
    body = json.dumps({f"k{i:x}": 0 for i in range(80_000)})  # below the usual limit of a body, and as many as fit
    with httpx.Client(base_url=sqlite_service.url, trust_env=False, timeout=60) as anybody:
        assert anybody.post("/v1/simulations", content=body).status_code == 401  # nobody without a key has it read
    with sqlite_service.client() as client:
        reply = client.post("/v1/simulations", content=body, headers={"Content-Type": "application/json"})
        assert reply.status_code == 422, reply.text
        assert len(reply.content) < 50_000
