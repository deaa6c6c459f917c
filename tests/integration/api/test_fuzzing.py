"""Requests made at random from the contract, right and wrong ones: no error of the service's own, no reply but what the contract says.

Schemathesis makes them from the OpenAPI document of the running service (https://schemathesis.readthedocs.io). A small share runs
with all tests, the same requests on every machine; `make fuzz` asks far more.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from copy import deepcopy
from typing import Any

import pytest
import requests
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis.errors import FlakyStrategyDefinition
from hypothesis.stateful import run_state_machine_as_test
from schemathesis import GenerationMode, openapi
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from tests.integration.api.conftest import Service, serving
from tests.integration.api.documents import LAG, OPTIMIZATION, RAW, lag_recording, upload
from tests.integration.api.rigs import AGENT, MEASUREMENT
from tests.integration.api.test_schedules import NIGHTLY
from tests.support import contract

CHECKS = [
    not_a_server_error,
    status_code_conformance,
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
]
SCHEMA = openapi.from_dict(contract.DOCUMENT)
OPERATIONS = {operation.ok().label: operation.ok() for operation in SCHEMA.get_all_operations()}
#: Random bodies are rarely right: every other time a story asks for one of these things as people do, and goes on with it.
RIGHT: dict[str, dict[str, Any]] = {
    "POST /v1/systems": LAG,
    "PUT /v1/systems/{identifier}": LAG,
    "POST /v1/datasets": RAW,
    "POST /v1/agents": AGENT,
    "POST /v1/acquisition-templates": MEASUREMENT,
    "POST /v1/acquisitions": MEASUREMENT,
    "POST /v1/webhooks": {"name": "x", "url": "https://webhooks.example/", "events": ["job.failed"]},
    "POST /v1/schedules": NIGHTLY,
    "POST /v1/keys": {"name": "x", "scopes": ["read"]},
    "POST /v1/simulations": {"system": LAG, "input": {"port": "u", "signal": {"kind": "step"}}, "keep": True},
    "POST /v1/optimizations": OPTIMIZATION | {"system": LAG},
}
#: Of the examples of a property: one in so many.
SHARE = 12
WHOLE = settings.default.max_examples > 1000
DATA = lag_recording(samples=100)


def cases() -> list[Any]:
    """Return every operation with right requests, and with wrong ones where anything of a request can be wrong."""
    found = []
    for label in sorted(OPERATIONS):
        described = contract.OPERATIONS[label]
        found.append(pytest.param(label, GenerationMode.POSITIVE, id=f"right {label}"))
        if "parameters" in described or "requestBody" in described:
            found.append(pytest.param(label, GenerationMode.NEGATIVE, id=f"wrong {label}"))
    return found


#: Random requests ask little of a database that a second kind would answer in another way; at full size both are asked.
pytestmark = pytest.mark.parametrize(
    "module_database_url", ["sqlite", "postgres"] if WHOLE else ["sqlite"], indirect=True, scope="module"
)


@pytest.fixture(scope="module")
def fuzzed(module_database_url: str) -> Iterator[Service]:
    with serving(module_database_url, request_seconds=5) as running:
        yield running


@pytest.fixture(scope="module")
def session(fuzzed) -> Iterator[requests.Session]:
    with requests.Session() as own:
        own.trust_env = False
        yield own


@pytest.mark.parametrize("kind", ["csv", "mat", "parquet", "hdf5"])
def test_what_is_not_ready_is_not_exported(fuzzed, kind) -> None:
    """Random requests found an answer 500 here."""
    with fuzzed.client() as client:
        for body in (RAW, {"name": "x", "format": "csv"}):
            made = client.post("/v1/datasets", json=body).json()["id"]
            reply = client.get(f"/v1/datasets/{made}/export", params={"format": kind})
            assert (reply.status_code, "must be ready, it is open" in reply.text) == (409, True)


def test_windows_without_length_and_ports_without_name_are_refused_at_their_place(fuzzed) -> None:
    """Random requests found an answer 500 here."""
    right = {"dataset": "ds_none", "inputs": {"u": "u"}, "outputs": {"y": "y"}}
    empty = {"estimation": [0, 0], "validation": [0, 0]}
    with fuzzed.client() as client:
        assert upload(client, RAW, DATA, segment=len(DATA)).status_code == 200
        right["dataset"] = client.get("/v1/datasets").json()["items"][0]["id"]
        for wrong, place in (
            (empty, "/estimation"),
            ({"inputs": {"": "u"}}, "/inputs/"),
            ({"outputs": {"": "y"}}, "/outputs/"),
        ):
            for body, before in ((right | wrong, ""), ({"experiments": [right | wrong]}, "/experiments/0")):
                reply = client.post("/v1/identifications", json={"system": LAG, "parameters": ["k"], **body})
                assert reply.status_code == 422, reply.text
                assert before + place in {error["pointer"] for error in reply.json()["errors"]}


@pytest.mark.parametrize(("label", "mode"), cases())
def test_every_reply_is_in_the_contract(fuzzed, session, label, mode) -> None:
    @settings(
        max_examples=max(1, settings.default.max_examples // SHARE),
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(case=OPERATIONS[label].as_strategy(generation_mode=mode))
    def ask(case) -> None:
        case.call_and_validate(
            base_url=fuzzed.url,
            session=session,
            headers={"Authorization": f"Bearer {fuzzed.keys['admin']}"},
            checks=CHECKS,
            timeout=120,  # a machine may be busy; that the service is quick is shown elsewhere
        )

    ask()


def test_what_follows_from_replies_is_in_the_contract_too(fuzzed) -> None:
    """Schemathesis goes from reply to request by itself: what one operation has made is read, changed and deleted by others."""
    wanted = settings.default.max_examples if WHOLE else SHARE // 4
    begun: list[int] = []
    asked: list[str] = []
    wrong: list[BaseException] = []

    class Machine(SCHEMA.as_state_machine()):  # type: ignore[misc] # made from the contract
        def setup(self) -> None:
            begun.append(len(asked))

        def before_call(self, case: Any) -> None:
            if len(asked) % 2 and case.operation.label in RIGHT:
                case.body, case.media_type = deepcopy(RIGHT[case.operation.label]), "application/json"

        def get_call_kwargs(self, case: Any) -> dict[str, Any]:
            return {
                "base_url": fuzzed.url,
                "headers": {"Authorization": f"Bearer {fuzzed.keys['admin']}"},
                "timeout": 120,
            }

        def validate_response(self, response: Any, case: Any, additional_checks: Any = (), **more: Any) -> None:
            asked.append(case.operation.label)
            try:
                case.validate_response(response, checks=CHECKS, headers=self.get_call_kwargs(case)["headers"])
            except BaseException as error:
                wrong.append(error)  # the story may be another one when it is told again
                raise

    while len(begun) < wanted:
        # a service remembers: what a story asks again is answered in another way, and Hypothesis gives up; another seed
        # begins other stories
        with suppress(FlakyStrategyDefinition):
            run_state_machine_as_test(
                seed(len(begun))(Machine),
                settings=settings(
                    max_examples=wanted - len(begun),
                    stateful_step_count=6,
                    deadline=None,
                    database=None,
                    phases=[Phase.generate],
                    suppress_health_check=list(HealthCheck),
                ),
            )
    assert not wrong
    assert len(set(asked)) > (40 if WHOLE else 2), asked
