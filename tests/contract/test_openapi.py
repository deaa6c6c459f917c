"""openapi/openapi.json is the contract: the code makes exactly this, and it says what clients rely on."""

from __future__ import annotations

import pytest

from api.app.export_openapi import render
from engine import elements, signals
from optimizers import methods
from tests.support.contract import DOCUMENT, SNAPSHOT

ENDPOINTS = [
    "POST /v1/systems",
    "GET /v1/systems",
    "GET /v1/systems/{identifier}",
    "PUT /v1/systems/{identifier}",
    "DELETE /v1/systems/{identifier}",
    "GET /v1/systems/{identifier}/revisions",
    "GET /v1/systems/{identifier}/revisions/{number}",
    "POST /v1/simulations",
    "POST /v1/frequency-responses",
    "POST /v1/influence",
    "POST /v1/validations",
    "POST /v1/optimizations",
    "POST /v1/identifications",
    "GET /v1/jobs",
    "GET /v1/jobs/{identifier}",
    "GET /v1/jobs/{identifier}/result",
    "GET /v1/jobs/{identifier}/events",
    "POST /v1/jobs/{identifier}/cancel",
    "POST /v1/datasets",
    "GET /v1/datasets",
    "GET /v1/datasets/{identifier}",
    "DELETE /v1/datasets/{identifier}",
    "PUT /v1/datasets/{identifier}/segments/{sha256}",
    "GET /v1/datasets/{identifier}/segments",
    "POST /v1/datasets/{identifier}/commit",
    "GET /v1/datasets/{identifier}/channels/{name}",
    "GET /v1/datasets/{identifier}/original",
    "GET /v1/results",
    "GET /v1/results/{identifier}",
    "GET /v1/catalog/elements",
    "GET /v1/catalog/signals",
    "GET /v1/catalog/metrics",
    "GET /v1/catalog/methods",
    "POST /v1/keys",
    "GET /v1/keys",
    "GET /v1/keys/{identifier}",
    "DELETE /v1/keys/{identifier}",
    "POST /v1/keys/{identifier}/rotate",
    "POST /v1/workspaces",
    "GET /v1/workspaces",
    "GET /v1/workspaces/{identifier}",
    "PUT /v1/workspaces/{identifier}",
    "POST /v1/session",
    "GET /v1/session",
    "DELETE /v1/session",
    "POST /v1/tickets",
    "GET /v1/audit",
    "POST /v1/schedules",
    "GET /v1/schedules",
    "GET /v1/schedules/{identifier}",
    "PUT /v1/schedules/{identifier}",
    "DELETE /v1/schedules/{identifier}",
    "POST /v1/schedules/{identifier}/trigger",
    "POST /v1/schedules/{identifier}/pause",
    "POST /v1/schedules/{identifier}/resume",
    "GET /v1/schedules/{identifier}/runs",
    "POST /v1/webhooks",
    "GET /v1/webhooks",
    "GET /v1/webhooks/{identifier}",
    "PUT /v1/webhooks/{identifier}",
    "DELETE /v1/webhooks/{identifier}",
    "POST /v1/webhooks/{identifier}/test",
    "GET /v1/webhooks/{identifier}/deliveries",
    "GET /v1/alerts",
    "GET /v1/alerts/{identifier}",
    "GET /healthz",
    "GET /readyz",
]


def test_the_snapshot_is_what_the_code_makes() -> None:
    assert SNAPSHOT.read_text(encoding="utf-8") == render(), "run `make openapi` and look at the difference"


@pytest.mark.parametrize("endpoint", ENDPOINTS)
def test_what_the_contract_promises_is_there(endpoint) -> None:
    method, _, path = endpoint.partition(" ")
    assert method.lower() in DOCUMENT["paths"][path]


def operations():
    return [
        (f"{method.upper()} {path}", operation)
        for path, methods_of in DOCUMENT["paths"].items()
        for method, operation in methods_of.items()
    ]


@pytest.mark.parametrize(("endpoint", "operation"), operations())
def test_every_operation_under_v1_asks_for_a_key_and_answers_errors_as_problems(endpoint, operation) -> None:
    assert operation["summary"]
    if not endpoint.split()[1].startswith("/v1"):
        return
    assert operation["security"] == [{"HTTPBearer": []}]
    for status in ("401", "403", "422"):
        assert "application/problem+json" in operation["responses"][status]["content"]


#: Repeated, they do no harm; what some of them answer is a secret, and no secret is kept to be repeated.
UNREPEATED = {
    "POST /v1/state-space",
    "POST /v1/jobs/{identifier}/pause",
    "POST /v1/jobs/{identifier}/resume",
    # What an agent says of its attempt is the same when it says it twice; a claim is of what waits now.
    "POST /v1/acquisitions/{identifier}/attempts/{number}/dataset",
    "POST /v1/acquisitions/{identifier}/attempts/{number}/finish",
    "POST /v1/acquisitions/{identifier}/attempts/{number}/heartbeat",
    "POST /v1/acquisitions/{identifier}/cancel",
    "POST /v1/agents",
    "POST /v1/agents/{identifier}/claim",
    "POST /v1/jobs/{identifier}/cancel",
    "POST /v1/schedules/{identifier}/pause",
    "POST /v1/schedules/{identifier}/resume",
    "POST /v1/session",
    "POST /v1/tickets",
}


@pytest.mark.parametrize(("endpoint", "operation"), operations())
def test_every_post_that_creates_takes_an_idempotency_key(endpoint, operation) -> None:
    if endpoint.startswith("POST") and endpoint not in UNREPEATED:
        assert "Idempotency-Key" in [parameter["name"] for parameter in operation["parameters"]]


#: What is sent has its hash in its address; a key is revoked and a visit ends whatever has become of it meanwhile.
UNCONDITIONAL = {
    "PUT /v1/datasets/{identifier}/segments/{sha256}",
    "DELETE /v1/keys/{identifier}",
    "DELETE /v1/session",
}


@pytest.mark.parametrize(("endpoint", "operation"), operations())
def test_what_changes_a_document_says_which_revision_it_is_for(endpoint, operation) -> None:
    if endpoint.startswith(("PUT", "DELETE")):
        names = {parameter["name"] for parameter in operation.get("parameters", ())}
        assert ("If-Match" in names) == (endpoint not in UNCONDITIONAL)


def properties_of(operation):
    """Return the names in the JSON that a call answers when all is well."""
    reply = operation["responses"].get("200", {}).get("content", {}).get("application/json", {}).get("schema", {})
    if "$ref" in reply:
        reply = DOCUMENT["components"]["schemas"][reply["$ref"].rpartition("/")[2]]
    return set(reply.get("properties", ()))


@pytest.mark.parametrize(("endpoint", "operation"), operations())
def test_every_list_comes_in_pages(endpoint, operation) -> None:
    if not properties_of(operation) >= {"items"}:
        return
    assert "next_cursor" in properties_of(operation)
    # A catalogue is what the software knows: it is short, and the same for everybody.
    asked = {parameter["name"] for parameter in operation.get("parameters", ())}
    assert (asked >= {"cursor", "limit"}) != endpoint.startswith("GET /v1/catalog/")


def test_the_lists_are_found() -> None:
    assert sum(properties_of(operation) >= {"items"} for _, operation in operations()) >= 20


def tags(schema):
    """Return the mapping of every discriminator in a schema."""
    if isinstance(schema, dict):
        found = [schema["discriminator"]["mapping"]] if "discriminator" in schema else []
        return found + [mapping for value in schema.values() for mapping in tags(value)]
    return []


@pytest.mark.parametrize(
    ("schema", "kinds"),
    [
        ("SystemDocument", {*elements.catalogue(), "subsystem"}),
        ("InputDocument", set(signals.catalogue())),
        ("OptimizationRequest", set(methods.catalogue())),
    ],
)
def test_every_kind_of_the_catalogue_is_in_the_contract(schema, kinds) -> None:
    properties = DOCUMENT["components"]["schemas"][schema]["properties"]
    (mapping,) = [
        found for name in ("blocks", "signal", "method") if name in properties for found in tags(properties[name])
    ]
    assert set(mapping) == kinds


def test_a_parameter_carries_symbol_unit_and_bounds() -> None:
    area = DOCUMENT["components"]["schemas"]["LinearPneumaticMotorBlock"]["properties"]["area"]
    assert area["x-unit"] == "m**2"
    assert area["x-symbol"]
    assert area["description"]
    assert area["x-lower"] == 0.0
